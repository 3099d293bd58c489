"""Flight at constant speed: everything is linear, so that many samples follow from one at once, exactly.

A flight's state after k ticks is a matrix's power times its state at the flight's anchor, plus what weight,
coupling and unbalance have added since. Those are tabulated for k up to `BLOCK`, once for a speed, by
`simulator.flight_table`. A flight takes a new anchor at each multiple of `BLOCK` samples, at the latest.
The anchor is kept between calls, so that it does not matter how samples are divided among calls.
"""

from typing import NamedTuple

import numpy as np

from simulator.compile import inlined, kernel
from simulator.numeric import sine_cosine
from simulator.state import State

BLOCK = 100  # samples; a snapshot of the state at a multiple of it goes on to the same bytes
NOTHING = 1e-200  # m, m/s, rad/s: smaller numbers are slow to compute with

# Rows of the table: real and imaginary parts of what a complex tilt (and then its rate) gets of the tilt,
# of the rate, and of the unbalance's moment at the anchor; what it gets of weight and coupling along x and y.
OF_TILT, OF_RATE, OF_UNBALANCE, OF_WEIGHT = 0, 2, 4, 6
VECTOR = 8  # rows of the tilt; as many of its rate follow
HOUSE = 16  # rows: four for x, four for y, as in `Tick`
RING = 24  # and one more, so that rows come in pairs
TABLE_ROWS = 26


class Flight(NamedTuple):
    """Table and working memory of `glide`; made by `simulator.flight_table`."""

    table: np.ndarray  # (TABLE_ROWS, BLOCK + 1)
    anchor: np.ndarray  # (15,) the anchor's sample, below 0 for none, its state, and its unbalance's moment
    speed: float  # rad/s, for which the table is; NaN: for none
    tick: float  # s
    unbalance: float  # N m, the moment's size at that speed
    unbalance_angle: float  # rad
    station: float  # m, the bearing's
    radius: float  # m, within which the shaft's centre touches nothing


@inlined
def steady(flight: Flight, ramp: np.ndarray, pulses: np.ndarray, sample: int, speed: float) -> bool:
    """Tell whether the speed is the table's and stays so from a sample on, and no solenoid acts."""
    if speed != flight.speed or speed != ramp[1]:
        return False
    for index in range(pulses.shape[0]):
        if (sample - pulses[index, 0]) * flight.tick < pulses[index, 1]:
            return False
    return ramp[2] * ((sample - ramp[3]) * flight.tick) >= abs(ramp[1] - ramp[0])


@inlined
def clear(flight: Flight, x: float, y: float, rate_x: float, rate_y: float) -> bool:
    """Tell whether the shaft is well away from the bearing, by its centre's place (m) and velocity (m/s)."""
    room = max(flight.radius - 2.0 * (abs(rate_x) + abs(rate_y)) * flight.tick, 0.0)
    return x * x + y * y < room * room


@kernel
def glide(
    flight: Flight, sample: int, state: State, truth: np.ndarray, column: int, end: int
) -> tuple[int, State]:
    """Fill `truth` (17, n) from `column` towards `end` for as long as the shaft is clear of the bearing.

    `state` is that of `sample`, at `column`, where it is clear. Return the first column that is not filled,
    and its state.
    """
    first = int(flight.anchor[0])
    begin, room = sample - first, BLOCK - first % BLOCK
    if first < 0 or not 0 < begin < room or not same(after(flight, begin), state):
        set_anchor(flight, sample, state)
        begin, room = 0, BLOCK - sample % BLOCK
    count = min(end - column, room - begin)
    fill(flight, begin, truth, column, count)
    done = clear_columns(flight, truth, column, count)
    return column + done, after(flight, begin + done)


@inlined
def same(a: State, b: State) -> bool:
    """Tell whether two states are equal."""
    equal = True
    for one, other in zip(a, b):  # noqa: B905  numba's zip takes nothing else
        equal = equal and one == other
    return equal


@inlined
def set_anchor(flight: Flight, sample: int, state: State) -> None:
    """Let a flight begin at a sample."""
    anchor = flight.anchor
    anchor[0] = float(sample)
    for index, value in enumerate(state):
        anchor[1 + index] = value
    for index in range(5, 10):  # house and ring, which die away
        if abs(anchor[index]) < NOTHING:
            anchor[index] = 0.0
    sine, cosine = sine_cosine(state.angle + flight.unbalance_angle)
    anchor[13], anchor[14] = flight.unbalance * cosine, flight.unbalance * sine


@kernel
def after(flight: Flight, k: int) -> State:
    """Return the state k ticks after the anchor."""
    table, z = flight.table[:, k], flight.anchor[1:]
    found = np.empty(4)
    for part in range(2):
        row = part * VECTOR
        x, y = table[row + OF_WEIGHT], table[row + OF_WEIGHT + 1]
        for source, index in ((OF_TILT, 0), (OF_RATE, 2), (OF_UNBALANCE, 12)):
            a, b = table[row + source], table[row + source + 1]
            x += a * z[index] - b * z[index + 1]
            y += a * z[index + 1] + b * z[index]
        found[2 * part], found[2 * part + 1] = x, y
    return State(
        found[0],
        found[1],
        found[2],
        found[3],
        table[HOUSE] * z[4] + table[HOUSE + 1] * z[6],
        table[HOUSE + 4] * z[5] + table[HOUSE + 5] * z[7],
        table[HOUSE + 2] * z[4] + table[HOUSE + 3] * z[6],
        table[HOUSE + 6] * z[5] + table[HOUSE + 7] * z[7],
        table[RING] * z[8],
        z[9] + k * (flight.tick * z[10]),
        z[10],
        z[11],
    )


@kernel
def fill(flight: Flight, begin: int, truth: np.ndarray, column: int, count: int) -> None:
    """Write true signals (17, n) from `begin` ticks after the anchor on into `count` columns of `truth`."""
    table, z = flight.table, flight.anchor[1:]
    for row in range(truth.shape[0]):
        constant = z[10] if row in (10, 15) else 0.0
        signal = truth[row][column : column + count]
        for index in range(count):
            signal[index] = constant
    for part in range(2):
        row, x, y = part * VECTOR, truth[2 * part], truth[2 * part + 1]
        add(table, row + OF_WEIGHT, begin, 1.0, 0.0, x, column, count)
        add(table, row + OF_WEIGHT, begin, 0.0, 1.0, y, column, count)
        for source, index in ((OF_TILT, 0), (OF_RATE, 2), (OF_UNBALANCE, 12)):
            add(table, row + source, begin, z[index], -z[index + 1], x, column, count)
            add(table, row + source, begin, z[index + 1], z[index], y, column, count)
    for axis in range(2):
        for part in range(2):
            row = HOUSE + 4 * axis + 2 * part
            add(table, row, begin, z[4 + axis], z[6 + axis], truth[4 + axis + 2 * part], column, count)
    add(table, RING, begin, z[8], 0.0, truth[8], column, count)
    turn, angle = flight.tick * z[10], truth[9][column : column + count]
    for index in range(count):
        angle[index] = z[9] + (begin + index) * turn


@kernel
def add(
    table: np.ndarray, row: int, begin: int, x: float, y: float, out: np.ndarray, column: int, count: int
) -> None:
    """Add x times a row of the table, and y times the next, to `count` samples of a signal."""
    a, b = table[row][begin : begin + count], table[row + 1][begin : begin + count]
    target = out[column : column + count]
    for index in range(count):
        target[index] += a[index] * x + b[index] * y


@inlined
def clear_columns(flight: Flight, truth: np.ndarray, column: int, count: int) -> int:
    """Return how many of `count` columns come before the first that is not clear; the first of all is."""
    last, station = column + count, flight.station
    ux, uy = truth[0][column:last], truth[1][column:last]
    vx, vy = truth[2][column:last], truth[3][column:last]
    hx, hy = truth[4][column:last], truth[5][column:last]
    wx, wy = truth[6][column:last], truth[7][column:last]
    near = 0
    for k in range(1, count):
        x, y = station * ux[k] - hx[k], station * uy[k] - hy[k]
        rate = abs(station * vx[k] - wx[k]) + abs(station * vy[k] - wy[k])
        room = max(flight.radius - 2.0 * rate * flight.tick, 0.0)
        near += x * x + y * y >= room * room
    if near == 0:
        return count
    for k in range(1, count):
        x, y = station * ux[k] - hx[k], station * uy[k] - hy[k]
        if not clear(flight, x, y, station * vx[k] - wx[k], station * vy[k] - wy[k]):
            return k
    return count


@inlined
def forget(flight: Flight) -> None:
    """Let the next flight have an anchor of its own."""
    flight.anchor[0] = -1.0
