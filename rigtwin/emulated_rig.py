"""An emulated rig for tests: in virtual time in the test's process, or in real time as a real daq process.

Both are the whole daq: device, calibration, protection, commands and events. The pytest fixture
`emulated_rig` (`rigtwin.pytest_plugin`) starts them and ends them with the test.
"""

import subprocess
import sys
import time
import tomllib
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from threading import Event as Flag
from threading import Thread

import tomli_w

from daq import keys
from daq.acquisition import Acquisition
from daq.backends.emulator import Emulator
from daq.link import Inbox, Link
from daq.messages import decode_series
from daq.messages_pb2 import Answer, Command, Event
from daq.ports import with_free_ports
from daq.recording.signals import Signals, joined
from daq.rig import Rig, load_rig, rig_from_text

PATIENCE = 60.0
"""s that a real-time rig may take for what a test waits for."""
START = 300.0
"""s that it may take to start; the first one on a computer compiles the model."""
RENEWAL = 0.025
"""s between two renewals of the lease."""
WHO = "test"

Fault = Mapping[str, object]


class EmulatedRig(ABC):
    """A running emulated rig, at rest and unarmed at first. Times are s of the run.

    Attributes:
        rig: its description.
    """

    def __init__(self, rig: Rig) -> None:
        self.rig = rig
        self._blocks: list[bytes] = []
        self._events: list[Event] = []
        self._lease = ""

    @property
    @abstractmethod
    def sample(self) -> int:
        """Index behind the newest sample that was published."""

    @abstractmethod
    def run(self, seconds: float) -> None:
        """Let so much of the rig's time pass."""

    @abstractmethod
    def close(self) -> None:
        """End the rig."""

    @abstractmethod
    def _ask(self, command: Command) -> Answer:
        """Give a command to the daq."""

    def arm(self) -> None:
        """Take the lease; it is renewed until `fall_silent`."""
        answer = self.command("arm")
        assert answer.accepted, f"arm was refused: {answer.text}"
        self._lease = answer.lease

    def fall_silent(self) -> None:
        """Renew the lease no longer, as an operator that hangs."""
        self._lease = ""

    def command(self, name: str, /, **values: float | str) -> Answer:
        """Give a command as the lease's holder and return the answer; see `accepted` and `text`.

        Args:
            name: arm, speed, hit, stop, trip, reset or mark.
            values: what the command takes, as `speed_hz=8.0`.
        """
        texts = {key: value for key, value in values.items() if isinstance(value, str)}
        numbers = {key: float(value) for key, value in values.items() if not isinstance(value, str)}
        return self._ask(Command(name=name, who=WHO, lease=self._lease, values=numbers, texts=texts))

    def inject(self, kind: str, *, after: float = 0.0, **more: float | str) -> None:
        """Let something go wrong from now on, or `after` so many s of the rig's time.

        Args:
            kind: as in a row `[[emulator.fault]]`: `open`, `stuck`, `unbalance-step`, `dropped`, ...
            after: s from the present sample to the fault's first.
            more: what such a row has besides: `channel`, `size`, `duration`, ...

        Raises:
            ValueError: the rig cannot have it; the message says why.
        """
        answer = self.command("inject", kind=kind, after=after, **more)
        if not answer.accepted:
            raise ValueError(answer.text)

    def signals(self, *names: str) -> Signals:
        """Return all samples so far of some channels, or of all: `.samples` (n_channels, n_samples), SI."""
        blocks = [decode_series(block) for block in list(self._blocks)]
        return joined(blocks, names or None, 0, None, "the run")

    def events(self, kind: str = "") -> list[Event]:
        """Return the daq's events so far, of one kind or all."""
        return [event for event in list(self._events) if kind in ("", event.kind)]

    def expect(self, kind: str, within: float = 5.0) -> Event:
        """Let time pass until there is an event of that kind and return the first one.

        Raises `AssertionError` with what happened instead, when none comes within so many s of the run.
        """
        last = self.sample + round(within * self.rig.acquisition.rate)
        while not self.events(kind):
            told = "; ".join(f"{event.kind} ({event.text})" for event in self.events())
            assert self.sample < last, f"no event {kind} within {within:g} s, but: {told}"
            self.run(0.01)
        return self.events(kind)[0]

    def _take(self, key: str, payload: bytes) -> None:
        if key == keys.block(self.rig.name):
            self._blocks.append(payload)
        elif key == keys.event(self.rig.name, "daq"):
            self._events.append(Event.FromString(payload))


class VirtualRig(EmulatedRig):
    """A rig whose time passes in `run` alone, as fast as the computer goes."""

    def __init__(self, rig: Rig) -> None:
        super().__init__(rig)
        self._device = Emulator(paced=False)
        self._device.open(rig)
        self._daq = Acquisition(rig, self._device, self._take, run="test", t0_ns=0)
        self._daq.begin()

    @property
    def sample(self) -> int:
        """Index behind the newest sample that was read."""
        return self._daq.sample

    def run(self, seconds: float) -> None:
        """Read so many samples."""
        last = self.sample + round(seconds * self.rig.acquisition.rate)
        while self.sample < last:
            if self._lease:
                self._daq.renew(self._lease)
            self._daq.elapse(self._daq.step() / self.rig.acquisition.rate)

    def close(self) -> None:
        """End the run."""
        self._daq.end()
        self._device.close()

    def _ask(self, command: Command) -> Answer:
        return self._daq.serve(command)


class RealTimeRig(EmulatedRig):
    """A rig acquired by a process of its own, over the real link, on free ports.

    Args:
        rig: its ports are replaced by free ones where they are open.
        folder: for its description and what the process says.
    """

    def __init__(self, rig: Rig, folder: Path) -> None:
        super().__init__(with_free_ports(rig))
        self._stack = ExitStack()
        self._ended = Flag()
        with self._stack:
            self._start(folder)
            self._stack = self._stack.pop_all()

    def _start(self, folder: Path) -> None:
        name, link = self.rig.name, self.rig.link
        toml, log = folder / "rig.toml", folder / "daq.log"
        toml.write_text(self.rig.toml, encoding="utf-8")
        with log.open("wb") as output:
            words = ["-P", "-m", "daq", "acquire", "--rig", str(toml)]
            self._process = subprocess.Popen(
                [sys.executable, *words], stdin=subprocess.PIPE, stdout=output, stderr=subprocess.STDOUT
            )
        self._stack.callback(self._finish)
        until(lambda: b"ready" in log.read_bytes() or self._over, START, "the daq to start")
        assert not self._over, log.read_text(errors="replace")
        data = self._stack.enter_context(Link(connect=[link.endpoint("daq")]))
        self._control = self._stack.enter_context(Link(connect=[link.endpoint("control")], lease_ms=200))
        inbox = Inbox(10_000, "wait")
        for key in (keys.block(name), keys.event(name, "daq")):
            data.subscribe(key, inbox, recover=True)
        self._leases = self._control.publish(keys.lease(name))
        for task in (self._hear, self._renew):
            thread = Thread(target=task, args=(inbox,), daemon=True)
            thread.start()
            self._stack.callback(thread.join, PATIENCE)
        self._stack.callback(inbox.close)
        self._stack.callback(self._ended.set)
        until(lambda: bool(self._blocks), PATIENCE, "the first block")

    @property
    def sample(self) -> int:
        """Index behind the newest sample that has come."""
        newest = decode_series(self._blocks[-1])
        return newest.first_sample + newest.samples.shape[1]

    def run(self, seconds: float) -> None:
        """Wait for so many samples."""
        last = self.sample + round(seconds * self.rig.acquisition.rate)
        until(lambda: self.sample >= last or self._over, seconds + PATIENCE, "the samples")
        assert not self._over, "the daq has ended"

    def close(self) -> None:
        """End the process in order."""
        self._stack.close()

    @property
    def _over(self) -> bool:
        return self._process.poll() is not None

    def _finish(self) -> None:
        """Order the daq's end and wait for it."""
        assert self._process.stdin is not None
        self._process.stdin.close()
        try:
            self._process.wait(PATIENCE)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()

    def _ask(self, command: Command) -> Answer:
        key = keys.command(self.rig.name, command.name)
        return Answer.FromString(self._control.ask(key, command.SerializeToString(), PATIENCE))

    def _hear(self, inbox: Inbox) -> None:
        while not self._ended.is_set():
            if item := inbox.get(0.1):
                self._take(*item)

    def _renew(self, inbox: Inbox) -> None:
        while not self._ended.wait(RENEWAL):
            if self._lease:
                self._leases.put(self._lease.encode())


def started(
    rig: str | Path, settings: Sequence[str], faults: Iterable[Fault], folder: Path | None
) -> EmulatedRig:
    """Start an emulated rig; with a folder in real time, else in virtual time. Raises `RigError`."""
    described = with_faults(load_rig(rig, settings), faults)
    return VirtualRig(described) if folder is None else RealTimeRig(described, folder)


def with_faults(rig: Rig, faults: Iterable[Fault]) -> Rig:
    """Return the rig with more rows `[[emulator.fault]]`. Raises `RigError`."""
    tables = tomllib.loads(rig.toml)
    rows = tables.setdefault("emulator", {}).setdefault("fault", [])
    rows.extend({"name": f"fault-{number}", **fault} for number, fault in enumerate(faults, len(rows) + 1))
    return rig_from_text(tomli_w.dumps(tables), rig.name)


def until(condition: Callable[[], bool], seconds: float, what: str) -> None:
    """Wait for a condition. Raises `AssertionError` when it does not come."""
    deadline = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < deadline, f"waited {seconds:.0f} s in vain for {what}"
        time.sleep(0.002)
