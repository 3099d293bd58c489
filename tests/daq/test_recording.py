import os
import random
import resource
import signal
import subprocess
import sys
import time
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader

from daq import keys
from daq.messages import BlockStatus
from daq.messages_pb2 import Event
from daq.recording import Recording, RecordingError, RecordingWriter, part_path, parts, prepare, recover
from daq.recording.certificate import Coverage, Ledger
from daq.recording.fingerprint import numeric_fingerprint
from tests.daq.disk import small_disk
from tests.daq.recorded_run import BLOCK, NAMES, RATE, RIG, T0_NS, Maker, description, record, samples

ROOT = Path(__file__).parents[2]


def flipped(path: Path, position: int, bit: int = 0) -> Path:
    content = bytearray(path.read_bytes())
    content[position] ^= 1 << bit
    copy = path.with_name("flipped.mcap")
    copy.write_bytes(content)
    return copy


def content(recording: Recording, **options) -> list[tuple[str, bytes]]:
    return [(message.key, message.payload) for message in recording.messages(**options)]


# What goes in comes out.


def test_bytes_in_are_bytes_out_in_order(tmp_path):
    written = record(tmp_path / "run.mcap")
    assert content(Recording(tmp_path / "run.mcap")) == written


def test_log_time_is_that_of_the_sample_and_sequence_the_block_number(tmp_path):
    record(tmp_path / "run.mcap", blocks=5)
    found = list(Recording(tmp_path / "run.mcap").messages(keys.block(RIG)))
    assert [message.log_time for message in found] == [T0_NS + 10_000_000 * number for number in range(5)]
    assert [message.sequence for message in found] == list(range(5))


def test_log_time_is_exact_where_the_rate_divides_no_second(tmp_path):
    from daq.timing import SampleClock

    clock = SampleClock(T0_NS, 44_100.0)
    assert clock.ns(44_100 * 10**9) == T0_NS + 10**18
    assert clock.ns(1) - T0_NS == 22_675


def test_description_and_attachments_come_back(tmp_path):
    record(tmp_path / "run.mcap", blocks=1)
    recording = Recording(tmp_path / "run.mcap")
    assert recording.description == description()
    with (tmp_path / "run.mcap").open("rb") as file:
        attachments = {item.name: item.data.decode() for item in make_reader(file).iter_attachments()}
    assert attachments["rig.toml"] == description().toml
    assert attachments["channels.csv"].splitlines()[1].startswith("proximity_x,displacement,m,")


def test_series_are_arrays_by_name_and_time(tmp_path):
    record(tmp_path / "run.mcap", blocks=8)
    recording = Recording(tmp_path / "run.mcap")
    block = recording.series()
    np.testing.assert_array_equal(block.samples, samples(0, len(NAMES), 8 * BLOCK))
    assert block.names == NAMES
    assert block.gaps == ()
    estimate = recording.series("estimate", ["tilt_y"], first=2 * BLOCK, last=4 * BLOCK - 1)
    np.testing.assert_array_equal(estimate["tilt_y"], samples(2 * BLOCK, 3, 100, 5)[1])
    assert estimate.time[1] - estimate.time[0] == pytest.approx(5 / RATE)
    with pytest.raises(RecordingError, match="estimate has no channel 'tilt_z': it has tilt_x, tilt_y"):
        recording.series("estimate", ["tilt_z"])
    piece = recording.series("block", ["force_top"], first=260, last=801)
    assert piece.first_sample == 260
    np.testing.assert_array_equal(piece["force_top"], samples(260, 3, 542)[2])
    piece = recording.series("truth", first=251, last=300)
    assert piece.first_sample == 255
    np.testing.assert_array_equal(piece.samples, samples(255, 2, 10, 5))
    with pytest.raises(
        RecordingError, match="no series is named 'blocks': there are block, estimate, smoothed, truth"
    ):
        recording.series("blocks")
    with pytest.raises(RecordingError, match="block has no samples from index 99999 on"):
        recording.series(first=99_999)


def test_events_come_back_as_objects(tmp_path):
    record(tmp_path / "run.mcap", blocks=5)
    events = Recording(tmp_path / "run.mcap").events()
    assert [event.kind for event in events] == ["start", "mark", "end"]
    assert isinstance(events[0], Event)


@settings(max_examples=30)
@given(sizes=st.lists(st.integers(1, 700), min_size=1, max_size=30), flush=st.integers(1, 9))
def test_any_blocks_come_back_as_they_went_in(tmp_path_factory, sizes, flush):
    from daq.messages import SeriesEncoder

    encoder = SeriesEncoder("run-1", RATE, ("a",), ("V",))
    path = tmp_path_factory.mktemp("any") / "run.mcap"
    written, first = [], 0
    with RecordingWriter(path, description()) as writer:
        for number, size in enumerate(sizes):
            written.append(encoder.encode(0.0, first, 0, samples(first, 1, size)))
            first += size
            writer.add(keys.block(RIG), written[-1])
            if number % flush == 0:
                writer.flush()
    recording = Recording(path)
    assert [message.payload for message in recording.messages()] == written
    assert recording.check().verdict == "valid"
    assert recording.certificate.received == first


# The account.


def test_a_whole_run_is_valid(tmp_path):
    record(tmp_path / "run.mcap", blocks=10)
    recording = Recording(tmp_path / "run.mcap")
    stored, check = recording.certificate, recording.check()
    assert check.verdict == "valid"
    assert stored == check.certificate
    assert (stored.expected, stored.received, stored.lost, stored.gaps) == (2500, 2500, 0, ())
    assert stored.messages[keys.block(RIG)] == 10
    assert stored.clean
    assert stored.fingerprint == numeric_fingerprint()


def test_gaps_are_named_by_their_samples(tmp_path):
    make = Maker()
    with RecordingWriter(tmp_path / "run.mcap", description()) as writer:
        for number in (1, 2, 5, 6):
            writer.add(*make.block(number))
        writer.add(*make.end(8))
        assert writer.lost == 3 * BLOCK
    recording = Recording(tmp_path / "run.mcap")
    assert recording.certificate.gaps == ((0, 249), (750, 1249), (1750, 1999))
    assert (recording.certificate.expected, recording.certificate.received) == (2000, 1000)
    assert recording.check()[:2] == ("incomplete", "1000 samples are missing in 3 gaps")
    signals = recording.series()
    assert signals.first_sample == 250
    assert signals.gaps == ((750, 1249),)
    assert np.isnan(signals.samples[:, 500:1000]).all()
    assert not np.isnan(signals.samples[:, 1000:]).any()
    assert recording.series(first=600, last=1260).gaps == ((750, 1249),)
    assert recording.series(first=1250).gaps == ()


def test_duplicates_are_left_out_and_late_blocks_taken(tmp_path):
    make = Maker()
    with RecordingWriter(tmp_path / "run.mcap", description()) as writer:
        for number in (0, 1, 1, 3, 2, 2, 0, 4):
            writer.add(*make.block(number))
            writer.add(*make.summary(number))
        for _ in range(2):
            writer.add(*make.event(10, 0, "mark"))
            writer.add(*make.event(10, 1, "mark"))
            writer.add(*make.event(10, 0, "mark", "operator"))
        writer.add(*make.event(900, 0, "mark", "operator"))  # of an operator that was started anew
    recording = Recording(tmp_path / "run.mcap")
    assert [message.sequence for message in recording.messages(keys.block(RIG))] == [0, 1, 3, 2, 4]
    assert recording.certificate.gaps == ()
    assert len(recording.events()) == 4
    assert recording.check().verdict == "valid"


def test_messages_of_another_run_are_left_out(tmp_path):
    with RecordingWriter(tmp_path / "run.mcap", description()) as writer:
        writer.add(*Maker().block(0))
        writer.add(*Maker("another").block(1))
        writer.add(*Maker("another").summary(1))
    assert sum(Recording(tmp_path / "run.mcap").certificate.messages.values()) == 1


def test_signal_digest_leaves_run_time_and_timing_out_but_not_samples_and_quality():
    def digest(run="run-1", status=0, block=0):
        ledger = Ledger()
        ledger.admit(*Maker(run).block(block, status))
        return ledger.certificate(part=1, expected=None, clean=True)

    plain = digest().signal_digests
    assert digest(run="run-2").signal_digests == plain
    assert digest(status=BlockStatus.LATE | BlockStatus.OVERRUN).signal_digests == plain
    assert digest(run="run-2").file_digest != digest().file_digest
    assert digest(status=BlockStatus.CLIPPED).signal_digests != plain
    assert digest(block=1).signal_digests != plain
    assert digest(status=BlockStatus.LATE).late == 1


@given(st.lists(st.tuples(st.integers(0, 60), st.integers(0, 9)), max_size=40))
def test_coverage_is_the_union_of_what_was_added(stretches):
    coverage, there = Coverage(), set()
    for first, size in stretches:
        new = set(range(first, first + size)) - there
        assert coverage.add(first, first + size) == bool(new)
        there |= new
    assert coverage.samples == len(there)
    missing = [index for first, last in coverage.gaps(5, 70) for index in range(first, last + 1)]
    assert missing == [index for index in range(5, 70) if index not in there]


# Other people's readers.


def test_stock_reader_and_embedded_descriptors_suffice(tmp_path):
    written = record(tmp_path / "run.mcap", blocks=20)
    with (tmp_path / "run.mcap").open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        found = list(reader.iter_messages(log_time_order=False))
        summary = reader.get_summary()
    assert [(channel.topic, message.data) for _, channel, message in found] == written
    counts = {
        summary.channels[number].topic: count
        for number, count in summary.statistics.channel_message_counts.items()
    }
    assert counts == Counter(key for key, _ in written)
    pool = descriptor_pool.DescriptorPool()
    schema = next(schema for schema, channel, _ in found if channel.topic == keys.block(RIG))
    for file_proto in descriptor_pb2.FileDescriptorSet.FromString(schema.data).file:
        pool.Add(file_proto)
    block_class = message_factory.GetMessageClass(pool.FindMessageTypeByName(schema.name))
    blocks = [block_class.FromString(m.data) for _, channel, m in found if channel.topic == keys.block(RIG)]
    assert sum(len(block.channels[0].samples) for block in blocks) == 20 * BLOCK
    assert [(channel.name, channel.unit) for channel in blocks[0].channels][2] == ("force_top", "N")
    np.testing.assert_array_equal(blocks[3].channels[2].samples, samples(3 * BLOCK, 3, BLOCK)[2])


# Files that were cut off or damaged.


@pytest.mark.parametrize("share", [0.1, 0.35, 0.6, 0.9, 0.99])
def test_a_cut_off_file_is_read_up_to_its_last_sound_chunk(tmp_path, share):
    written = record(tmp_path / "run.mcap")
    whole = (tmp_path / "run.mcap").read_bytes()
    (tmp_path / "cut.mcap").write_bytes(whole[: int(len(whole) * share)])
    recording = Recording(tmp_path / "cut.mcap")
    found = content(recording)
    assert found == written[: len(found)]
    assert len(found) >= share * len(written) - 80
    assert not recording.complete
    verdict, reason, _account = recording.check()
    assert verdict == "incomplete"
    assert "cut off" in reason or "without having been closed" in reason
    result = recover(tmp_path / "cut.mcap", tmp_path / "mended.mcap")
    mended = Recording(tmp_path / "mended.mcap")
    assert content(mended) == found
    assert result.certificate.received == mended.certificate.received
    assert mended.notes["recovered"]["source"] == "cut.mcap"


def test_a_flipped_bit_in_a_chunk_ends_reading_and_recover_keeps_the_rest(tmp_path):
    written = record(tmp_path / "run.mcap")
    copy = flipped(tmp_path / "run.mcap", (tmp_path / "run.mcap").stat().st_size // 2)
    recording = Recording(copy)
    found = content(recording)
    assert found == written[: len(found)]
    assert 0 < len(found) < len(written)
    check = recording.check()
    assert check.verdict == "altered"
    assert "damaged" in check.reason
    recover(copy, tmp_path / "mended.mcap")
    mended = Recording(tmp_path / "mended.mcap")
    kept = content(mended)
    assert len(kept) >= len(written) - 50
    assert [item for item in written if item in kept] == kept
    assert mended.certificate.expected == 100 * BLOCK
    assert mended.certificate.gaps
    assert mended.check().verdict == "incomplete"


@pytest.mark.parametrize("closed", [True, False])
def test_a_flipped_bit_anywhere_loses_at_most_one_chunk_and_lies_never(tmp_path, closed):
    written = record(tmp_path / "run.mcap", blocks=60)
    if not closed:
        content_before = (tmp_path / "run.mcap").read_bytes()
        with Recording(tmp_path / "run.mcap") as recording:
            end = max(chunk.end for chunk in recording._records(heal=False))
        (tmp_path / "run.mcap").write_bytes(content_before[:end])
    size = (tmp_path / "run.mcap").stat().st_size
    places = random.Random(5)
    edges = chunk_edges(tmp_path / "run.mcap")
    for position in [places.randrange(8, size) for _ in range(60)] + edges:
        copy = flipped(tmp_path / "run.mcap", position, places.randrange(8))
        recording = Recording(copy)
        if closed:
            assert recording.check().verdict != "valid", position
        kept = content(recording, heal=True)
        assert len(kept) >= len(written) - 45, position
        assert set(kept) <= set(written), position


def chunk_edges(path: Path) -> list[int]:
    """Bytes of the head of a chunk in the middle and of the record behind it."""
    with Recording(path) as recording:
        chunks = [record for record in recording._records(heal=False) if record.kind == 6]
    chunk = chunks[len(chunks) // 2]
    return [*range(chunk.start - 9, chunk.start + 45, 2), *range(chunk.end, chunk.end + 12)]


def test_a_certificate_that_does_not_fit_is_found(tmp_path):
    make = Maker()
    with RecordingWriter(tmp_path / "run.mcap", description()) as writer:
        writer.add(*make.block(0))
        writer.ledger.admit(*make.block(1))
    assert Recording(tmp_path / "run.mcap").check()[:2] == (
        "altered",
        "what it holds differs from its certificate in received, gaps, messages, file_digest, signal_digests",
    )


def test_last_message_is_found_without_reading_everything(tmp_path):
    record(tmp_path / "run.mcap", end=False)
    whole = (tmp_path / "run.mcap").read_bytes()
    (tmp_path / "cut.mcap").write_bytes(whole[: len(whole) * 2 // 3])
    recording = Recording(tmp_path / "cut.mcap")
    everything = {message.key: message for message in recording.messages()}
    assert recording.last() == everything
    assert set(recording.topics()) == set(everything)
    block, event = keys.block(RIG), keys.event(RIG, "daq")
    assert recording.last(block, keys.event(RIG, "twin")) == {block: everything[block]}
    assert recording.last(event)[event].log_time == T0_NS


WRITER = """
import sys, time
from daq.recording import RecordingWriter
from tests.daq.recorded_run import BLOCK, RATE, Maker, description
make = Maker()
with RecordingWriter(sys.argv[1], description()) as writer:
    start, number = time.monotonic(), 0
    while True:
        due = start + (number + 1) * BLOCK / RATE
        time.sleep(max(0.0, due - time.monotonic()))
        for message in make.all(number):
            writer.add(*message)
        number += 1
        print(number, time.monotonic(), flush=True)
"""


@pytest.mark.parametrize("batch", range(5))
def test_a_killed_writer_leaves_all_but_the_last_moment(tmp_path, batch):
    chance = random.Random(batch)
    files = [tmp_path / f"{number}.mcap" for number in range(4)]
    for path, writer in zip(files, [start_writer(path) for path in files], strict=True):
        with writer:
            said = [writer.stdout.readline() for _ in range(chance.randrange(5, 50))]
            os.kill(writer.pid, signal.SIGKILL)
            said += writer.stdout.readlines()
        added_at = [float(line.split()[1]) for line in said if line.endswith("\n")]
        recording = Recording(path)
        kept = len(list(recording.messages(keys.block(RIG))))
        assert not recording.complete
        assert recording.check().certificate.gaps == ()
        assert kept >= sum(moment < added_at[-1] - 0.15 for moment in added_at)


def start_writer(path: Path) -> subprocess.Popen:
    return subprocess.Popen(
        [sys.executable, "-c", WRITER, str(path)], stdout=subprocess.PIPE, text=True, cwd=ROOT
    )


# Clear refusals.


def test_files_that_are_no_recordings_are_refused_in_one_line(tmp_path):
    (tmp_path / "empty.mcap").touch()
    (tmp_path / "text.mcap").write_text("not a recording at all")
    (tmp_path / "bare.mcap").write_bytes(b"\x89MCAP0\r\n")
    refusals = {
        "missing.mcap": "no such file",
        "empty.mcap": "is empty",
        "text.mcap": "is not an MCAP file",
        "bare.mcap": "holds no recording of a rig",
        ".": "is a folder",
    }
    for name, words in refusals.items():
        with pytest.raises(RecordingError, match=words) as refusal:
            Recording(tmp_path / name)
        assert "\n" not in str(refusal.value)


def test_nothing_is_overwritten_and_folders_are_made(tmp_path):
    record(tmp_path / "new" / "folder" / "run.mcap", blocks=1)
    with pytest.raises(RecordingError, match="exists already"):
        RecordingWriter(tmp_path / "new" / "folder" / "run.mcap", description())
    with pytest.raises(RecordingError, match="is a folder: name a file in it"):
        RecordingWriter(tmp_path, description())
    with pytest.raises(RecordingError, match="exists already"):
        recover(tmp_path / "new" / "folder" / "run.mcap", tmp_path / "new" / "folder" / "run.mcap")
    (tmp_path / "file").touch()
    with pytest.raises(RecordingError, match="file: a file, not a folder: record elsewhere"):
        prepare(tmp_path / "file" / "run.mcap")
    with pytest.raises(RecordingError, match=r"rate is 0\.0 Hz"):
        RecordingWriter(tmp_path / "x.mcap", description(rate=0.0))


def test_a_file_system_that_takes_no_files_is_refused():
    with pytest.raises(RecordingError, match="/proc"):
        RecordingWriter("/proc/run.mcap", description())


def fill(path: Path, blocks: int = 3000) -> tuple[RecordingWriter, str]:
    """Write until the disk refuses; return the writer and what it said."""
    make = Maker()
    writer = RecordingWriter(path, description())
    try:
        for number in range(blocks):
            writer.add(*make.block(number))
            writer.flush()
    except RecordingError as error:
        writer.add(*make.block(blocks))  # said once; what comes after is left out
        writer.close()
        return writer, str(error)
    raise AssertionError("the disk took everything")


def test_at_the_largest_file_size_what_is_there_stays_readable(tmp_path):
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    handler = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (300_000, before[1]))
    try:
        writer, said = fill(tmp_path / "run.mcap")
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
        signal.signal(signal.SIGXFSZ, handler)
    assert "largest size allowed" in said
    recording = Recording(tmp_path / "run.mcap")
    assert recording.check().verdict == "incomplete"
    assert recording.check().certificate.received >= writer.samples - 2 * BLOCK


def test_before_the_disk_is_full_the_file_is_closed_in_order(tmp_path):
    with small_disk(tmp_path / "disk", 6) as disk:
        writer, said = fill(disk / "run.mcap")
        recording = Recording(disk / "run.mcap")
        assert "the disk is full: free some space" in said
        assert recording.complete
        assert recording.certificate.received == writer.samples
        assert recording.check()[:2] == ("incomplete", "the recording ended before the run did")
        recording.close()


def test_a_file_that_is_removed_while_it_is_written_is_noticed(tmp_path):
    writer = RecordingWriter(tmp_path / "run.mcap", description())
    (tmp_path / "run.mcap").unlink()
    with pytest.raises(RecordingError, match="was removed"):
        writer.flush()
    writer.close()


def test_parts_are_found_by_name(tmp_path):
    first = tmp_path / "run.mcap"
    for number in (1, 2, 3):
        part_path(first, number).touch()
    assert [path.name for path in parts(first)] == ["run.mcap", "run.part2.mcap", "run.part3.mcap"]


def test_the_file_is_flushed_by_the_clock_alone(tmp_path):
    writer = RecordingWriter(tmp_path / "run.mcap", description())
    writer.add(*Maker().block(0))
    deadline = time.monotonic() + 20
    while not list(Recording(tmp_path / "run.mcap").messages()) and time.monotonic() < deadline:
        writer.tick()
    assert len(list(Recording(tmp_path / "run.mcap").messages())) == 1
    writer.close()
