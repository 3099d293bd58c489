import struct
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from google.protobuf.message import DecodeError
from hypothesis import given
from hypothesis import strategies as st

from daq import messages
from daq import messages_pb2 as pb

ROOT = Path(__file__).parents[2]
NAMES = ("proximity_x", "force_top", "encoder_angle")
UNITS = ("m", "N", "rad")


def protobuf_series(message, timestamp, run, first_sample, rate, status, samples, names=NAMES, units=UNITS):
    """Let protobuf's own classes write the series."""
    message.timestamp, message.run, message.first_sample = timestamp, run, first_sample
    message.rate, message.status = rate, status
    for name, unit, row in zip(names, units, samples, strict=True):
        message.channels.add(name=name, unit=unit, samples=row.tolist())
    return message


def some_samples(n_channels=3, n_samples=250):
    return np.random.default_rng(1).normal(size=(n_channels, n_samples)).astype(np.float32)


def some_payload():
    encoder = messages.SeriesEncoder("run-1", 25000.0, NAMES, UNITS)
    return encoder.encode(1.75e9, 500, messages.BlockStatus.EMULATED, some_samples(n_samples=20))


def text_field(tag, text):
    octets = text.encode()
    return bytes((tag, len(octets))) + octets


def test_committed_classes_are_those_of_the_proto_file(tmp_path):
    command = [sys.executable, "-m", "grpc_tools.protoc", f"-I{ROOT}", f"--python_out={tmp_path}"]
    subprocess.run(
        [*command, f"--pyi_out={tmp_path}", "daq/messages.proto"], check=True, cwd=ROOT, timeout=60
    )
    for name in ("messages_pb2.py", "messages_pb2.pyi"):
        assert (tmp_path / "daq" / name).read_text() == (ROOT / "daq" / name).read_text()


@pytest.mark.parametrize(
    ("kind", "stride"), [(pb.Block, 0), (pb.Estimate, 5), (pb.Smoothed, 5), (pb.Truth, 300)]
)
@pytest.mark.parametrize("n_samples", [0, 1, 31, 32, 250, 5000])
def test_bytes_are_those_of_protobuf(kind, stride, n_samples):
    samples = some_samples(n_samples=n_samples)
    message = protobuf_series(kind(), 1.75e9, "run-1", 12_345_678, 25000.0, 20, samples)
    if stride:
        message.stride = stride
    encoder = messages.SeriesEncoder("run-1", 25000.0, NAMES, UNITS, stride)
    assert encoder.encode(1.75e9, 12_345_678, 20, samples) == message.SerializeToString()


@given(
    timestamp=st.floats(allow_nan=False),
    run=st.text(st.characters(exclude_categories=["Cs"])),
    first_sample=st.integers(0, 2**64 - 1),
    rate=st.floats(allow_nan=False),
    status=st.integers(0, 2**32 - 1),
    n_samples=st.integers(0, 300),
    labels=st.lists(st.tuples(st.text(max_size=200), st.text(max_size=5)), max_size=5),
)
def test_any_values_give_the_bytes_of_protobuf_and_come_back(
    timestamp, run, first_sample, rate, status, n_samples, labels
):
    names, units = tuple(name for name, _ in labels), tuple(unit for _, unit in labels)
    samples = some_samples(len(labels), n_samples)
    message = protobuf_series(pb.Block(), timestamp, run, first_sample, rate, status, samples, names, units)
    payload = messages.SeriesEncoder(run, rate, names, units).encode(timestamp, first_sample, status, samples)
    assert payload == message.SerializeToString()
    series = messages.decode_series(payload)
    assert series[:8] == (timestamp, run, first_sample, rate, status, 0, names, units)
    assert series.samples.tolist() == samples.tolist()
    assert messages.read_header(payload) == (timestamp, run, first_sample)


def test_an_encoder_serves_blocks_of_changing_length():
    encoder = messages.SeriesEncoder("run-1", 25000.0, NAMES, UNITS)
    for n_samples in (250, 10, 250):
        samples = some_samples(n_samples=n_samples)
        np.testing.assert_array_equal(
            messages.decode_series(encoder.encode(0.0, 0, 0, samples)).samples, samples
        )


def test_samples_of_any_memory_order_keep_their_values():
    samples = some_samples()
    encoder = messages.SeriesEncoder("run-1", 25000.0, NAMES, UNITS)
    expected = encoder.encode(0.0, 0, 0, samples)
    assert encoder.encode(0.0, 0, 0, np.asfortranarray(samples)) == expected
    assert encoder.encode(0.0, 0, 0, samples.astype(">f4")) == expected


def test_what_is_not_finite_survives():
    samples = np.array([[np.nan, np.inf], [-np.inf, -0.0], [1e-45, 3.4e38]], dtype=np.float32)
    payload = messages.SeriesEncoder("run-1", 25000.0, NAMES, UNITS).encode(-0.0, 0, 0, samples)
    series = messages.decode_series(payload)
    assert series.samples.tobytes() == samples.tobytes()
    assert struct.pack("<d", series.timestamp) == struct.pack("<d", -0.0)


def test_decoded_samples_are_the_callers_own():
    series = messages.decode_series(some_payload())
    series.samples[:] = 0.0
    assert series.samples.dtype == np.float32
    assert series.samples.flags.c_contiguous


def test_an_empty_message_is_an_empty_series():
    series = messages.decode_series(b"")
    assert series.names == ()
    assert series.samples.shape == (0, 0)
    assert messages.read_header(b"") == (0.0, "", 0)


def test_unknown_fields_are_skipped():
    unknown = b"\x78\xac\x02" + b"\x81\x01" + bytes(8) + b"\x8a\x01\x02ab" + b"\x95\x01" + bytes(4)
    channel = unknown + text_field(0x0A, "x") + text_field(0x12, "m") + b"\x1a\x04" + struct.pack("<f", 2.0)
    payload = unknown + b"\x18\x05" + b"\x32" + bytes((len(channel),)) + channel + unknown
    series = messages.decode_series(payload)
    assert (series.first_sample, series.names, series.samples.tolist()) == (5, ("x",), [[2.0]])


def test_samples_in_several_pieces_are_joined():
    pieces = b"\x1a\x04" + struct.pack("<f", 1.0) + b"\x1a\x08" + struct.pack("<2f", 2.0, 3.0)
    series = messages.decode_series(b"\x32" + bytes((len(pieces),)) + pieces)
    assert series.samples.tolist() == [[1.0, 2.0, 3.0]]


@pytest.mark.parametrize(
    ("payload", "reason"),
    [
        (b"\x09\x00", "cut off"),
        (b"\x12\x05ab", "cut off"),
        (b"\x18", "cut off"),
        (b"\x18" + b"\xff" * 11, "more than ten bytes"),
        (b"\x12\x01\xff", "not UTF-8"),
        (b"\x0b", "wire type 3"),
        (b"\x02\x00", "field number 0"),
        (b"\x32\x05\x1a\x03abc", "whole number of floats"),
        (b"\x32\x05\x1d" + bytes(4), "not packed"),
        (b"\x32\x06\x1a\x04" + bytes(4) + b"\x32\x0a\x1a\x08" + bytes(8), "differ in length"),
    ],
)
def test_bytes_that_are_no_series_are_refused(payload, reason):
    with pytest.raises(messages.MessageError, match=reason):
        messages.decode_series(payload)


def test_every_cut_is_noticed_or_gives_a_shorter_series():
    payload = some_payload()
    for size in range(len(payload)):
        try:
            series = messages.decode_series(payload[:size])
        except messages.MessageError:
            continue
        assert len(series.names) < len(NAMES)


@given(st.binary(max_size=60))
def test_any_bytes_give_a_message_error_or_what_protobuf_reads(payload):
    try:
        series = messages.decode_series(payload)
    except messages.MessageError:
        return
    try:
        message = pb.Estimate.FromString(payload)
    except DecodeError:
        pytest.fail("protobuf refuses what decode_series reads")
    assert (series.run, series.first_sample, series.stride) == (
        message.run,
        message.first_sample,
        message.stride,
    )
    assert series.status == message.status
    assert struct.pack("<2d", series.timestamp, series.rate) == struct.pack(
        "<2d", message.timestamp, message.rate
    )
    assert series.names == tuple(channel.name for channel in message.channels)


@given(st.data(), st.integers(1, 8))
def test_damaged_payloads_never_raise_anything_else(data, n_changes):
    payload = bytearray(some_payload())
    for _ in range(n_changes):
        payload[data.draw(st.integers(0, len(payload) - 1))] = data.draw(st.integers(0, 255))
    for read in (messages.decode_series, messages.read_header):
        try:
            read(bytes(payload))
        except messages.MessageError:
            continue


@pytest.mark.parametrize(
    "message",
    [
        pb.Event(timestamp=1.5, run="r", sample=7, text="x"),
        pb.Status(timestamp=1.5, run="r", sample=7, process="daq"),
        pb.ChannelSummary(timestamp=1.5, run="r", first_sample=7, mean=1.0),
        pb.Summary(timestamp=1.5, run="r", first_sample=7),
        pb.TwinSummary(timestamp=1.5, run="r", first_sample=7, valid=True),
        pb.Description(timestamp=1.5, run="r", first_sample=7, toml="a" * 5000),
        pb.Truth(timestamp=1.5, run="r", first_sample=7, stride=3),
    ],
)
def test_every_message_has_the_same_header(message):
    assert messages.read_header(message.SerializeToString()) == messages.Header(1.5, "r", 7)


def test_values_that_no_message_can_carry_are_refused():
    encoder = messages.SeriesEncoder("run-1", 25000.0, NAMES, UNITS)
    with pytest.raises(messages.MessageError, match=r"first_sample = -1"):
        encoder.encode(0.0, -1, 0, some_samples())
    with pytest.raises(messages.MessageError, match="status"):
        encoder.encode(0.0, 0, 2**32, some_samples())
    for wrong in (some_samples(n_channels=2), some_samples()[0]):
        with pytest.raises(messages.MessageError, match=r"expected \(3, n_samples\)"):
            encoder.encode(0.0, 0, 0, wrong)
    with pytest.raises(messages.MessageError, match="3 channel names but 1 units"):
        messages.SeriesEncoder("run-1", 25000.0, NAMES, ("m",))
    with pytest.raises(messages.MessageError, match="stride"):
        messages.SeriesEncoder("run-1", 25000.0, NAMES, UNITS, stride=-5)
