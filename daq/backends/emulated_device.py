"""The emulated rig behind a process of its own, which has a watchdog as hardware has one."""

import subprocess
import sys
from math import inf
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from time import monotonic
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from daq.backend import (
    BackendError,
    Capabilities,
    EnableOutput,
    HitOutput,
    Output,
    Reading,
    RestOutput,
    SpeedOutput,
)
from daq.backends.signals import TRUTH, TRUTH_UNITS
from daq.rig import Rig
from simulator.faults import Fault
from simulator.validation import Quantity, tuple_at

if TYPE_CHECKING:
    from daq.device import Reply, Samples

RATES = (100.0, 1e6)
PATIENCE = 5.0
"""s in which the device must answer."""
COMPILING = 300.0
"""s that it may take to open, which compiles the model."""


class DeviceSettings(NamedTuple):
    """Table `[device]` of a rig whose backend is the emulated device."""

    watchdog_s: Annotated[float, Quantity("s", 0.02, 60.0, "silence of the daq that stops the rig")] = 0.2


class EmulatedDevice:
    """Drives the emulator in a process of its own (a `Backend` and a `TruthSource`).

    When the daq is silent for `[device] watchdog_s`, stopped or killed, the device brings the rig to rest
    by its safe ramp, and says so on the standard error that it shares with the daq.
    """

    truth_names = TRUTH
    truth_units = TRUTH_UNITS

    def __init__(self) -> None:
        self.capabilities = Capabilities(
            rates=RATES,
            outputs=(SpeedOutput, HitOutput, RestOutput, EnableOutput),
            hardware_timing=True,
            watchdog_s=DeviceSettings().watchdog_s,
            emulated=True,
            paced=True,
            longest_pulse_s=inf,
        )
        self._process: subprocess.Popen[bytes] | None = None
        self._device: Connection | None = None
        self._sampling = False
        self._next = 0
        self._truth = np.empty((len(TRUTH), 0))

    def open(self, rig: Rig) -> None:
        """Start the device's process and let it compile what it needs."""
        settings = tuple_at(DeviceSettings, rig.device, "[device]")
        self.capabilities = self.capabilities._replace(watchdog_s=settings.watchdog_s)
        ours, theirs = Pipe()
        words = ["-m", "daq", "device", "--socket", str(theirs.fileno())]
        self._process = subprocess.Popen(
            [sys.executable, "-P", *words, "--watchdog", str(settings.watchdog_s)],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            pass_fds=[theirs.fileno()],
            start_new_session=True,  # it is not to die with the daq
        )
        theirs.close()
        self._device = ours
        self._ask("open", rig.toml, patience=COMPILING)

    def start(self) -> None:
        """Begin at sample 0 with the shaft hanging still."""
        self._origin, self._pace = self._ask("start")
        self._next = 0
        self._sampling = True

    def clock(self) -> int:
        """Return the number of samples that the device has taken; it lives by this host's clock."""
        self._running()
        return int((monotonic() - self._origin) * self._pace)

    def read(self, out: NDArray[np.float64]) -> Reading:
        """Fetch the oldest samples from the device."""
        self._running()
        samples: Samples = self._ask("read", out.shape[1])
        count = samples.raw.shape[1]
        out[:, :count] = samples.raw
        self._truth = samples.truth
        self._origin, self._pace = samples.clock
        return Reading(samples.first_sample, count, samples.flags)

    def truth(self) -> NDArray[np.float64]:
        """Return the true signals of the last reading."""
        return self._truth

    def write(self, output: Output, at_sample: int | None = None) -> int:
        """Schedule an output on the device."""
        self._running()
        sample: int = self._ask("write", output, at_sample)
        return sample

    def inject(self, fault: Fault) -> None:
        """Let something more go wrong with the device or its rig. Raises `OutputRefused` where it cannot."""
        self._running()
        self._ask("inject", fault)

    def stop(self) -> None:
        """End sampling; the emulated rig ends with it."""
        if self._sampling:
            self._sampling = False
            self._ask("stop")

    def close(self) -> None:
        """End the device's process, unless it has to bring the rig to rest."""
        self._sampling = False
        if self._device is not None and self._process is not None:
            device, self._device = self._device, None
            try:
                device.send(("close",))
                self._process.wait(PATIENCE)
            except (OSError, subprocess.TimeoutExpired):
                pass  # it has died, or it brings the rig to rest and ends by itself
            device.close()
            self._process = None

    def _running(self) -> None:
        if not self._sampling:
            raise BackendError("the emulated device is not sampling: call start() first")

    def _ask(self, method: str, *arguments: Any, patience: float = PATIENCE) -> Any:
        """Send a request and return the reply's value. Raises what the device refuses it with."""
        if self._device is None:
            raise BackendError("the emulated device is not open: call open(rig) first")
        try:
            self._device.send((method, *arguments))
            if not self._device.poll(patience):
                raise BackendError(f"the emulated device has not answered for {patience:g} s")
            reply: Reply = self._device.recv()
        except (EOFError, ConnectionError) as error:
            raise BackendError("the emulated device has died") from error
        if reply.refusal is not None:
            raise reply.refusal
        return reply.value
