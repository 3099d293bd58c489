"""Events: what happened at one sample, numbered by its source, dated by sample index."""

from collections.abc import Callable, Mapping

from daq import keys
from daq.messages_pb2 import INFO, Event, Severity
from daq.timing import StartTime

Publish = Callable[[str, bytes], None]
SOURCE = "daq"


class EventCounter:
    """Makes the events of one source, numbered from 0."""

    def __init__(self, source: str) -> None:
        self._source = source
        self._sequence = 0

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
    """Publishes the daq's events of one run.

    Args:
        rig: name of the rig.
        run: run id.
        rate: Hz, of the sample index.
        start: UTC of sample 0.
        publish: takes key and payload.
    """

    def __init__(self, rig: str, run: str, rate: float, start: StartTime, publish: Publish) -> None:
        self._key = keys.event(rig, SOURCE)
        self._run = run
        self._rate = rate
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
        timestamp = self._start.timestamp(sample, self._rate)
        payload = self._events.make(kind, text, sample, severity, details, run=self._run, timestamp=timestamp)
        self._publish(self._key, payload)
