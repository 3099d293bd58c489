"""Free flight by an exact map for each tick, many ticks at once, while the shaft is away from the bearing.

Without contact and solenoids the shaft's speed depends on the drive alone, and everything else is linear.
A tick's map of the rotor is a short polynomial of the tick's mean speed; `simulator.flight_map` works the
coefficients out, once for a model. So the drive is taken through some ticks first, then their maps and
loads are worked out side by side, then the rotor goes through them; where the speed stays, a table has
the maps and loads of a whole block.

A block begins where the flight does or where the block before ends. One that is longer than what is asked for
is computed in spare memory, where the next call finds the rest of it: it does not matter how samples are
divided among calls.
"""

import numpy as np

from simulator.compile import inlined, kernel
from simulator.contact import relative_motion
from simulator.drive import set_point
from simulator.dynamics import Tick
from simulator.flight_block import (
    ANGLE,
    BLOCK,
    CLEAR,
    FIRST,
    INTEGRAL,
    SPEED,
    WANTED,
    Flight,
    put_loads,
    put_rest,
    settle_on,
    swing,
    turn,
)
from simulator.flight_table import look_up
from simulator.rig import Model
from simulator.state import State


@inlined
def quiet(pulses: np.ndarray, sample: int, tick: float) -> bool:
    """Tell whether no solenoid acts from a sample on."""
    active = 0
    for index in range(pulses.shape[0]):
        active += (sample - pulses[index, 0]) * tick < pulses[index, 1]
    return active == 0


@inlined
def clear(model: Model, tick: Tick, flight: Flight, state: State) -> bool:
    """Tell whether the shaft is well away from the bearing through a tick, and its speed not too high."""
    x, y, rate_x, rate_y = relative_motion(model, state)
    room = max(flight.room - (abs(rate_x) + abs(rate_y)) * tick.length, 0.0)
    return x * x + y * y < room * room and abs(state.speed) < flight.fastest


@kernel
def glide(
    model: Model,
    tick: Tick,
    flight: Flight,
    ramp: np.ndarray,
    sample: int,
    state: State,
    truth: np.ndarray,
    column: int,
    end: int,
) -> tuple[int, State]:
    """Fill `truth` (17, n) from `column` towards `end` for as long as the shaft is clear of the bearing.

    `state` is that of `sample`, at `column`, where it is clear. Return the first column that is not filled,
    and its state.
    """
    while column < end and clear(model, tick, flight, state):
        flown = ticks_flown(tick, flight, ramp, sample, state)
        whole = flown == 0 and end - column >= BLOCK
        out, at = (truth, column) if whole else (flight.spare, 0)
        if flown == 0:
            fly_block(model, tick, flight, ramp, sample, state, out, at)
            flight.work[FIRST] = sample
            flight.work[CLEAR] = clear_columns(model, tick, flight, out, at)
        done = min(int(flight.work[CLEAR]) - flown, end - column)
        if not whole:
            for row in range(truth.shape[0]):
                for k in range(done):
                    truth[row, column + k] = out[row, flown + k]
        state = state_at(flight, out, at, flown + done)
        column += done
        sample += done
    return column, state


@inlined
def ticks_flown(tick: Tick, flight: Flight, ramp: np.ndarray, sample: int, state: State) -> int:
    """Return how many ticks before a sample the block in spare memory begins; 0 if it does not go on there.

    It does if a call ended within it and neither the state nor the set-points were changed since.
    """
    flown = sample - int(flight.work[FIRST])
    if flown <= 0 or flown >= int(flight.work[CLEAR]):
        return 0
    changes = 0
    for now, then in zip(state, state_at(flight, flight.spare, 0, flown)):  # noqa: B905 - numba has no strict
        changes += now != then
    for k in range(BLOCK + 1 - flown):
        changes += set_point(ramp, sample + k, tick.length) != flight.work[WANTED + flown + k]
    return flown if changes == 0 else 0


@inlined
def fly_block(
    model: Model,
    tick: Tick,
    flight: Flight,
    ramp: np.ndarray,
    sample: int,
    state: State,
    truth: np.ndarray,
    column: int,
) -> None:
    """Move everything on; fill `BLOCK` columns of `truth`, and the spare memory's last with what is after."""
    if turn(model.drive, tick, flight, ramp, sample, state):
        look_up(tick, flight, state, truth, column)
    else:
        put_loads(tick, flight)
        swing(flight, state, truth, column)
    settle_on(tick, flight, state, truth, column)
    put_rest(flight, truth, column)


@inlined
def clear_columns(model: Model, tick: Tick, flight: Flight, truth: np.ndarray, column: int) -> int:
    """Return how many of a block's columns come before the first that is not clear; the first of all is."""
    station = model.rotor.bearing_station
    ux, uy = truth[0, column : column + BLOCK], truth[1, column : column + BLOCK]
    vx, vy = truth[2, column : column + BLOCK], truth[3, column : column + BLOCK]
    hx, hy = truth[4, column : column + BLOCK], truth[5, column : column + BLOCK]
    wx, wy = truth[6, column : column + BLOCK], truth[7, column : column + BLOCK]
    near = 0
    for k in range(1, BLOCK):
        x, y = station * ux[k] - hx[k], station * uy[k] - hy[k]
        rate_x, rate_y = station * vx[k] - wx[k], station * vy[k] - wy[k]
        room = max(flight.room - (abs(rate_x) + abs(rate_y)) * tick.length, 0.0)
        near += not (x * x + y * y < room * room)
    for k in range(1, BLOCK):
        near += not (abs(flight.work[SPEED + k]) < flight.fastest)
    if near == 0:
        return BLOCK
    for k in range(1, BLOCK):
        if not clear(model, tick, flight, state_at(flight, truth, column, k)):
            return k
    return BLOCK


@inlined
def state_at(flight: Flight, truth: np.ndarray, column: int, k: int) -> State:
    """Return the state before tick k of the block that begins at `column` of `truth` (17, n), or after it."""
    if k == BLOCK:
        truth, column = flight.spare, 0
    at = column + k
    return State(
        truth[0, at],
        truth[1, at],
        truth[2, at],
        truth[3, at],
        truth[4, at],
        truth[5, at],
        truth[6, at],
        truth[7, at],
        truth[8, at],
        flight.work[ANGLE + k],
        flight.work[SPEED + k],
        flight.work[INTEGRAL + k],
    )
