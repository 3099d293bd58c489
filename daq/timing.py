"""When sample 0 was, by the host's clock."""

from collections.abc import Callable
from time import monotonic_ns, time_ns
from typing import NamedTuple

ATTEMPTS = 5


class StartTime(NamedTuple):
    """UTC of sample 0 in ns since 1970, how far off it may be, and whose clock it is."""

    t0_ns: int
    uncertainty_ns: int
    source: str

    def timestamp(self, sample: int, rate: float) -> float:
        """Return the UTC of a sample in s since 1970."""
        return self.t0_ns * 1e-9 + sample / rate


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
