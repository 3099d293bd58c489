"""The emulated device as a process of its own: it outlives the daq, and its watchdog then stops the rig.

It talks with the daq through a socket that it inherits (`daq.backends.emulated_device` starts it): each
request names a method of the emulator and its arguments, each reply is a `Reply`. Every request is a sign
of life. While the device samples, a daq that is silent for longer than the watchdog's time, or gone,
loses the rig: the safe state is written as a device's own logic would, and nothing but `close` is obeyed
after that. What the watchdog does is said on standard error.
"""

import sys
import time
from multiprocessing.connection import Connection
from typing import Any, NamedTuple

import numpy as np

from daq.acquisition import AT_REST
from daq.backend import BackendError, EnableOutput, RestOutput
from daq.backends.emulator import Emulator
from daq.backends.signals import TRUTH
from daq.rig import Rig, rig_from_text
from simulator.faults import Fault

PIECE = 0.01
"""s of the rig's time that are simulated at once while it runs down."""


class Clock(NamedTuple):
    """When sample 0 was, s of the host's monotonic clock, and the samples in each of its seconds."""

    origin: float
    pace: float


class Samples(NamedTuple):
    """One reading: raw (n_channels, n) and true signals (n_signals, n) from `first_sample` on."""

    first_sample: int
    flags: int
    raw: np.ndarray
    truth: np.ndarray
    clock: Clock


class Reply(NamedTuple):
    """Answer to a request: a value, or a refusal."""

    value: Any = None
    refusal: BackendError | None = None


class Device:
    """Serves one daq until that closes the device or is gone.

    Args:
        daq: where requests come from.
        watchdog_s: silence while sampling after which the rig is brought to rest.
    """

    def __init__(self, daq: Connection, watchdog_s: float) -> None:
        self._daq = daq
        self._watchdog_s = watchdog_s
        self._emulator = Emulator()
        self._rig: Rig | None = None
        self._sampling = False
        self._tripped = ""

    def serve(self) -> None:
        """Answer requests; return when there will be no more."""
        try:
            while self._heard():
                method, *arguments = self._daq.recv()
                self._daq.send(self._reply(method, arguments))
                if method == "close":
                    return
        except (EOFError, ConnectionError):
            if self._sampling and not self._tripped:
                self._trip("the daq is gone")
        finally:
            self._emulator.close()

    def _heard(self) -> bool:
        """Wait for a request, with a watchdog on the daq's silence as long as the rig may move."""
        if self._sampling and not self._tripped and not self._daq.poll(self._watchdog_s):
            self._trip(f"the daq was silent for {self._watchdog_s:g} s")
        return self._daq.poll(None)

    def _reply(self, method: str, arguments: list[Any]) -> Reply:
        if self._tripped and method not in ("stop", "close"):
            return Reply(refusal=BackendError(self._tripped))
        try:
            return Reply(getattr(self, f"_do_{method}")(*arguments))
        except BackendError as error:
            return Reply(refusal=type(error)(str(error)))
        except ValueError as error:
            return Reply(refusal=BackendError(str(error)))

    def _do_open(self, toml: str) -> None:
        self._rig = rig_from_text(toml)
        self._emulator.open(self._rig)

    def _do_start(self) -> Clock:
        self._emulator.start()
        self._sampling = True
        return Clock(*self._emulator.pace)

    def _do_read(self, count: int) -> Samples:
        assert self._rig is not None
        raw = np.empty((len(self._rig.channels), count))
        reading = self._emulator.read(raw)
        samples = np.ascontiguousarray(raw[:, : reading.n_samples])
        clock = Clock(*self._emulator.pace)
        return Samples(reading.first_sample, reading.flags, samples, self._emulator.truth(), clock)

    def _do_write(self, output: Any, at_sample: int | None) -> int:
        return self._emulator.write(output, at_sample)

    def _do_inject(self, fault: Fault) -> None:
        self._emulator.inject(fault)

    def _do_stop(self) -> None:
        self._sampling = False
        self._emulator.stop()

    def _do_close(self) -> None:
        self._do_stop()

    def _trip(self, reason: str) -> None:
        """Bring the rig to rest as a device's watchdog does, whatever the daq wants from now on."""
        assert self._rig is not None
        sample = self._emulator.write(RestOutput(self._rig.safe_state.ramp))
        self._emulator.write(EnableOutput(False))
        self._tripped = f"the device's watchdog has brought the rig to rest from sample {sample} on: {reason}"
        say(self._tripped)
        out = np.empty((len(self._rig.channels), round(PIECE * self._rig.acquisition.rate)))
        while not self._at_rest(sample, out):
            time.sleep(0.2 * PIECE)

    def _at_rest(self, since: int, out: np.ndarray) -> bool:
        """Let the rig go on to the present; tell whether it has come to rest after the watchdog acted."""
        reading = self._emulator.read(out)
        speed = self._emulator.truth()[TRUTH.index("speed")]
        now = reading.first_sample + reading.n_samples
        if not reading.n_samples or now <= since or np.abs(speed).max() >= AT_REST:
            return False
        say(f"the rig is at rest at sample {now}")
        return True


def say(text: str) -> None:
    """Say on standard error what the watchdog did; it may be the only one left to tell."""
    print(f"device: {text}", file=sys.stderr, flush=True)


def serve(descriptor: int, watchdog_s: float) -> None:
    """Be the emulated device for the daq at the other end of an inherited socket."""
    with Connection(descriptor) as daq:
        Device(daq, watchdog_s).serve()
