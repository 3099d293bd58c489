"""Free flight by an exact map for each tick, many ticks at once, while the shaft is away from the bearing.

Without contact and solenoids the shaft's speed depends on the drive alone, and everything else is linear.
A tick's map of the rotor is a short polynomial of the tick's mean speed; `simulator.flight_map` works the
coefficients out, once for a model. So the drive is taken through some ticks first, then their maps and
loads are worked out side by side, then the rotor goes through them. Nothing is carried from tick to tick
but the state: it does not matter how samples are divided among calls.
"""

import numpy as np

from simulator.compile import inlined, kernel
from simulator.contact import relative_motion
from simulator.dynamics import Tick
from simulator.flight_block import ANGLE, BLOCK, INTEGRAL, SPEED, Flight, move, put_loads, turn
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
        whole = end - column >= BLOCK
        out, at = (truth, column) if whole else (flight.spare, 0)
        steady = turn(model.drive, tick, flight, ramp, sample, state)
        put_loads(tick, flight, steady)
        last = move(tick, flight, steady, state, out, at)
        done = min(clear_columns(model, tick, flight, out, at), end - column)
        if not whole:
            for row in range(truth.shape[0]):
                for k in range(done):
                    truth[row, column + k] = out[row, k]
        state = last if done == BLOCK else state_at(flight, out, at, done)
        column += done
        sample += done
    return column, state


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
    """Return the state before a block's tick k; the block begins at `column` of `truth` (17, n)."""
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
