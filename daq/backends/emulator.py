"""The emulated device: the simulated rig behind sensors, a converter, a buffer and a clock."""

from collections.abc import Callable
from heapq import heappop, heappush
from math import inf
from time import monotonic

import numpy as np
from numpy.typing import NDArray

from daq.backend import (
    BackendError,
    Capabilities,
    EnableOutput,
    HitOutput,
    Output,
    OutputRefused,
    PastSampleError,
    Reading,
    RestOutput,
    SpeedOutput,
)
from daq.backends.mishaps import TIMING, DeviceClock, Mishaps
from daq.backends.signals import TRUTH, TRUTH_UNITS
from daq.messages import BlockStatus
from daq.rig import Rig, RigError
from simulator.faults import Fault, FaultKind, of_device, of_rig, of_sensor
from simulator.readings import Readings
from simulator.sensors import sensor_table
from simulator.simulation import Simulation, SimulationError
from simulator.state import SIGNALS

OVERRUN, CLIPPED = int(BlockStatus.OVERRUN), int(BlockStatus.CLIPPED)
FORCE = SIGNALS.index("solenoid_force")
RATES = (100.0, 1e6)
CHUNK = 1000
"""Samples simulated at once."""


class Emulator:
    """A device whose rig is simulated (a `Backend` and a `TruthSource`).

    Paced, it lives by the host's monotonic clock from `start` on: a sample exists once its time has come,
    and is computed when it is read. The device holds the rig's `[emulator] buffer` seconds of samples; a
    reader that is further behind loses the oldest. An output takes effect `latency` after the sample that
    the clock has reached when it is written, whether that sample has been computed yet or not.

    Unpaced, the clock is at the last sample read, and each read moves it on by what was asked for.

    Args:
        paced: whether to live by the host's clock.
        clock: seconds that never go back.
    """

    truth_names = TRUTH
    truth_units = TRUTH_UNITS

    def __init__(self, paced: bool = True, clock: Callable[[], float] = monotonic) -> None:
        self.capabilities = Capabilities(
            rates=RATES,
            outputs=(SpeedOutput, HitOutput, RestOutput, EnableOutput),
            hardware_timing=True,
            watchdog_s=None,
            emulated=True,
            paced=paced,
            longest_pulse_s=inf,
        )
        self._now = clock
        self._rig: Rig | None = None
        self._simulation: Simulation | None = None
        self._fresh: Simulation | None = None  # made by `open`, so that `start` takes no time
        self._next = 0  # sample that the next reading begins with
        self._stopped_at: int | None = 0  # what `clock()` says while nothing is sampled
        self._pending: list[tuple[int, int, Output]] = []  # heap of (sample, order of writing, output)
        self._written = 0
        self._enabled = True  # by the enable line
        self._hitting = 0  # number of the solenoid that hit last
        self._signals = Scratch(len(SIGNALS))  # and the force of each solenoid by itself, once opened
        self._part = Scratch(len(SIGNALS))
        self._last = self._signals.columns(0)

    def open(self, rig: Rig) -> None:
        """Take the rig's model and channels, and compile what the first read needs."""
        if not RATES[0] <= rig.acquisition.rate <= RATES[1]:
            allowed = f"{RATES[0]:g} to {RATES[1]:g} Hz"
            raise BackendError(f"the emulator samples with {allowed}, not {rig.acquisition.rate:g} Hz")
        self._rig = rig
        force_per_ampere = rig.solenoids[0].force_per_ampere if rig.solenoids else 1.0
        self._table = sensor_table(
            rig.channels, rig.emulated_model, rig.encoder, force_per_ampere, rig.emulator, rig.solenoids
        )
        self._signals = Scratch(len(SIGNALS) + len(rig.solenoids))
        self._part = Scratch(len(SIGNALS))
        self._solenoids = {solenoid.name: solenoid for solenoid in rig.solenoids}
        self._latency = max(1, round(rig.emulator.latency * rig.acquisition.rate))
        self._buffer = max(1, round(rig.emulator.buffer * rig.acquisition.rate))
        self._warm_up(rig)
        self._fresh = simulation_of(rig)

    def start(self) -> None:
        """Begin at sample 0 with the shaft hanging still."""
        rig = self._opened()
        self._simulation = self._fresh or simulation_of(rig)
        self._fresh = None
        self._readings = self._sensors(rig)
        self._pending.clear()
        self._enabled = True
        self._next = 0
        self._stopped_at = None
        rate, faults = rig.acquisition.rate, [fault for fault in rig.faults if of_device(fault)]
        self._mishaps = Mishaps(faults, rate, self.capabilities.paced, len(rig.channels))
        self._clock = DeviceClock(self._now(), rate, faults)

    def go_on_from(
        self, sample: int, state: NDArray[np.float64], set_point: float, closing: float = 0.0
    ) -> None:
        """Go on at another sample: see `simulator.simulation.Simulation.go_on_from`."""
        self._running().go_on_from(sample, state, set_point, closing)
        self._next = sample

    @property
    def pace(self) -> tuple[float, float]:
        """When sample 0 was, s of the device's clock, and the samples that follow in each of its seconds."""
        return self._clock.origin, self._clock.pace

    def clock(self) -> int:
        """Return the number of samples taken."""
        if self._stopped_at is not None:
            return self._stopped_at
        if not self.capabilities.paced:
            return self._next
        return self._clock.samples(self._now())

    def read(self, out: NDArray[np.float64]) -> Reading:
        """Compute and return the oldest samples that have not been read; `out` must be C-contiguous."""
        simulation = self._running()
        taken = self.clock() if self.capabilities.paced else None
        flags = 0
        if taken is not None and taken - self._buffer > self._next:
            flags |= OVERRUN
            self._lose(simulation, taken - self._buffer)
        delivers, sample = self._mishaps.happen(self._next, taken)
        self._lose(simulation, sample)
        if (repeated := self._mishaps.repeat(self._next, out)) is not None:
            return repeated
        count = self._mishaps.room(self._next, out.shape[1]) if delivers else 0
        if taken is not None:
            count = min(count, taken - self._next)
        return self._deliver(simulation, out, count, flags)

    def truth(self) -> NDArray[np.float64]:
        """Return the true signals of the last reading."""
        return self._last[: len(TRUTH)]

    def write(self, output: Output, at_sample: int | None = None) -> int:
        """Schedule an output; the earliest is `latency` after the present."""
        self._running()
        if isinstance(output, HitOutput) and output.solenoid not in self._solenoids:
            raise BackendError(f"the emulated rig has no solenoid {output.solenoid}")
        reached = self.clock()
        earliest = reached + self._latency
        if at_sample is not None and at_sample < earliest:
            raise PastSampleError(
                f"sample {at_sample} is too early: the device is at {reached} and needs {self._latency} more"
            )
        sample = earliest if at_sample is None else at_sample
        if isinstance(output, RestOutput):
            self._pending = sorted(entry for entry in self._pending if entry[0] <= reached)
        self.schedule(sample, output)
        return sample

    def schedule(self, sample: int, output: Output) -> None:
        """Let an output take effect at a sample that is still to be computed, without any latency."""
        heappush(self._pending, (sample, self._written, output))
        self._written += 1

    def inject(self, fault: Fault) -> None:
        """Let something more go wrong, now or later. Raises `OutputRefused` where it cannot."""
        simulation, rate = self._running(), self._opened().acquisition.rate
        fault = fault._replace(at=max(fault.at, self.clock() / rate))
        try:
            if of_rig(fault):
                simulation.add_fault(fault)
            elif of_sensor(fault):
                self._readings.add_fault(fault)
            elif fault.kind in TIMING and not self.capabilities.paced:
                raise RigError("a device in virtual time has no clock: it can be neither late nor fast")
            elif fault.kind == FaultKind.CLOCK_DRIFT:
                self._clock.add(fault)
            else:
                self._mishaps.add(fault, self._next)
        except RigError as error:
            raise OutputRefused(str(error)) from error

    def stop(self) -> None:
        """End sampling; the simulated rig ends with it."""
        self._stopped_at = self.clock()
        self._simulation = None
        self._pending.clear()

    def close(self) -> None:
        """Forget the rig."""
        self.stop()
        self._rig = self._fresh = None

    def _opened(self) -> Rig:
        if self._rig is None:
            raise BackendError("the emulator is not open: call open(rig) first")
        return self._rig

    def _running(self) -> Simulation:
        if self._simulation is None:
            raise BackendError("the emulator is not sampling: call start() first")
        return self._simulation

    def _deliver(self, simulation: Simulation, out: NDArray[np.float64], count: int, flags: int) -> Reading:
        """Compute the next `count` samples."""
        first = self._next
        self._last = self._signals.columns(count)
        if count:
            self._simulate(simulation, self._last)
            if self._readings.read(self._last, first, out):
                flags |= CLIPPED
            self._mishaps.remember(out[:, :count])
            self._next += count
        return Reading(first, count, flags)

    def _simulate(self, simulation: Simulation, signals: NDArray[np.float64]) -> None:
        """Fill `signals`, performing each output at its sample."""
        done, count = 0, signals.shape[1]
        while done < count:
            self._perform_due(simulation)
            step = count - done
            if self._pending:
                step = min(step, self._pending[0][0] - simulation.sample)
            columns = slice(done, done + step)
            if step == count:
                _advance(simulation, signals[: len(SIGNALS)])
            else:
                part = self._part.columns(step)
                _advance(simulation, part)
                signals[: len(SIGNALS), columns] = part
            self._credit(signals[:, columns])
            done += step

    def _credit(self, signals: NDArray[np.float64]) -> None:
        """Credit the solenoids' force to the one that hit last; the daq lets one hit at a time."""
        own = signals[len(SIGNALS) :]
        own[...] = 0.0
        if len(own):
            own[self._hitting] = signals[FORCE]

    def _perform_due(self, simulation: Simulation) -> None:
        while self._pending and self._pending[0][0] <= simulation.sample:
            _, _, output = heappop(self._pending)
            self._perform(simulation, output)

    def _perform(self, simulation: Simulation, output: Output) -> None:
        """Do what an output says; with the enable line dropped the drive comes to rest and stays."""
        if isinstance(output, EnableOutput):
            self._enabled = output.energised
            if not self._enabled:
                self._perform(simulation, RestOutput(self._opened().safe_state.ramp))
        elif isinstance(output, RestOutput):
            simulation.set_speed(0.0, output.ramp)
            simulation.release()
        elif self._enabled and isinstance(output, HitOutput):
            self._hitting = list(self._solenoids).index(output.solenoid)
            simulation.hit(self._solenoids[output.solenoid], output.force, output.duration)
        elif self._enabled and isinstance(output, SpeedOutput):
            simulation.set_speed(output.speed, output.ramp)

    def _lose(self, simulation: Simulation, until: int) -> None:
        """Go on to sample `until` without keeping what is on the way."""
        while self._next < until:
            count = min(CHUNK, until - self._next)
            signals = self._signals.columns(count)
            self._simulate(simulation, signals)
            self._readings.miss(signals, self._next)
            self._next += count

    def _sensors(self, rig: Rig) -> Readings:
        """Return the rig's sensors before the first sample, with their faults."""
        faults = [fault for fault in rig.faults if of_sensor(fault)]
        return Readings(rig.channels, self._table, faults, rig.acquisition.rate, rig.emulator.seed)

    def _warm_up(self, rig: Rig) -> None:
        """Run everything once, so that what is compiled on its first call is compiled now."""
        simulation = Simulation(rig.emulated_model, rig.acquisition.rate)
        simulation.set_speed(1.0, 1.0)
        for solenoid in rig.solenoids:
            simulation.hit(solenoid, 0.0, solenoid.max_duration)
        signals = self._signals.columns(2)
        _advance(simulation, signals[: len(SIGNALS)])
        self._credit(signals)
        self._sensors(rig).read(signals, 0, np.empty((len(rig.channels), 2)))


class Scratch:
    """Working memory that gives contiguous arrays of a fixed number of rows."""

    def __init__(self, n_rows: int) -> None:
        self._n_rows = n_rows
        self._memory = np.empty(n_rows * CHUNK)

    def columns(self, count: int) -> NDArray[np.float64]:
        """Return an array (n_rows, count); it is valid until the next call."""
        size = self._n_rows * count
        if size > len(self._memory):
            self._memory = np.empty(size)
        return self._memory[:size].reshape(self._n_rows, count)


def simulation_of(rig: Rig) -> Simulation:
    """Return the emulated rig at sample 0, with the faults that it will have."""
    faults = [fault for fault in rig.faults if of_rig(fault)]
    return Simulation(rig.emulated_model, rig.acquisition.rate, faults=faults)


def _advance(simulation: Simulation, signals: NDArray[np.float64]) -> None:
    try:
        simulation.advance(signals)
    except (SimulationError, RigError) as error:
        raise BackendError(f"the emulated rig failed: {error}") from error
