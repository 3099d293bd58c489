import signal
from concurrent.futures import ThreadPoolExecutor

import pytest

from daq import keys
from daq.link import Inbox, Link
from daq.messages_pb2 import Description, Event, Status
from daq.recording import RecordingWriter, part_path
from daq.runtime import AlreadyRunning, claim, running
from replay.__main__ import main
from replay.play import play
from replay.player import PlayerError
from tests.daq.broadcast import PATIENCE, wait_until
from tests.daq.recorded_run import BLOCK, RIG, Maker, description, record
from tests.replay.players import Listener

TWIN = "twin/estimate"


def without_twin(messages: list[tuple[str, bytes]]) -> list[tuple[str, bytes]]:
    return [item for item in messages if TWIN not in item[0]]


@pytest.mark.parametrize("pause", [0.0, 0.002])
def test_as_fast_as_it_is_taken_every_byte_arrives_in_order(tmp_path, rig, start, pause):
    written = record(tmp_path / "run.mcap", blocks=600)
    player = start(tmp_path / "run.mcap", "--rate", "max", "--wait-for", "twin")
    assert Listener(rig[0], pause=pause).listen() == without_twin(written)
    assert player.wait(PATIENCE) == 0
    assert player.log.read_text() == "replay: 150000 samples played\n"


def test_what_the_twin_said_is_played_when_asked_for(tmp_path, rig, start):
    written = record(tmp_path / "run.mcap", blocks=50)
    start(tmp_path / "run.mcap", "--rate", "max", "--recorded-twin", "--wait-for", "twin")
    assert Listener(rig[0]).listen() == written


def test_a_slow_subscriber_holds_back_but_loses_nothing_beside_a_quick_one(tmp_path, rig, start):
    written = without_twin(record(tmp_path / "run.mcap", blocks=300))
    start(tmp_path / "run.mcap", "--rate", "max", "--wait-for", "twin,display")
    with ThreadPoolExecutor(2) as pool:
        slow = pool.submit(Listener(rig[0], "twin", pause=0.003).listen)
        quick = pool.submit(Listener(rig[0], "display").listen)
        assert slow.result() == quick.result() == written


def test_at_a_rate_time_passes_as_in_the_run(tmp_path, rig, start):
    record(tmp_path / "run.mcap", blocks=100)
    start(tmp_path / "run.mcap", "--rate", "2", "--wait-for", "twin")
    listener = Listener(rig[0])
    blocks = [n for n, (key, _) in enumerate(listener.listen()) if key == keys.block(RIG)]
    spans = [listener.arrived[n] - listener.arrived[blocks[0]] for n in blocks]
    assert all(span > 0.005 * number - 0.2 for number, span in enumerate(spans))
    assert spans[-1] > 0.4  # it cannot be early; how late it is depends on the machine


def test_the_description_says_replay_and_the_rig_is_claimed(tmp_path, rig, start):
    record(tmp_path / "run.mcap", blocks=400)
    player = start(tmp_path / "run.mcap", "--rate", "0.1")
    wait_until(lambda: (tmp_path / "runtime" / f"{RIG}.json").exists(), "the claim")
    assert running(RIG)["mode"] == "REPLAY"
    with Link(connect=[rig[0].link.endpoint("daq")]) as link:
        statuses = Inbox(10, "drop_oldest")
        link.subscribe(keys.status(RIG, "player"), statuses)
        found = Description.FromString(link.ask(keys.description(RIG), b"", PATIENCE))
        expected = description(mode="REPLAY")
        assert found == expected
        assert Status.FromString(statuses.get(PATIENCE)[1]).state == "playing"
        assert link.alive(keys.alive(RIG, "*")) >= {keys.alive(RIG, "daq"), keys.alive(RIG, "player")}
    with pytest.raises(AlreadyRunning):
        play(rig[0], [tmp_path / "run.mcap"])
    player.stdin.close()
    assert player.wait(PATIENCE) == 0


def test_a_live_rig_is_not_replayed_into(tmp_path, start):
    record(tmp_path / "run.mcap", blocks=1)
    with claim(RIG, {"mode": "LIVE"}):
        player = start(tmp_path / "run.mcap")
        assert player.wait(PATIENCE) == 2
    said = player.log.read_text()
    assert said.count("\n") == 1
    assert "already running" in said


def test_a_cut_off_recording_is_played_as_far_as_it_goes_and_then_ended(tmp_path, rig, start):
    written = without_twin(record(tmp_path / "run.mcap", blocks=100))
    whole = (tmp_path / "run.mcap").read_bytes()
    (tmp_path / "cut.mcap").write_bytes(whole[: len(whole) // 2])
    player = start(tmp_path / "cut.mcap", "--rate", "max", "--wait-for", "twin")
    got = Listener(rig[0]).listen()
    assert got[:-1] == written[: len(got) - 1]
    end = Event.FromString(got[-1][1])
    blocks = sum(key == keys.block(RIG) for key, _ in got)
    assert end.details == {"samples": str(blocks * BLOCK), "synthesised": "yes"}
    assert end.sequence == 1
    assert player.wait(PATIENCE) == 0
    said = player.log.read_text().splitlines()
    assert "warning" in said[0]
    assert "cut off" in said[0]
    assert said[1:] == [f"replay: {blocks * BLOCK} samples played"]


def test_continuations_follow(tmp_path, rig, start):
    make, path = Maker(), tmp_path / "run.mcap"
    with RecordingWriter(path, description()) as writer:
        for number in range(20):
            writer.add(*make.block(number))
        writer.close(clean=False)
    with RecordingWriter(part_path(path, 2), description(first_sample=20 * BLOCK), part=2) as writer:
        for number in range(20, 40):
            writer.add(*make.block(number))
        writer.add(*make.end(40))
    start(path, "--rate", "max", "--wait-for", "twin")
    assert Listener(rig[0]).listen() == [*map(make.block, range(40)), make.end(40)]


def test_the_end_of_the_input_stops_it_and_subscribers_are_told(tmp_path, rig, start):
    record(tmp_path / "run.mcap", blocks=1000)
    player = start(tmp_path / "run.mcap", "--rate", "0.2", "--wait-for", "twin")
    wait_until(lambda: (tmp_path / "runtime" / f"{RIG}.json").exists(), "the claim")
    player.send_signal(signal.SIGINT)  # Ctrl-C is the supervisor's business
    listener = Listener(rig[0])
    assert listener.take() is not None
    player.stdin.close()
    assert Event.FromString(listener.listen()[-1][1]).text == "the replay was stopped"
    assert player.wait(PATIENCE) == 0


def test_a_process_that_does_not_come_is_named(tmp_path, rig, monkeypatch):
    monkeypatch.setattr("replay.player.PATIENCE", 0.1)
    record(tmp_path / "run.mcap", blocks=1)
    with pytest.raises(PlayerError, match="twin and display did not come within 0 s"):
        play(rig[0], [tmp_path / "run.mcap"], wait_for=["twin", "display"])


@pytest.mark.parametrize("words", ["0", "-1", "fast", "nan"])
def test_a_rate_that_is_none_is_refused(tmp_path, words, capsys):
    with pytest.raises(SystemExit) as refusal:
        main(["play", "run.mcap", "--rate", words])
    assert refusal.value.code == 2
    assert "must be a number from 0.01 on, or max" in capsys.readouterr().err


def test_a_file_that_is_not_there_is_refused(tmp_path, start):
    player = start(tmp_path / "none.mcap")
    assert player.wait(PATIENCE) == 2
    assert player.log.read_text() == f"replay: {tmp_path}/none.mcap: no such file\n"
