"""Wire messages: series of samples packed and read by hand, and the header that all messages share.

A series is a `Block`, an `Estimate` or a `Truth` of `messages.proto`: channels of equal length over one
stretch of a run. Packing it by hand gives the bytes that protobuf gives, ten times as fast, because a
packed float field is a contiguous array. All other messages use the classes of `daq.messages_pb2`.

Samples are read from the packed form only, in one piece or in several; a message with one tag a sample,
which proto3 writers do not make, is refused. Unknown fields are skipped, as protobuf skips them.
"""

import struct
from collections.abc import Iterator, Sequence
from enum import IntFlag
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

Samples = npt.NDArray[np.float32]


class MessageError(ValueError):
    """Bytes that are not the message they should be, or values that no message can carry."""


class BlockStatus(IntFlag):
    """Flags in a block's `status` (the loss and quality of what it holds)."""

    OVERRUN = 1
    """The device's buffer overflowed: samples before this block are lost."""
    LATE = 2
    """A read came later than the next one was due; nothing is lost."""
    CLIPPED = 4
    """At least one sample is at the end of its channel's range."""
    SENSOR_NOT_OK = 8
    """At least one sensor's voltage is outside its OK range."""
    EMULATED = 16
    """The samples come from a model, not from hardware."""
    GAP_BEFORE = 32
    """Samples between the previous block and this one are missing."""
    RECORDING_OFF = 64
    """A plan has switched recording off: of such samples only those before a trip are recorded."""


TIMING_FLAGS = BlockStatus.OVERRUN | BlockStatus.LATE
"""Flags that tell of the computer's timing: signal digests leave them out."""


class Header(NamedTuple):
    """What every message begins with."""

    timestamp: float
    """s since 1970 UTC, for people and plot tools only."""
    run: str
    """Run id."""
    sample: int
    """Sample index that the message refers to; of a series, its first."""


class Series(NamedTuple):
    """Channels over one stretch of a run; column j is sample `first_sample + j * max(stride, 1)`."""

    timestamp: float
    """s since 1970 UTC of the first sample, for people and plot tools only."""
    run: str
    """Run id."""
    first_sample: int
    """Index of the first sample since the run's start."""
    rate: float
    """Hz, of the sample index."""
    status: int
    """Flags of `BlockStatus`."""
    stride: int
    """Samples of the index between two columns; 0 in a block, which holds every sample."""
    names: tuple[str, ...]
    units: tuple[str, ...]
    samples: Samples
    """(n_channels, n_samples), C-contiguous, in the channels' units."""


# Tags of the fields: (number << 3) | wire type.
TIMESTAMP, RUN, FIRST_SAMPLE, RATE, STATUS, CHANNELS, STRIDE = 0x09, 0x12, 0x18, 0x21, 0x28, 0x32, 0x38
CHANNEL_NAME, CHANNEL_UNIT, CHANNEL_SAMPLES, CHANNEL_SAMPLE = 0x0A, 0x12, 0x1A, 0x1D
VARINT, EIGHT_BYTES, LENGTH_DELIMITED, FOUR_BYTES = 0, 1, 2, 5

DOUBLE = struct.Struct("<d")
UINT32_MAX = 2**32 - 1
UINT64_MAX = 2**64 - 1
LAST_HEADER_FIELD = 3


class SeriesEncoder:
    """Packs series of one run that share rate, channels and stride.

    Args:
        run: run id.
        rate: Hz, of the sample index.
        names: channel names, in the order of the rows of the samples.
        units: unit of each channel.
        stride: samples of the index between two columns; 0 for a block.

    Raises:
        MessageError: names and units differ in number, or stride does not fit 32 bits.
    """

    def __init__(
        self, run: str, rate: float, names: Sequence[str], units: Sequence[str], stride: int = 0
    ) -> None:
        if len(names) != len(units):
            raise MessageError(f"{len(names)} channel names but {len(units)} units: each channel needs one")
        self._n_channels = len(names)
        self._run = _text_field(RUN, run)
        self._rate = _double_field(RATE, rate)
        self._stride = _integer_field(STRIDE, stride, UINT32_MAX, "stride")
        self._labels = [
            _text_field(CHANNEL_NAME, name) + _text_field(CHANNEL_UNIT, unit)
            for name, unit in zip(names, units, strict=True)
        ]
        self._n_samples = 0
        self._prefixes = self._channel_prefixes(0)

    def encode(self, timestamp: float, first_sample: int, status: int, samples: Samples) -> bytes:
        """Return the message's bytes, equal to those of protobuf's `SerializeToString`.

        Args:
            timestamp: s since 1970 UTC of the first sample.
            first_sample: its index.
            status: flags of `BlockStatus`.
            samples: (n_channels, n_samples), float32.

        Raises:
            MessageError: the samples' shape does not fit the channels, or a number does not fit its field.
        """
        rows = np.ascontiguousarray(samples, dtype="<f4")
        if rows.ndim != 2 or rows.shape[0] != self._n_channels:
            raise MessageError(f"samples of shape {rows.shape}: expected ({self._n_channels}, n_samples)")
        n_samples = rows.shape[1]
        if n_samples != self._n_samples:
            self._prefixes = self._channel_prefixes(n_samples)
            self._n_samples = n_samples
        pieces = [
            _double_field(TIMESTAMP, timestamp),
            self._run,
            _integer_field(FIRST_SAMPLE, first_sample, UINT64_MAX, "first_sample"),
            self._rate,
            _integer_field(STATUS, status, UINT32_MAX, "status"),
        ]
        content = rows.tobytes()
        row_bytes = 4 * n_samples
        start = 0
        for prefix in self._prefixes:
            end = start + row_bytes
            pieces += (prefix, content[start:end])
            start = end
        pieces.append(self._stride)
        return b"".join(pieces)

    def _channel_prefixes(self, n_samples: int) -> list[bytes]:
        """Return what stands before each row's floats."""
        size = 4 * n_samples
        tail = bytes((CHANNEL_SAMPLES,)) + _varint(size) if n_samples else b""
        return [
            bytes((CHANNELS,)) + _varint(len(label) + len(tail) + size) + label + tail
            for label in self._labels
        ]


def decode_series(payload: bytes) -> Series:
    """Read a `Block`, `Estimate` or `Truth`; the samples are a copy that the caller may change.

    Raises:
        MessageError: the bytes are cut off, are no such message, or its channels differ in length.
    """
    timestamp, rate, run, first_sample, status, stride = 0.0, 0.0, "", 0, 0, 0
    names: list[str] = []
    units: list[str] = []
    pieces: list[memoryview] = []
    sizes: list[int] = []
    view = memoryview(payload)
    for tag, value, start, end in _fields(payload, 0, len(payload)):
        if tag == CHANNELS:
            name, unit, size = _read_channel(payload, view, start, end, pieces)
            names.append(name)
            units.append(unit)
            sizes.append(size)
        elif tag == TIMESTAMP:
            (timestamp,) = DOUBLE.unpack_from(payload, start)
        elif tag == RATE:
            (rate,) = DOUBLE.unpack_from(payload, start)
        elif tag == RUN:
            run = _text(payload, start, end)
        elif tag == FIRST_SAMPLE:
            first_sample = value
        elif tag == STATUS:
            status = value & UINT32_MAX
        elif tag == STRIDE:
            stride = value & UINT32_MAX
    samples = _matrix(names, sizes, pieces)
    return Series(timestamp, run, first_sample, rate, status, stride, tuple(names), tuple(units), samples)


def read_header(payload: bytes) -> Header:
    """Read fields 1 to 3 of any message of a run, without looking at what follows them.

    Fields are taken in the order of their numbers, as all protobuf writers put them.

    Raises:
        MessageError: the bytes are cut off within the header or are no such message.
    """
    timestamp, run, sample = 0.0, "", 0
    for tag, value, start, end in _fields(payload, 0, len(payload)):
        if tag >> 3 > LAST_HEADER_FIELD:
            break
        if tag == TIMESTAMP:
            (timestamp,) = DOUBLE.unpack_from(payload, start)
        elif tag == RUN:
            run = _text(payload, start, end)
        elif tag == FIRST_SAMPLE:
            sample = value
    return Header(timestamp, run, sample)


def read_status(payload: bytes) -> int:
    """Read the flags of a series, without looking at its samples.

    Raises:
        MessageError: the bytes are cut off before the flags or are no such message.
    """
    for tag, value, _start, _end in _fields(payload, 0, len(payload)):
        if tag == STATUS:
            return value & UINT32_MAX
        if tag >> 3 > STATUS >> 3:
            break
    return 0


def _varint(value: int) -> bytes:
    """Return a non-negative number in protobuf's variable length, seven bits a byte, lowest first."""
    octets = bytearray()
    while value > 0x7F:
        octets.append(value & 0x7F | 0x80)
        value >>= 7
    octets.append(value)
    return bytes(octets)


def _integer_field(tag: int, value: int, largest: int, name: str) -> bytes:
    if not 0 <= value <= largest:
        raise MessageError(f"{name} = {value}: must be between 0 and {largest}")
    return bytes((tag,)) + _varint(int(value)) if value else b""


def _double_field(tag: int, value: float) -> bytes:
    octets = DOUBLE.pack(value)
    return bytes((tag,)) + octets if any(octets) else b""


def _text_field(tag: int, text: str) -> bytes:
    octets = text.encode()
    return bytes((tag,)) + _varint(len(octets)) + octets if octets else b""


def _read_varint(payload: bytes, position: int, end: int) -> tuple[int, int]:
    """Return the number that starts at `position` and the position behind it."""
    value = 0
    for shift in range(0, 70, 7):
        if position >= end:
            raise MessageError(f"cut off in a number at byte {position}")
        octet = payload[position]
        position += 1
        value |= (octet & 0x7F) << shift
        if octet < 0x80:
            return value & UINT64_MAX, position
    raise MessageError(f"number of more than ten bytes before byte {position}")


def _fields(payload: bytes, position: int, end: int) -> Iterator[tuple[int, int, int, int]]:
    """Yield (tag, value, start, end) of each field: the value of a varint, the extent of all others."""
    while position < end:
        tag = payload[position]
        position += 1
        if tag >= 0x80:
            tag, position = _read_varint(payload, position - 1, end)
        if not 1 <= tag >> 3 <= 0x1FFFFFFF:
            raise MessageError(f"field number {tag >> 3} before byte {position}")
        wire_type = tag & 7
        value = 0
        start = position
        if wire_type == VARINT:
            value, stop = _read_varint(payload, position, end)
        elif wire_type == LENGTH_DELIMITED:
            size, start = _read_varint(payload, position, end)
            stop = start + size
        elif wire_type == EIGHT_BYTES:
            stop = position + 8
        elif wire_type == FOUR_BYTES:
            stop = position + 4
        else:
            raise MessageError(f"wire type {wire_type} before byte {position}")
        if stop > end:
            raise MessageError(f"cut off: field {tag >> 3} ends at byte {stop} of {end}")
        yield tag, value, start, stop
        position = stop


def _read_channel(
    payload: bytes, view: memoryview, start: int, end: int, pieces: list[memoryview]
) -> tuple[str, str, int]:
    """Read one channel: append its floats' bytes to `pieces`, return name, unit and their size in bytes."""
    name, unit, size = "", "", 0
    for tag, _value, begin, stop in _fields(payload, start, end):
        if tag == CHANNEL_SAMPLES:
            pieces.append(view[begin:stop])
            size += stop - begin
            if (stop - begin) % 4:
                raise MessageError(f"channel {name!r}: {stop - begin} bytes are not a whole number of floats")
        elif tag == CHANNEL_NAME:
            name = _text(payload, begin, stop)
        elif tag == CHANNEL_UNIT:
            unit = _text(payload, begin, stop)
        elif tag == CHANNEL_SAMPLE:
            raise MessageError(f"channel {name!r}: samples are not packed")
    return name, unit, size


def _text(payload: bytes, start: int, end: int) -> str:
    try:
        return payload[start:end].decode()
    except UnicodeDecodeError:
        raise MessageError(f"bytes {start} to {end} are not UTF-8 text") from None


def _matrix(names: list[str], sizes: list[int], pieces: list[memoryview]) -> Samples:
    """Return the channels' floats as the rows of one array."""
    if len(set(sizes)) > 1:
        shortest, longest = min(sizes), max(sizes)
        raise MessageError(
            f"channels differ in length: {names[sizes.index(shortest)]!r} has {shortest // 4} samples, "
            f"{names[sizes.index(longest)]!r} has {longest // 4}"
        )
    floats = np.frombuffer(bytearray().join(pieces), dtype="<f4")
    return floats.reshape(len(names), sizes[0] // 4 if sizes else 0)
