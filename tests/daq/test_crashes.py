"""What is left of a recording after a kill, a power cut, a truncation or a flipped bit, many times."""

import os
import random
import signal
from pathlib import Path
from types import SimpleNamespace

import pytest
from mcap.reader import make_reader
from mcap.records import Chunk, Message
from mcap.stream_reader import StreamReader, breakup_chunk

from daq import keys
from daq.recording import Recording, RecordingWriter, recover
from tests.daq.recorded_run import BLOCK, RATE, RIG, Maker, description, record
from tests.daq.test_recording import content, flipped, start_writer

SYNC = 0.1  # s that a disk may take to sync
RECOVERED = 0.25  # s before a power cut up to which everything is recovered
FLUSHED = 0.15  # s before a kill, likewise

OFTEN = pytest.mark.slow


def power_cut_model(path: Path, monkeypatch, seconds: float) -> tuple[list[float], list[tuple[float, int]]]:
    """Record by a clock made by hand; return when each block came, and what was on the disk from when on."""
    now, synced = [0.0], []

    def request(syncer) -> None:
        synced.append((now[0] + SYNC, os.fstat(syncer._fd).st_size))

    monkeypatch.setattr("daq.recording.storage._Syncer.request", request)
    monkeypatch.setattr("daq.recording.writer.time", SimpleNamespace(monotonic=lambda: now[0]))
    make, came = Maker(), []
    with RecordingWriter(path, description()) as writer:
        for number in range(round(seconds * RATE / BLOCK)):
            now[0] += BLOCK / RATE
            came.append(now[0])
            for message in make.all(number):
                writer.add(*message)
    return came, synced


def test_after_a_power_cut_all_but_the_last_quarter_second_is_there(tmp_path, monkeypatch):
    """The disk holds what was synced before the cut and nothing behind it."""
    path = tmp_path / "run.mcap"
    came, synced = power_cut_model(path, monkeypatch, 4.0)
    written, whole = content(Recording(path)), path.read_bytes()
    chance = random.Random(7)
    for number in range(50):
        cut = chance.uniform(0.5, came[-1])
        size = max(size for done, size in synced if done <= cut)
        (tmp_path / "cut.mcap").write_bytes(whole[:size])
        mended = tmp_path / f"{number}.mcap"
        recover(tmp_path / "cut.mcap", mended)
        with Recording(mended) as recording:
            found = content(recording)
            assert found == written[: len(found)]
            assert recording.certificate.received >= BLOCK * sum(when <= cut - RECOVERED for when in came)
            assert recording.check().verdict in ("valid", "incomplete")


def messages_by_end(path: Path) -> list[tuple[int, int]]:
    """Return where each chunk ends and how many messages it holds, by the mcap package's own reader."""
    with path.open("rb") as file:
        indexes = make_reader(file).get_summary().chunk_indexes
    with path.open("rb") as file:
        chunks = [item for item in StreamReader(file, emit_chunks=True).records if isinstance(item, Chunk)]
    counts = [sum(isinstance(each, Message) for each in breakup_chunk(chunk)) for chunk in chunks]
    ends = sorted(index.chunk_start_offset + index.chunk_length for index in indexes)
    return list(zip(ends, counts, strict=True))


def test_cut_off_anywhere_every_whole_chunk_is_read(tmp_path):
    written = record(tmp_path / "run.mcap", blocks=150)
    chunks = messages_by_end(tmp_path / "run.mcap")
    assert sum(count for _end, count in chunks) == len(written)
    whole = (tmp_path / "run.mcap").read_bytes()
    chance = random.Random(11)
    for cut in (chance.randrange(chunks[0][0], len(whole)) for _ in range(50)):
        (tmp_path / "cut.mcap").write_bytes(whole[:cut])
        with Recording(tmp_path / "cut.mcap") as recording:
            found = content(recording, heal=True)
        assert found == written[: sum(count for end, count in chunks if end <= cut)], cut


@pytest.mark.parametrize("flips", [40, pytest.param(200, marks=OFTEN)])
def test_a_flipped_bit_costs_its_own_chunk_at_most_and_no_wrong_sample_is_taken(tmp_path, flips):
    written = record(tmp_path / "run.mcap", blocks=100)
    largest = max(count for _end, count in messages_by_end(tmp_path / "run.mcap"))
    size = (tmp_path / "run.mcap").stat().st_size
    chance = random.Random(13)
    for position in (chance.randrange(8, size) for _ in range(flips)):
        with Recording(flipped(tmp_path / "run.mcap", position, chance.randrange(8))) as recording:
            kept = content(recording, heal=True)
            assert recording.check().verdict != "valid", position
        assert set(kept) <= set(written), position
        assert len(kept) >= len(written) - largest, position


@pytest.mark.slow
@pytest.mark.parametrize("batch", range(25))
def test_killed_two_hundred_times_a_writer_leaves_all_but_the_last_moment(tmp_path, batch):
    """Eight writers at a time."""
    chance = random.Random(1000 + batch)
    files = [tmp_path / f"{number}.mcap" for number in range(8)]
    for path, writer in zip(files, [start_writer(path) for path in files], strict=True):
        with writer:
            said = [writer.stdout.readline() for _ in range(chance.randrange(5, 60))]
            os.kill(writer.pid, signal.SIGKILL)
            said += writer.stdout.readlines()
        added = [float(line.split()[1]) for line in said if line.endswith("\n")]
        with Recording(path) as recording:
            blocks = [message.sequence for message in recording.messages(keys.block(RIG))]
        assert blocks == list(range(len(blocks)))
        assert len(blocks) >= sum(when < added[-1] - FLUSHED for when in added)
