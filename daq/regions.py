"""Marked regions: the stretch around a trip, an impact or a mark, told by one event when it is over.

Everything is recorded anyway; a region says which stretch of it somebody will want to look at.
"""

from collections.abc import Iterator
from typing import NamedTuple

TRIGGERS = ("trip", "lease_lost", "failure", "mark")
"""Kinds of the daq's events that begin a region or prolong one."""
KIND = "region"


class Region(NamedTuple):
    """A stretch from sample `first` to `last`, and what happened in it, in order and each once."""

    first: int
    last: int
    causes: tuple[str, ...]

    def text(self, rate: float) -> str:
        """Return one sentence that tells it."""
        seconds = (self.last - self.first + 1) / rate
        return f"region of {seconds:.2f} s around {', '.join(self.causes)}"

    def details(self) -> dict[str, object]:
        """Return it as an event's details."""
        return {"first": self.first, "last": self.last, "causes": ", ".join(self.causes)}


class Regions:
    """Collects what triggers; triggers whose stretches overlap make one region.

    Args:
        before: samples before a trigger that belong to its region.
        after: samples after it.
    """

    def __init__(self, before: int, after: int) -> None:
        self._before = before
        self._after = after
        self._open: Region | None = None

    def trigger(self, sample: int, cause: str) -> None:
        """Begin a region, or prolong the one that is open."""
        region = self._open or Region(max(0, sample - self._before), sample, ())
        causes = region.causes if cause in region.causes else (*region.causes, cause)
        first = min(region.first, max(0, sample - self._before))
        self._open = Region(first, max(region.last, sample + self._after), causes)

    def over(self, sample: int, ending: bool = False) -> Iterator[Region]:
        """Yield the region that is over when the samples before `sample` are there, or with the run's end."""
        region = self._open
        if region and (ending or sample > region.last):
            self._open = None
            yield region._replace(last=min(region.last, max(region.first, sample - 1)))
