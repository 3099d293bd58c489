"""Events: what happened at one sample, numbered by its source, dated by sample index."""

from collections.abc import Callable, Mapping

from daq import keys
from daq.messages_pb2 import INFO, Event, Severity
from daq.regions import KIND, TRIGGERS, Regions
from daq.rig import Rig
from daq.timing import StartTime

Publish = Callable[[str, bytes], None]
SOURCE = "daq"
LEFT_OUT = "left_out"
"""Kind of the daq's event that tells samples `first` to `last`, which were not to be recorded."""


class EventCounter:
    """Makes the events of one source, numbered from `first` on."""

    def __init__(self, source: str, first: int = 0) -> None:
        self._source = source
        self._sequence = first

    def make(
        self,
        kind: str,
        text: str,
        sample: int,
        severity: Severity = INFO,
        details: Mapping[str, object] | None = None,
        *,
        run: str,
        timestamp: float,
    ) -> bytes:
        """Return the next event's payload; `details` become texts, `timestamp` is in s since 1970 UTC."""
        event = Event(
            timestamp=timestamp,
            run=run,
            sample=sample,
            sequence=self._sequence,
            severity=severity,
            source=self._source,
            kind=kind,
            text=text,
            details={name: str(value) for name, value in (details or {}).items()},
        )
        self._sequence += 1
        return event.SerializeToString(deterministic=True)


class EventLog:
    """Publishes the daq's events of one run, and the regions around them.

    Args:
        rig: its name, rate and regions.
        run: run id.
        start: UTC of sample 0.
        publish: takes key and payload.
    """

    def __init__(self, rig: Rig, run: str, start: StartTime, publish: Publish) -> None:
        self._key = keys.event(rig.name, SOURCE)
        self._run = run
        self._rate = rig.acquisition.rate
        self._regions = Regions(*rig.regions)
        self._start = start
        self._publish = publish
        self._events = EventCounter(SOURCE)

    def add(
        self,
        kind: str,
        text: str,
        sample: int,
        severity: Severity = INFO,
        details: Mapping[str, object] | None = None,
    ) -> None:
        """Publish one event; `details` are written as texts."""
        if kind in TRIGGERS:
            self._regions.trigger(sample, kind)
        timestamp = self._start.timestamp(sample, self._rate)
        payload = self._events.make(kind, text, sample, severity, details, run=self._run, timestamp=timestamp)
        self._publish(self._key, payload)

    def advance(self, sample: int, ending: bool = False) -> None:
        """Publish the region that is over now that the samples before `sample` are there, or with the run."""
        for region in self._regions.over(sample, ending):
            self.add(KIND, region.text(self._rate), sample, details=region.details())
