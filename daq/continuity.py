"""Follows a device's count of samples: what is missing, what comes twice, and when it keeps wrong time."""

from typing import NamedTuple

from daq.backend import Reading

LATE_AFTER = 0.05
"""s for which a device may deliver nothing of what it has taken before that is an event."""
DRIFT_WINDOW = 50.0
"""s over which the device's clock is compared with the host's."""
MOST_DRIFT = 0.05
"""s that they may part within the window: 1000 ppm, ten times what a converter's clock may be off."""


class Arrival(NamedTuple):
    """What is to be said of a reading: samples lost before it, come again before it, and how late it is."""

    reading: Reading  # without what had come already
    missing: int
    again: int
    late: int  # samples that the device took while it delivered none, beyond those missing


class Continuity:
    """Compares each reading with those before it.

    Args:
        rate: of the samples, Hz.
    """

    def __init__(self, rate: float) -> None:
        self._most_late = LATE_AFTER * rate
        self._next = 0
        self._again = 0  # samples that have come again since the last new one
        self._empty_since: int | None = None  # the device's clock when it first delivered nothing

    def nothing(self, clock: int) -> None:
        """Note that a read gave nothing although the device's clock says that there is something."""
        if self._empty_since is None:
            self._empty_since = clock

    def admit(self, reading: Reading, clock: int) -> Arrival:
        """Take a reading that is not empty. What is to be said comes with the next new sample."""
        end = reading.first_sample + reading.n_samples
        first = min(max(reading.first_sample, self._next), end)
        old = first - reading.first_sample
        fresh = Reading(first, end - first, reading.flags)
        self._again += old
        if not fresh.n_samples:
            return Arrival(fresh, 0, 0, 0)
        missing = first - self._next
        late = clock - self._empty_since - missing if self._empty_since is not None else 0
        arrival = Arrival(fresh, missing, self._again, late if late > self._most_late else 0)
        self._next, self._again, self._empty_since = end, 0, None
        return arrival


class DriftWatch:
    """Compares the device's clock with the host's, over one window after the other.

    Args:
        rate: of the device's samples, Hz.
    """

    def __init__(self, rate: float) -> None:
        self._rate = rate
        self._elapsed = 0.0
        self._first: int | None = None  # the device's clock at the window's beginning
        self._told = False

    def elapse(self, seconds: float, clock: int) -> float:
        """Let the host's time pass; return the device's excess in ppm, once, when it is too large; else 0."""
        if self._first is None:
            self._first, self._elapsed = clock, 0.0
            return 0.0
        self._elapsed += seconds
        apart = (clock - self._first) / self._rate - self._elapsed
        if abs(apart) > MOST_DRIFT and not self._told:
            self._told = True
            return 1e6 * apart / self._elapsed
        if self._elapsed >= DRIFT_WINDOW:
            self._first, self._elapsed = clock, 0.0
        return 0.0
