"""A recording in several parts of a limited size, and a recorder whose disk fills up."""

from collections import Counter

import numpy as np
import pytest

from daq import keys
from daq.link import Inbox
from daq.messages_pb2 import Status
from daq.recording import Recording, parts
from daq.recording.recorded_run import RecordedRun
from daq.recording.rotation import Rotation, RotationError, rotation
from replay.info import info, text
from tests.daq.broadcast import PATIENCE, Broadcast
from tests.daq.disk import small_disk
from tests.daq.recorded_run import BLOCK, NAMES, RIG, samples
from tests.twin.recorders import blocks, recorded, said


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("10min", Rotation(seconds=600.0)),
        ("1.5h", Rotation(seconds=5400.0)),
        ("30 s", Rotation(seconds=30.0)),
        ("500MB", Rotation(size=5e8)),
        ("2GB", Rotation(size=2e9)),
    ],
)
def test_sizes_and_times_of_a_part(text, expected):
    assert rotation(text) == expected


@pytest.mark.parametrize("text", ["", "10", "min", "0.5s", "0.1MB", "-1GB", "1.2.3h", "2 weeks"])
def test_what_is_no_size_is_refused_with_an_example(text):
    with pytest.raises(RotationError, match="such as 10min or 500MB"):
        rotation(text)


@pytest.mark.parametrize("size", ["1s", "1MB"])
def test_parts_follow_without_a_gap_and_are_read_as_one(tmp_path, rig, start, size):
    path = tmp_path / "run.mcap"
    recorder = start(path, "--rotate", size)
    with Broadcast(rig[0]) as daq:
        daq.wait_for("recorder")
        daq.put_blocks(0, 350)
        daq.finish(350)
        assert recorder.wait(PATIENCE) == 0
    files = parts(path)
    assert len(files) >= 2  # of a size, how many depends on how well the chunks are compressed
    assert f"{350 * BLOCK} samples recorded, 0 lost" in said(recorder)[-1]
    assert Counter(item for file in files for item in recorded(file)) == Counter(daq.sent)
    assert [block for file in files for block in blocks(recorded(file))] == blocks(daq.sent)
    for file in files:
        with Recording(file) as part:
            assert part.check()[:2] == ("valid", "")
    found = info(path)
    assert (found["samples"], found["lost"], found["certificate"]["verdict"]) == (350 * BLOCK, 0, "valid")
    assert found["certificate"]["clean"]
    assert "goes on in run.part2.mcap" in text(found)
    with RecordedRun(path) as run:
        assert not run.series().gaps
        np.testing.assert_array_equal(run.series().samples, samples(0, len(NAMES), 350 * BLOCK))
        assert len(run.events()) == 36


def test_a_part_that_is_missing_is_named(tmp_path, rig, start):
    path = tmp_path / "run.mcap"
    recorder = start(path, "--rotate", "1s")
    with Broadcast(rig[0]) as daq:
        daq.wait_for("recorder")
        daq.put_blocks(0, 250)
        daq.finish(250)
        assert recorder.wait(PATIENCE) == 0
    third = parts(path)[2]
    third.unlink()
    certificate = info(path)["certificate"]
    assert (certificate["verdict"], certificate["clean"]) == ("incomplete", False)
    assert certificate["reason"] == f"it goes on in {third}, which is missing"


def test_a_disk_that_fills_up_is_warned_of_and_ends_the_recording_in_order(tmp_path, rig, start):
    states = Inbox(10_000, "drop_oldest")
    with small_disk(tmp_path / "disk", 8) as disk, Broadcast(rig[0]) as daq:
        daq.link.subscribe(keys.status(RIG, "recorder"), states)
        recorder = start(disk / "run.mcap")
        daq.wait_for("recorder")
        number = 0
        while recorder.poll() is None and number < 5000:
            daq.put_blocks(number, number + 10)
            number += 10
        assert recorder.wait(PATIENCE) == 1
        assert "the disk is full: free some space" in said(recorder)[-1]
        with Recording(disk / "run.mcap") as recording:
            assert recording.complete
            assert recording.check()[:2] == ("incomplete", "the recording ended before the run did")
            assert (
                blocks(recorded(recording.path))
                == blocks(daq.sent)[: recording.certificate.received // BLOCK]
            )
        again = start(disk / "again.mcap")
        assert again.wait(PATIENCE) == 1
        assert "the disk is full" in said(again)[0]
        assert not (disk / "again.mcap").exists()
    told = []
    while (item := states.get(0.0)) is not None:
        told.append(Status.FromString(item[1]).state)
    warned = [state for state in told if state.startswith("the disk is nearly full: ")]
    assert warned
    assert told.index(warned[0]) < told.index(next(state for state in told if "free some space" in state))
