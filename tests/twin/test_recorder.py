import os
import resource
import signal
from collections import Counter
from pathlib import Path

import pytest

from daq import keys
from daq.link import Inbox, Link, free_ports
from daq.messages_pb2 import Status
from daq.recording import Recording, parts
from tests.daq.broadcast import PATIENCE, Broadcast, wait_until
from tests.daq.recorded_run import BLOCK, RIG, Maker, record
from tests.twin.recorders import blocks, recorded, said
from twin.recorder import Recorder, held, next_part


def samples_in(path: Path) -> int:
    if not path.exists() or path.stat().st_size < 1000:
        return 0
    with Recording(path) as recording:
        return sum(1 for _ in recording.messages(keys.block(RIG))) * BLOCK


def test_a_run_is_recorded_whole_and_certified(tmp_path, rig, start):
    path = tmp_path / "new" / "run.mcap"
    recorder = start(path)
    with Broadcast(rig[0]) as daq:
        daq.wait_for("recorder")
        statuses = Inbox(100, "drop_oldest")
        daq.link.subscribe(keys.status(RIG, "recorder"), statuses)
        daq.put_blocks(0, 100)
        recorder.send_signal(signal.SIGINT)  # Ctrl-C is the supervisor's business
        daq.put_blocks(100, 200)
        daq.finish(200)
        assert recorder.wait(PATIENCE) == 0
    assert said(recorder) == [f"recorder: 50000 samples recorded, 0 lost, in {path}"]
    found = recorded(path)
    assert blocks(found) == blocks(daq.sent)
    assert Counter(found) == Counter(daq.sent)
    recording = Recording(path)
    assert recording.check().verdict == "valid"
    assert recording.certificate.clean
    told = []
    while (item := statuses.get(0.0)) is not None:
        told.append(Status.FromString(item[1]))
    assert {status.state for status in told} <= {"waiting", "recording"}
    assert max(status.samples for status in told) > 0


def test_a_killed_recorder_is_followed_by_part_two_without_a_gap(tmp_path, rig, start):
    path = tmp_path / "run.mcap"
    first = start(path)
    with Broadcast(rig[0]) as daq:
        daq.wait_for("recorder")
        daq.put_blocks(0, 150)
        wait_until(lambda: samples_in(path) > 100 * BLOCK, "the first part to grow")
        first.kill()
        first.wait()
        daq.put_blocks(150, 250)
        part_path, part, after = next_part(path)
        assert (part_path.name, part) == ("run.part2.mcap", 2)
        second = start(path, "--part", part, "--after", after)
        daq.put_blocks(250, 300, pace=0.005)
        daq.finish(300)
        assert second.wait(PATIENCE) == 0
    assert [each.name for each in parts(path)] == ["run.mcap", "run.part2.mcap"]
    one, two = recorded(path), recorded(part_path)
    assert blocks(one) + blocks(two) == blocks(daq.sent)
    assert Counter(one + two) == Counter(daq.sent)
    certificate = Recording(part_path).check()
    assert certificate.verdict == "valid"
    assert certificate.certificate.first_sample == after + 1
    assert Recording(path).check().verdict == "incomplete"


def test_a_stopped_recorder_loses_nothing(tmp_path, rig, start):
    recorder = start(tmp_path / "run.mcap")
    with Broadcast(rig[0]) as daq:
        daq.wait_for("recorder")
        daq.put_blocks(0, 50)
        os.kill(recorder.pid, signal.SIGSTOP)
        daq.put_blocks(50, 1000, pace=0.003)
        os.kill(recorder.pid, signal.SIGCONT)
        daq.put_blocks(1000, 1050)
        daq.finish(1050)
        assert recorder.wait(PATIENCE) == 0
    assert Counter(recorded(tmp_path / "run.mcap")) == Counter(daq.sent)
    assert Recording(tmp_path / "run.mcap").check().verdict == "valid"


def test_without_an_end_the_recording_is_closed_but_not_clean(tmp_path, rig, start):
    path = tmp_path / "run.mcap"
    recorder = start(path)
    with Broadcast(rig[0]) as daq:
        daq.wait_for("recorder")
        daq.put_blocks(0, 50)
        wait_until(lambda: samples_in(path) == 50 * BLOCK, "the blocks to be recorded")
    assert recorder.wait(PATIENCE) == 1
    assert said(recorder) == [
        f"recorder: 12500 samples recorded, 0 lost, in {path}, without the end of the run"
    ]
    assert Recording(path).check()[:2] == ("incomplete", "the recording ended before the run did")


def test_missing_blocks_are_named_after_a_bounded_wait(tmp_path, rig, start):
    recorder = start(tmp_path / "run.mcap")
    with Broadcast(rig[0]) as daq:
        daq.wait_for("recorder")
        daq.put_blocks(0, 20)
        daq.put_blocks(25, 30)
        daq.finish(30)
        assert recorder.wait(PATIENCE) == 0
    check = Recording(tmp_path / "run.mcap").check()
    assert check.verdict == "incomplete"
    assert check.certificate.gaps == ((5000, 6249),)


def test_an_orphan_that_has_nothing_to_record_ends(tmp_path, start):
    recorder = start(tmp_path / "run.mcap")
    recorder.stdin.close()
    assert recorder.wait(PATIENCE) == 0
    assert said(recorder) == ["recorder: nothing was recorded: no run began"]
    assert not (tmp_path / "run.mcap").exists()


def test_an_orphan_goes_on_to_the_end_of_the_run(tmp_path, rig, start):
    recorder = start(tmp_path / "run.mcap")
    with Broadcast(rig[0]) as daq:
        daq.wait_for("recorder")
        daq.put_blocks(0, 20)
        recorder.stdin.close()
        recorder.send_signal(signal.SIGTERM)
        daq.put_blocks(20, 120)
        daq.finish(120)
        assert recorder.wait(PATIENCE) == 0
    assert Recording(tmp_path / "run.mcap").check().verdict == "valid"


def small_files() -> None:
    resource.setrlimit(resource.RLIMIT_FSIZE, (400_000, 400_000))


def test_a_full_disk_is_said_and_what_is_there_stays_readable(tmp_path, rig, start):
    recorder = start(tmp_path / "run.mcap", before=small_files)
    with Broadcast(rig[0]) as daq:
        daq.wait_for("recorder")
        number = 0
        while recorder.poll() is None and number < 5000:
            daq.put_blocks(number, number + 10)
            number += 10
        assert recorder.wait(PATIENCE) == 1
    assert len(said(recorder)) == 1
    assert "largest size allowed here" in said(recorder)[0]
    found = recorded(tmp_path / "run.mcap")
    assert len(found) > 100
    assert blocks(found) == blocks(daq.sent)[: len(blocks(found))]


@pytest.mark.parametrize(("name", "words"), [("there.mcap", "exists already"), (".", "is a folder")])
def test_a_file_that_cannot_be_made_is_refused_at_once(tmp_path, start, name, words):
    record(tmp_path / "there.mcap", blocks=1)
    recorder = start(tmp_path / name)
    assert recorder.wait(PATIENCE) == 1
    assert len(said(recorder)) == 1
    assert words in said(recorder)[0]


def test_another_process_hears_the_status_when_it_is_named(tmp_path, rig, start):
    endpoint = f"tcp/127.0.0.1:{free_ports(1)[0]}"
    heard = Inbox(10, "drop_oldest")
    with Link(listen=[endpoint]) as supervisor:
        supervisor.subscribe(keys.status(RIG, "recorder"), heard)
        recorder = start(tmp_path / "run.mcap", "--connect", endpoint)
        item = heard.get(PATIENCE)
        assert Status.FromString(item[1]).state == "waiting"
        recorder.stdin.close()
        recorder.wait(PATIENCE)


def test_what_is_held_counts_all_parts(tmp_path):
    record(tmp_path / "run.mcap", blocks=20, end=False)
    whole = (tmp_path / "run.mcap").read_bytes()
    (tmp_path / "run.mcap").write_bytes(whole[: len(whole) - 300])
    (tmp_path / "run.part2.mcap").write_bytes(whole[:40])  # killed before its first block
    assert next_part(tmp_path / "run.mcap") == (tmp_path / "run.part3.mcap", 3, 20 * BLOCK - 1)
    ends, events = held(parts(tmp_path / "run.mcap"))
    assert ends[keys.estimate(RIG)] == 20 * BLOCK
    assert ends[keys.summary(RIG)] == 19 * BLOCK + 1
    assert events == {Maker().event(0, 0, "start")[1], Maker().event(757, 0, "mark", "operator")[1]}
    assert next_part(tmp_path / "new.mcap") == (tmp_path / "new.mcap", 1, -1)


def test_messages_that_are_not_readable_are_left_out(tmp_path, rig, start):
    recorder = start(tmp_path / "run.mcap")
    with Broadcast(rig[0]) as daq:
        daq.wait_for("recorder")
        daq.put_blocks(0, 5)
        for _ in range(3):
            daq.put([(keys.estimate(RIG), b"\xff\xff")])
        daq.put([Maker().end(5)])
        assert recorder.wait(PATIENCE) == 0
    assert "is not readable and is left out" in said(recorder)[0]
    assert len(said(recorder)) == 2
    assert Recording(tmp_path / "run.mcap").check().verdict == "valid"


def test_the_status_says_so_when_the_recorder_falls_behind(tmp_path, rig, monkeypatch):
    monkeypatch.setattr("twin.recorder.CAPACITY", 500)
    heard = Inbox(100, "drop_oldest")
    with Broadcast(rig[0]) as daq:
        daq.link.subscribe(keys.status(RIG, "recorder"), heard)
        with Link(connect=[rig[0].link.endpoint("daq")]) as link:
            recorder = Recorder(rig[0], link, tmp_path / "run.mcap")
            daq.wait_for("recorder")
            for number in range(400):
                daq.put(Maker().all(number))
            wait_until(lambda: recorder._inbox.fill > 0.55, "the inbox to fill")
            recorder._step()
            states = []
            while "falling behind" not in states:
                item = heard.get(PATIENCE)
                assert item is not None, states
                states.append(Status.FromString(item[1]).state)
            recorder._inbox.close()
            recorder.writer.close()
