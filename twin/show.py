"""Feeds the messages of one run to a screen, live or from a recording."""

from collections.abc import Iterator
from contextlib import contextmanager

from google.protobuf.message import DecodeError

from analysis.regime import named
from daq import keys
from daq.messages import MessageError, Series, decode_series
from daq.messages_pb2 import Event, Status, TwinSummary
from daq.rig import Rig
from simulator.rig import BearingKind
from twin.display import Screen
from twin.display_data import MICRO, Scene

LONGEST_RUN = 1e9  # s: a later sample is no sample
HEADLINE_PERIOD = 0.2  # s of the run between two headlines


class Show:
    """One run on one screen.

    `take` every message, then `draw` now and then what has come. Messages of other runs are left out;
    what cannot be read is counted in `unreadable`.
    """

    def __init__(self, rig: Rig, scene: Scene, screen: Screen, mode: str) -> None:
        self.mode = mode  # LIVE, EMULATED or REPLAY
        self.over = False  # the daq has ended the run
        self.unreadable = 0
        self._rig = rig
        self._scene = scene
        self._screen = screen
        self._regime = ""
        self._confidence = 0.0  # in the regime
        self._state = ""
        self._first_out = ""
        self._next_headline = -1.0
        name = rig.name
        self._readers = {
            keys.block(name): self._on_block,
            keys.estimate(name): self._on_estimate,
            keys.twin_summary(name): self._on_twin_summary,
            keys.status(name, "daq"): self._on_status,
            keys.status(name, "player"): self._on_status,
            **{keys.event(name, source): self._on_event for source in ("daq", "twin", "operator")},
        }

    @property
    def topics(self) -> tuple[str, ...]:
        """Keys that the picture is made of."""
        return tuple(self._readers)

    def take(self, key: str, payload: bytes) -> None:
        """Take in one message."""
        reader = self._readers.get(key)
        if reader is not None:
            with self._counting_unreadable():
                reader(payload)

    def draw(self) -> None:
        """Draw what has come since the last call."""
        frame = self._scene.frame()
        self._screen.show(frame)
        if frame.time >= self._next_headline or self.over:
            self._next_headline = frame.time + HEADLINE_PERIOD
            self._screen.headline(frame.time, self.headline())

    def headline(self) -> str:
        """Return the state of the rig in one line of Markdown."""
        numbers = self._scene.numbers
        parts = [f"{numbers.time:.1f} s", f"{numbers.speed_hz:.2f} Hz", self._orbit_text(numbers.radius)]
        if self._scene.sensors.force:
            parts.append(f"force {numbers.force:.1f} N")
        if self._regime or self._state:
            parts.append(named(self._regime, self._confidence) if self._regime else self._state)
        if self._first_out:
            parts.append(f"TRIPPED: {self._first_out}")
        if self._scene.skipped:
            parts.append(f"{self._scene.skipped:,} samples not shown")
        if self.over:
            parts.append("ended")
        return f"## {self.mode} {self._rig.name}   {'  ·  '.join(parts)}"

    def _orbit_text(self, radius: float) -> str:
        text = f"orbit {radius:.0f} µm"
        bearing = self._rig.model.backup_bearing if self._rig.model else None
        if bearing is not None and bearing.kind != BearingKind.PINNED:  # between pins it can go farther
            text += f" of {MICRO * bearing.clearance:.0f} µm"
        return text

    def _on_block(self, payload: bytes) -> None:
        self._scene.add_block(self._series(payload))

    def _on_estimate(self, payload: bytes) -> None:
        self._scene.add_estimate(self._series(payload))

    def _series(self, payload: bytes) -> Series:
        series = decode_series(payload)
        self._seconds(series.first_sample)
        return series

    def _on_twin_summary(self, payload: bytes) -> None:
        summary = TwinSummary.FromString(payload)
        regime = summary.regime if summary.valid else "not valid"
        self._confidence = summary.regime_confidence if summary.valid else 0.0
        if regime and regime != self._regime:
            self._regime = regime
            self._screen.regime(self._seconds(summary.first_sample), regime)

    def _on_status(self, payload: bytes) -> None:
        status = Status.FromString(payload)
        self._state, self._first_out = status.state, status.first_out

    def _on_event(self, payload: bytes) -> None:
        event = Event.FromString(payload)
        self._screen.event(self._seconds(event.sample), event.source, event.severity, event.text)
        self.over = self.over or (event.kind == "end" and event.source == "daq")

    def _seconds(self, sample: int) -> float:
        seconds = sample / self._scene.rate
        if seconds > LONGEST_RUN:
            raise MessageError(f"sample {sample} would be {seconds:g} s after the run's start")
        return seconds

    @contextmanager
    def _counting_unreadable(self) -> Iterator[None]:
        try:
            yield
        except (MessageError, DecodeError):
            self.unreadable += 1
