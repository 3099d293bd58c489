"""The map of free flight through a tick, as polynomials of the shaft's speed."""

from functools import lru_cache

import numpy as np

from simulator.clearance import least_clearance
from simulator.dynamics import LEAST_GAP, Tick, static_moment
from simulator.flight_block import ROW, TABLE_SPEED, WORK, Flight, Polynomial
from simulator.rig import Model
from simulator.state import SIGNALS

MOST_TURN = 0.0125  # rad of the fastest motion in a tick: what the polynomials leave out is 1e-9 of a load
TERMS = 8  # of the series in time: the next is 1e-17 at most
NONE: Polynomial = (0.0, 0.0, 0.0, 0.0)
ONE: Polynomial = (1.0, 0.0, 0.0, 0.0)


def flight_of(model: Model, tick: Tick) -> Flight:
    """Return a model's free flight through a tick."""
    rotor, magnet = model.rotor, model.magnetic_bearing
    arm = rotor.magnet_station * rotor.magnet_station
    spring = -(magnet.stiffness * arm + rotor.pivot_stiffness) / rotor.inertia
    drag, spin = -magnet.damping * arm / rotor.inertia, rotor.polar_inertia / rotor.inertia

    def through(
        tilt: Polynomial, rate: Polynomial, moment: float, turning: bool
    ) -> tuple[Polynomial, Polynomial]:
        load = scaled(moment / rotor.inertia, ONE)
        return series(spring, drag, spin, (tilt, rate, load), turning, tick.length)

    of_tilt, of_rate = through(ONE, NONE, 0.0, False), through(NONE, ONE, 0.0, False)
    of_unbalance, of_weight = through(NONE, NONE, 1.0, True), through(NONE, NONE, static_moment(rotor), False)
    return Flight(
        *(of_tilt[0], of_rate[0], of_unbalance[0], of_weight[0]),
        *(of_tilt[1], of_rate[1], of_unbalance[1], of_weight[1]),
        unbalance=rotor.disk_station * rotor.unbalance,
        unbalance_angle=rotor.unbalance_angle,
        late_load=tick.length**2 / 6.0 * rotor.disk_station * rotor.unbalance / rotor.inertia,
        shaft_response=tick.length / (model.drive.inertia + rotor.polar_inertia),
        rate=1.0 / tick.length,
        fastest=(MOST_TURN / tick.length - tick.flight_rate) / tick.gyroscopic,
        room=max(least_clearance(model.backup_bearing) - LEAST_GAP, 0.0),
        work=memory(),
        spare=np.zeros((len(SIGNALS), ROW)),
    )


def memory() -> np.ndarray:
    """Return working memory (WORK,) in which there is neither a table nor a block yet."""
    work = np.zeros(WORK)
    work[TABLE_SPEED] = np.nan
    return work


@lru_cache(maxsize=64)  # rigs of a sweep differ in little, and all make theirs under the interpreter's lock
def series(
    spring: float,
    drag: float,
    spin: float,
    start: tuple[Polynomial, Polynomial, Polynomial],
    turning: bool,
    length: float,
) -> tuple[Polynomial, Polynomial]:
    """Return (w, w') after `length` s of w'' = spring w + (drag + spin p) w' + f, as polynomials of p.

    `start` is (w, w', f) at the beginning; f stays or, if `turning`, is multiplied by exp(p t).
    """
    w, v, f = start
    total_w, total_v = w, v
    for order in range(1, TERMS):
        scale = length / order
        pull = plus(plus(scaled(spring, w), scaled(drag, v)), plus(scaled(spin, times_p(v)), f))
        w, v = scaled(scale, v), scaled(scale, pull)
        f = scaled(scale, times_p(f)) if turning else NONE
        total_w, total_v = plus(total_w, w), plus(total_v, v)
    return total_w, total_v


def times_p(a: Polynomial) -> Polynomial:
    """Return p times a polynomial of p, without what goes beyond the last term."""
    return 0.0, a[0], a[1], a[2]


def plus(a: Polynomial, b: Polynomial) -> Polynomial:
    """Return the sum of two polynomials."""
    return a[0] + b[0], a[1] + b[1], a[2] + b[2], a[3] + b[3]


def scaled(factor: float, a: Polynomial) -> Polynomial:
    """Return a number times a polynomial."""
    return factor * a[0], factor * a[1], factor * a[2], factor * a[3]
