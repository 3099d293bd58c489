"""What happened in a recording, in few numbers: written at its end, so that many are listed at once."""

import json
from collections import Counter
from dataclasses import dataclass, field

from daq import keys
from daq.messages_pb2 import Event, Summary

RECORD = "overview"
"""Name of the metadata record; its values are JSON."""


@dataclass
class Overview:
    """Extremes and counts of one recording, made message by message.

    Attributes:
        max_speed_hz: largest mean speed of a block, Hz; of either direction.
        radius_maximum: of the shaft's centre at the backup bearing's plane, m.
        force_maximum: resultant of the transducers, N.
        events: how often each kind of event came.
        trips: cause of each trip, in order.
    """

    max_speed_hz: float = 0.0
    radius_maximum: float = 0.0
    force_maximum: float = 0.0
    events: Counter[str] = field(default_factory=Counter)
    trips: list[str] = field(default_factory=list)

    def take(self, key: str, payload: bytes) -> None:
        """Take in a message; those of other kinds than events and summaries change nothing."""
        if key.endswith("/event"):
            self._take_event(Event.FromString(payload))
        elif key.endswith("/daq/summary"):
            summary = Summary.FromString(payload)
            self.max_speed_hz = max(self.max_speed_hz, abs(summary.speed_hz))
            self.radius_maximum = max(self.radius_maximum, summary.radius_maximum)
            self.force_maximum = max(self.force_maximum, summary.force_maximum)

    def add(self, other: "Overview") -> None:
        """Take in what happened in a continuation."""
        self.max_speed_hz = max(self.max_speed_hz, other.max_speed_hz)
        self.radius_maximum = max(self.radius_maximum, other.radius_maximum)
        self.force_maximum = max(self.force_maximum, other.force_maximum)
        self.events.update(other.events)
        self.trips += other.trips

    def to_metadata(self) -> dict[str, str]:
        """Return the fields as text, as a recording stores them."""
        return {name: json.dumps(value) for name, value in vars(self).items()}

    @classmethod
    def from_metadata(cls, texts: dict[str, str]) -> "Overview":
        """Read the fields from a recording's text.

        Raises:
            ValueError: the text is no overview.
        """
        try:
            values = {name: json.loads(text) for name, text in texts.items()}
            return cls(**values | {"events": Counter(values["events"])})
        except (TypeError, KeyError) as error:
            raise ValueError(f"the overview is not readable: {error}") from error

    def _take_event(self, event: Event) -> None:
        self.events[event.kind] += 1
        if event.kind in ("trip", "lease_lost"):
            self.trips.append(event.details.get("cause", event.text))


def topics(rig: str) -> list[str]:
    """Return the topics that an overview is made of."""
    return [keys.summary(rig), *(keys.event(rig, source) for source in ("daq", "operator", "twin"))]
