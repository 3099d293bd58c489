"""Impacts in a trace of contact force: where they are, how large, and how two traces agree.

An impact is one unbroken stretch in which the force exceeds a threshold. Two traces, such as truth and
estimate, are compared impact by impact: impacts that overlap in time (within a tolerance) belong
together; what is left over on one side is a miss, on the other a false alarm.
"""

from typing import NamedTuple

import numpy as np


class Impacts(NamedTuple):
    """Impacts in order of time; all arrays (n_impacts,)."""

    start: np.ndarray  # index of the first sample above the threshold
    end: np.ndarray  # index one past the last sample above it
    peak: np.ndarray  # N
    impulse: np.ndarray  # N s

    def select(self, chosen: np.ndarray) -> "Impacts":
        """Return the impacts picked by a mask or an index array."""
        return Impacts(*(values[chosen] for values in self))


class Comparison(NamedTuple):
    """Impacts of a reference trace against those of another; errors are relative to the reference."""

    pairs: np.ndarray  # (n_pairs, 2) indices into reference and other
    peak_error: np.ndarray  # (n_pairs,) other / reference - 1
    impulse_error: np.ndarray  # (n_pairs,)
    missed: np.ndarray  # indices of reference impacts without a partner
    false_alarms: np.ndarray  # indices of the other's impacts without a partner


def find_impacts(force: np.ndarray, rate: float, threshold: float = 0.1) -> Impacts:
    """Find the impacts in `force` (n,), N at `rate` Hz, as stretches above `threshold` N.

    The impulse is the sum of the samples within the stretch over the rate.
    """
    above = np.concatenate([[False], force > threshold, [False]])
    edges = np.flatnonzero(above[1:] != above[:-1])
    start, end = edges[0::2], edges[1::2]
    if start.size == 0:
        return Impacts(start, end, np.empty(0), np.empty(0))
    bounds = np.stack([start, end], axis=1).ravel()
    padded = np.append(force, 0.0)  # an impact may last to the very end of the trace
    return Impacts(
        start,
        end,
        np.maximum.reduceat(padded, bounds)[0::2],
        np.add.reduceat(padded, bounds)[0::2] / rate,
    )


def compare_impacts(reference: Impacts, other: Impacts, tolerance: int, least: float = 5.0) -> Comparison:
    """Match impacts of `reference` with those of `other` that overlap it within `tolerance` samples.

    Only impacts of the reference with a peak above `least` N must be met, and only impacts of the other
    above `least` can be false alarms, so that one that is 4.9 N here and 5.1 N there is neither. Each
    reference impact takes the largest of its candidates.
    """
    pairs = []
    for index in np.flatnonzero(reference.peak > least):
        near = overlapping(other, reference.start[index] - tolerance, reference.end[index] + tolerance)
        if near.size:
            pairs.append((index, near[np.argmax(other.peak[near])]))
    found = np.array(pairs, dtype=int).reshape(-1, 2)
    alarms = [
        index
        for index in np.flatnonzero(other.peak > least)
        if not overlapping(reference, other.start[index] - tolerance, other.end[index] + tolerance).size
    ]
    return Comparison(
        found,
        other.peak[found[:, 1]] / reference.peak[found[:, 0]] - 1.0,
        other.impulse[found[:, 1]] / reference.impulse[found[:, 0]] - 1.0,
        np.setdiff1d(np.flatnonzero(reference.peak > least), found[:, 0]),
        np.array(alarms, dtype=int),
    )


def overlapping(impacts: Impacts, start: int, end: int) -> np.ndarray:
    """Return the indices of impacts that share a sample with [start, end)."""
    first = np.searchsorted(impacts.end, start, side="right")
    last = np.searchsorted(impacts.start, end, side="left")
    return np.arange(first, last)


def correlation(one: np.ndarray, other: np.ndarray) -> float:
    """Return Pearson's correlation of two equally long traces; 0 when one of them does not vary."""
    spread = float(np.std(one) * np.std(other))
    if spread == 0.0:
        return 0.0
    return float(np.mean((one - np.mean(one)) * (other - np.mean(other))) / spread)
