"""Time update of the observer: the simulator's model through one tick, and how uncertainty goes with it.

In free flight the model is linear: its exact transition is built once and kept until the shaft's speed
has changed. Near the bearing the state goes through the simulator's own substeps, and the transition of
small deviations is built from the contact's slopes at the middle of the tick.
"""

from math import ceil, log2

import numpy as np

from simulator.compile import kernel
from simulator.contact import latch, penetration
from simulator.dynamics import Tick, collide, contact_substeps, may_touch
from simulator.numeric import sine_cosine
from simulator.rig import Model
from simulator.state import Inputs, State
from twin.layout import (
    DYNAMIC,
    HOUSE_RATE,
    MOMENT,
    RESIDUAL,
    RING,
    SIZE,
    TILT_RATE,
    UNBALANCE,
    Memory,
    Tuning,
)
from twin.linear import congruence, copy, discretise
from twin.slopes import add_contact, contact_slopes, free_rates, house_mass, input_rates
from twin.tracking import ACCELERATION, ANGLE, SPEED

SPEED_STEP = 0.05  # rad/s by which the speed may change before the transition of free flight is built anew
FREE_DOUBLINGS = 1  # halvings of the tick for the house's modes: 0.2 rad a half tick


@kernel
def predict(
    model: Model, tick: Tick, memory: Memory, tuning: Tuning, moment_x: float, moment_y: float
) -> None:
    """Advance state and covariance in `memory` by one tick.

    `model` is the bare rotor: without weight, coupling and unbalance, which are states here. `moment_x`,
    `moment_y` (N m) are the solenoids' over the tick. The shaft's angle, speed and acceleration are
    those of the encoder's loop at the tick's start.
    """
    step = tick.length
    pull_x, pull_y = unbalance_pull(model, memory.shaft, step)
    total_x, total_y = total_moment(memory.state, pull_x, pull_y)
    total_x += moment_x
    total_y += moment_y
    before = state_of(memory.state, memory.shaft)
    if may_touch(model, tick, before, penetration(model, memory.candidates, before)):
        after = through_contact(model, tick, memory, before, total_x, total_y)
        contact_flow(model, tick, memory, before, after)
        put(after, memory.state)
        add_residual(memory)
    else:
        free_flow(model, memory, step)
        fly(memory, total_x, total_y)
    fill_transition(memory, 1.0 - step / tuning.residual_time, pull_x, pull_y)
    congruence(memory.transition, memory.covariance, memory.square_work)
    spread(model, memory, tuning, step)


@kernel
def unbalance_pull(model: Model, shaft: np.ndarray, step: float) -> tuple[float, float]:
    """Return the moment (x, y) per unit of unbalance along the encoder's zero (N m per kg m), mid-tick.

    It is station (Omega^2 - i alpha) exp(i theta); an unbalance across the zero gives it turned by a
    quarter turn.
    """
    sine, cosine = sine_cosine(
        shaft[ANGLE] + (0.5 * shaft[SPEED] + 0.125 * shaft[ACCELERATION] * step) * step
    )
    speed = shaft[SPEED] + 0.5 * shaft[ACCELERATION] * step
    radial = model.rotor.disk_station * speed * speed
    tangential = model.rotor.disk_station * shaft[ACCELERATION]
    return radial * cosine + tangential * sine, radial * sine - tangential * cosine


@kernel
def total_moment(state: np.ndarray, pull_x: float, pull_y: float) -> tuple[float, float]:
    """Return the estimated moment (x, y) of unbalance, weight and coupling, N m."""
    along, across = state[UNBALANCE], state[UNBALANCE + 1]
    return pull_x * along - pull_y * across + state[MOMENT], pull_y * along + pull_x * across + state[
        MOMENT + 1
    ]


@kernel
def state_of(vector: np.ndarray, shaft: np.ndarray) -> State:
    """Return the simulator's state with the observer's values in it."""
    return State(
        vector[0],
        vector[1],
        vector[2],
        vector[3],
        vector[4],
        vector[5],
        vector[6],
        vector[7],
        vector[8],
        shaft[ANGLE],
        shaft[SPEED],
        0.0,
    )


@kernel
def put(state: State, vector: np.ndarray) -> None:
    """Write the dynamic states back into the observer's vector."""
    vector[0] = state.tilt_x
    vector[1] = state.tilt_y
    vector[2] = state.tilt_rate_x
    vector[3] = state.tilt_rate_y
    vector[4] = state.house_x
    vector[5] = state.house_y
    vector[6] = state.house_rate_x
    vector[7] = state.house_rate_y
    vector[8] = state.ring_speed


@kernel
def free_flow(model: Model, memory: Memory, step: float) -> None:
    """Set the tick's flow to that of free flight, built anew when the speed has changed."""
    speed = memory.shaft[SPEED]
    if not abs(speed - memory.free_speed[0]) < SPEED_STEP:
        memory.free_speed[0] = speed
        free_rates(model, speed, memory.rates)
        input_rates(model, memory.inputs)
        discretise(memory.rates, memory.inputs, step, FREE_DOUBLINGS, memory.free_flow, memory.flow_work)
    copy(memory.free_flow, memory.flow)
    memory.force[0] = 0.0


@kernel
def fly(memory: Memory, moment_x: float, moment_y: float) -> None:
    """Advance the dynamic states through free flight under a moment (N m)."""
    flow, state, work = memory.flow, memory.state, memory.vector_work
    for i in range(DYNAMIC):
        work[i] = flow[i, DYNAMIC] * moment_x + flow[i, DYNAMIC + 1] * moment_y
        for j in range(DYNAMIC):
            work[i] += flow[i, j] * state[j]
    for i in range(DYNAMIC):
        state[i] = work[i]


@kernel
def through_contact(
    model: Model, tick: Tick, memory: Memory, state: State, moment_x: float, moment_y: float
) -> State:
    """Return the state after a tick of the simulator's model under a moment (N m), contact included."""
    inputs = Inputs(0.0, memory.shaft[ACCELERATION], moment_x, moment_y)
    count = contact_substeps(model, tick, memory.candidates, state)
    for _ in range(count):
        latch(model, state, memory.candidates)
        state = collide(model, memory.candidates, inputs, inputs, inputs, tick.length / count, state)
    return state


@kernel
def contact_flow(model: Model, tick: Tick, memory: Memory, before: State, after: State) -> None:
    """Set the tick's flow from the contact's slopes at the middle between two states."""
    middle = halfway(before, after)
    here = contact_slopes(model, memory.candidates, middle, memory.slopes)
    memory.force[0] = here.normal
    free_rates(model, memory.shaft[SPEED], memory.rates)
    input_rates(model, memory.inputs)
    add_contact(model, memory.slopes, memory.rates)
    count = contact_substeps(model, tick, memory.candidates, middle)
    doublings = ceil(log2(float(count))) + 1
    discretise(memory.rates, memory.inputs, tick.length, doublings, memory.flow, memory.flow_work)


@kernel
def halfway(a: State, b: State) -> State:
    """Return the mean of two states."""
    return State(
        0.5 * (a.tilt_x + b.tilt_x),
        0.5 * (a.tilt_y + b.tilt_y),
        0.5 * (a.tilt_rate_x + b.tilt_rate_x),
        0.5 * (a.tilt_rate_y + b.tilt_rate_y),
        0.5 * (a.house_x + b.house_x),
        0.5 * (a.house_y + b.house_y),
        0.5 * (a.house_rate_x + b.house_rate_x),
        0.5 * (a.house_rate_y + b.house_rate_y),
        0.5 * (a.ring_speed + b.ring_speed),
        0.5 * (a.angle + b.angle),
        0.5 * (a.speed + b.speed),
        0.0,
    )


@kernel
def add_residual(memory: Memory) -> None:
    """Let the residual contact force act on rotor and house through the tick."""
    for i in range(DYNAMIC):
        memory.state[i] += (
            memory.flow[i, DYNAMIC + 2] * memory.state[RESIDUAL]
            + memory.flow[i, DYNAMIC + 3] * memory.state[RESIDUAL + 1]
        )


@kernel
def fill_transition(memory: Memory, ageing: float, pull_x: float, pull_y: float) -> None:
    """Set the transition of small deviations of the whole state from the tick's flow, and age the residual.

    In contact `ageing` of the residual force is left after the tick; out of contact there is none.
    """
    transition, flow = memory.transition, memory.flow
    kept = ageing if memory.force[0] > 0.0 else 0.0
    for i in range(DYNAMIC):
        for j in range(DYNAMIC):
            transition[i, j] = flow[i, j]
        to_x, to_y = flow[i, DYNAMIC], flow[i, DYNAMIC + 1]
        transition[i, UNBALANCE] = to_x * pull_x + to_y * pull_y
        transition[i, UNBALANCE + 1] = to_y * pull_x - to_x * pull_y
        transition[i, MOMENT] = to_x
        transition[i, MOMENT + 1] = to_y
        transition[i, RESIDUAL] = flow[i, DYNAMIC + 2]
        transition[i, RESIDUAL + 1] = flow[i, DYNAMIC + 3]
    for i in range(DYNAMIC, SIZE):
        transition[i, i] = 1.0
    for i in range(RESIDUAL, RESIDUAL + 2):
        transition[i, i] = kept
        memory.state[i] *= kept


@kernel
def spread(model: Model, memory: Memory, tuning: Tuning, step: float) -> None:
    """Add a tick's process noise to the covariance."""
    covariance, normal = memory.covariance, memory.force[0]
    for axis in range(2):
        rate, house = TILT_RATE + axis, HOUSE_RATE + axis
        covariance[rate, rate] += (tuning.moment_noise / model.rotor.inertia) ** 2 * step
        covariance[house, house] += (tuning.house_noise / house_mass(model, axis)) ** 2 * step
        covariance[UNBALANCE + axis, UNBALANCE + axis] += tuning.unbalance_walk**2 * step
        covariance[MOMENT + axis, MOMENT + axis] += tuning.moment_walk**2 * step
        if normal > 0.0:
            residual = RESIDUAL + axis
            change = (tuning.residual_share * normal) ** 2 + tuning.residual_noise**2
            covariance[residual, residual] += change * step
    covariance[RING, RING] += tuning.ring_noise**2 * step
