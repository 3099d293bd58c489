"""Replays that are steered while they run: by the commands that a user gives, through the link."""

import pytest

from daq import keys
from daq.messages import decode_series
from daq.messages_pb2 import Event
from daq.recording import RecordingWriter, part_path
from replay.play import play
from replay.player import PlayerError
from rigtwin.replay_control import send
from tests.daq.broadcast import PATIENCE
from tests.daq.recorded_run import BLOCK, RIG, Maker, description, record
from tests.replay.players import Listener

LONG = 3000  # blocks: 30 s


@pytest.fixture
def listener(rig):
    listener = Listener(rig[0])
    yield listener
    listener.leave()


def next_block(listener: Listener) -> int:
    """Return the number of the next block that comes."""
    while True:
        item = listener.take()
        assert item is not None, "the replay fell silent"
        if item[0] == keys.block(RIG):
            return decode_series(item[1]).first_sample // BLOCK


def blocks_until(listener: Listener, wanted) -> list[int]:
    numbers = [next_block(listener)]
    while not wanted(numbers[-1]):
        numbers.append(next_block(listener))
    return numbers


def accepted(rig, name: str, **values: float) -> str:
    answer = send(rig[0], name, values)
    assert answer.accepted, answer.text
    return answer.text


def test_a_replay_is_paused_stepped_and_sought(tmp_path, rig, start, listener):
    record(tmp_path / "run.mcap", blocks=LONG)
    player = start(tmp_path / "run.mcap", "--wait-for", "twin")
    blocks_until(listener, lambda number: number >= 10)
    assert accepted(rig, "pause").startswith("paused at 0.")
    accepted(rig, "seek", seconds=20.0)
    assert blocks_until(listener, lambda number: number >= 2000)[-1] == 2000
    accepted(rig, "step", blocks=3)
    assert [next_block(listener) for _ in range(3)] == [2001, 2002, 2003]
    accepted(rig, "seek", by=-10.0)
    assert next_block(listener) == 1003
    assert send(rig[0], "seek", {"seconds": 31.0}).text.startswith("seek takes a time from 0 to 30.000 s")
    accepted(rig, "rate", times=1000.0)
    accepted(rig, "resume")
    assert blocks_until(listener, lambda number: number == LONG - 1) == list(range(1004, LONG))
    listener.listen()
    assert player.wait(PATIENCE) == 0


def test_a_loop_begins_again_and_ends_when_it_is_told(tmp_path, rig, start, listener):
    written = record(tmp_path / "run.mcap", blocks=20)
    player = start(tmp_path / "run.mcap", "--rate", "5", "--loop", "--wait-for", "twin")
    passes = blocks_until(listener, lambda number: number == 19)
    assert next_block(listener) == 0
    assert passes == list(range(20))
    assert accepted(rig, "loop", on=0.0) == "ending at the end"
    rest = listener.listen()
    assert rest[-1] == written[-1]
    assert [Event.FromString(m).kind for k, m in rest if k == keys.event(RIG, "daq")][-1] == "end"
    assert player.wait(PATIENCE) == 0


def test_it_begins_where_it_is_told(tmp_path, rig, start, listener):
    written = record(tmp_path / "run.mcap", blocks=100)
    start(tmp_path / "run.mcap", "--rate", "max", "--start", "0.75", "--wait-for", "twin")
    first = next(n for n, item in enumerate(written) if item == Maker().truth(75))
    expected = [item for item in written[first:] if "twin/estimate" not in item[0]]
    assert listener.listen() == expected


def test_several_recordings_follow_one_another_with_one_end(tmp_path, rig, start, listener):
    one = record(tmp_path / "one.mcap", blocks=10)
    make = Maker("run-2")
    two = [*map(make.block, range(10)), make.end(10)]
    with RecordingWriter(tmp_path / "two.mcap", description(run="run-2")) as writer:
        for message in two:
            writer.add(*message)
    player = start(tmp_path / "one.mcap", tmp_path / "two.mcap", "--rate", "max", "--wait-for", "twin")
    played = [item for item in one[:-1] if "twin/estimate" not in item[0]]
    assert listener.listen() == [*played, *two]
    assert player.wait(PATIENCE) == 0


def test_the_parts_of_a_recording_are_played_once_however_they_are_named(tmp_path, rig, start, listener):
    make, path = Maker(), tmp_path / "run.mcap"
    with RecordingWriter(path, description()) as writer:
        for number in range(20):
            writer.add(*make.block(number))
    following = part_path(path, 2)
    with RecordingWriter(following, description(first_sample=20 * BLOCK), part=2) as writer:
        for number in range(20, 40):
            writer.add(*make.block(number))
        writer.add(*make.end(40))
    part_path(path, 3).write_bytes(path.read_bytes()[:40])  # killed before its first block
    player = start(path, following, "--rate", "max", "--wait-for", "twin")
    assert listener.listen() == [*map(make.block, range(40)), make.end(40)]
    assert player.wait(PATIENCE) == 0
    assert "run.part3.mcap" in player.log.read_text()


def test_recordings_of_two_rigs_are_refused(tmp_path, rig):
    record(tmp_path / "one.mcap", blocks=1)
    with RecordingWriter(tmp_path / "two.mcap", description(rig="other")) as writer:
        writer.add(keys.block("other"), Maker().block(0)[1])
    with pytest.raises(PlayerError, match=f"is of rig other, and .* of {RIG}: replay them one at a time"):
        play(rig[0], [tmp_path / "one.mcap", tmp_path / "two.mcap"])
