"""Reads what is new in a series of messages that are laid out alike, many times as fast as decoding them.

From one message to the next of a topic only time, first sample, status and samples change. A layout
knows where they stand and checks that everything else is as it was.
"""

from typing import NamedTuple

import numpy as np

from daq.messages import DOUBLE, Series, SeriesEncoder, decode_series

TIMESTAMP, RUN, SAMPLE, STATUS = 0x09, 0x12, 0x18, 0x28  # tags of fields
AFTER_TIMESTAMP = 9
RATE_SIZE = 9
LONGEST = 127  # bytes of a run id whose length takes one byte
NEXT = 0x80  # bit of a number's byte that says that more follow


class Variable(NamedTuple):
    """What differs between the messages of a topic."""

    first_sample: int
    status: int
    shape: tuple[int, int]
    """(n_channels, n_columns)."""
    labels: bytes
    """Names and units of the channels."""
    samples: bytes
    """Little-endian float32, channel after channel."""


class Layout:
    """Where the parts of a topic's messages stand, learned from one of them that was decoded."""

    def __init__(self, series: Series) -> None:
        encoder = SeriesEncoder(series.run, series.rate, series.names, series.units, series.stride)
        self.stride = max(series.stride, 1)
        """Samples of the index between two columns."""
        shape = series.samples.shape
        blank = encoder.encode(1.0, 1, 1, np.zeros(shape, np.float32))
        inked = encoder.encode(1.0, 1, 1, np.full(shape, -1, np.int32).view(np.float32))
        head = SeriesEncoder(series.run, series.rate, (), ()).encode(1.0, 1, 1, np.empty((0, 0), np.float32))
        run_end = len(head) - 2 - RATE_SIZE - 2  # behind it stand first sample 1, rate and status 1
        self._run = head[AFTER_TIMESTAMP:run_end]
        self._rate = head[run_end + 2 : -2]
        self._samples = _runs(blank[len(head) :], inked[len(head) :])
        self._fixed = _between(self._samples, len(blank) - len(head))
        self._frame = b"".join([blank[len(head) :][part] for part in self._fixed])
        self._size = len(blank) - len(head)
        self._shape = shape
        self._labels = labels(series)

    def read(self, payload: bytes) -> Variable | None:
        """Return what differs in a message; None when it is laid out in another way."""
        found = self._open(payload)
        if found is None:
            return None
        first_sample, status, body = found
        samples = b"".join([body[part] for part in self._samples])
        return Variable(first_sample, status, self._shape, self._labels, samples)

    def extent(self, payload: bytes) -> tuple[int, int] | None:
        """Return the first sample of a message and its columns; None when it is laid out in another way."""
        found = self._open(payload)
        return None if found is None else (found[0], self._shape[1])

    def _open(self, payload: bytes) -> tuple[int, int, bytes] | None:
        """Return first sample, status and what stands behind it, if all that is fixed is as it should be."""
        position = AFTER_TIMESTAMP + len(self._run)
        if not payload or payload[0] != TIMESTAMP or not payload.startswith(self._run, AFTER_TIMESTAMP):
            return None
        first_sample, position = read_number(payload, position, SAMPLE)
        if not payload.startswith(self._rate, position):
            return None
        status, position = read_number(payload, position + RATE_SIZE, STATUS)
        body = payload[position:]
        if len(body) != self._size or b"".join([body[part] for part in self._fixed]) != self._frame:
            return None
        return first_sample, status, body


class SeriesDecoder:
    """Decodes messages of one topic: what is laid out like the message before at a fifth of the cost."""

    def __init__(self) -> None:
        self._like: tuple[Series, Layout] | None = None

    def decode(self, payload: bytes) -> Series:
        """Return the same as `daq.messages.decode_series`.

        Raises:
            MessageError: the bytes are cut off, are no such message, or its channels differ in length.
        """
        if self._like is not None:
            series, layout = self._like
            found = layout.read(payload)
            if found is not None:
                (timestamp,) = DOUBLE.unpack_from(payload, 1)
                samples = np.frombuffer(bytearray(found.samples), "<f4").reshape(found.shape)
                return series._replace(
                    timestamp=timestamp, first_sample=found.first_sample, status=found.status, samples=samples
                )
        series = decode_series(payload)
        self._like = series, Layout(series)
        return series

    def extent(self, payload: bytes) -> tuple[int, int]:
        """Return the first sample of a series and its columns, and leave its samples where they are.

        Raises:
            MessageError: as `decode`.
        """
        found = self._like[1].extent(payload) if self._like else None
        if found is not None:
            return found
        series = self.decode(payload)
        return series.first_sample, series.samples.shape[1]


class HeaderLayout:
    """Reads the sample index of any message of one run."""

    def __init__(self, run: str) -> None:
        octets = run.encode()
        self._run = bytes((RUN, len(octets))) + octets if 0 < len(octets) <= LONGEST else b""

    def read(self, payload: bytes) -> int | None:
        """Return the sample index; None when the message must be looked at more closely."""
        position = AFTER_TIMESTAMP + len(self._run)
        if (
            not (self._run and payload)
            or payload[0] != TIMESTAMP
            or not payload.startswith(self._run, AFTER_TIMESTAMP)
        ):
            return None
        sample, end = read_number(payload, position, SAMPLE)
        return sample if end > position else None


def variable(series: Series) -> Variable:
    """Return the same of a message that was decoded."""
    samples = series.samples
    return Variable(series.first_sample, series.status, samples.shape, labels(series), samples.tobytes())


def labels(series: Series) -> bytes:
    """Return names and units of the channels."""
    return "\0".join([*series.names, *series.units]).encode()


def read_number(payload: bytes, position: int, tag: int) -> tuple[int, int]:
    """Return the number of a field, 0 when the field is not there, and the position behind it."""
    if position >= len(payload) or payload[position] != tag:
        return 0, position
    value = shift = 0
    while True:
        position += 1
        octet = payload[position] if position < len(payload) else 0
        value |= (octet & 0x7F) << shift
        if octet < NEXT:
            return value, position + 1
        shift += 7


def _runs(blank: bytes, inked: bytes) -> list[slice]:
    """Return the stretches in which two messages differ."""
    differs = np.frombuffer(blank, np.uint8) != np.frombuffer(inked, np.uint8)
    edges = np.flatnonzero(np.diff(np.concatenate(([False], differs, [False]))))
    return [slice(start, end) for start, end in edges.reshape(-1, 2).tolist()]


def _between(stretches: list[slice], size: int) -> list[slice]:
    """Return the stretches that lie before, between and behind others."""
    starts = [0, *(stretch.stop for stretch in stretches)]
    ends = [*(stretch.start for stretch in stretches), size]
    return [slice(start, end) for start, end in zip(starts, ends, strict=True)]
