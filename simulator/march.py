"""A rig's outcomes without its signals: the loop over samples for a processor with many small threads.

It steps by the kernels that `simulator.stepping` uses and allocates nothing, so that it compiles for a GPU
as it does for a CPU. Where `Simulation` computes a flight at once it goes tick by tick, and nothing hits.
"""

import numpy as np

from simulator.compile import kernel
from simulator.contact import contact_force, latch, penetration
from simulator.drive import IDEAL, motor_torque, next_integral, set_point
from simulator.dynamics import Tick, collide, contact_substeps, flight_substeps, fly, may_touch, settle
from simulator.rig import Model
from simulator.state import Inputs, State
from simulator.stepping import pack, sound, unpacked, with_drive

LARGEST_RADIUS, LARGEST_FORCE, IN_CONTACT, LAST_CONTACT, DIVERGED = range(5)
OUTCOMES = 5


@kernel
def march(
    model: Model,
    tick: Tick,
    ramp: np.ndarray,
    first: int,
    begin: int,
    count: int,
    watched: int,
    values: np.ndarray,
    candidates: np.ndarray,
    found: np.ndarray,
) -> None:
    """Step one rig from sample `begin` of a leg, which began at sample `first` of the run, `count` ticks on.

    `values` (12,) and `candidates` (8, 6) hold the state; `found` (5,) the leg's outcomes from its sample
    `watched` on: largest radius (m) and normal force (N), samples in contact, the number of samples up to the
    last one in contact, and whether the rig diverged, after which it stays as it is. All are brought up to
    date.
    """
    if found[DIVERGED] > 0.0:
        return
    state, station = unpacked(values), model.rotor.bearing_station
    for sample in range(begin, begin + count):
        depth = penetration(model, candidates, state)
        if sample >= watched:
            x, y = station * state.tilt_x, station * state.tilt_y
            found[LARGEST_RADIUS] = max(found[LARGEST_RADIUS], (x * x + y * y) ** 0.5)
            if depth > 0.0:
                note(contact_force(model, candidates, state).normal, sample, found)
        state = stepped(model, tick, ramp, first + sample, candidates, depth, state)
        if not sound(state):
            found[DIVERGED] = 1.0
            return
    pack(state, values)


@kernel
def note(normal: float, sample: int, found: np.ndarray) -> None:
    """Bring the outcomes (5,) up to date by a normal force (N) at a sample."""
    if normal > 0.0:
        found[LARGEST_FORCE] = max(found[LARGEST_FORCE], normal)
        found[IN_CONTACT] += 1.0
        found[LAST_CONTACT] = sample + 1.0


@kernel
def stepped(
    model: Model,
    tick: Tick,
    ramp: np.ndarray,
    sample: int,
    candidates: np.ndarray,
    depth: float,
    state: State,
) -> State:
    """Return the state at the next sample; `depth` is the penetration now, m."""
    wanted = set_point(ramp, sample, tick.length)
    next_wanted = set_point(ramp, sample + 1, tick.length)
    error = wanted - state.speed
    torque = motor_torque(model.drive, error, state.speed_error_integral)
    held = Inputs(torque, (next_wanted - wanted) / tick.length, 0.0, 0.0)
    integral = next_integral(model.drive, error, state.speed_error_integral, tick.length)
    if may_touch(model, tick, state, depth):
        count = contact_substeps(model, tick, candidates, state)
        for _ in range(count):
            latch(model, state, candidates)
            state = collide(model, candidates, held, held, held, tick.length / count, state)
    else:
        count = flight_substeps(tick, state.speed)
        for _ in range(count):
            state = fly(model, held, held, held, tick.length / count, state)
        state = settle(tick, state)
    speed = next_wanted if model.drive.mode == IDEAL else state.speed
    return with_drive(state, speed, integral)
