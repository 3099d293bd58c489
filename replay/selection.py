"""Chooses recordings of a catalogue by what they tell of themselves."""

from dataclasses import dataclass, field
from datetime import date

from replay.catalogue import Entry


@dataclass(frozen=True)
class Selection:
    """What a recording must be; None: anything.

    Attributes:
        rig: name.
        bearing: kind of backup bearing.
        since: first day of its start, UTC.
        until: last day of its start, UTC.
        event: kind of an event that it has.
        min_speed_hz: least value of its largest speed, Hz.
        max_speed_hz: largest value of its largest speed, Hz.
        tripped: whether the protection tripped.
        meta: what people told of it.
    """

    rig: str | None = None
    bearing: str | None = None
    since: date | None = None
    until: date | None = None
    event: str | None = None
    min_speed_hz: float | None = None
    max_speed_hz: float | None = None
    tripped: bool | None = None
    meta: dict[str, str] = field(default_factory=dict)

    def judge(self, entry: Entry) -> bool | None:
        """Return whether a recording is wanted; None when it does not tell what decides it."""
        if not self._is_of_the_kind(entry):
            return False
        happened = entry.overview
        if happened is None:
            asked = (self.event, self.min_speed_hz, self.max_speed_hz, self.tripped)
            return True if asked == (None, None, None, None) else None
        return (
            (self.event is None or happened.events[self.event] > 0)
            and (self.min_speed_hz is None or happened.max_speed_hz >= self.min_speed_hz)
            and (self.max_speed_hz is None or happened.max_speed_hz <= self.max_speed_hz)
            and (self.tripped is None or self.tripped == bool(happened.trips))
        )

    def _is_of_the_kind(self, entry: Entry) -> bool:
        """Whether that which stands at the beginning of the file fits."""
        return (
            self.rig in (None, entry.rig)
            and self.bearing in (None, entry.bearing)
            and (self.since is None or entry.day >= self.since)
            and (self.until is None or entry.day <= self.until)
            and self.meta.items() <= entry.meta.items()
        )
