"""What every data acquisition device offers to the acquisition loop, and how a device is found by name.

A backend drives one device. `make_backend` imports it only when it is named, so that reading a rig
description needs no vendor's driver. A laboratory adds its own by the entry-point group
`rigtwin.backends`, whose entries name a class (or a function without arguments that returns a backend).
"""

from collections.abc import Callable
from importlib import import_module
from importlib.metadata import entry_points
from typing import Any, NamedTuple, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from daq.rig import Rig
from simulator.faults import Fault
from simulator.validation import nearest

ENTRY_POINTS = "rigtwin.backends"


class BackendError(RuntimeError):
    """A device that cannot do what was asked: the message names the device, the cause and the remedy."""


class OutputRefused(BackendError):
    """The device does not perform this output, and nothing has happened; it goes on as before."""


class PastSampleError(OutputRefused):
    """An output was scheduled for a sample that the device has already passed."""


class SpeedOutput(NamedTuple):
    """Bring the speed set-point to `speed` (rad/s) with `ramp` (rad/s2, positive)."""

    speed: float
    ramp: float


class HitOutput(NamedTuple):
    """Fire a solenoid once: a half-sine of peak `force` (N) that lasts `duration` (s)."""

    solenoid: str
    force: float
    duration: float


class RestOutput(NamedTuple):
    """Safe state: speed set-point to zero with `ramp` (rad/s2), solenoids off, scheduled outputs dropped."""

    ramp: float


class EnableOutput(NamedTuple):
    """Trip relay: energised while nothing is tripped; dropped, the drive stops by itself."""

    energised: bool


Output = SpeedOutput | HitOutput | RestOutput | EnableOutput


class Reading(NamedTuple):
    """What one `read` delivered: `n_samples` samples from `first_sample` on."""

    first_sample: int
    n_samples: int
    flags: int  # of `BlockStatus`: OVERRUN, CLIPPED


class Capabilities(NamedTuple):
    """What a device can do.

    `rates`: lowest and highest sampling rate, Hz. `outputs`: the output kinds that it performs.
    `hardware_timing`: `write` honours `at_sample`. `watchdog_s`: time after which the device brings the
    rig to rest by itself when its driver dies, None without one. `emulated`: no real rig is behind it.
    `paced`: samples come by the device's own clock; otherwise they are there whenever they are asked for.
    `longest_pulse_s`: the longest pulse whose end the device times by itself, s; None where it times none.
    A hit that the device would not end by itself is refused.
    """

    rates: tuple[float, float]
    outputs: tuple[type, ...]
    hardware_timing: bool
    watchdog_s: float | None
    emulated: bool
    paced: bool
    longest_pulse_s: float | None = None


def no_pulse(capabilities: Capabilities, duration: float) -> str:
    """Return why a device must not be told to make a pulse of `duration` s; nothing where it may be."""
    longest = capabilities.longest_pulse_s
    if longest is None:
        return "the device does not end a hit by its own timing: hits are refused"
    if not duration <= longest:
        return f"the device ends a hit of at most {longest:g} s by its own timing, not one of {duration:g} s"
    return ""


@runtime_checkable
class Backend(Protocol):
    """One device. Rules for an implementer; `daq.conformance` tests them:

    1. `open(rig)` takes the device and configures it for the rig's channels, in the rig's order, and for
       its rate. It moves nothing and starts nothing. It raises `BackendError` when the device is missing
       or busy, or when it can do less than the rig asks.
    2. `start()` begins sampling at sample 0. After `stop()` it may be called again; the count is then at
       0 anew.
    3. `read(out)` fills the first columns of `out`, C-contiguous float64 of shape (n_channels, n), with
       the oldest samples that have not been read, in the terminal's unit (volts, counts), and returns at
       once: it never waits, also when nothing is there (0 samples).
    4. `first_sample` of a reading comes from the device's counter. Samples that the device lost are
       indices that were skipped, and the reading after them carries the flag `BlockStatus.OVERRUN`.
    5. `clock()` is the number of samples that the device has taken since `start()`; it never goes back.
    6. `write(output)` makes the output happen as soon as the device can, at a sample that the device has
       not yet taken, and returns that sample's index. With `at_sample` it happens exactly there;
       `PastSampleError` when that has passed.
       A `HitOutput` ends by the device's own timing, whatever the computer does meanwhile; a device that
       can do that says so in `longest_pulse_s`, and any longer hit is refused before it is written.
    7. A `RestOutput` overrides all that was written before it, scheduled outputs included.
    8. `stop()` and `close()` leave the outputs in the safe state and end sampling. `close()` gives the
       device back too; it may be called at any time, also twice, also without `open`.
    9. All calls come from one thread.
    """

    @property
    def capabilities(self) -> Capabilities:
        """What the device can do; known before `open`, which may narrow it to what the rig describes."""

    def open(self, rig: Rig) -> None:
        """Take and configure the device (rule 1)."""

    def start(self) -> None:
        """Begin sampling (rule 2)."""

    def read(self, out: NDArray[np.float64]) -> Reading:
        """Fetch what is there, at most `out.shape[1]` samples, without waiting (rules 3 and 4)."""

    def clock(self) -> int:
        """Return the number of samples that the device has taken (rule 5)."""

    def write(self, output: Output, at_sample: int | None = None) -> int:
        """Perform or schedule an output and return the sample at which it takes effect (rules 6 and 7)."""

    def stop(self) -> None:
        """Leave the outputs safe and end sampling (rule 8)."""

    def close(self) -> None:
        """Give the device back (rule 8)."""


@runtime_checkable
class TruthSource(Protocol):
    """A backend that also knows the true state behind its samples, as an emulator does."""

    @property
    def truth_names(self) -> tuple[str, ...]:
        """Names of the true signals, in the order of the rows of `truth`."""

    @property
    def truth_units(self) -> tuple[str, ...]:
        """Their units."""

    def truth(self) -> NDArray[np.float64]:
        """Return the true signals of the last reading, shape (n_signals, n_samples); valid until the next."""


@runtime_checkable
class FaultTarget(Protocol):
    """A backend with which something can be made to go wrong while it samples, as with an emulator."""

    def inject(self, fault: Fault) -> None:
        """Let a fault happen, now where its time has passed. Raises `OutputRefused` where it cannot."""


BACKENDS: dict[str, tuple[str, str]] = {
    "emulator": ("daq.backends.emulator", "Emulator"),
    "emulated-device": ("daq.backends.emulated_device", "EmulatedDevice"),
    "nidaqmx": ("daq.backends.nidaqmx", "NiDaqmx"),
    "opendaq": ("daq.backends.opendaq", "OpenDaq"),
    "recording": ("daq.backends.recording", "RecordedDevice"),
}


def make_backend(name: str, **options: Any) -> Backend:
    """Return a new, unopened backend. Raises `BackendError` that lists the known ones for another name."""
    check_known(name)
    if name in BACKENDS:
        module, attribute = BACKENDS[name]
        factory: Callable[..., Backend] = getattr(import_module(module), attribute)
    else:
        factory = next(iter(entry_points(group=ENTRY_POINTS, name=name))).load()
    return factory(**options)


def check_known(name: str) -> None:
    """Refuse a backend that is not installed, without importing any. Raises `BackendError`."""
    if name not in known_backends():
        known = nearest(name, known_backends(), "installed are")
        raise BackendError(f"no backend is called {name}{known}")


def known_backends() -> tuple[str, ...]:
    """Names that `make_backend` takes: the shipped ones and those that installed packages add."""
    return tuple(sorted({*BACKENDS, *(entry.name for entry in entry_points(group=ENTRY_POINTS))}))


def address_of(rig: Rig, meaning: str) -> str:
    """Return `[device] address` of a rig. Raises `BackendError` with its meaning where there is none."""
    address = rig.device.get("address")
    if not isinstance(address, str) or not address:
        raise BackendError(f"[device] lacks address: {meaning}")
    return address


def take_rest(output: Output, at_sample: int | None, now: int, device: str) -> int:
    """Do as `write` of a device that moves nothing: only a `RestOutput` is accepted, and nothing happens.

    Args:
        output: what is written.
        at_sample: when it is to happen.
        now: the device's clock.
        device: how messages name it.
    """
    if not isinstance(output, RestOutput):
        raise OutputRefused(f"{device} has no outputs: nothing can be moved with it")
    if at_sample is not None and at_sample < now:
        raise PastSampleError(f"sample {at_sample} is too early: the device is at {now}")
    return now
