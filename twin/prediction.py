"""Time update of the observer: the simulator's model through one tick, and how uncertainty goes with it.

In free flight the model is linear: its exact transition is built once and kept until the shaft's speed
has changed. Near the bearing the state goes through the simulator's own substeps, and the transition of
small deviations is built from the contact's slopes at the middle of the tick.
"""

from math import ceil, log2

import numpy as np

from simulator.candidates import SLIDING
from simulator.compile import kernel
from simulator.contact import PINNED, Contact, penetration
from simulator.dynamics import Tick, collide, contact_substeps, may_touch
from simulator.numeric import sine_cosine
from simulator.rig import Model
from simulator.state import Inputs, State
from twin.layout import (
    CLEARANCE,
    CONTACT_PARAMETERS,
    DAMPING,
    DYNAMIC,
    FRICTION,
    HOUSE_RATE,
    MAGNET_DAMPING,
    MAGNET_STIFFNESS,
    MOMENT,
    RESIDUAL,
    RING,
    SIZE,
    STIFFNESS,
    TILT,
    TILT_RATE,
    UNBALANCE,
    Memory,
    Tuning,
)
from twin.linear import carry, discretise
from twin.misfit import FREE, scale
from twin.parameters import adjusted, latch_adjusted
from twin.proximity import curvature_force, depth_doubt
from twin.slopes import (
    add_contact,
    add_parameters,
    contact_slopes,
    free_rates,
    house_mass,
    input_rates,
    parameter_slopes,
)
from twin.tracking import ACCELERATION, ANGLE, SPEED

SPEED_STEP = 0.05  # rad/s by which the speed may change before the transition of free flight is built anew
STIFFNESS_STEP = 1e-3  # likewise, of the relative change of K; what is left acts as a moment
DAMPING_STEP = 0.02  # likewise, of c
FREE_DOUBLINGS = 1  # halvings of the tick for the house's modes: 0.2 rad a half tick
NEAR = 2e-4  # m from the wall within which it is asked how well the distance is known
SURPRISING = 3.0  # times their expected variance, from which the innovations tell of an unforeseen contact
SURPRISE_REACH = 6e-5  # m from the wall within which they may
MARGIN = 3.0  # standard deviations of that distance within which the shaft may touch
CAUTION = 2.0  # times the force by which the contact's curvature may mislead the filter
SLIDES = 0.7  # of the friction of full sliding, below which the contact rolls and says nothing of friction
DAMPS = 0.01  # of the normal force, below which the damping's share says nothing of it


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
    memory.near[0], memory.near[1] = 0.0, gap(model, memory, before)
    memory.force[0] = 0.0
    if may_touch(model, tick, before, NEAR - memory.near[1]):
        close_to_wall(model, tick, memory, before, total_x, total_y)
    if memory.near[0] == 0.0:
        free_flow(model, memory, step)
        fly(model, memory, total_x, total_y)
        fill_transition(memory, memory.free_flow, pull_x, pull_y)
    else:
        fill_transition(memory, memory.flow, pull_x, pull_y)
    add_magnet(model, memory.transition, before)
    carry(memory.transition, memory.covariance, memory.half_work, memory.turned_work, memory.square_work)
    ageing = step / tuning.residual_time
    age_residual(memory, 1.0 - ageing if memory.near[0] > 0.0 else 0.0)
    spread(model, memory, tuning, step)
    if memory.near[0] > 0.0:
        curved = CAUTION * curvature_force(model, memory.candidates, -memory.near[1], memory.near[0])
        spread_contact(memory, 2.0 * ageing * curved * curved, tuning, step)


@kernel
def close_to_wall(
    model: Model,
    tick: Tick,
    memory: Memory,
    before: State,
    moment_x: float,
    moment_y: float,
) -> None:
    """Advance the state by a tick if the shaft may touch in it, with the parameters as estimated.

    Sets the tick's flow and, as a sign that it has acted, `memory.near[0]`: how well the distance is known.
    When the sensors tell what cannot be without a contact, the wall must be nearer, by about the gap.
    """
    now = adjusted(model, memory)
    depth = penetration(now, memory.candidates, before)
    if memory.surprise[0] > SURPRISING and 0.0 < -depth < SURPRISE_REACH:
        known = memory.covariance[CLEARANCE, CLEARANCE]
        memory.covariance[CLEARANCE, CLEARANCE] = max(known, depth * depth)
    doubt = min(depth_doubt(now, memory, before), NEAR)  # without sensors it would feed on itself
    if not may_touch(now, tick, before, depth + MARGIN * doubt):
        return
    memory.near[0], memory.near[1] = doubt, -depth
    after = through_contact(now, tick, memory, before, moment_x, moment_y)
    contact_flow(now, tick, memory, before, after)
    put(after, memory.state)
    add_residual(memory)


@kernel
def gap(model: Model, memory: Memory, state: State) -> float:
    """Return how far the wall is from the shaft (m), with the candidates as they were when last in use."""
    clearance = 0.0 if model.backup_bearing.kind == PINNED else memory.state[CLEARANCE]
    return clearance - penetration(model, memory.candidates, state)


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
    """Have the tick's flow be that of free flight, built anew when speed or magnetic bearing have changed."""
    at, speed, state = memory.free_at, memory.shaft[SPEED], memory.state
    holds = (
        abs(speed - at[0]) < SPEED_STEP
        and abs(state[MAGNET_STIFFNESS] - at[1]) < STIFFNESS_STEP
        and abs(state[MAGNET_DAMPING] - at[2]) < DAMPING_STEP
    )
    if not holds:
        at[0], at[1], at[2] = speed, state[MAGNET_STIFFNESS], state[MAGNET_DAMPING]
        free_rates(adjusted(model, memory), speed, memory.rates)
        input_rates(model, memory.free_inputs)
        discretise(memory.rates, memory.free_inputs, step, FREE_DOUBLINGS, memory.free_flow, memory.free_work)


@kernel
def fly(model: Model, memory: Memory, moment_x: float, moment_y: float) -> None:
    """Advance the dynamic states through free flight under a moment (N m).

    What the magnetic bearing has changed by since the flow was built acts as a moment too.
    """
    flow, state, work = memory.free_flow, memory.state, memory.vector_work
    magnet, arm = model.magnetic_bearing, model.rotor.magnet_station * model.rotor.magnet_station
    stiffness = arm * magnet.stiffness * (state[MAGNET_STIFFNESS] - memory.free_at[1])
    damping = arm * magnet.damping * (state[MAGNET_DAMPING] - memory.free_at[2])
    moment_x -= stiffness * state[TILT] + damping * state[TILT_RATE]
    moment_y -= stiffness * state[TILT + 1] + damping * state[TILT_RATE + 1]
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
        latch_adjusted(model, memory, state)
        state = collide(model, memory.candidates, inputs, inputs, inputs, tick.length / count, state)
    return state


@kernel
def contact_flow(model: Model, tick: Tick, memory: Memory, before: State, after: State) -> None:
    """Set the tick's flow from the contact's slopes at the middle between two states."""
    middle = halfway(before, after)
    here = contact_slopes(model, memory.candidates, middle, memory.slopes)
    parameter_slopes(model, memory.candidates, middle, here, memory.slopes, memory.varied_work)
    memory.force[0] = here.normal
    freeze(model, memory, here)
    free_rates(model, memory.shaft[SPEED], memory.rates)
    input_rates(model, memory.inputs)
    add_contact(model, memory.slopes, memory.rates)
    add_parameters(model, memory.slopes, memory.inputs)
    count = contact_substeps(model, tick, memory.candidates, middle)
    doublings = ceil(log2(float(count))) + 1
    discretise(memory.rates, memory.inputs, tick.length, doublings, memory.flow, memory.flow_work)


@kernel
def freeze(model: Model, memory: Memory, here: Contact) -> None:
    """Leave out of the slopes what the contact `here` says next to nothing of, and note what it tells.

    Friction in rolling contact, damping on a soft orbit: a filter that is fed with what is barely
    observable lets it wander.
    """
    tangential = abs(here.shaft_torque) / model.rotor.shaft_radius
    slides = tangential > SLIDES * memory.candidates[0, SLIDING] * here.normal
    damped = abs(memory.slopes[2, 6]) + abs(memory.slopes[3, 6]) > DAMPS * here.normal
    memory.tells[0] = 1.0 if damped else 0.0
    memory.tells[1] = 1.0 if slides else 0.0
    for row in range(5):
        memory.slopes[row, 6] *= memory.tells[0]
        memory.slopes[row, 7] *= memory.tells[1]


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
def fill_transition(memory: Memory, flow: np.ndarray, pull_x: float, pull_y: float) -> None:
    """Set the transition of small deviations from the tick's flow, but for the magnetic bearing's columns.

    Out of contact neither residual force nor contact parameters act.
    """
    transition = memory.transition
    touching = memory.near[0] > 0.0
    for i in range(DYNAMIC):
        for j in range(DYNAMIC):
            transition[i, j] = flow[i, j]
        to_x, to_y = flow[i, DYNAMIC], flow[i, DYNAMIC + 1]
        transition[i, UNBALANCE] = to_x * pull_x + to_y * pull_y
        transition[i, UNBALANCE + 1] = to_y * pull_x - to_x * pull_y
        transition[i, MOMENT] = to_x
        transition[i, MOMENT + 1] = to_y
        for j in range(2 + CONTACT_PARAMETERS):
            transition[i, RESIDUAL + j] = flow[i, DYNAMIC + 2 + j] if touching else 0.0


@kernel
def add_magnet(model: Model, transition: np.ndarray, state: State) -> None:
    """Set the columns of K and c in the `transition` (DYNAMIC, SIZE): each makes a moment.

    `model` is the described one, to which their changes are relative.
    """
    arm = model.rotor.magnet_station * model.rotor.magnet_station
    stiffness, damping = arm * model.magnetic_bearing.stiffness, arm * model.magnetic_bearing.damping
    for i in range(DYNAMIC):
        to_x, to_y = transition[i, MOMENT], transition[i, MOMENT + 1]
        transition[i, MAGNET_STIFFNESS] = -stiffness * (to_x * state.tilt_x + to_y * state.tilt_y)
        transition[i, MAGNET_DAMPING] = -damping * (to_x * state.tilt_rate_x + to_y * state.tilt_rate_y)


@kernel
def age_residual(memory: Memory, kept: float) -> None:
    """Keep a share of the residual force, and of what is known of it; none out of contact."""
    memory.misfit[FREE] *= kept * kept
    for i in range(RESIDUAL, RESIDUAL + 2):
        memory.state[i] *= kept
        for j in range(SIZE):
            memory.covariance[i, j] *= kept
        for j in range(SIZE):
            memory.covariance[j, i] *= kept


@kernel
def spread(model: Model, memory: Memory, tuning: Tuning, step: float) -> None:
    """Add a tick's process noise to the covariance."""
    covariance = memory.covariance
    for axis in range(2):
        rate, house = TILT_RATE + axis, HOUSE_RATE + axis
        covariance[rate, rate] += (tuning.moment_noise / model.rotor.inertia) ** 2 * step
        covariance[house, house] += (tuning.house_noise / house_mass(model, axis)) ** 2 * step
        covariance[UNBALANCE + axis, UNBALANCE + axis] += tuning.unbalance_walk**2 * step
        covariance[MOMENT + axis, MOMENT + axis] += tuning.moment_walk**2 * step
    covariance[RING, RING] += tuning.ring_noise**2 * step
    if tuning.magnet_stiffness_doubt > 0.0:
        covariance[MAGNET_STIFFNESS, MAGNET_STIFFNESS] += tuning.magnet_stiffness_walk**2 * step
    if tuning.magnet_damping_doubt > 0.0:
        covariance[MAGNET_DAMPING, MAGNET_DAMPING] += tuning.magnet_damping_walk**2 * step


@kernel
def spread_contact(memory: Memory, curved: float, tuning: Tuning, step: float) -> None:
    """Add a tick's process noise of the residual force and of the contact's parameters that it tells of.

    `curved` (N2) is added to the residual force's: see `curvature_force`.
    """
    covariance, normal = memory.covariance, memory.force[0]
    change = (tuning.residual_share * normal) ** 2 + tuning.residual_noise**2
    added = scale(memory) * change * step + curved
    memory.misfit[FREE] += added
    for i in range(RESIDUAL, RESIDUAL + 2):
        covariance[i, i] += added
    if normal > 0.0:
        walk = tuning.contact_walk**2 * step
        covariance[STIFFNESS, STIFFNESS] += walk
        covariance[DAMPING, DAMPING] += walk * memory.tells[0]
        covariance[FRICTION, FRICTION] += walk * memory.tells[1]
        covariance[CLEARANCE, CLEARANCE] += tuning.clearance_walk**2 * step
