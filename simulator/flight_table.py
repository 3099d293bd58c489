"""Tables of flights at constant speed: the exact map through 0, 1, 2, ... ticks, and what loads add."""

from math import nan

import numpy as np

from simulator.clearance import least_clearance
from simulator.dynamics import Tick, static_moment
from simulator.flight import (
    BLOCK,
    HOUSE,
    OF_RATE,
    OF_TILT,
    OF_UNBALANCE,
    OF_WEIGHT,
    RING,
    TABLE_ROWS,
    VECTOR,
    Flight,
)
from simulator.rig import DriveMode, Model
from simulator.state import STATE
from simulator.tick import product

TERMS = 30  # of the exponentials' series
MOST_TURN = 2.0  # rad of the fastest motion in a tick for which the series are exact
TO_SPARE = 1e-6  # m of clearance, within which a flight is not taken at once

Vector = tuple[complex, complex]


def flight_at(model: Model, tick: Tick, speed: float) -> Flight:
    """Return the flight of a model at a constant speed (rad/s), or none where it is not exact."""
    bearing, rotor = model.backup_bearing, model.rotor
    turn = tick.length * (tick.flight_rate + tick.gyroscopic * abs(speed))
    possible = model.drive.mode == DriveMode.IDEAL and turn <= MOST_TURN
    table = np.zeros((TABLE_ROWS, BLOCK + 1))
    if possible:
        fill_rotor(table, model, tick.length, speed)
        fill_house(table, tick)
    return Flight(
        table,
        np.full(3 + len(STATE), -1.0),
        speed if possible else nan,
        tick.length,
        rotor.disk_station * rotor.unbalance * speed * speed,
        rotor.unbalance_angle,
        rotor.bearing_station,
        max(least_clearance(bearing) - TO_SPARE, 0.0),
    )


def fill_rotor(table: np.ndarray, model: Model, length: float, speed: float) -> None:
    """Fill the rows of tilt and tilt rate."""
    rotor, magnet = model.rotor, model.magnetic_bearing
    arm = rotor.magnet_station * rotor.magnet_station
    spring = -(magnet.stiffness * arm + rotor.pivot_stiffness) / rotor.inertia
    damper = (1j * rotor.polar_inertia * speed - magnet.damping * arm) / rotor.inertia
    load = 1.0 / rotor.inertia
    of_tilt = series(spring, damper, 0.0, 0.0, (1.0, 0.0), length)
    of_rate = series(spring, damper, 0.0, 0.0, (0.0, 1.0), length)
    of_held = series(spring, damper, load, 0.0, (0.0, 0.0), length)
    of_turning = series(spring, damper, load, 1j * speed, (0.0, 0.0), length)
    turn = exponential(1j * speed * length)
    weight = 1j * static_moment(rotor)
    tilt, rate, held, turning, phase = (1.0 + 0j, 0j), (0j, 1.0 + 0j), (0j, 0j), (0j, 0j), 1.0 + 0j
    for k in range(BLOCK + 1):
        for part in range(2):
            row = part * VECTOR
            put(table, row + OF_TILT, k, tilt[part])
            put(table, row + OF_RATE, k, rate[part])
            put(table, row + OF_UNBALANCE, k, turning[part])
            put(table, row + OF_WEIGHT, k, held[part] * weight)
        tilt, rate = mapped(of_tilt, of_rate, tilt), mapped(of_tilt, of_rate, rate)
        held = plus(mapped(of_tilt, of_rate, held), of_held, 1.0)
        turning = plus(mapped(of_tilt, of_rate, turning), of_turning, phase)
        phase *= turn


def series(
    spring: complex, damper: complex, load: float, turning: complex, start: Vector, length: float
) -> Vector:
    """Return (w, w') after `length` s of w'' = spring w + damper w' + load exp(turning t), from `start`."""
    w, v, p = (*start, 1.0 + 0j)
    total: Vector = start
    for order in range(1, TERMS):
        scale = length / order
        w, v, p = scale * v, scale * (spring * w + damper * v + load * p), scale * turning * p
        total = (total[0] + w, total[1] + v)
    return total


def exponential(exponent: complex) -> complex:
    """Return e to a small exponent."""
    total, term = 1.0 + 0j, 1.0 + 0j
    for order in range(1, TERMS):
        term *= exponent / order
        total += term
    return total


def mapped(of_tilt: Vector, of_rate: Vector, vector: Vector) -> Vector:
    """Return a vector after one tick more."""
    return (
        of_tilt[0] * vector[0] + of_rate[0] * vector[1],
        of_tilt[1] * vector[0] + of_rate[1] * vector[1],
    )


def plus(a: Vector, b: Vector, scale: complex) -> Vector:
    """Return a + scale b."""
    return a[0] + scale * b[0], a[1] + scale * b[1]


def put(table: np.ndarray, row: int, k: int, value: complex) -> None:
    """Write real and imaginary part one below the other."""
    table[row, k], table[row + 1, k] = value.real, value.imag


def fill_house(table: np.ndarray, tick: Tick) -> None:
    """Fill the rows of house and ring."""
    x, y, ring = (1.0, 0.0, 0.0, 1.0), (1.0, 0.0, 0.0, 1.0), 1.0
    one_x = (tick.house_x_x, tick.house_x_v, tick.house_v_x, tick.house_v_v)
    one_y = (tick.house_y_y, tick.house_y_v, tick.house_w_y, tick.house_w_w)
    for k in range(BLOCK + 1):
        table[HOUSE : HOUSE + 4, k], table[HOUSE + 4 : HOUSE + 8, k], table[RING, k] = x, y, ring
        x, y, ring = product(one_x, x), product(one_y, y), tick.ring_decay * ring
