"""Devices behind openDAQ, the open data acquisition SDK: analog inputs, read in step by one multi-reader.

`[device]` of the rig names the device by openDAQ's connection string and may set its properties; a
channel's `terminal` is the device's channel or signal. openDAQ counts time in ticks of its own clock, and
the sample index follows from them, so that samples which never came are known as a gap.
"""

import time
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from daq.backend import BackendError, Capabilities, Output, Reading, RestOutput, address_of, take_rest
from daq.messages import BlockStatus
from daq.optional import optional
from daq.rig import Rig
from simulator.validation import nearest

RATES = (1.0, 1e6)
RATE_PROPERTIES = ("GlobalSampleRate", "SampleRate")
SILENCE = 1.0
"""s without any sample after which the device counts as gone; they come each 10 ms or so."""
POLL = 0.001
OVERRUN = int(BlockStatus.OVERRUN)


class Samples(NamedTuple):
    """Samples that have been fetched: values (n_channels, n), and the index of each (n,)."""

    values: NDArray[np.float64]
    indices: NDArray[np.int64]


class OpenDaq:
    """An openDAQ device's analog inputs (a `Backend`). It has no outputs: it cannot bring a rig to rest."""

    capabilities = Capabilities(
        rates=RATES,
        outputs=(RestOutput,),
        hardware_timing=False,
        watchdog_s=None,
        emulated=False,
        paced=True,
    )

    def __init__(self) -> None:
        self._instance: Any = None
        self._signals: list[Any] = []
        self._reader: Any = None

    def open(self, rig: Rig) -> None:
        """Connect to the device, set its properties and rate, and find the rig's terminals."""
        self._driver = optional("opendaq", "the backend opendaq", "opendaq")
        self._address, properties = device_settings(rig)
        self._instance = self._driver.Instance()
        try:
            self._device = self._instance.add_device(self._address)
        except RuntimeError as error:
            raise BackendError(f"openDAQ finds no device {self._address}, or it is busy: {error}") from error
        for name, value in properties.items():
            self._set(self._device, name, value)
        self._set_rate(rig.acquisition.rate)
        self._signals = [self._signal(channel.terminal) for channel in rig.channels]
        self._ticks_per_sample = self._check_rate(rig.acquisition.rate)

    def start(self) -> None:
        """Begin to read; sample 0 follows the first samples that the device delivers, which are dropped."""
        if not self._signals:
            raise BackendError("the openDAQ device is not open: call open(rig) first")
        builder = self._driver.MultiReaderBuilder()
        for signal in self._signals:
            builder.add_signal(signal)
        builder.value_read_type = self._driver.SampleType.Float64
        builder.domain_read_type = self._driver.SampleType.Int64
        self._reader = builder.build()
        self._origin = self._first_ticks() + self._ticks_per_sample
        self._next = 0
        self._kept = Samples(np.empty((len(self._signals), 0)), np.empty(0, np.int64))
        self._heard = time.monotonic()

    def clock(self) -> int:
        """Return the number of samples delivered. Raises `BackendError` when the device falls silent."""
        reader = self._reading()
        waiting = len(self._kept.indices) + reader.available_count
        if waiting:
            self._heard = time.monotonic()
        elif time.monotonic() - self._heard > SILENCE:
            raise BackendError(
                f"{self._address} has delivered nothing for {SILENCE:g} s: look at its cable and its power"
            )
        return self._next + waiting

    def read(self, out: NDArray[np.float64]) -> Reading:
        """Fill `out` with the oldest samples, up to the next gap."""
        self._reading()
        if not len(self._kept.indices):
            self._kept = self._fetch(out.shape[1])
        values, indices = self._kept
        count = min(run_length(indices), out.shape[1])
        if not count:
            return Reading(self._next, 0, 0)
        out[:, :count] = values[:, :count]
        self._kept = Samples(values[:, count:], indices[count:])
        first, expected = int(indices[0]), self._next
        self._next = first + count
        return Reading(first, count, OVERRUN if first > expected else 0)

    def write(self, output: Output, at_sample: int | None = None) -> int:
        """Accept `RestOutput`, for which there is nothing to do, and no other."""
        return take_rest(output, at_sample, self.clock(), self._address)

    def stop(self) -> None:
        """End reading."""
        self._reader = None

    def close(self) -> None:
        """Disconnect from the device."""
        self.stop()
        self._signals = []
        if self._instance is not None:
            self._device = None
            self._instance = None

    def _reading(self) -> Any:
        if self._reader is None:
            raise BackendError("the openDAQ device is not sampling: call start() first")
        return self._reader

    def _fetch(self, most: int) -> Samples:
        """Take at most so many samples from openDAQ's queue."""
        values, ticks = self._reader.read_with_domain(most, timeout_ms=0)
        return Samples(values, sample_indices(ticks[0], self._origin, self._ticks_per_sample))

    def _first_ticks(self) -> int:
        """Wait for the first samples; return the tick of the last of them."""
        deadline = time.monotonic() + SILENCE
        while time.monotonic() < deadline:
            # The first call only takes note of the signals; no sample is counted as available before it.
            _values, ticks = self._reader.read_with_domain(max(1, self._reader.available_count), timeout_ms=0)
            if ticks.shape[1] and not self._reader.available_count:
                return int(ticks[0, -1])
            time.sleep(POLL)
        raise BackendError(f"{self._address} delivers no samples; all its channels must have the same rate")

    def _set(self, component: Any, name: str, value: object) -> None:
        """Set a property. Raises `BackendError` when the device has no such one or takes another value."""
        place = f"[device.properties] {name} = {value!r}"
        try:
            component.set_property_value(name, value)
            taken = component.get_property_value(name)
        except RuntimeError as error:
            known = nearest(name, [prop.name for prop in component.all_properties], "it has")
            raise BackendError(f"{place}: {self._address} refused it{known}") from error
        if taken != value:
            raise BackendError(f"{place}: {self._address} made {taken!r} of it")

    def _set_rate(self, rate: float) -> None:
        """Set the rate, where the device or its channels have a property for it."""
        for component in [self._device, *self._device.channels]:
            for name in RATE_PROPERTIES:
                if component.has_property(name):
                    component.set_property_value(name, rate)
                    break

    def _signal(self, terminal: str) -> Any:
        """Return the signal of a terminal: a channel's name, or the end of a signal's path."""
        known = []
        for channel in self._device.channels_recursive:
            for signal in channel.signals:
                known.append(channel.local_id)
                if terminal == channel.local_id or signal.global_id.endswith(f"/{terminal}"):
                    return signal
        there = nearest(terminal, known, "there are")
        raise BackendError(f'terminal = "{terminal}" is no channel of {self._address}{there}')

    def _check_rate(self, rate: float) -> int:
        """Return the ticks of a sample. Raises `BackendError` where a signal has not the rig's rate."""
        for signal in self._signals:
            domain = signal.domain_signal.descriptor
            resolution = domain.tick_resolution
            ticks = int(domain.rule.parameters["delta"])
            true_rate = resolution.denominator / resolution.numerator / ticks
            if abs(true_rate - rate) > 1e-9 * rate:
                raise BackendError(
                    f"{self._address} samples {signal.local_id} with {true_rate:.9g} Hz when told "
                    f"{rate:.9g} Hz: write [acquisition] rate = {true_rate:.9g}, or one that it supports"
                )
        return ticks


def device_settings(rig: Rig) -> tuple[str, Mapping[str, Any]]:
    """Return the connection string and the properties of `[device]`. Raises `BackendError`."""
    keys = ("address", "properties")
    for key in rig.device:
        if key not in keys:
            raise BackendError(f"[device] {key} is not a key for openDAQ{nearest(key, keys)}")
    address = address_of(rig, 'openDAQ\'s connection string, as "daq.nd://192.168.0.5"')
    properties = rig.device.get("properties", {})
    if not isinstance(properties, Mapping):
        raise BackendError(f"[device.properties] must be a table, not {properties!r}")
    return address, properties


def sample_indices(ticks: NDArray[np.int64], origin: int, ticks_per_sample: int) -> NDArray[np.int64]:
    """Return the sample index of each tick: that of the sample nearest to it."""
    return (ticks - origin + ticks_per_sample // 2) // ticks_per_sample


def run_length(indices: NDArray[np.int64]) -> int:
    """Return how many of the first indices follow one another without a gap."""
    jumps = np.flatnonzero(np.diff(indices) != 1)
    return int(jumps[0]) + 1 if len(jumps) else len(indices)
