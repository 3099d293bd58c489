"""The emulated device by a clock that the tests turn, so that nothing depends on the machine's speed."""

import numpy as np
import pytest

from daq.backend import BackendError, HitOutput, PastSampleError, RestOutput, SpeedOutput, TruthSource
from daq.backends.emulator import Emulator
from daq.messages import BlockStatus
from daq.rig import load_rig
from simulator.state import TRUTH

RIG = load_rig("thesis-ball")
RATE = RIG.acquisition.rate
LATENCY = 25


class Hands:
    """A clock's hands."""

    def __init__(self):
        self.seconds = 100.0

    def __call__(self):
        return self.seconds


@pytest.fixture
def hands():
    return Hands()


@pytest.fixture
def emulator(hands):
    emulator = Emulator(clock=hands)
    emulator.open(RIG)
    emulator.start()
    yield emulator
    emulator.close()


def read_all(emulator, size=50):
    """Read all that is there: (first sample, raw of shape (n_channels, n), flags)."""
    parts, flags, first = [], 0, None
    while True:
        out = np.empty((len(RIG.channels), size))
        reading = emulator.read(out)
        if not reading.n_samples:
            return first, np.concatenate(parts, axis=1), flags
        first = reading.first_sample if first is None else first
        parts.append(out[:, : reading.n_samples])
        flags |= reading.flags


def test_a_sample_is_there_once_its_time_has_come(emulator, hands):
    out = np.empty((len(RIG.channels), 50))
    assert emulator.read(out).n_samples == 0
    hands.seconds += 10.5 / RATE
    assert emulator.clock() == 10
    assert emulator.read(out)[:2] == (0, 10)
    assert emulator.read(out)[:2] == (10, 0)


def test_any_reading_pattern_gives_the_same_samples(hands):
    def samples_by(size):
        emulator = Emulator(clock=hands)
        emulator.open(RIG)
        emulator.start()
        start = hands.seconds
        emulator.write(SpeedOutput(50.0, 500.0))
        emulator.write(HitOutput("horizontal", 20.0, 0.01), 777)
        hands.seconds += 2000.5 / RATE
        _, samples, _ = read_all(emulator, size)
        hands.seconds = start
        return samples

    whole = samples_by(2000)
    assert whole.shape[1] == 2000
    for size in (1, 7, 50, 333):
        np.testing.assert_array_equal(samples_by(size), whole)


def test_an_output_takes_effect_after_the_clock_not_after_what_was_read(emulator, hands):
    hands.seconds += 1000.5 / RATE
    sample = emulator.write(SpeedOutput(50.0, 500.0))
    assert sample == 1000 + LATENCY
    hands.seconds += 1000.5 / RATE
    _, raw, _ = read_all(emulator)
    command = raw[RIG.channels.index("motor_speed_command")]
    assert np.ptp(command[: sample + 1]) == 0.0
    assert command[sample + 20] > command[sample]


def test_a_hit_shows_at_its_sample(emulator, hands):
    assert emulator.write(HitOutput("horizontal", 40.0, 0.01), 500) == 500
    hands.seconds += 1000.5 / RATE
    _, raw, _ = read_all(emulator)
    current = raw[RIG.channels.index("solenoid_current")]
    assert np.abs(current[:500]).max() < 0.1
    assert current[500:750].max() == pytest.approx(40.0 / 20.0 * 2.0, rel=0.01)
    assert np.abs(current[751:]).max() < 0.1


def test_rest_cuts_a_hit_and_forgets_the_scheduled_ones(emulator, hands):
    emulator.write(HitOutput("horizontal", 40.0, 0.05))
    emulator.write(HitOutput("horizontal", 40.0, 0.01), 5000)
    hands.seconds += 400.5 / RATE
    rest = emulator.write(RestOutput(250.0))
    hands.seconds += 6000 / RATE
    _, raw, _ = read_all(emulator)
    current = raw[RIG.channels.index("solenoid_current")]
    assert current[300] > 1.0
    assert np.abs(current[rest:]).max() < 0.1


def test_an_output_for_a_sample_that_has_passed_is_refused(emulator, hands):
    hands.seconds += 1000.5 / RATE
    with pytest.raises(PastSampleError, match="the device is at 1000 and needs 25 more"):
        emulator.write(SpeedOutput(1.0, 1.0), 1010)


def test_a_reader_within_the_buffer_loses_nothing(emulator, hands):
    hands.seconds += RIG.emulator.buffer - 0.001
    first, raw, flags = read_all(emulator, 1000)
    assert first == 0
    assert raw.shape[1] == emulator.clock()
    assert not flags & BlockStatus.OVERRUN


def test_what_the_buffer_cannot_hold_is_lost_and_said(emulator, hands):
    hands.seconds += RIG.emulator.buffer + 0.1
    first, raw, flags = read_all(emulator, 1000)
    held = round(RIG.emulator.buffer * RATE)
    assert first == emulator.clock() - held
    assert raw.shape[1] == held
    assert flags & BlockStatus.OVERRUN


def test_the_rig_goes_on_while_samples_are_lost(hands):
    def speed_after(pause):
        emulator = Emulator(clock=hands)
        emulator.open(RIG)
        emulator.start()
        start = hands.seconds
        emulator.write(SpeedOutput(60.0, 30.0))
        hands.seconds += pause
        read_all(emulator, 1000)
        hands.seconds = start + 6.0
        _, raw, _ = read_all(emulator, 1000)
        hands.seconds = start
        return raw[:, -1000:]

    np.testing.assert_array_equal(speed_after(5.5), speed_after(1.0))


def test_knows_the_truth_of_the_last_reading(emulator, hands):
    assert isinstance(emulator, TruthSource)
    assert emulator.truth_names == TRUTH
    assert len(emulator.truth_units) == len(TRUTH)
    hands.seconds += 30.5 / RATE
    emulator.read(np.empty((len(RIG.channels), 50)))
    truth = emulator.truth()
    assert truth.shape == (len(TRUTH), 30)
    station = RIG.model.rotor.disk_station
    assert truth[TRUTH.index("tilt_y"), 0] * station == pytest.approx(-1.704e-3, rel=0.01)


def test_readings_agree_with_the_truth(emulator, hands):
    hands.seconds += 50.5 / RATE
    out = np.empty((len(RIG.channels), 50))
    emulator.read(out)
    row = RIG.channels.index("proximity_y")
    measured = out[row] / RIG.channels["proximity_y"].sensitivity
    true = emulator.truth()[TRUTH.index("tilt_y")] * RIG.model.rotor.disk_station
    assert np.abs(measured - true).max() < 10e-6


def test_unpaced_the_clock_is_what_was_read():
    emulator = Emulator(paced=False)
    emulator.open(RIG)
    emulator.start()
    assert emulator.clock() == 0
    assert emulator.read(np.empty((len(RIG.channels), 250)))[:2] == (0, 250)
    assert emulator.clock() == 250
    assert emulator.write(SpeedOutput(1.0, 1.0)) == 250 + LATENCY


def test_the_actual_rig_may_differ_from_the_told_one(hands):
    rig = load_rig("thesis-ball", ["emulator.actual.magnetic_bearing.stiffness=1800.0"])
    emulator = Emulator(clock=hands)
    emulator.open(rig)
    emulator.start()
    hands.seconds += 10.5 / RATE
    emulator.read(np.empty((len(rig.channels), 10)))
    lower = emulator.truth()[TRUTH.index("tilt_y"), 0] * rig.model.rotor.disk_station
    assert lower < -1.75e-3


def test_an_unknown_solenoid_is_refused(emulator):
    with pytest.raises(BackendError, match="no solenoid vertical"):
        emulator.write(HitOutput("vertical", 1.0, 0.01))


def test_a_rate_that_cannot_be_is_refused():
    rig = load_rig("thesis-ball", ["acquisition.rate=50.0", "acquisition.read=1", "acquisition.block=5"])
    with pytest.raises(BackendError, match="100 to 1e\\+06 Hz, not 50 Hz"):
        Emulator().open(rig)
