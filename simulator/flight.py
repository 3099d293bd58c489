"""Flight at constant speed: everything is linear, so that many samples follow from one at once, exactly.

A flight's state after k ticks is a matrix's power times its state at the flight's anchor, plus what weight,
coupling and unbalance have added since. Those matrices and additions are tabulated for k up to `BLOCK`,
once for a speed; a flight takes a new anchor at each multiple of `BLOCK` samples, at the latest. The anchor
is kept between calls, so that it does not matter how samples are divided among calls.
"""

from typing import NamedTuple

import numpy as np

from simulator.compile import inlined, kernel
from simulator.contact import penetration
from simulator.drive import IDEAL
from simulator.dynamics import Tick, may_touch, static_moment
from simulator.numeric import sine_cosine
from simulator.rig import Model
from simulator.state import STATE, State

BLOCK = 100  # samples; a snapshot of the state at a multiple of it goes on to the same bytes
MOST_TURN = 2.0  # rad of the fastest motion in a tick for which the series below are exact
TERMS = 30
NOTHING = 1e-200  # m, m/s, rad/s: smaller numbers are slow to compute with

# Rows of the table: real and imaginary parts of what a complex tilt (and then its rate) gets of the tilt,
# of the rate, and of the unbalance's moment at the anchor; what it gets of weight and coupling along x and y.
OF_TILT, OF_RATE, OF_UNBALANCE, OF_WEIGHT = 0, 2, 4, 6
VECTOR = 8  # rows of the tilt; as many of its rate follow
HOUSE = 16  # rows: four for x, four for y, as in `Tick`
RING = 24  # and one more, so that rows come in pairs
TABLE_ROWS = 26


class Flight(NamedTuple):
    """Working memory of `glide`; made by `no_flight`."""

    table: np.ndarray  # (TABLE_ROWS, BLOCK + 1)
    speed: np.ndarray  # (1,) rad/s for which the table is; NaN: for none
    anchor: np.ndarray  # (13,) the anchor's sample, below 0 for none, and its state


def no_flight() -> Flight:
    """Return memory in which no flight is known."""
    return Flight(np.zeros((TABLE_ROWS, BLOCK + 1)), np.full(1, np.nan), np.full(1 + len(STATE), -1.0))


@inlined
def steady(model: Model, tick: Tick, ramp: np.ndarray, pulses: np.ndarray, sample: int, speed: float) -> bool:
    """Tell whether the speed is prescribed and constant from a sample on, and no solenoid acts."""
    if model.drive.mode != IDEAL or speed != ramp[1]:
        return False
    for index in range(pulses.shape[0]):
        if (sample - pulses[index, 0]) * tick.length < pulses[index, 1]:
            return False
    since = (sample - ramp[3]) * tick.length
    turn = tick.length * (tick.flight_rate + tick.gyroscopic * abs(speed))
    return ramp[2] * since >= abs(ramp[1] - ramp[0]) and turn <= MOST_TURN


@kernel
def glide(
    model: Model,
    tick: Tick,
    flight: Flight,
    sample: int,
    state: State,
    truth: np.ndarray,
    column: int,
    end: int,
) -> tuple[int, State]:
    """Fill `truth` (17, n) from `column` towards `end` for as long as the shaft cannot touch.

    `state` is that of `sample`, at `column`, where it cannot. Return the first column that is not filled,
    and its state.
    """
    if flight.speed[0] != state.speed:
        tabulate(model, tick, state.speed, flight.table)
        flight.speed[0] = state.speed
        flight.anchor[0] = -1.0
    first = int(flight.anchor[0])
    begin, room = sample - first, BLOCK - first % BLOCK
    if first < 0 or not 0 < begin < room or not same(after(model, tick, flight, begin), state):
        set_anchor(flight, sample, state)
        begin, room = 0, BLOCK - sample % BLOCK
    count = min(end - column, room - begin)
    fill(model, tick, flight, begin, truth, column, count)
    done = free_columns(model, tick, truth, column, count)
    return column + done, after(model, tick, flight, begin + done)


@inlined
def same(a: State, b: State) -> bool:
    """Tell whether two states are equal in what flies."""
    return (
        a.tilt_x == b.tilt_x
        and a.tilt_y == b.tilt_y
        and a.tilt_rate_x == b.tilt_rate_x
        and a.tilt_rate_y == b.tilt_rate_y
        and a.house_x == b.house_x
        and a.house_y == b.house_y
        and a.house_rate_x == b.house_rate_x
        and a.house_rate_y == b.house_rate_y
        and a.ring_speed == b.ring_speed
        and a.angle == b.angle
    )


@inlined
def set_anchor(flight: Flight, sample: int, state: State) -> None:
    """Let a flight begin at a sample."""
    flight.anchor[0] = float(sample)
    for index, value in enumerate(state):
        flight.anchor[1 + index] = value
    for index in range(5, 10):  # house and ring, which die away
        if abs(flight.anchor[index]) < NOTHING:
            flight.anchor[index] = 0.0


@inlined
def unbalance_at(model: Model, flight: Flight) -> tuple[float, float]:
    """Return the unbalance's moment (x, y) at the anchor, N m."""
    speed = flight.anchor[11]
    size = model.rotor.disk_station * model.rotor.unbalance * speed * speed
    sine, cosine = sine_cosine(flight.anchor[10] + model.rotor.unbalance_angle)
    return size * cosine, size * sine


@inlined
def component(
    table: np.ndarray, row: int, k: int, x: float, y: float, vx: float, vy: float, px: float, py: float
) -> tuple[float, float]:
    """Return the tilt (row 0) or its rate (row `VECTOR`), x and y, k ticks after the anchor."""
    to_x, to_y = table[row + OF_WEIGHT, k], table[row + OF_WEIGHT + 1, k]
    to_x += table[row + OF_TILT, k] * x + table[row + OF_TILT + 1, k] * -y
    to_y += table[row + OF_TILT, k] * y + table[row + OF_TILT + 1, k] * x
    to_x += table[row + OF_RATE, k] * vx + table[row + OF_RATE + 1, k] * -vy
    to_y += table[row + OF_RATE, k] * vy + table[row + OF_RATE + 1, k] * vx
    to_x += table[row + OF_UNBALANCE, k] * px + table[row + OF_UNBALANCE + 1, k] * -py
    to_y += table[row + OF_UNBALANCE, k] * py + table[row + OF_UNBALANCE + 1, k] * px
    return to_x, to_y


@kernel
def after(model: Model, tick: Tick, flight: Flight, k: int) -> State:
    """Return the state k ticks after the anchor."""
    table, z = flight.table, flight.anchor[1:]
    px, py = unbalance_at(model, flight)
    tilt_x, tilt_y = component(table, 0, k, z[0], z[1], z[2], z[3], px, py)
    rate_x, rate_y = component(table, VECTOR, k, z[0], z[1], z[2], z[3], px, py)
    return State(
        tilt_x,
        tilt_y,
        rate_x,
        rate_y,
        table[HOUSE, k] * z[4] + table[HOUSE + 1, k] * z[6],
        table[HOUSE + 4, k] * z[5] + table[HOUSE + 5, k] * z[7],
        table[HOUSE + 2, k] * z[4] + table[HOUSE + 3, k] * z[6],
        table[HOUSE + 6, k] * z[5] + table[HOUSE + 7, k] * z[7],
        table[RING, k] * z[8],
        z[9] + k * (tick.length * z[10]),
        z[10],
        z[11],
    )


@kernel
def fill(
    model: Model, tick: Tick, flight: Flight, begin: int, truth: np.ndarray, column: int, count: int
) -> None:
    """Write true signals (17, n) from `begin` ticks after the anchor on into `count` columns of `truth`."""
    z = flight.anchor[1:]
    px, py = unbalance_at(model, flight)
    for row in range(truth.shape[0]):
        constant = z[10] if row in (10, 15) else 0.0
        signal = truth[row][column : column + count]
        for index in range(count):
            signal[index] = constant
    for part in (0, 1):
        row, x, y = part * VECTOR, truth[2 * part], truth[2 * part + 1]
        add(flight.table, row + OF_WEIGHT, begin, 1.0, 0.0, x, column, count)
        add(flight.table, row + OF_WEIGHT, begin, 0.0, 1.0, y, column, count)
        add(flight.table, row + OF_TILT, begin, z[0], -z[1], x, column, count)
        add(flight.table, row + OF_TILT, begin, z[1], z[0], y, column, count)
        add(flight.table, row + OF_RATE, begin, z[2], -z[3], x, column, count)
        add(flight.table, row + OF_RATE, begin, z[3], z[2], y, column, count)
        add(flight.table, row + OF_UNBALANCE, begin, px, -py, x, column, count)
        add(flight.table, row + OF_UNBALANCE, begin, py, px, y, column, count)
    add(flight.table, HOUSE, begin, z[4], z[6], truth[4], column, count)
    add(flight.table, HOUSE + 4, begin, z[5], z[7], truth[5], column, count)
    add(flight.table, HOUSE + 2, begin, z[4], z[6], truth[6], column, count)
    add(flight.table, HOUSE + 6, begin, z[5], z[7], truth[7], column, count)
    add(flight.table, RING, begin, z[8], 0.0, truth[8], column, count)
    turn, angle = tick.length * z[10], truth[9][column : column + count]
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
def free_columns(model: Model, tick: Tick, truth: np.ndarray, column: int, count: int) -> int:
    """Return how many of `count` columns come before the first where the shaft may touch; at least one."""
    station, clearance = model.rotor.bearing_station, narrowest(model)
    last = column + count
    ux, uy = truth[0][column:last], truth[1][column:last]
    vx, vy = truth[2][column:last], truth[3][column:last]
    hx, hy = truth[4][column:last], truth[5][column:last]
    wx, wy = truth[6][column:last], truth[7][column:last]
    near = 0
    for k in range(1, count):
        x, y = station * ux[k] - hx[k], station * uy[k] - hy[k]
        rate = abs(station * vx[k] - wx[k]) + abs(station * vy[k] - wy[k])
        gap = max(clearance - 2.0 * rate * tick.length, 0.0)
        near += x * x + y * y >= gap * gap
    if near == 0:
        return count
    for k in range(1, count):
        state = State(
            ux[k],
            uy[k],
            vx[k],
            vy[k],
            hx[k],
            hy[k],
            wx[k],
            wy[k],
            0.0,
            0.0,
            0.0,
            0.0,
        )
        if may_touch(model, tick, state, penetration(model, state)):
            return k
    return count


@inlined
def narrowest(model: Model) -> float:
    """Return a radius, m, within which the shaft's centre touches nothing, with 1 um to spare."""
    bearing = model.backup_bearing
    return bearing.clearance + min(bearing.pin_wear, 0.0) - 1e-6


@kernel
def tabulate(model: Model, tick: Tick, speed: float, table: np.ndarray) -> None:
    """Fill a flight's table (TABLE_ROWS, BLOCK + 1) for a speed (rad/s)."""
    one = tick_response(model, tick, speed)
    power = np.eye(4, dtype=np.complex128)
    house = np.zeros((4, 2))
    house[0, 0] = house[1, 1] = house[2, 0] = house[3, 1] = 1.0
    ring = 1.0
    weight = 1j * static_moment(model.rotor)
    for k in range(BLOCK + 1):
        for part in range(2):
            row = part * VECTOR
            for source, place in ((0, OF_TILT), (1, OF_RATE), (3, OF_UNBALANCE)):
                table[row + place, k] = power[part, source].real
                table[row + place + 1, k] = power[part, source].imag
            held = power[part, 2] * weight
            table[row + OF_WEIGHT, k], table[row + OF_WEIGHT + 1, k] = held.real, held.imag
        for axis in range(2):
            for i in range(2):
                for j in range(2):
                    table[HOUSE + 4 * axis + 2 * i + j, k] = house[2 * axis + i, j]
        table[RING, k] = ring
        power = matrix_product(one, power)
        house = next_house(tick, house)
        ring *= tick.ring_decay


@kernel
def tick_response(model: Model, tick: Tick, speed: float) -> np.ndarray:
    """Return exp(G tick), (4, 4), of d/dt (w, w', 1, e^(i psi)) = G (w, w', 1, e^(i psi)).

    w is the complex tilt; the third entry stands for a constant moment of 1 N m, the fourth for one that
    turns with the shaft.
    """
    rotor, magnet = model.rotor, model.magnetic_bearing
    arm = rotor.magnet_station * rotor.magnet_station
    generator = np.zeros((4, 4), dtype=np.complex128)
    generator[0, 1] = 1.0
    generator[1, 0] = -(magnet.stiffness * arm + rotor.pivot_stiffness) / rotor.inertia
    generator[1, 1] = (1j * rotor.polar_inertia * speed - magnet.damping * arm) / rotor.inertia
    generator[1, 2] = generator[1, 3] = 1.0 / rotor.inertia
    generator[3, 3] = 1j * speed
    total = np.eye(4, dtype=np.complex128)
    term: np.ndarray = np.eye(4, dtype=np.complex128)
    for order in range(1, TERMS):
        term = matrix_product(generator, term) * (tick.length / order)
        total += term
    return total


@kernel
def matrix_product(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the product of two matrices (4, 4)."""
    out = np.zeros((4, 4), dtype=np.complex128)
    for i in range(4):
        for j in range(4):
            for k in range(4):
                out[i, j] += a[i, k] * b[k, j]
    return out


@inlined
def next_house(tick: Tick, house: np.ndarray) -> np.ndarray:
    """Return both houses' maps (4, 2), x above y, one tick on."""
    out = np.zeros((4, 2))
    for j in range(2):
        out[0, j] = tick.house_x_x * house[0, j] + tick.house_x_v * house[1, j]
        out[1, j] = tick.house_v_x * house[0, j] + tick.house_v_v * house[1, j]
        out[2, j] = tick.house_y_y * house[2, j] + tick.house_y_v * house[3, j]
        out[3, j] = tick.house_w_y * house[2, j] + tick.house_w_w * house[3, j]
    return out
