"""openDAQ's own reference device, which streams by its own thread and clock."""

import sys
import time
from importlib.util import find_spec

import numpy as np
import pytest

from daq.acquisition import Acquisition
from daq.backend import BackendError, HitOutput, make_backend
from daq.backends.opendaq import OpenDaq, Samples, run_length, sample_indices
from daq.conformance import BackendConformance
from daq.describe import describe
from daq.messages import BlockStatus
from daq.optional import MissingPackage
from daq.recording import Recording, RecordingWriter
from daq.rig import load_rig
from tests.conftest import require

NAME = "opendaq-reference"


@pytest.fixture(autouse=True)
def installed():
    require(find_spec("opendaq") is not None, "opendaq")


class TestOpenDaq(BackendConformance):
    rig = load_rig(NAME)

    def new_backend(self):
        return make_backend("opendaq")

    def unplug(self, backend):
        backend._instance.remove_device(backend._device)


def stream(path, seconds):
    """Record so many seconds of the device, through acquisition and writer."""
    rig, messages = load_rig(NAME), []
    backend = make_backend("opendaq")
    backend.open(rig)
    acquisition = Acquisition(rig, backend, lambda key, payload: messages.append((key, payload)), run="r")
    try:
        acquisition.begin()
        with RecordingWriter(path, describe(rig, "r", acquisition.start_time, emulated=False)) as writer:
            while acquisition.sample < seconds * rig.acquisition.rate:
                time.sleep(min(0.002, acquisition.due()))
                if acquisition.due() <= 0.0:
                    acquisition.step()
            acquisition.end()
            for message in messages:
                writer.add(*message)
            writer.close(expected=acquisition.sample, clean=True)
    finally:
        backend.close()
    return rig


@pytest.mark.parametrize("seconds", [2.0, pytest.param(60.0, marks=pytest.mark.slow)])
def test_streams_into_a_recording_without_a_gap(tmp_path, seconds):
    rig = stream(tmp_path / "run.mcap", seconds)
    with Recording(tmp_path / "run.mcap") as recording:
        assert recording.check().verdict == "valid"
        assert [event.kind for event in recording.events()] == ["start", "end"]
        signals = recording.series()
    assert signals.gaps == ()
    assert signals.samples.shape[1] >= seconds * rig.acquisition.rate
    # The device makes 10 Hz sines of 5 V, whose crossings of zero tell the rate by the sample index.
    force = signals["support_force"]
    assert np.abs(force).max() == pytest.approx(5.0 / 0.02, rel=1e-3)
    rising = np.flatnonzero((force[:-1] < 0.0) & (force[1:] >= 0.0))
    assert np.diff(rising) == pytest.approx(np.full(len(rising) - 1, 2500.0), abs=1.0)


def test_a_device_that_is_not_there_is_named():
    rig = load_rig(NAME, ["device.address=daqref://device9"])
    with pytest.raises(BackendError, match="openDAQ finds no device daqref://device9"):
        OpenDaq().open(rig)


def test_a_rate_that_the_device_cannot_keep_is_refused():
    rig = load_rig(NAME, ["acquisition.rate=51200.0"])
    with pytest.raises(BackendError, match=r"with 50000 Hz when told 51200 Hz: write .* rate = 50000"):
        OpenDaq().open(rig)


@pytest.mark.parametrize(
    ("setting", "message"),
    [
        ("device.properties.NumberOfChanels=4", "NumberOfChanels = 4: .*did you mean NumberOfChannels"),
        ("device.properties.NumberOfChannels=-3", "NumberOfChannels = -3: .* made 1 of it"),
        ("device.propertys=1", "propertys is not a key for openDAQ; did you mean properties"),
        ("device.address=3", "lacks address: openDAQ's connection string"),
        ("channel.probe_left.terminal=RefCh7", 'terminal = "RefCh7" is no channel .*RefCh'),
    ],
)
def test_what_is_wrong_with_the_description_is_said(setting, message):
    with pytest.raises(BackendError, match=message):
        OpenDaq().open(load_rig(NAME, [setting]))


def test_a_device_that_falls_silent_is_a_failure(monkeypatch):
    monkeypatch.setattr("daq.backends.opendaq.SILENCE", 0.1)
    backend = OpenDaq()
    backend.open(load_rig(NAME))
    backend.start()
    backend._instance.remove_device(backend._device)
    out = np.empty((4, 1000))

    def go_on():
        for _ in range(1000):
            backend.clock()
            backend.read(out)
            time.sleep(0.002)

    with pytest.raises(BackendError, match=r"has delivered nothing for 0\.1 s"):
        go_on()


def test_nothing_can_be_moved():
    backend = OpenDaq()
    backend.open(load_rig(NAME))
    backend.start()
    with pytest.raises(BackendError, match="daqref://device0 has no outputs"):
        backend.write(HitOutput("any", 1.0, 0.01))
    backend.close()


def test_a_missing_driver_names_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "opendaq", None)
    with pytest.raises(MissingPackage, match=r"pip install 'rigtwin\[opendaq\]'"):
        OpenDaq().open(load_rig(NAME))


def test_jumps_of_the_domain_signal_are_gaps():
    class Reader:
        available_count = 0

        def read_with_domain(self, most, timeout_ms):
            ticks = 1000 + 40 * np.array([[0, 1, 2, 7, 8]])
            return np.arange(10.0).reshape(2, 5), np.repeat(ticks, 2, axis=0)

    backend = OpenDaq()
    backend._reader, backend._origin, backend._ticks_per_sample, backend._next = Reader(), 1000, 40, 0
    backend._kept = Samples(np.empty((2, 0)), np.empty(0, np.int64))
    out = np.full((2, 5), np.nan)
    assert backend.read(out) == (0, 3, 0)
    np.testing.assert_array_equal(out[:, :3], [[0, 1, 2], [5, 6, 7]])
    assert backend.read(out) == (7, 2, BlockStatus.OVERRUN)
    np.testing.assert_array_equal(out[:, :2], [[3, 4], [8, 9]])


def test_indices_follow_from_ticks():
    ticks = 5_000 + np.array([0, 39, 41, 80, 160])
    np.testing.assert_array_equal(sample_indices(ticks, 5_000, 40), [0, 1, 1, 2, 4])
    assert run_length(np.array([], np.int64)) == 0
    assert run_length(np.array([4, 5, 7])) == 2
