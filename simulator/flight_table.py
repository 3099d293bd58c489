"""A block of free flight at a speed that stays, from a table: no tick waits for the one before.

Through k ticks at one speed the rotor's state s becomes P s + G exp(i a) + W, where a is the unbalance's
angle at the block's begin. P is the k-th power of a tick's map, G and W are what the unbalance and the weight
add meanwhile. A table of them for all ticks of a block is made once for a speed. A state is a pair of complex
numbers here, tilt and rate; P's columns are what becomes of a tilt and of a rate of one.
"""

import numpy as np

from simulator.compile import inlined, kernel
from simulator.dynamics import Tick
from simulator.flight_block import BLOCK, MAP, ROW, TABLE, TABLE_SPEED, Flight, at_speed, put_map
from simulator.numeric import sine_cosine
from simulator.state import State

# Four rows each of the table: real and imaginary part of the tilt, and of the rate.
OF_TILT, OF_RATE, OF_UNBALANCE, OF_WEIGHT = TABLE, TABLE + 4 * ROW, TABLE + 8 * ROW, TABLE + 12 * ROW


@inlined
def look_up(tick: Tick, flight: Flight, state: State, truth: np.ndarray, column: int) -> None:
    """Move the rotor on at the state's speed; fill as `simulator.flight_block.swing` does."""
    if flight.work[TABLE_SPEED] != state.speed:
        put_table(tick, flight, state.speed)
    tilts_x, tilts_y = truth[0, column : column + BLOCK], truth[1, column : column + BLOCK]
    rates_x, rates_y = truth[2, column : column + BLOCK], truth[3, column : column + BLOCK]
    sine, cosine = sine_cosine(state.angle + flight.unbalance_angle)
    for k in range(BLOCK):
        tilts_x[k], tilts_y[k] = part_at(flight.work, k, state, sine, cosine)
        rates_x[k], rates_y[k] = part_at(flight.work, 2 * ROW + k, state, sine, cosine)
    after = flight.spare
    after[0, BLOCK], after[1, BLOCK] = part_at(flight.work, BLOCK, state, sine, cosine)
    after[2, BLOCK], after[3, BLOCK] = part_at(flight.work, 2 * ROW + BLOCK, state, sine, cosine)


@inlined
def part_at(work: np.ndarray, k: int, state: State, sine: float, cosine: float) -> tuple[float, float]:
    """Return tilt (x, y) after k ticks, or, two rows further, its rate."""
    a, b = work[OF_TILT + k], work[OF_TILT + ROW + k]
    c, d = work[OF_RATE + k], work[OF_RATE + ROW + k]
    g, h = work[OF_UNBALANCE + k], work[OF_UNBALANCE + ROW + k]
    x, y, rate_x, rate_y = state.tilt_x, state.tilt_y, state.tilt_rate_x, state.tilt_rate_y
    load_x = (g * cosine - h * sine) + work[OF_WEIGHT + k]
    load_y = (g * sine + h * cosine) + work[OF_WEIGHT + ROW + k]
    return (
        (a * x - b * y) + ((c * rate_x - d * rate_y) + load_x),
        (a * y + b * x) + ((c * rate_y + d * rate_x) + load_y),
    )


@kernel
def put_table(tick: Tick, flight: Flight, speed: float) -> None:
    """Fill the table for a speed (rad/s)."""
    work, square = flight.work, speed * speed
    put_map(flight, speed, speed, 0)
    radial, turned = flight.unbalance * square, tick.length * speed
    a, b = at_speed(flight.tilt_of_unbalance, speed, square)
    c, d = at_speed(flight.rate_of_unbalance, speed, square)
    e, f = at_speed(flight.tilt_of_weight, speed, square)
    g, h = at_speed(flight.rate_of_weight, speed, square)
    for cell in range(TABLE, TABLE + 16 * ROW, ROW):
        work[cell] = 0.0
    work[OF_TILT] = work[OF_RATE + 2 * ROW] = 1.0
    for k in range(BLOCK):
        sine, cosine = sine_cosine(k * turned)
        x, y = radial * cosine, radial * sine
        put_next(work, OF_TILT + k, 0.0, 0.0, 0.0, 0.0)
        put_next(work, OF_RATE + k, 0.0, 0.0, 0.0, 0.0)
        put_next(work, OF_UNBALANCE + k, a * x - b * y, a * y + b * x, c * x - d * y, c * y + d * x)
        put_next(work, OF_WEIGHT + k, -f, e, -h, g)  # the weight's moment is along y
    work[TABLE_SPEED] = speed


@inlined
def put_next(work: np.ndarray, at: int, tilt_x: float, tilt_y: float, rate_x: float, rate_y: float) -> None:
    """Move the state in the four rows at `at` on by a tick, under the tick's load."""
    x, y, u, v = work[at], work[at + ROW], work[at + 2 * ROW], work[at + 3 * ROW]
    a, b, c, d = work[MAP], work[MAP + ROW], work[MAP + 2 * ROW], work[MAP + 3 * ROW]
    e, f, g, h = work[MAP + 4 * ROW], work[MAP + 5 * ROW], work[MAP + 6 * ROW], work[MAP + 7 * ROW]
    work[at + 1] = (a * x - b * y) + ((c * u - d * v) + tilt_x)
    work[at + ROW + 1] = (a * y + b * x) + ((c * v + d * u) + tilt_y)
    work[at + 2 * ROW + 1] = (e * x - f * y) + ((g * u - h * v) + rate_x)
    work[at + 3 * ROW + 1] = (e * y + f * x) + ((g * v + h * u) + rate_y)
