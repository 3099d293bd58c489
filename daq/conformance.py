"""The tests that every backend passes: the rules of `daq.backend.Backend`, run on a real device.

A laboratory tests its own backend by subclassing in a pytest module::

    from daq.conformance import BackendConformance

    class TestMyDevice(BackendConformance):
        rig = load_rig("my-rig.toml")

        def new_backend(self):
            return MyDevice()

Tests of outputs are skipped where the device declares none, or where the rig has no channel
`motor_speed_command`, or `solenoid_current`, on which an output shows.
"""

import threading
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from typing import ClassVar

import numpy as np
import pytest
from numpy.typing import NDArray

from daq.backend import Backend, BackendError, HitOutput, PastSampleError, RestOutput, SpeedOutput
from daq.messages import BlockStatus
from daq.rig import Rig

PATIENCE = 30.0
"""s that a device may take to deliver what a test waits for."""
PAUSE = 0.2
"""s for which a reader pauses."""
SPEED = 30.0
RAMP = 300.0
SHOWS_ON = "motor_speed_command"
PULSE = 0.005
"""s that a solenoid is on."""
PULSE_SHOWS_ON = "solenoid_current"


class BackendConformance(ABC):
    """Subclass it as `Test...`, give `rig` and `new_backend`."""

    rig: ClassVar[Rig]

    @abstractmethod
    def new_backend(self) -> Backend:
        """Return a new, unopened backend."""

    @pytest.fixture
    def backend(self) -> Iterator[Backend]:
        """Give a sampling device."""
        backend = self.new_backend()
        backend.open(self.rig)
        backend.start()
        yield backend
        backend.close()

    def test_tells_what_it_can_before_it_is_opened(self) -> None:
        """A new backend tells its capabilities, and they include the rig's rate."""
        backend = self.new_backend()
        assert isinstance(backend, Backend)
        lowest, highest = backend.capabilities.rates
        assert lowest <= self.rig.acquisition.rate <= highest

    def test_close_may_come_at_any_time_and_twice(self) -> None:
        """`close` does no harm, unopened, sampling or closed."""
        backend = self.new_backend()
        backend.close()
        backend = self.new_backend()
        backend.open(self.rig)
        backend.start()
        backend.close()
        backend.close()

    def test_reading_or_writing_before_start_is_refused(self) -> None:
        """A device that does not sample raises `BackendError`."""
        backend = self.new_backend()
        with pytest.raises(BackendError):
            backend.read(np.empty((len(self.rig.channels), 1)))
        with pytest.raises(BackendError):
            backend.write(RestOutput(RAMP))

    def test_samples_follow_one_another_from_zero(self, backend: Backend) -> None:
        """No sample is missing, none comes twice, all are numbers."""
        samples = self.collect(backend, 2000)
        assert samples.shape == (len(self.rig.channels), 2000)
        assert np.isfinite(samples).all()

    def test_raw_values_are_within_the_ranges(self, backend: Backend) -> None:
        """Raw readings are what the inputs can read."""
        samples = self.collect(backend, 500)
        for channel, values in zip(self.rig.channels, samples, strict=True):
            assert min(channel.range) <= values.min() <= values.max() <= max(channel.range), channel.name

    @pytest.mark.parametrize("size", [1, 7, 50, 250])
    def test_fills_no_more_than_it_says(self, backend: Backend, size: int) -> None:
        """A reading fills as many columns as it says and no others."""
        out = np.full((len(self.rig.channels), size), np.nan)

        def read() -> bool:
            reading = backend.read(out)
            assert 0 <= reading.n_samples <= size
            assert np.isfinite(out[:, : reading.n_samples]).all()
            assert np.isnan(out[:, reading.n_samples :]).all()
            return reading.n_samples > 0

        self.until(read)

    def test_the_clock_never_goes_back_and_covers_what_was_read(self, backend: Backend) -> None:
        """`clock` grows, and no sample is read before it was taken."""
        out = np.empty((len(self.rig.channels), 50))
        before, read = backend.clock(), 0

        def advance() -> bool:
            nonlocal before, read
            reading = backend.read(out)
            read = reading.first_sample + reading.n_samples
            now = backend.clock()
            assert before <= now
            assert read <= now
            before = now
            return read >= 1000

        self.until(advance)

    def test_a_paced_clock_keeps_the_rate(self, backend: Backend) -> None:
        """The device's clock agrees with the host's within 2 percent."""
        if not backend.capabilities.paced:
            pytest.skip("the device is not paced")
        rate = self.rig.acquisition.rate
        early, first, late = time.monotonic(), backend.clock(), time.monotonic()
        self.until(lambda: backend.clock() >= first + 0.2 * rate)
        early_now, now, late_now = time.monotonic(), backend.clock(), time.monotonic()
        assert 0.98 * rate * (early_now - late) - 0.02 * rate <= now - first
        assert now - first <= 1.02 * rate * (late_now - early) + 0.02 * rate

    def test_an_output_takes_effect_where_it_says(self, backend: Backend) -> None:
        """An output shows from the sample that `write` returned, not before."""
        row = self.output_row(backend)
        before = backend.clock()
        sample = backend.write(SpeedOutput(SPEED, RAMP))
        assert sample >= before
        commands = self.collect(backend, sample + 1000)[row]
        assert np.ptp(commands[:sample]) == 0.0
        assert commands[-1] != commands[0]

    def test_a_scheduled_output_takes_effect_exactly_there(self, backend: Backend) -> None:
        """An output with `at_sample` shows there, to within 100 samples."""
        row = self.output_row(backend)
        if not backend.capabilities.hardware_timing:
            pytest.skip("the device has no hardware timing")
        wanted = backend.clock() + round(0.2 * self.rig.acquisition.rate)
        assert backend.write(SpeedOutput(SPEED, RAMP), wanted) == wanted
        commands = self.collect(backend, wanted + 1000)[row]
        assert np.ptp(commands[:wanted]) == 0.0
        assert np.ptp(commands[wanted : wanted + 100]) > 0.0

    def test_a_schedule_in_the_past_is_refused(self, backend: Backend) -> None:
        """A sample that has passed raises `PastSampleError`."""
        self.output_row(backend)
        self.collect(backend, 100)
        with pytest.raises(PastSampleError):
            backend.write(SpeedOutput(SPEED, RAMP), 10)

    def test_rest_overrides_what_was_written_before(self, backend: Backend) -> None:
        """After a `RestOutput` nothing earlier moves the rig, schedules included."""
        row = self.output_row(backend)
        backend.write(SpeedOutput(SPEED, RAMP))
        if backend.capabilities.hardware_timing:
            backend.write(SpeedOutput(SPEED, RAMP), backend.clock() + round(0.2 * self.rig.acquisition.rate))
        sample = backend.write(RestOutput(RAMP))
        commands = self.collect(backend, sample + round(0.5 * self.rig.acquisition.rate))[row]
        assert np.ptp(commands[-100:]) == 0.0
        assert commands[-1] == commands[0]

    def test_a_pulse_ends_by_itself(self, backend: Backend) -> None:
        """A device that says that it times a pulse ends it, although nobody calls it meanwhile."""
        row = self.pulse_row(backend)
        solenoid = self.rig.solenoids[0]
        duration = min(PULSE, solenoid.max_duration)
        count = round(duration * self.rig.acquisition.rate)
        pieces: list[NDArray[np.float64]] = []
        out = np.empty((len(self.rig.channels), self.rig.acquisition.read))

        def read_to(end: int) -> bool:
            reading = backend.read(out)
            pieces.append(out[row, : reading.n_samples].copy())
            return sum(map(len, pieces)) >= end

        self.until(lambda: read_to(4 * count))
        begin = backend.write(HitOutput(solenoid.name, solenoid.max_force, duration))
        time.sleep(4.0 * duration)
        self.until(lambda: read_to(begin + 6 * count))
        current = np.concatenate(pieces)
        before, during = current[:begin], current[begin : begin + 2 * count]
        after = current[begin + 2 * count :]  # what a filter needs is over by then
        rest = np.median(before)
        largest = np.abs(during - rest).max()
        assert largest > 5.0 * np.abs(before - rest).max()
        assert largest > 5.0 * np.abs(after - rest).max()

    def test_starts_again_at_zero_after_a_stop(self, backend: Backend) -> None:
        """A second `start` counts from 0 without a gap."""
        self.collect(backend, 500)
        backend.stop()
        backend.start()
        self.collect(backend, 500)

    def test_a_reader_that_pauses_gets_all_or_is_told(self, backend: Backend) -> None:
        """After a pause the samples follow without a gap, or the reading behind the gap says so."""
        out = np.empty((len(self.rig.channels), self.rig.acquisition.read))
        time.sleep(PAUSE)
        expected = 0

        def read() -> bool:
            nonlocal expected
            reading = backend.read(out)
            if reading.n_samples:
                assert reading.first_sample >= expected
                assert reading.first_sample == expected or reading.flags & BlockStatus.OVERRUN
                expected = reading.first_sample + reading.n_samples
            return expected >= 1.5 * PAUSE * self.rig.acquisition.rate

        self.until(read)

    def test_an_unplugged_device_is_an_error(self, backend: Backend) -> None:
        """Who reads, or asks for the clock, learns that the device is gone; `close` still does no harm."""
        self.collect(backend, 100)
        self.unplug(backend)
        out = np.empty((len(self.rig.channels), self.rig.acquisition.read))

        def read() -> bool:
            backend.clock()
            backend.read(out)
            return False

        with pytest.raises(BackendError):
            self.until(read)
        backend.close()

    def test_close_leaves_no_thread_behind(self) -> None:
        """What a device started for itself has ended after `close`."""
        before = set(threading.enumerate())
        backend = self.new_backend()
        backend.open(self.rig)
        backend.start()
        backend.close()
        assert set(threading.enumerate()) <= before

    def unplug(self, backend: Backend) -> None:
        """Take the device away, as a pulled cable does. Where that cannot be done the test is skipped."""
        pytest.skip("the device cannot be unplugged by a program")

    def output_row(self, backend: Backend) -> int:
        """Return the row on which a speed output shows, or skip the test."""
        if SpeedOutput not in backend.capabilities.outputs or SHOWS_ON not in self.rig.channels:
            pytest.skip("no output to be seen")
        return self.rig.channels.index(SHOWS_ON)

    def pulse_row(self, backend: Backend) -> int:
        """Return the row on which the first solenoid's pulse shows, or skip the test."""
        if HitOutput not in backend.capabilities.outputs or PULSE_SHOWS_ON not in self.rig.channels:
            pytest.skip("no solenoid to be seen")
        longest = backend.capabilities.longest_pulse_s
        assert longest is not None, "it has HitOutput but no longest_pulse_s: all hits would be refused"
        if longest < PULSE:
            pytest.skip(f"the device times no pulse of {PULSE} s")
        return self.rig.channels.index(PULSE_SHOWS_ON)

    def collect(self, backend: Backend, count: int) -> NDArray[np.float64]:
        """Read samples 0 to `count` - 1 of a run and return them; fail when any is missing."""
        samples = np.empty((len(self.rig.channels), count))
        out = np.empty((len(self.rig.channels), self.rig.acquisition.read))
        done = 0

        def read() -> bool:
            nonlocal done
            reading = backend.read(out)
            if reading.n_samples:
                assert reading.first_sample == done
            taken = min(reading.n_samples, count - done)
            samples[:, done : done + taken] = out[:, :taken]
            done += taken
            return done == count

        self.until(read)
        return samples

    @staticmethod
    def until(condition: Callable[[], bool]) -> None:
        """Try again and again until the condition is met."""
        deadline = time.monotonic() + PATIENCE
        while not condition():
            assert time.monotonic() < deadline, "the device took too long"
            time.sleep(0.0005)
