"""What an engineer reads off an orbit: its largest radius, its Poincaré sections, where it crosses a line.

An orbit is an array (2, n): x and y of the shaft's centre in the bearing, in m, at a constant rate.
"""

import numpy as np

TURN = 2.0 * np.pi


def largest_radius(orbit: np.ndarray) -> float:
    """Return the largest distance of an `orbit` (2, n) from the bearing's centre, in its unit; 0 if empty."""
    return float(np.hypot(orbit[0], orbit[1]).max(initial=0.0))


def once_a_turn(angle: np.ndarray, signals: np.ndarray, at: float = 0.0) -> np.ndarray:
    """Sample `signals` (k, n) each time the shaft `angle` (n,), unwrapped, in rad, passes `at`: (k, m).

    This is the stroboscopic Poincaré section: one point for a motion that repeats each turn, p points for
    one that repeats each p turns, a scatter for chaos. Values between samples are interpolated linearly,
    so the error is (turn per sample)^2 / 8 of the signal's second derivative by angle. The shaft must turn
    one way.
    """
    turned = angle if angle.size == 0 or angle[-1] >= angle[0] else -angle
    offset = at if turned is angle else -at
    passages = np.floor((turned - offset) / TURN)
    before = np.flatnonzero(np.diff(passages) > 0.0)
    targets = TURN * passages[before + 1] + offset
    weight = (targets - turned[before]) / (turned[before + 1] - turned[before])
    return np.asarray(signals[:, before] * (1.0 - weight) + signals[:, before + 1] * weight)


def crossings(orbit: np.ndarray, rate: float) -> np.ndarray:
    """Return where an `orbit` (2, n), sampled at `rate` Hz, crosses the vertical line x = 0: (3, m).

    The rows are y, in the orbit's unit, and the velocities along x and y there, in that unit a second.
    Crossings both ways count, as in P1's bifurcation diagram.
    """
    x, y = orbit
    before = np.flatnonzero((x[:-1] < 0.0) != (x[1:] < 0.0))
    if before.size == 0:
        return np.empty((3, 0))
    rise_x, rise_y = x[before + 1] - x[before], y[before + 1] - y[before]
    return np.stack([y[before] - x[before] / rise_x * rise_y, rise_x * rate, rise_y * rate])
