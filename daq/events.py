"""The daq's events: numbered, dated by sample index, published as they happen."""

from collections.abc import Callable, Mapping

from daq import keys
from daq.messages_pb2 import INFO, Event, Severity
from daq.timing import StartTime

Publish = Callable[[str, bytes], None]
SOURCE = "daq"


class EventLog:
    """Numbers and publishes the events of one run.

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
        self._sequence = 0

    def add(
        self,
        kind: str,
        text: str,
        sample: int,
        severity: Severity = INFO,
        details: Mapping[str, object] | None = None,
    ) -> None:
        """Publish one event; `details` are written as texts."""
        event = Event(
            timestamp=self._start.timestamp(sample, self._rate),
            run=self._run,
            sample=sample,
            sequence=self._sequence,
            severity=severity,
            source=SOURCE,
            kind=kind,
            text=text,
            details={name: str(value) for name, value in (details or {}).items()},
        )
        self._sequence += 1
        self._publish(self._key, event.SerializeToString(deterministic=True))
