"""Compares a series with the same series computed again, bit by bit and against a bound."""

from collections.abc import Iterable, Iterator
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from daq.messages import TIMING_FLAGS, Series

QUALITY = ~int(TIMING_FLAGS)
TURN = 2.0 * np.pi
ANGLES = ("angle", "contact_angle", "unbalance_phase")  # channels that jump by one turn


@dataclass(frozen=True)
class Difference:
    """Where two series differ.

    Attributes:
        sample: index of the sample.
        channel: name; empty when the message as a whole differs.
        recorded: value there, or what it is that was recorded, in words.
        rerun: the same, computed again.
        size: of the difference, in the channel's unit; NaN where there are no two numbers to compare.
        bound: largest size that counts as equivalent.
        unit: of the channel.
    """

    sample: int
    channel: str
    recorded: float | str
    rerun: float | str
    size: float = float("nan")
    bound: float = 0.0
    unit: str = ""

    def to_json(self) -> dict[str, Any]:
        """Return the fields, with None for what is no number."""
        return {name: None if value != value else value for name, value in asdict(self).items()}

    def __str__(self) -> str:
        if not self.channel:
            return f"sample {self.sample}: recorded {self.recorded}, now {self.rerun}"
        return (
            f"sample {self.sample}, {self.channel}: recorded {self.recorded:.9g} {self.unit}, now "
            f"{self.rerun:.9g} {self.unit}; they differ by {self.size:.3g}, the bound is {self.bound:.3g}"
        )


class Scales:
    """Largest magnitude of each channel of a series."""

    def __init__(self) -> None:
        self._largest: dict[str, float] = {}

    def take(self, series: Series) -> None:
        """Take in one message."""
        finite = np.nan_to_num(np.abs(series.samples), nan=0.0, posinf=0.0)
        for name, value in zip(series.names, finite.max(axis=1, initial=0.0).tolist(), strict=True):
            self._largest[name] = max(value, self._largest.get(name, 0.0))

    def of(self, series: Series) -> np.ndarray:
        """Return the scale of each channel (n_channels, 1)."""
        return np.array([[self._largest.get(name, 0.0)] for name in series.names])


class Comparison:
    """Takes pairs of messages and keeps the account.

    Args:
        bound: what counts as equivalent, as a share of each channel's largest magnitude.
        scales: those magnitudes.
    """

    def __init__(self, bound: float, scales: Scales) -> None:
        self.bound, self._scales = bound, scales
        self.compared = 0
        """Messages compared."""
        self.unrecorded = 0
        """Messages that were computed again although none was recorded."""
        self.unequal: Difference | None = None
        """The first difference of a bit."""
        self.beyond: Difference | None = None
        """The first difference beyond the bound."""
        self.largest = 0.0
        """Largest difference, as a share of its channel's largest magnitude."""

    def take(self, recorded: Series, rerun: Series) -> None:
        """Compare one message with the same one computed again."""
        self.compared += 1
        if _bits(recorded) == _bits(rerun):
            return
        found = _different_kind(recorded, rerun) or self._different_values(recorded, rerun)
        self.unequal = self.unequal or found
        if not found.size <= found.bound:
            self.beyond = self.beyond or found

    def take_all(self, recorded: Iterable[Series], rerun: Iterator[Series]) -> None:
        """Compare recorded messages with those computed again for the same samples."""
        ahead: dict[int, Series] = {}
        reached = -1
        for series in recorded:
            while reached < series.first_sample and (made := next(rerun, None)) is not None:
                reached = made.first_sample
                ahead[reached] = made
            partner = ahead.pop(series.first_sample, None)
            if partner is None:
                self.missing(series)
            else:
                self.take(series, partner)
        self.unrecorded += len(ahead) + sum(1 for _ in rerun)

    def missing(self, recorded: Series) -> None:
        """Note a message that was not computed again."""
        found = Difference(recorded.first_sample, "", "a message", "nothing")
        self.unequal, self.beyond = self.unequal or found, self.beyond or found

    def nearest(self, recorded: Series, candidates: dict[int, Series]) -> int | None:
        """Return the key of the message that is nearest to the recorded one, the lowest of equals."""
        return min(candidates, key=lambda key: self._distance(recorded, candidates[key]), default=None)

    def _distance(self, recorded: Series, rerun: Series) -> float:
        """Return the largest difference as a share of its channel's largest magnitude."""
        if _different_kind(recorded, rerun):
            return float("inf")
        return float(self._shares(recorded, rerun)[1].max(initial=0.0))

    def _shares(self, recorded: Series, rerun: Series) -> tuple[np.ndarray, np.ndarray]:
        """Return the size of each difference, and as a share of its channel's largest magnitude."""
        size = _sizes(recorded, rerun)
        scale = self._scales.of(recorded)
        return size, np.divide(size, scale, out=np.where(size > 0.0, np.inf, 0.0), where=scale > 0.0)

    def _different_values(self, recorded: Series, rerun: Series) -> Difference:
        """Return the first difference beyond the bound, or else the first of all."""
        size, shares = self._shares(recorded, rerun)
        self.largest = max(self.largest, float(shares.max(initial=0.0)))
        wrong = shares > self.bound
        if not wrong.any():
            wrong = recorded.samples.view(np.uint32) != rerun.samples.view(np.uint32)
        column = int(np.flatnonzero(wrong.any(axis=0))[0])
        channel = int(np.argmax(np.where(wrong, shares, -1.0)[:, column]))
        return Difference(
            recorded.first_sample + column * max(recorded.stride, 1),
            recorded.names[channel],
            float(recorded.samples[channel, column]),
            float(rerun.samples[channel, column]),
            float(size[channel, column]),
            self.bound * float(self._scales.of(recorded)[channel, 0]),
            recorded.units[channel],
        )


def _sizes(recorded: Series, rerun: Series) -> np.ndarray:
    """Return the size of each difference; infinite where only one of the two is a number."""
    before, now = recorded.samples.astype(np.float64), rerun.samples.astype(np.float64)
    with np.errstate(invalid="ignore"):
        size = np.abs(now - before)
    for name in set(ANGLES) & set(recorded.names):
        row = size[recorded.names.index(name)]
        row[:] = np.minimum(row, np.abs(TURN - row))
    size[(before == now) | (np.isnan(before) & np.isnan(now))] = 0.0
    size[np.isnan(size)] = np.inf
    return size


def _bits(series: Series) -> tuple[object, ...]:
    """Return what a signal digest covers."""
    quality = series.status & QUALITY
    return (
        series.first_sample,
        quality,
        series.names,
        series.units,
        series.samples.shape,
        series.samples.tobytes(),
    )


def _different_kind(recorded: Series, rerun: Series) -> Difference | None:
    """Return how two messages differ other than in their values, if they do."""
    for what, before, now in (
        ("channels", recorded.names, rerun.names),
        ("units", recorded.units, rerun.units),
        ("shape", recorded.samples.shape, rerun.samples.shape),
        ("status", recorded.status & QUALITY, rerun.status & QUALITY),
    ):
        if before != now:
            return Difference(recorded.first_sample, "", f"{what} {before}", f"{what} {now}")
    return None
