"""A recording played as a device: the daq makes the same run of it again."""

import numpy as np
import pytest

from daq import keys
from daq.acquisition import Acquisition
from daq.backend import BackendError, SpeedOutput, make_backend
from daq.backends.recording import RecordedDevice
from daq.conformance import BackendConformance
from daq.describe import describe
from daq.messages import BlockStatus, SeriesEncoder, decode_series
from daq.recording import Recording, RecordingWriter
from daq.rig import load_rig, with_overrides
from daq.timing import StartTime

SECONDS, BLOCK = 1.2, 250
GAP = 40  # blocks before the one that is left out in the recording with a gap


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """The emulated rig at rest, and the same with one block missing: paths and the raw readings."""
    folder = tmp_path_factory.mktemp("recorded")
    rig = load_rig("thesis-ball")
    emulator = make_backend("emulator", paced=False)
    emulator.open(rig)
    emulator.start()
    raw = np.empty((len(rig.channels), round(SECONDS * rig.acquisition.rate)))
    emulator.read(raw)
    emulator.close()
    values = rig.channels.calibrate(raw, np.empty_like(raw)).astype(np.float32)
    encoder = SeriesEncoder("r", rig.acquisition.rate, rig.channels.names, rig.channels.units)
    start = StartTime(1_800_000_000_000_000_000, 0, "given")
    for name, missing in (("whole", None), ("gap", GAP)):
        with RecordingWriter(folder / f"{name}.mcap", describe(rig, "r", start, emulated=True)) as writer:
            for first in range(0, raw.shape[1], BLOCK):
                if first != (missing or -1) * BLOCK:
                    part = np.ascontiguousarray(values[:, first : first + BLOCK])
                    time = start.timestamp(first, rig.acquisition.rate)
                    writer.add(keys.block(rig.name), encoder.encode(time, first, 0, part))
            writer.close(expected=raw.shape[1], clean=True)
    return folder, raw


@pytest.fixture
def rig(recorded):
    return rig_of(recorded[0] / "whole.mcap")


def rig_of(path, *settings):
    return load_rig("thesis-ball", ["acquisition.backend=recording", f"device.address={path}", *settings])


def opened(rig):
    backend = RecordedDevice(paced=False)
    backend.open(rig)
    backend.start()
    return backend


class TestRecordedDevice(BackendConformance):
    @pytest.fixture(autouse=True)
    def its_rig(self, rig):
        type(self).rig = rig

    def new_backend(self):
        return make_backend("recording")


class TestUnpacedRecordedDevice(TestRecordedDevice):
    def new_backend(self):
        return make_backend("recording", paced=False)


def test_the_readings_are_those_that_were_recorded(rig, recorded):
    backend = opened(rig)
    out = np.empty((len(rig.channels), 333))
    raw = np.empty_like(recorded[1])
    done = 0
    while done < raw.shape[1]:
        reading = backend.read(out)
        raw[:, done : done + reading.n_samples] = out[:, : reading.n_samples]
        done += reading.n_samples
    for channel, found, true in zip(rig.channels, raw, recorded[1], strict=True):
        # float32 in the recording keeps 24 bits of a value
        assert np.abs(found - true).max() <= 2.0**-23 * np.abs(true - channel.offset).max() + 1e-12
    with pytest.raises(BackendError, match=r"whole\.mcap is over after 1\.200 s"):
        backend.read(out)


def test_the_daq_publishes_the_recorded_blocks_again(rig, recorded):
    published = []
    acquisition = Acquisition(rig, opened(rig), lambda key, load: published.append((key, load)), run="again")
    acquisition.begin()
    while acquisition.sample < recorded[1].shape[1]:
        acquisition.step()
    acquisition.end()
    again = [decode_series(load).samples for key, load in published if key == keys.block(rig.name)]
    with Recording(recorded[0] / "whole.mcap") as recording:
        np.testing.assert_array_equal(np.concatenate(again, axis=1), recording.series().samples)


def test_a_gap_in_the_recording_is_a_gap_again(recorded):
    rig = rig_of(recorded[0] / "gap.mcap")
    backend = opened(rig)
    out = np.empty((len(rig.channels), BLOCK))
    readings = [backend.read(out) for _ in range(GAP + 1)]
    assert readings[GAP - 1] == ((GAP - 1) * BLOCK, BLOCK, 0)
    assert readings[GAP] == ((GAP + 1) * BLOCK, BLOCK, BlockStatus.OVERRUN)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        (["acquisition.rate=10000.0"], r"sampled with 25000 Hz: write .* rate = 25000\.0"),
        (["device.address=nowhere.mcap"], "nowhere.mcap"),
        (["device.address=1"], "lacks address: the recording to play"),
    ],
)
def test_a_recording_that_does_not_fit_is_refused(recorded, settings, message):
    with pytest.raises(BackendError, match=message):
        RecordedDevice().open(rig_of(recorded[0] / "whole.mcap", *settings))


def test_a_channel_that_was_not_recorded_is_named(rig):
    toml = with_overrides(rig, []).toml.replace("force_top", "force_upper")
    from daq.rig import rig_from_text

    with pytest.raises(BackendError, match="no channel force_upper; did you mean force_top"):
        RecordedDevice().open(rig_from_text(toml))


def test_a_recording_cannot_be_moved(rig):
    with pytest.raises(BackendError, match="a recording has no outputs"):
        opened(rig).write(SpeedOutput(1.0, 1.0))
