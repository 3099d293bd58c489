"""Free flight by an exact map for each tick, many ticks at once, while the shaft is away from the bearing.

Without contact and solenoids the shaft's speed depends on the drive alone, and everything else is linear.
A tick's map of the rotor is a short polynomial of the tick's mean speed; `simulator.flight_map` works the
coefficients out, once for a model. So the drive is taken through some ticks first, then their maps and
loads are worked out side by side, then the rotor goes through them. Nothing is carried from tick to tick
but the state: it does not matter how samples are divided among calls.
"""

from math import sqrt
from typing import NamedTuple

import numpy as np

from simulator.compile import inlined, kernel
from simulator.contact import relative_motion
from simulator.drive import IDEAL, motor_torque, next_integral, set_point
from simulator.dynamics import Tick, settle
from simulator.numeric import sine_cosine
from simulator.rig import Drive, Model
from simulator.state import State

BLOCK = 64  # ticks that are worked out at once, so that processors do several of them in one instruction
ROW = BLOCK + 8  # of the working memory
WANTED, SPEED, ANGLE, INTEGRAL, SINE, COSINE = 0, ROW, 2 * ROW, 3 * ROW, 4 * ROW, 5 * ROW
TILT_LOAD, RATE_LOAD, MAP, WORK = 6 * ROW, 8 * ROW, 10 * ROW, 18 * ROW

# Coefficients of 1, p, p^2, p^3, where p = i Omega.
Polynomial = tuple[float, float, float, float]


class Flight(NamedTuple):
    """A tick of free flight; made by `simulator.flight_map.flight_of`."""

    tilt_of_tilt: Polynomial  # what the complex tilt gets of itself,
    tilt_of_rate: Polynomial  # s, of its rate,
    tilt_of_unbalance: Polynomial  # 1/(N m), of the unbalance's moment at the tick's begin, which turns on,
    tilt_of_weight: Polynomial  # and of the moment of weight and coupling
    rate_of_tilt: Polynomial  # 1/s, what its rate gets
    rate_of_rate: Polynomial
    rate_of_unbalance: Polynomial  # 1/(N m s)
    rate_of_weight: Polynomial
    unbalance: float  # kg m^2, the unbalance's moment for each (rad/s)^2
    unbalance_angle: float  # rad
    late_load: float  # s^2, what the tilt lacks, for each (rad/s)^2, because the load grows with the speed
    shaft_response: float  # (rad/s)/(N m), what a torque adds to the shaft's speed in a tick
    rate: float  # 1/s, ticks a second
    fastest: float  # rad/s: below it the polynomials are exact to 1e-9 of what a tick changes
    room: float  # m, within which the shaft's centre touches nothing
    work: np.ndarray  # (WORK,) working memory


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
        count = min(end - column, horizon(model, tick, flight, state))
        turn(model.drive, tick, flight, ramp, sample, state, count)
        put_loads(tick, flight, count)
        last = swing(tick, flight, state, truth, column, count)
        done = clear_columns(model, tick, flight, truth, column, count)
        state = last if done == count else state_at(flight, truth, column, done)
        column += done
        sample += done
    return column, state


@inlined
def horizon(model: Model, tick: Tick, flight: Flight, state: State) -> int:
    """Return for how many ticks the shaft is likely to be clear of the bearing, 4 to `BLOCK`."""
    x, y, rate_x, rate_y = relative_motion(model, state)
    way = (abs(rate_x) + abs(rate_y)) * tick.length
    room = flight.room - sqrt(x * x + y * y)
    return BLOCK if room > BLOCK * way else max(4, int(room / way))


@kernel
def turn(
    motor: Drive, tick: Tick, flight: Flight, ramp: np.ndarray, sample: int, state: State, count: int
) -> None:
    """Work out set-point, speed, angle and the controller's integral through `count` ticks."""
    work, length = flight.work, tick.length
    speed, angle, integral = state.speed, state.angle, state.speed_error_integral
    wanted = set_point(ramp, sample, length)
    for k in range(count):
        following = set_point(ramp, sample + k + 1, length)
        work[WANTED + k], work[SPEED + k], work[ANGLE + k], work[INTEGRAL + k] = (
            wanted,
            speed,
            angle,
            integral,
        )
        error, before = wanted - speed, speed
        if motor.mode == IDEAL:
            speed = following
        else:
            speed = before + motor_torque(motor, error, integral) * flight.shaft_response
        integral = next_integral(motor, error, integral, length)
        angle += length * (0.5 * (before + speed))
        wanted = following
    work[SPEED + count], work[ANGLE + count], work[INTEGRAL + count] = speed, angle, integral


@kernel
def put_loads(tick: Tick, flight: Flight, count: int) -> None:
    """Work out the rotor's maps and loads through `count` ticks."""
    work = flight.work
    for k in range(count):
        # The twelfths, here and below, make the load's mean right to second order where the speed changes.
        lead = (work[SPEED + k + 1] - work[SPEED + k]) * (tick.length / 12.0)
        work[SINE + k], work[COSINE + k] = sine_cosine(work[ANGLE + k] + flight.unbalance_angle + lead)
    for k in range(count):
        before, after = work[SPEED + k], work[SPEED + k + 1]
        speed = 0.5 * (before + after)
        square = speed * speed
        gained = after - before
        radial = flight.unbalance * (square + gained * gained / 12.0)
        tangential = flight.unbalance * (gained * flight.rate)
        late = flight.late_load * speed * gained
        sine, cosine = work[SINE + k], work[COSINE + k]
        moment_x, moment_y = radial * cosine + tangential * sine, radial * sine - tangential * cosine
        a, b = at_speed(flight.tilt_of_unbalance, speed, square)
        c, d = at_speed(flight.tilt_of_weight, speed, square)
        work[TILT_LOAD + k] = (a * moment_x - b * moment_y) - (d + late * cosine)
        work[TILT_LOAD + ROW + k] = (a * moment_y + b * moment_x) + (c - late * sine)
        a, b = at_speed(flight.rate_of_unbalance, speed, square)
        c, d = at_speed(flight.rate_of_weight, speed, square)
        work[RATE_LOAD + k] = (a * moment_x - b * moment_y) - d
        work[RATE_LOAD + ROW + k] = (a * moment_y + b * moment_x) + c
    for k in range(count):
        speed = 0.5 * (work[SPEED + k] + work[SPEED + k + 1])
        square = speed * speed
        work[MAP + k], work[MAP + ROW + k] = at_speed(flight.tilt_of_tilt, speed, square)
        work[MAP + 2 * ROW + k], work[MAP + 3 * ROW + k] = at_speed(flight.tilt_of_rate, speed, square)
        work[MAP + 4 * ROW + k], work[MAP + 5 * ROW + k] = at_speed(flight.rate_of_tilt, speed, square)
        work[MAP + 6 * ROW + k], work[MAP + 7 * ROW + k] = at_speed(flight.rate_of_rate, speed, square)


@kernel
def swing(tick: Tick, flight: Flight, state: State, truth: np.ndarray, column: int, count: int) -> State:
    """Move rotor, house and ring on; fill `count` columns of `truth`; return the state after them."""
    work = flight.work
    for k in range(count):
        truth[0, column + k] = state.tilt_x
        truth[1, column + k] = state.tilt_y
        truth[2, column + k] = state.tilt_rate_x
        truth[3, column + k] = state.tilt_rate_y
        truth[4, column + k] = state.house_x
        truth[5, column + k] = state.house_y
        truth[6, column + k] = state.house_rate_x
        truth[7, column + k] = state.house_rate_y
        truth[8, column + k] = state.ring_speed
        truth[9, column + k] = work[ANGLE + k]
        truth[10, column + k] = work[SPEED + k]
        for row in (11, 12, 13, 14):  # of the contact
            truth[row, column + k] = 0.0
        truth[15, column + k] = work[WANTED + k]
        truth[16, column + k] = 0.0  # of the solenoids
        state = swung(work, k, settle(tick, state))
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
        work[ANGLE + count],
        work[SPEED + count],
        work[INTEGRAL + count],
    )


@inlined
def swung(work: np.ndarray, k: int, state: State) -> State:
    """Return the state with the rotor moved on by the block's tick k."""
    x, y, rate_x, rate_y = state.tilt_x, state.tilt_y, state.tilt_rate_x, state.tilt_rate_y
    a, b, c, d = work[MAP + k], work[MAP + ROW + k], work[MAP + 2 * ROW + k], work[MAP + 3 * ROW + k]
    e, f, g, h = (
        work[MAP + 4 * ROW + k],
        work[MAP + 5 * ROW + k],
        work[MAP + 6 * ROW + k],
        work[MAP + 7 * ROW + k],
    )
    return State(
        (a * x - b * y) + ((c * rate_x - d * rate_y) + work[TILT_LOAD + k]),
        (a * y + b * x) + ((c * rate_y + d * rate_x) + work[TILT_LOAD + ROW + k]),
        (e * x - f * y) + ((g * rate_x - h * rate_y) + work[RATE_LOAD + k]),
        (e * y + f * x) + ((g * rate_y + h * rate_x) + work[RATE_LOAD + ROW + k]),
        state.house_x,
        state.house_y,
        state.house_rate_x,
        state.house_rate_y,
        state.ring_speed,
        0.0,
        0.0,
        0.0,
    )


@inlined
def clear_columns(
    model: Model, tick: Tick, flight: Flight, truth: np.ndarray, column: int, count: int
) -> int:
    """Return how many of `count` columns come before the first that is not clear; the first of all is."""
    station = model.rotor.bearing_station
    last = column + count
    ux, uy, vx, vy = (
        truth[0][column:last],
        truth[1][column:last],
        truth[2][column:last],
        truth[3][column:last],
    )
    hx, hy, wx, wy = (
        truth[4][column:last],
        truth[5][column:last],
        truth[6][column:last],
        truth[7][column:last],
    )
    near = 0
    for k in range(1, count):
        x, y = station * ux[k] - hx[k], station * uy[k] - hy[k]
        rate_x, rate_y = station * vx[k] - wx[k], station * vy[k] - wy[k]
        room = max(flight.room - (abs(rate_x) + abs(rate_y)) * tick.length, 0.0)
        near += not (x * x + y * y < room * room)
    for k in range(1, count):
        near += not (abs(flight.work[SPEED + k]) < flight.fastest)
    if near == 0:
        return count
    for k in range(1, count):
        if not clear(model, tick, flight, state_at(flight, truth, column, k)):
            return k
    return count


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


@inlined
def at_speed(c: Polynomial, speed: float, square: float) -> tuple[float, float]:
    """Return real and imaginary part of a polynomial of i times the speed (rad/s), `square` its square."""
    return c[0] - c[2] * square, speed * (c[1] - c[3] * square)
