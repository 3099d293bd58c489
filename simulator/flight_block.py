"""Some ticks of free flight at once: what goes from tick to tick one after another, all else side by side.

Where the speed changes, drive and rotor wait for the tick before. Everything between them, the maps and
loads, is worked out in loops over the block's ticks that the compiler turns into vector instructions. Where
the speed stays exactly as it is, nothing waits: see `simulator.flight_table`.
"""

from typing import NamedTuple

import numpy as np

from simulator.compile import inlined
from simulator.drive import IDEAL, motor_torque, next_integral, put_set_points
from simulator.dynamics import Tick, faded
from simulator.numeric import sine_cosine
from simulator.rig import Drive
from simulator.state import State

BLOCK = 64  # ticks that are worked out at once, so that processors do several of them in one instruction
ROW = BLOCK + 8  # of the working memory
WANTED, SPEED, ANGLE, INTEGRAL, SINE, COSINE = 0, ROW, 2 * ROW, 3 * ROW, 4 * ROW, 5 * ROW
TILT_LOAD, RATE_LOAD, MAP, TABLE = 6 * ROW, 8 * ROW, 10 * ROW, 18 * ROW
NOTES = 34 * ROW  # of the table and of the block at hand:
TABLE_SPEED, FIRST, CLEAR = NOTES, NOTES + 1, NOTES + 2  # see `simulator.flight_table` and `simulator.flight`
WORK = NOTES + 3

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
    spare: np.ndarray  # (17, ROW) true signals of a block that is longer than what is asked for, and after it


def end_block(flight: Flight) -> None:
    """Let the next block begin at the next sample, whatever there is of one in spare memory."""
    flight.work[CLEAR] = 0.0


@inlined
def turn(motor: Drive, tick: Tick, flight: Flight, ramp: np.ndarray, sample: int, state: State) -> bool:
    """Work out set-point, speed, angle and controller through the block; tell whether the speed stays."""
    put_set_points(ramp, sample, tick.length, BLOCK + 1, flight.work)
    steady = stays(motor, tick, flight, state)
    if not steady:
        follow(motor, tick, flight, state)
    return steady


@inlined
def stays(motor: Drive, tick: Tick, flight: Flight, state: State) -> bool:
    """Fill in speed, angle and integral as if the speed stayed; tell whether it does.

    That is so where neither a ramp nor the controller's torque adds as much as a rounding error.
    """
    work, speed = flight.work, state.speed
    error = work[WANTED] - speed
    if next_speed(motor, flight, speed, error, state.speed_error_integral, work[WANTED + 1]) != speed:
        return False
    turned, summed = tick.length * speed, error * tick.length
    for k in range(BLOCK + 1):
        work[SPEED + k] = speed
        work[ANGLE + k] = state.angle + k * turned
        work[INTEGRAL + k] = state.speed_error_integral + k * summed
    changes = 0
    for k in range(BLOCK):
        integral, following = work[INTEGRAL + k], work[WANTED + k + 1]
        changes += following != work[WANTED]
        changes += next_speed(motor, flight, speed, error, integral, following) != speed
        changes += next_integral(motor, error, integral, tick.length) != integral + summed
    return changes == 0


@inlined
def follow(motor: Drive, tick: Tick, flight: Flight, state: State) -> None:
    """Fill in speed, angle and integral, tick by tick."""
    work, length = flight.work, tick.length
    speed, angle, integral = state.speed, state.angle, state.speed_error_integral
    for k in range(BLOCK):
        work[SPEED + k], work[ANGLE + k], work[INTEGRAL + k] = speed, angle, integral
        error, before = work[WANTED + k] - speed, speed
        speed = next_speed(motor, flight, before, error, integral, work[WANTED + k + 1])
        integral = next_integral(motor, error, integral, length)
        angle += length * (0.5 * (before + speed))
    work[SPEED + BLOCK], work[ANGLE + BLOCK], work[INTEGRAL + BLOCK] = speed, angle, integral


@inlined
def next_speed(
    motor: Drive, flight: Flight, speed: float, error: float, integral: float, following: float
) -> float:
    """Return the speed after a tick; `following` is the set-point then."""
    if motor.mode == IDEAL:
        return following
    return speed + motor_torque(motor, error, integral) * flight.shaft_response


@inlined
def put_loads(tick: Tick, flight: Flight) -> None:
    """Work out the rotor's maps and loads through the block."""
    work = flight.work
    for k in range(BLOCK):
        # The twelfths, here and below, make the load's mean right to second order where the speed changes.
        lead = (work[SPEED + k + 1] - work[SPEED + k]) * (tick.length / 12.0)
        work[SINE + k], work[COSINE + k] = sine_cosine(work[ANGLE + k] + flight.unbalance_angle + lead)
    for k in range(BLOCK):
        put_load(flight, work[SPEED + k], work[SPEED + k + 1], k)
    for k in range(BLOCK):
        put_map(flight, work[SPEED + k], work[SPEED + k + 1], k)


@inlined
def put_load(flight: Flight, before: float, after: float, k: int) -> None:
    """Work out the load of tick k, in which the speed goes from `before` to `after` (rad/s)."""
    work, speed, gained = flight.work, 0.5 * (before + after), after - before
    square = speed * speed
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


@inlined
def put_map(flight: Flight, before: float, after: float, k: int) -> None:
    """Work out the map of tick k, in which the speed goes from `before` to `after` (rad/s)."""
    work, speed = flight.work, 0.5 * (before + after)
    square = speed * speed
    work[MAP + k], work[MAP + ROW + k] = at_speed(flight.tilt_of_tilt, speed, square)
    work[MAP + 2 * ROW + k], work[MAP + 3 * ROW + k] = at_speed(flight.tilt_of_rate, speed, square)
    work[MAP + 4 * ROW + k], work[MAP + 5 * ROW + k] = at_speed(flight.rate_of_tilt, speed, square)
    work[MAP + 6 * ROW + k], work[MAP + 7 * ROW + k] = at_speed(flight.rate_of_rate, speed, square)


@inlined
def at_speed(c: Polynomial, speed: float, square: float) -> tuple[float, float]:
    """Return real and imaginary part of a polynomial of i times the speed (rad/s), `square` its square."""
    return c[0] - c[2] * square, speed * (c[1] - c[3] * square)


@inlined
def swing(flight: Flight, state: State, truth: np.ndarray, column: int) -> None:
    """Move the rotor on, tick by tick; fill its rows of `truth`, and those of the spare memory after it."""
    work, after = flight.work, flight.spare
    tilts_x, tilts_y = truth[0, column : column + BLOCK], truth[1, column : column + BLOCK]
    rates_x, rates_y = truth[2, column : column + BLOCK], truth[3, column : column + BLOCK]
    x, y, rate_x, rate_y = state.tilt_x, state.tilt_y, state.tilt_rate_x, state.tilt_rate_y
    for k in range(BLOCK):
        tilts_x[k], tilts_y[k], rates_x[k], rates_y[k] = x, y, rate_x, rate_y
        own = MAP + k
        a, b, c, d = work[own], work[own + ROW], work[own + 2 * ROW], work[own + 3 * ROW]
        e, f, g, h = work[own + 4 * ROW], work[own + 5 * ROW], work[own + 6 * ROW], work[own + 7 * ROW]
        x, y, rate_x, rate_y = (
            (a * x - b * y) + ((c * rate_x - d * rate_y) + work[TILT_LOAD + k]),
            (a * y + b * x) + ((c * rate_y + d * rate_x) + work[TILT_LOAD + ROW + k]),
            (e * x - f * y) + ((g * rate_x - h * rate_y) + work[RATE_LOAD + k]),
            (e * y + f * x) + ((g * rate_y + h * rate_x) + work[RATE_LOAD + ROW + k]),
        )
    after[0, BLOCK], after[1, BLOCK], after[2, BLOCK], after[3, BLOCK] = x, y, rate_x, rate_y


@inlined
def settle_on(tick: Tick, flight: Flight, state: State, truth: np.ndarray, column: int) -> None:
    """Move house and ring on as `simulator.dynamics.settle` does; fill as `swing` does."""
    x, y, rate_x, rate_y = state.house_x, state.house_y, state.house_rate_x, state.house_rate_y
    ring = state.ring_speed
    places_x, places_y = truth[4, column : column + BLOCK], truth[5, column : column + BLOCK]
    rates_x, rates_y = truth[6, column : column + BLOCK], truth[7, column : column + BLOCK]
    rings = truth[8, column : column + BLOCK]
    still = x == 0.0 and y == 0.0 and rate_x == 0.0 and rate_y == 0.0 and ring == 0.0
    for k in range(1 if still else BLOCK):
        places_x[k], places_y[k], rates_x[k], rates_y[k], rings[k] = x, y, rate_x, rate_y, ring
        x, rate_x = (
            faded(tick.house_x_x * x + tick.house_x_v * rate_x),
            faded(tick.house_v_x * x + tick.house_v_v * rate_x),
        )
        y, rate_y = (
            faded(tick.house_y_y * y + tick.house_y_v * rate_y),
            faded(tick.house_w_y * y + tick.house_w_w * rate_y),
        )
        ring = faded(tick.ring_decay * ring)
    if still:
        for row in range(4, 9):
            put_zeros(truth[row, column : column + BLOCK], 1)
    after = flight.spare
    after[4, BLOCK], after[5, BLOCK], after[6, BLOCK], after[7, BLOCK] = x, y, rate_x, rate_y
    after[8, BLOCK] = ring


@inlined
def put_rest(flight: Flight, truth: np.ndarray, column: int) -> None:
    """Fill the rows of the drive, and those of contact and solenoids, which are zero."""
    copy(flight.work, ANGLE, truth[9, column : column + BLOCK])
    copy(flight.work, SPEED, truth[10, column : column + BLOCK])
    copy(flight.work, WANTED, truth[15, column : column + BLOCK])
    for row in (11, 12, 13, 14, 16):
        put_zeros(truth[row, column : column + BLOCK], 0)


@inlined
def copy(work: np.ndarray, begin: int, out: np.ndarray) -> None:
    """Copy a row of the working memory."""
    for k in range(BLOCK):
        out[k] = work[begin + k]


@inlined
def put_zeros(out: np.ndarray, begin: int) -> None:
    """Fill the block's part of a row with zeros, from its cell `begin` on."""
    for k in range(begin, BLOCK):
        out[k] = 0.0
