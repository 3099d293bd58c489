"""The loop over samples: record the truth, then step the state to the next sample. Nothing is allocated."""

from typing import Any

import numpy as np

from simulator.candidates import for_kernels
from simulator.compile import inlined, kernel
from simulator.contact import Contact, beyond_pins, contact_force, latch
from simulator.drive import IDEAL, motor_torque, next_integral, set_point
from simulator.dynamics import Tick, collide_from, contact_substeps, flight_substeps, fly, may_touch, settle
from simulator.flight import clear, glide, quiet
from simulator.flight_block import Flight
from simulator.rig import BackupBearing, Drive, Housing, MagneticBearing, Model, Rotor
from simulator.solenoid import pulse_in_tick, solenoid_force, solenoid_moment
from simulator.state import Inputs, State

PULSE_SUBSTEPS = 4  # of a tick during a pulse, at least
LARGEST_TILT = 1.0  # rad: beyond it the small-angle equations mean nothing


def numbers_of(model: Model, tick: Tick, flight: Flight) -> Any:
    """Return a rig's constants for `run`, as tuples without names: they are passed six times as fast."""
    return tuple(tuple(part) for part in for_kernels(model)), tuple(tick), tuple(flight)


@inlined
def named(numbers: Any) -> tuple[Model, Tick, Flight]:
    """Return a rig's constants with their names."""
    (rotor, magnet, bearing, housing, drive), tick, flight = numbers
    model = Model(
        Rotor(*rotor), MagneticBearing(*magnet), BackupBearing(*bearing), Housing(*housing), Drive(*drive)
    )
    return model, Tick(*tick), Flight(*flight)


@kernel
def run(
    numbers: Any,
    ramp: np.ndarray,
    pulses: np.ndarray,
    sample: int,
    values: np.ndarray,
    candidates: np.ndarray,
    truth: np.ndarray,
    begin: int,
    end: int,
) -> tuple[int, bool]:
    """Fill the columns `begin` to `end` of `truth` (17, n), the first being `sample`, and step as often.

    Return how many ticks were good, and whether the shaft was behind the pins. `numbers` are `numbers_of`.
    `values` (12,) and `candidates` (8, 6) hold the state and are brought up to date. A count below
    the columns' means that the state after that many ticks is no number any more, or out of all proportion.
    """
    model, tick, flight = named(numbers)
    state = unpacked(values)
    lost = False
    sample -= begin
    column = begin
    while column < end:
        free = clear(model, tick, flight, state) and quiet(pulses, sample + column, tick.length)
        if free and sound(state):
            column, state = glide(model, tick, flight, ramp, sample + column, state, truth, column, end)
            continue
        force = contact_force(model, candidates, state)
        touching = may_touch(model, tick, state, force.penetration)
        record(tick, ramp, pulses, sample + column, state, force, truth, column)
        state = step(model, tick, ramp, pulses, sample + column, candidates, touching, force, state)
        column += 1
        lost = lost or beyond_pins(model, state)
        if not sound(state):
            pack(state, values)
            return column - begin - 1, lost
    pack(state, values)
    return end - begin, lost


@inlined
def step(
    model: Model,
    tick: Tick,
    ramp: np.ndarray,
    pulses: np.ndarray,
    sample: int,
    candidates: np.ndarray,
    touching: bool,
    force: Contact,
    state: State,
) -> State:
    """Return the state at the next sample."""
    wanted = set_point(ramp, sample, tick.length)
    next_wanted = set_point(ramp, sample + 1, tick.length)
    error = wanted - state.speed
    torque = motor_torque(model.drive, error, state.speed_error_integral)
    held = Inputs(torque, (next_wanted - wanted) / tick.length, 0.0, 0.0)
    integral = next_integral(model.drive, error, state.speed_error_integral, tick.length)
    state = through_tick(model, tick, held, pulses, sample, candidates, touching, force, state)
    speed = next_wanted if model.drive.mode == IDEAL else state.speed
    return with_drive(state, speed, integral)


@inlined
def through_tick(
    model: Model,
    tick: Tick,
    held: Inputs,
    pulses: np.ndarray,
    sample: int,
    candidates: np.ndarray,
    touching: bool,
    force: Contact,
    state: State,
) -> State:
    """Return the state after a tick under held torque or acceleration, in as many substeps as it takes."""
    pulsed = pulse_in_tick(pulses, sample, tick.length)
    if touching:
        count = contact_substeps(model, tick, candidates, state)
    else:
        count = flight_substeps(tick, state.speed)
    if pulsed:
        count = max(count, PULSE_SUBSTEPS)
    duration = tick.length / count
    for index in range(count):
        first, middle, last = held, held, held
        if pulsed:
            first = with_pulses(held, pulses, sample, index * duration, tick.length)
            middle = with_pulses(held, pulses, sample, (index + 0.5) * duration, tick.length)
            last = with_pulses(held, pulses, sample, (index + 1.0) * duration, tick.length)
        if touching:
            latch(model, state, candidates)
            if index > 0:
                force = contact_force(model, candidates, state)
            state = collide_from(force, model, candidates, first, middle, last, duration, state)
        else:
            state = fly(model, first, middle, last, duration, state)
    return state if touching else settle(tick, state)


@inlined
def with_pulses(held: Inputs, pulses: np.ndarray, sample: int, offset: float, tick: float) -> Inputs:
    """Return the inputs with the solenoids' moments `offset` seconds after a sample."""
    moment_x, moment_y = solenoid_moment(pulses, sample, offset, tick)
    return Inputs(held.torque, held.acceleration, moment_x, moment_y)


@inlined
def with_drive(state: State, speed: float, integral: float) -> State:
    """Return the state with another speed (rad/s) and another integral of the speed error (rad)."""
    return State(
        state.tilt_x,
        state.tilt_y,
        state.tilt_rate_x,
        state.tilt_rate_y,
        state.house_x,
        state.house_y,
        state.house_rate_x,
        state.house_rate_y,
        state.ring_speed,
        state.angle,
        speed,
        integral,
    )


@inlined
def record(
    tick: Tick,
    ramp: np.ndarray,
    pulses: np.ndarray,
    sample: int,
    state: State,
    force: Contact,
    truth: np.ndarray,
    column: int,
) -> None:
    """Write one column of true signals; the rows are `simulator.simulation.SIGNALS`."""
    truth[0, column] = state.tilt_x
    truth[1, column] = state.tilt_y
    truth[2, column] = state.tilt_rate_x
    truth[3, column] = state.tilt_rate_y
    truth[4, column] = state.house_x
    truth[5, column] = state.house_y
    truth[6, column] = state.house_rate_x
    truth[7, column] = state.house_rate_y
    truth[8, column] = state.ring_speed
    truth[9, column] = state.angle
    truth[10, column] = state.speed
    truth[11, column] = force.force_x
    truth[12, column] = force.force_y
    truth[13, column] = force.normal
    truth[14, column] = max(force.penetration, 0.0)
    truth[15, column] = set_point(ramp, sample, tick.length)
    truth[16, column] = solenoid_force(pulses, sample, tick.length)


@inlined
def sound(state: State) -> bool:
    """Tell whether every field is a finite number and the tilt is in proportion."""
    total = 0.0
    for value in state:
        total += value
    return total - total == 0.0 and abs(state.tilt_x) + abs(state.tilt_y) < LARGEST_TILT


@inlined
def unpacked(values: np.ndarray) -> State:
    """Return the state held in an array (12,)."""
    return State(
        values[0],
        values[1],
        values[2],
        values[3],
        values[4],
        values[5],
        values[6],
        values[7],
        values[8],
        values[9],
        values[10],
        values[11],
    )


@inlined
def pack(state: State, values: np.ndarray) -> None:
    """Write a state into an array (12,)."""
    for index, value in enumerate(state):
        values[index] = value
