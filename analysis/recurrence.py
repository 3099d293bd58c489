"""Whether a motion repeats, by its Poincaré marks: where the shaft's centre is at the end of each turn."""

import numpy as np


def dispersion(marks: np.ndarray, longest: int) -> float:
    """Return how far marks (n,), complex, are from repeating; NaN when they are not all known.

    It is the median distance between marks p revolutions apart, for the p up to `longest` for which it is
    least: zero for a periodic motion, near the attractor's size for a chaotic one. A motion of two periods
    comes back closely within some revolutions.
    """
    periods = range(1, min(longest, marks.size - 1) + 1)
    apart = [float(np.median(np.abs(marks[p:] - marks[:-p]))) for p in periods]
    return min(apart, default=float("nan"))


def divergence(marks: np.ndarray, turns: int, resolution: float) -> float:
    """Return by which factor nearly equal motions are farther apart `turns` revolutions later.

    `marks` (n,), complex; two in a row tell a motion, as position and velocity would. Each is followed beside
    the one that is nearest to it, and the median factor returned: about 1 for a motion of one or two periods,
    more for a chaotic one (Rosenstein, Collins and De Luca, Physica D 65, 1993). Distances below
    `resolution`, in the marks' unit, count as that. NaN when marks are unknown or too few.
    """
    pairs = np.stack([marks[1:], marks[:-1]])
    apart = np.sqrt(np.sum(np.abs(pairs[:, :, np.newaxis] - pairs[:, np.newaxis]) ** 2, axis=0)) + resolution
    count = len(apart) - turns
    if count < 2 or np.isnan(apart).any():
        return float("nan")
    before = apart[:count, :count] + np.diag(np.full(count, np.inf))
    each = np.arange(count)
    nearest = np.argmin(before, axis=1)
    return float(np.median(apart[turns + each, turns + nearest] / before[each, nearest]))
