"""Watches pairs of transducers that face each other: what one reads, the other reads with the other sign."""

from typing import NamedTuple

import numpy as np

from analysis.cusum import Cusum
from daq.rig import Rig
from daq.rig.channels import Channel
from twin.fault import Fault
from twin.windows import Window

AUDIBLE = 1.0  # N from which a sample counts when gain and lag are looked at
LEAST = 100  # such samples in a window
REFERENCE = 4  # windows that tell what is usual
SMOOTHED = 9  # samples whose mean is taken first, lest noise hide a lag
OFFSET = 0.1  # N by which a mean without contact may vary
GAIN = 0.02  # by which the ratio of two gains may vary
LAG = 4e-6  # s by which two readings may lag
USUAL, THRESHOLD, MOST = 4.0, 20.0, 15.0  # of the cumulative sums of squares of deviations


class Pair(NamedTuple):
    """What one window tells of two transducers."""

    gain: float  # of the first less that of the second, over their mean
    lag: float  # s, of the first behind the second
    deviations: np.ndarray  # (2,) of gain and lag, by the noise
    rms: np.ndarray  # (2,) N, of each


class TransducerWatch:
    """Compares offsets without contact, and gains and lags with contact, with what they were at first.

    Args:
        rig: for its force channels; those without a partner that faces them are not watched.
    """

    def __init__(self, rig: Rig) -> None:
        self._channels = [each for each in rig.channels if each.quantity == "force" and each.station]
        self._pairs = facing(self._channels)
        self._seen: list[list[tuple[int, Pair]]] = [[] for _ in self._pairs]  # by sample, since the first
        self._first_means: np.ndarray | None = None
        self._offsets = [Cusum(USUAL, THRESHOLD, MOST) for _ in self._channels]
        self._gains = [Cusum(USUAL, THRESHOLD, MOST) for _ in self._pairs]
        self._lags = [Cusum(USUAL, THRESHOLD, MOST) for _ in self._pairs]

    def add(self, window: Window) -> list[Fault]:
        """Take in a window and return what it proves."""
        if window.free:
            return self._offset(window)
        faults = []
        for index, (one, other) in enumerate(self._pairs):
            pair = pair_of(window.forces[[one, other]], window.rate)
            if pair:
                faults += self._compare(index, pair, window.first_sample)
        return faults

    def forget(self) -> None:
        """Learn what is usual anew."""
        for seen in self._seen:
            seen.clear()
        self._first_means = None
        for each in (*self._offsets, *self._gains, *self._lags):
            each.reset()

    def _offset(self, window: Window) -> list[Fault]:
        """Return which transducers have drifted."""
        means = window.forces.mean(axis=1)
        if self._first_means is None:
            self._first_means = means
        change = means - self._first_means
        for index, each in enumerate(self._offsets):
            if each.add((change[index] / OFFSET) ** 2, window.first_sample):
                onset, name = each.onset or window.first_sample, self._channels[index].name
                self.forget()
                return [Fault("drift", name, float(change[index]), "N", 1.0, onset)]
        return []

    def _compare(self, index: int, now: Pair, sample: int) -> list[Fault]:
        """Return what has changed between the two of a pair."""
        seen = self._seen[index]
        seen.append((sample, now))
        if len(seen) <= REFERENCE:
            return []
        first = combined([pair for _, pair in seen[:REFERENCE]])
        gain, lag = ratio(now.gain) / ratio(first.gain), now.lag - first.lag
        deviations = np.hypot(now.deviations, first.deviations)
        if self._gains[index].add(((gain - 1.0) / deviations[0]) ** 2, sample):
            onset = self._gains[index].onset or sample
            culprit = self._louder_or_softer(index, onset, now)
            return self._told(index, culprit, "gain", gain if culprit == 0 else 1.0 / gain, onset)
        if self._lags[index].add((lag / deviations[1]) ** 2, sample):
            onset = self._lags[index].onset or sample
            return self._told(index, int(lag < 0.0), "skew", abs(lag), onset)
        return []

    def _louder_or_softer(self, index: int, onset: int, now: Pair) -> int:
        """Return which of a pair reads otherwise than just before `onset`, more than its partner does."""
        before = [pair for sample, pair in self._seen[index] if sample < onset]
        change = np.abs(np.log(now.rms / before[-1].rms))
        return int(np.argmax(change))

    def _told(self, index: int, culprit: int, kind: str, size: float, onset: int) -> list[Fault]:
        channel = self._channels[self._pairs[index][culprit]]
        self.forget()
        return [Fault(kind, channel.name, size, "s" if kind == "skew" else "", 1.0, onset)]


def ratio(difference: float) -> float:
    """Return the ratio of two gains whose difference over their mean is given."""
    return (1.0 + 0.5 * difference) / max(1.0 - 0.5 * difference, 1e-6)


def facing(channels: list[Channel]) -> list[tuple[int, int]]:
    """Return the pairs of channels at one station that look in opposite directions."""
    return [
        (i, j)
        for i, one in enumerate(channels)
        for j, other in enumerate(channels)
        if i < j
        and one.station == other.station
        and abs(((one.angle_deg or 0.0) - (other.angle_deg or 0.0)) % 360.0 - 180.0) < 1e-6
    ]


def combined(pairs: list[Pair]) -> Pair:
    """Return the mean of pairs, each with the weight that its deviations deserve."""
    values = np.array([[pair.gain, pair.lag] for pair in pairs])
    weights = np.array([pair.deviations for pair in pairs]) ** -2.0
    gain, lag = np.sum(weights * values, axis=0) / weights.sum(axis=0)
    rms = np.mean([pair.rms for pair in pairs], axis=0)
    return Pair(float(gain), float(lag), weights.sum(axis=0) ** -0.5, rms)


def pair_of(readings: np.ndarray, rate: float) -> Pair | None:
    """Return gain and lag of the first of two `readings` (2, n) against the second with its sign changed.

    None where too little is heard.

    With h what both see, the first reads (1 + g / 2) h(t - lag / 2), the second -(1 - g / 2) h(t + lag / 2):
    half their difference is h, and their sum g h - lag h'. Equal noise in both biases neither.
    """
    one, other = (
        np.convolve(each - each.mean(), np.full(SMOOTHED, 1.0 / SMOOTHED), "same") for each in readings
    )
    seen = 0.5 * (one - other)
    audible = np.abs(seen) > AUDIBLE
    basis = np.stack([seen, -np.gradient(seen) * rate])[:, audible]
    if np.count_nonzero(audible) < LEAST:
        return None
    both, spread = (one + other)[audible], np.linalg.inv(basis @ basis.T)
    found = spread @ (basis @ both)
    # The mean of neighbours makes noise alike over as many samples.
    noise = SMOOTHED * np.mean((both - found @ basis) ** 2)
    deviations = np.hypot(np.sqrt(noise * np.diag(spread)), (GAIN, LAG))
    return Pair(float(found[0]), float(found[1]), deviations, np.sqrt(np.mean(readings**2, axis=1)))
