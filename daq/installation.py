"""What an installation is measured by: readings at rest, the bearing's wall, a slow roll, small hits.

Pure functions of arrays; `daq.setup` gets the arrays from a device.
"""

from math import pi, tau
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from analysis.synchronous import synchronous
from simulator.validation import RigError

Values = NDArray[np.float64]
WIDEST_GAP = pi / 2
"""rad: where the wall was touched nowhere over a wider angle, its centre is not known."""
LEAST_TURNS = 3


class Wall(NamedTuple):
    """The backup bearing's wall as the shaft's centre sees it, in the plane of the probes."""

    centre: Values  # (2,) m
    radius: float  # m
    residual: float  # m rms of the touching points about the circle


class Roll(NamedTuple):
    """A slow roll: which way the encoder counts, and what every probe sees once a turn."""

    counts_up: bool
    speed: float  # rad/s, mean of the encoder's
    runout: Values  # (n,) complex, m: amplitude and phase of the probes' 1X vectors


def wall_of(points: Values) -> Wall:
    """Return the circle through touching points (2, n), by linear least squares (Kasa 1976).

    x2 + y2 = 2 a x + 2 b y + c has the centre (a, b) and the radius sqrt(c + a2 + b2). Raises `RigError`
    where the points do not go all the way round.
    """
    if points.shape[1] < 3:
        raise RigError("the shaft did not touch the wall: push it against the bearing all the way round")
    x, y = points
    basis = np.stack([2.0 * x, 2.0 * y, np.ones_like(x)])
    a, b, c = np.linalg.lstsq(basis.T, x**2 + y**2, rcond=None)[0]
    centre, radius = np.array([a, b]), float(np.sqrt(max(0.0, c + a**2 + b**2)))
    away = points - centre[:, np.newaxis]
    angles = np.sort(np.arctan2(away[1], away[0]))
    gap = float(np.max(np.diff(np.append(angles, angles[0] + tau))))
    if gap > WIDEST_GAP:
        raise RigError(
            f"the shaft touched the wall nowhere over {np.degrees(gap):.0f} deg: push it all the way round"
        )
    residual = float(np.sqrt(np.mean((np.hypot(*away) - radius) ** 2)))
    return Wall(centre, radius, residual)


def roll_of(angle: Values, signals: Values, rate: float) -> Roll:
    """Return what a slow roll in the positive sense shows.

    `angle` (n,) is the encoder's, wrapped, rad; `signals` (n_probes, n), m; `rate` Hz. Raises `RigError`
    where the shaft turned less than three times.
    """
    turned = np.unwrap(angle)
    change = float(turned[-1] - turned[0])
    if abs(change) < LEAST_TURNS * tau:
        raise RigError(
            f"the shaft turned {abs(change) / tau:.1f} times in the slow roll, not {LEAST_TURNS}: "
            "look at drive and encoder"
        )
    forward = turned if change > 0.0 else -turned
    speed = abs(change) * rate / (len(angle) - 1)
    return Roll(change > 0.0, speed, synchronous(forward, signals).vector)


def answers(before: Values, after: Values, direction: Values) -> float:
    """Return how far the shaft's centre moved along a direction in answer to a hit, m; its largest way.

    `before` and `after` (2, n) are its path; `direction` (2,) is the one that the description says.
    """
    way = direction @ (after - before.mean(axis=1, keepdims=True))
    return float(way[np.argmax(np.abs(way))])
