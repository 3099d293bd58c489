"""A piece of a recording is what the whole has there, and is read without the whole."""

import os
import random
from pathlib import Path

import numpy as np
import pytest

from daq import keys
from daq.messages import SeriesEncoder
from daq.recording import Recording, RecordingWriter
from tests.daq.recorded_run import BLOCK, RATE, RIG, T0_NS, Maker, description, record, samples

SMALL = 4096  # bytes that a record may take


@pytest.fixture
def bytes_read(monkeypatch):
    """Count what is read from files."""
    count = [0]
    real = os.pread

    def pread(fd: int, size: int, position: int) -> bytes:
        content = real(fd, size, position)
        count[0] += len(content)
        return content

    monkeypatch.setattr(os, "pread", pread)
    return count


def cut_off(path: Path) -> Path:
    """The same recording without its end, as a crash leaves it."""
    with Recording(path) as recording:
        end = max(chunk.end for chunk in recording._index.chunks())
    copy = path.with_name("cut.mcap")
    copy.write_bytes(path.read_bytes()[:end])
    return copy


def with_damaged_summary(path: Path) -> Path:
    content = bytearray(path.read_bytes())
    content[-200] ^= 1
    copy = path.with_name("damaged.mcap")
    copy.write_bytes(content)
    return copy


def irregular(path: Path) -> np.ndarray:
    """Write blocks of very different lengths, some missing, some late; return which samples are missing."""
    chance, encoder = random.Random(3), SeriesEncoder("run-1", RATE, ("a",), ("V",))
    blocks, missing, first = [], [], 0
    for _ in range(60):
        size = chance.choice((1, 7, 250, 6000))
        missing.append(np.full(size, chance.random() < 0.2))
        if not missing[-1][0]:
            blocks.append((first, encoder.encode(0.0, first, 0, samples(first, 1, size))))
        first += size
    for number in (10, 25, 26, 40):
        blocks.insert(number + 6, blocks.pop(number))
    make = Maker()
    with RecordingWriter(path, description()) as writer:
        for number, (sample, payload) in enumerate(blocks):
            writer.add(keys.block(RIG), payload)
            writer.add(*make.event(sample, number, "mark"))
            if chance.random() < 0.5:
                writer.flush()
    return np.concatenate(missing)


@pytest.mark.parametrize("state", [lambda path: path, cut_off, with_damaged_summary])
def test_a_piece_is_what_the_whole_has_there(tmp_path, state):
    missing = irregular(tmp_path / "run.mcap")
    path, end = state(tmp_path / "run.mcap"), len(missing)
    expected = samples(0, 1, end)
    expected[0, missing] = np.nan
    assert 0.05 < missing.mean() < 0.6
    chance = random.Random(4)
    for _ in range(60):
        first = chance.randrange(end)
        last = min(end - 1, first + chance.choice((0, 3, 400, 9000)))
        if missing[first : last + 1].all():
            continue
        with Recording(path) as recording:
            piece = recording.series(first=first, last=last)
        begin, behind = piece.first_sample, piece.first_sample + piece.samples.shape[1]
        np.testing.assert_array_equal(piece.samples, expected[:, begin:behind])
        assert missing[first:begin].all()
        assert missing[behind : last + 1].all()
        in_gaps = {index for low, high in piece.gaps for index in range(low, high + 1)}
        assert in_gaps == set((begin + np.flatnonzero(np.isnan(piece.samples[0]))).tolist())


@pytest.mark.parametrize("state", [lambda path: path, cut_off])
def test_messages_of_a_stretch_are_those_that_refer_to_it(tmp_path, state):
    record(tmp_path / "run.mcap", blocks=60)
    with Recording(state(tmp_path / "run.mcap")) as recording:
        everything = list(recording.messages())
        first, last = 13 * BLOCK + 1, 41 * BLOCK
        begin, end = (T0_NS + sample * 40_000 for sample in (first, last))
        wanted = [message for message in everything if begin <= message.log_time <= end]
        assert list(recording.messages_between(first=first, last=last)) == wanted
        block = keys.block(RIG)
        blocks = [message for message in wanted if message.key == block]
        assert list(recording.messages_between(block, first=first, last=last)) == blocks
        assert list(recording.messages_between()) == everything


def test_only_what_is_wanted_is_read(tmp_path, bytes_read):
    record(tmp_path / "run.mcap", blocks=2000)
    size = (tmp_path / "run.mcap").stat().st_size
    index = 0.02 * size  # the summary, of which a run of small chunks has the more
    with Recording(tmp_path / "run.mcap") as recording:
        assert recording.certificate.received == 2000 * BLOCK
        assert len(recording.events()) == 3
        assert bytes_read[0] < 0.1 * size + index
        bytes_read[0] = 0
        piece = recording.series(first=1000 * BLOCK, last=1020 * BLOCK - 1)
        np.testing.assert_array_equal(piece.samples, samples(1000 * BLOCK, 6, 20 * BLOCK))
        assert bytes_read[0] < 0.05 * size + SMALL


def test_a_damaged_chunk_is_a_gap_in_what_is_read(tmp_path):
    record(tmp_path / "run.mcap", blocks=60)
    with Recording(tmp_path / "run.mcap") as recording:
        (chunk,) = recording._index.chunks([2])
        lost = [m for m in recording._of(recording._unpacked(chunk.record)) if m.key == keys.block(RIG)]
    content = bytearray((tmp_path / "run.mcap").read_bytes())
    content[(chunk.start + chunk.end) // 2] ^= 1
    (tmp_path / "flipped.mcap").write_bytes(content)
    with Recording(tmp_path / "flipped.mcap") as recording:
        assert recording.series().gaps == ((lost[0].sequence * BLOCK, (lost[-1].sequence + 1) * BLOCK - 1),)
        assert f"the chunk at byte {chunk.start} is damaged" in recording.damage[0]
