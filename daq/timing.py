"""When sample 0 was by the host's clock, and from there when any other was."""

from collections.abc import Callable
from datetime import UTC, date, datetime
from time import monotonic_ns, time_ns
from typing import NamedTuple

ATTEMPTS = 5
NS = 10**9


class StartTime(NamedTuple):
    """UTC of sample 0 in ns since 1970, how far off it may be, and whose clock it is."""

    t0_ns: int
    uncertainty_ns: int
    source: str

    def timestamp(self, sample: int, rate: float) -> float:
        """Return the UTC of a sample in s since 1970."""
        return self.t0_ns * 1e-9 + sample / rate

    @property
    def day(self) -> date:
        """UTC day of sample 0."""
        return datetime.fromtimestamp(self.t0_ns * 1e-9, UTC).date()


class SampleClock:
    """Turns sample indices of a run into ns since 1970 UTC, as exact integers."""

    def __init__(self, t0_ns: int, rate: float) -> None:
        self.t0_ns = t0_ns
        self._samples, self._seconds = rate.as_integer_ratio()

    def ns(self, sample: int) -> int:
        """Return when a sample happened, rounded down to 1 ns."""
        return self.t0_ns + self.elapsed_ns(sample)

    def elapsed_ns(self, sample: int) -> int:
        """Return the time from sample 0 to a sample, rounded down to 1 ns."""
        return sample * NS * self._seconds // self._samples


def start_timed(start: Callable[[], None]) -> StartTime:
    """Call `start` and estimate when it happened.

    The UTC clock is read between two readings of the monotonic clock, the tightest of several attempts,
    and carried back to the middle of the call.
    """
    before = monotonic_ns()
    start()
    after = monotonic_ns()
    width, middle, utc = min(_bracket() for _ in range(ATTEMPTS))
    started = (before + after) // 2
    return StartTime(utc - (middle - started), (width + after - before) // 2 + 1, "host clock")


def _bracket() -> tuple[int, int, int]:
    """Return the width of the bracket, its middle and the UTC read within, in ns."""
    before = monotonic_ns()
    utc = time_ns()
    after = monotonic_ns()
    return after - before, (before + after) // 2, utc
