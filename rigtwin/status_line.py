"""The line that `rigtwin live` and `rigtwin replay` keep up to date, and the events above it."""

import sys
from typing import TYPE_CHECKING, TextIO

from daq.messages_pb2 import Event, Severity
from rigtwin.monitor import Picture

if TYPE_CHECKING:
    from daq.rig import Rig

PLAIN_PERIOD = 5.0  # s of the run between two lines where the output is not a terminal


def status_text(picture: Picture, rig: "Rig", recording: bool) -> str:
    """One line: time, what the rig measures of speed, orbit and contact force, regime, samples, loss, lag."""
    parts = [f"{picture.time:7.2f} s"]
    if rig.channels.of_quantity("speed"):
        parts.append(f"{picture.speed_hz:5.2f} Hz")
    if rig.channels.of_quantity("displacement"):
        gap = f" of {rig.model.backup_bearing.clearance * 1e6:.0f} µm" if rig.model else ""
        parts.append(f"orbit {picture.radius * 1e6:5.0f} µm{gap}")
    if rig.channels.of_quantity("force"):
        parts.append(f"contact {picture.contact_force:5.1f} N")
    parts.append(f"{picture.regime or picture.state:<30}")
    if recording:
        parts.append(f"recorded {picture.recorded:,} samples, lost {picture.lost:,}")
    parts.append(f"{picture.lag * 1e3:.0f} ms behind")
    return " | ".join(parts)


def event_text(event: Event, rate: float) -> str:
    """One event as a line, with its time in the run."""
    mark = {Severity.WARNING: "warning: ", Severity.ALARM: "ALARM: "}.get(event.severity, "")
    return f"{event.sample / rate:7.2f} s  {mark}{event.text}"


def worth_showing(event: Event) -> bool:
    """Whether an event is news: a plan's step is, the accepted command that it sends is not."""
    by_plan = event.details.get("who", "").startswith("plan ")
    return event.severity != Severity.INFO or not (event.source == "daq" and by_plan)


class StatusLine:
    """Writes events as lines and, under them, one line that is rewritten in place.

    Where the output is no terminal, the status is printed as a line of its own every few seconds.
    """

    def __init__(self, output: TextIO | None = None) -> None:
        self._output = output or sys.stdout
        self._in_place = self._output.isatty()
        self._width = 0
        self._next_plain = 0.0

    def show(self, text: str, time: float) -> None:
        """Show the status at `time` seconds of the run."""
        if self._in_place:
            self._write("\r" + text.ljust(self._width))
            self._width = len(text)
        elif time >= self._next_plain:
            self._next_plain = time + PLAIN_PERIOD
            self._write(text + "\n")

    def line(self, text: str) -> None:
        """Write one lasting line above the status."""
        if self._in_place and self._width:
            self._write("\r" + " " * self._width + "\r")
            self._width = 0
        self._write(text + "\n")

    def _write(self, text: str) -> None:
        self._output.write(text)
        self._output.flush()
