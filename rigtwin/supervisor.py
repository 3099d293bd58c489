"""Keeps the processes of a run: starts them, mends what may be mended, ends them in order."""

import signal
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from types import FrameType

from daq.rig import Rig
from rigtwin.crew import Child, Crew
from rigtwin.monitor import Monitor
from rigtwin.status_line import StatusLine, event_text, status_text, worth_showing

POLL = 0.1  # s between two looks at the children
FINISH = 40.0  # s that an orderly end may take in all
LULL = 0.2  # s of silence after which all that the ended children said has come
MOST_RESTARTS = 5  # of one child


class StopRequest:
    """Turns the first Ctrl-C or SIGTERM into a wish to end; used as a context manager."""

    def __init__(self) -> None:
        self.made = False
        self._before: dict[int, object] = {}

    def __enter__(self) -> "StopRequest":
        for number in (signal.SIGINT, signal.SIGTERM):
            self._before[number] = signal.signal(number, self._on_signal)
        return self

    def __exit__(self, *_: object) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)  # type: ignore[arg-type]

    def _on_signal(self, _number: int, _frame: FrameType | None) -> None:
        self.made = True


class Supervisor:
    """Runs a crew until the run is over.

    `essential` children end the run when they end; the others are started anew when they fail.
    """

    def __init__(
        self,
        rig: Rig,
        crew: Crew,
        *,
        essential: Sequence[str],
        recording: bool,
        output: StatusLine | None = None,
    ) -> None:
        self.rig = rig
        self.crew = crew
        self.screen = output or StatusLine()
        self.monitor = Monitor(rig)
        self.failed = ""  # why the run did not go as planned
        self._essential = set(essential)
        self._again: dict[str, Callable[[], Sequence[str]]] = {}
        self._restarts: dict[str, int] = {}
        self._announcements: dict[str, tuple[str, str]] = {}
        self._recording = recording
        self._warned = ""

    def add(
        self, name: str, arguments: Sequence[str], again: Callable[[], Sequence[str]] | None = None
    ) -> None:
        """Start one more child; `again` returns the arguments to start it anew, the same ones if None."""
        self.crew.start(name, *arguments)
        self._again[name] = again or (lambda: arguments)

    def announce(self, name: str, start: str, text: str) -> None:
        """Print `text` and what child `name` says from `start` on, as soon as it says it."""
        self._announcements[name] = (start, text)

    def run(self, stop: StopRequest, over: Callable[[], bool]) -> None:
        """Show the run until it is over, by itself or because `stop` was made or `over` says so."""
        while not (stop.made or over() or self.monitor.picture.ended):
            self.look(POLL)
            if not self._tend():
                return

    def look(self, seconds: float) -> bool:
        """Take in and show what arrives, waiting at most `seconds` for it; return whether anything has."""
        news = self.monitor.update(seconds)
        while self.monitor.news:
            event = self.monitor.news.popleft()
            if worth_showing(event):
                self.screen.line(event_text(event, self.rig.acquisition.rate))
        for name in list(self._announcements):
            self._announce(name)
        picture = self.monitor.picture
        self._warn(picture.recorder_alarm)
        self.screen.show(status_text(picture, self.rig, self._recording), picture.time)
        return news

    def finish(self, order: Sequence[str]) -> None:
        """Order the end, child after child, going on to show what happens meanwhile."""
        deadline = time.monotonic() + FINISH
        for name in order:
            child = self.crew.get(name)
            if child is None:
                continue
            child.order_end()
            while child.exit_code is None and time.monotonic() < deadline:
                self.look(POLL)
        killed = self.crew.finish(order, 5.0)
        if killed:
            self._fail(f"{' and '.join(killed)} did not end in time and had to be killed")
        while self.look(LULL):
            pass  # the last words of those that have ended are still on their way
        self.monitor.close()

    def _warn(self, alarm: str) -> None:
        """Say once what threatens the recording."""
        kind = alarm.partition(":")[0]
        if kind and kind != self._warned:
            self.screen.line(f"warning: recorder: {alarm}")
        self._warned = kind

    def _announce(self, name: str) -> None:
        start, text = self._announcements[name]
        child = self.crew.get(name)
        said = next((line for line in child.said() if start in line), None) if child else None
        if said is not None:
            self.screen.line(text + said[said.index(start) :].strip())
            del self._announcements[name]

    def _tend(self) -> bool:
        """Deal with the children that have ended; return False when the run cannot go on."""
        go_on = True
        for child in self.crew.ended():
            if child.name in self._essential:
                go_on = False
                if child.exit_code != 0:
                    self._fail(explain(child))
            elif child.exit_code != 0:
                self._replace(child)
        return go_on

    def _replace(self, child: Child) -> None:
        count = self._restarts[child.name] = self._restarts.get(child.name, 0) + 1
        if count > MOST_RESTARTS:
            self._fail(explain(child))
            return
        self.screen.line(f"{explain(child)}; starting it again")
        self.crew.start(child.name, *self._again[child.name]())

    def _fail(self, text: str) -> None:
        self.failed = self.failed or text
        self.screen.line(text)


def explain(child: Child) -> str:
    """Say in plain words how a child ended."""
    code = child.exit_code
    if code is not None and code < 0:
        return f"{child.name} was ended by {signal.Signals(-code).name}"
    if code == 0:
        return f"{child.name} has ended"
    return f"{child.name}: {child.last_words().removeprefix(child.name).removeprefix(':').strip()}"


def write_rig(rig: Rig, folder: Path) -> str:
    """Write the resolved rig description where the children find it; return its path."""
    path = folder / "rig.toml"
    path.write_text(rig.toml, encoding="utf-8")
    return str(path)
