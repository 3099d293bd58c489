"""Where a recording's chunks and notes stand, so that a piece of it is read without all that is before it.

A file that was closed in order says so at its end, under a checksum; of any other the records are walked
through once. An hour has tens of thousands of chunks: they are kept as columns of one table, and only
those that are asked for become objects.
"""

import struct
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from daq.recording.records import CHANNEL, HEAD, Op, Record, RecordFile, text_at

HOLDS = struct.Struct("<HQ")  # an entry of the map: channel, and where the index of its messages stands
PLACE = struct.Struct("<QQ")  # start and length
CHUNK_INDEX = np.dtype(
    [
        ("kind", "u1"),
        ("length", "<u8"),
        ("first_ns", "<u8"),
        ("last_ns", "<u8"),
        ("start", "<u8"),
        ("size", "<u8"),
        ("map_size", "<u4"),
    ]
)
"""A chunk index up to its map: its head, times of first and last message, the chunk's start and length."""
TABLE = np.dtype([(name, "u8") for name in ("first_ns", "last_ns", "start", "end", "map_start", "map_end")])


class Chunk(NamedTuple):
    """A chunk, when its messages happened and what it holds."""

    first_ns: int
    last_ns: int
    start: int
    """Of the record's content."""
    end: int
    map: bytes
    """One `HOLDS` for each channel."""

    @property
    def record(self) -> Record:
        """The chunk's record."""
        return Record(Op.CHUNK, self.start, self.end)

    @property
    def channels(self) -> set[int]:
        """Channels of which it holds messages; empty when that is not known."""
        return {channel for channel, _position in HOLDS.iter_unpack(self.map)}


@dataclass
class Index:
    """Chunks in the order of the file, topics by their channel, and metadata records and attachments."""

    table: np.ndarray
    """One row of `TABLE` for each chunk."""
    maps: bytes
    """Bytes in which the chunks' maps stand."""
    topics: dict[int, str] = field(default_factory=dict)
    notes: list[Record] = field(default_factory=list)
    damage: list[str] = field(default_factory=list)
    """What was found cut off or damaged on the way, in plain words."""

    def chunks(self, numbers: Iterable[int] | None = None) -> Iterator[Chunk]:
        """Yield the chunks of these numbers; None: all, in the order of the file."""
        for number in range(len(self.table)) if numbers is None else numbers:
            first, last, start, end, map_start, map_end = self.table[number].tolist()
            yield Chunk(first, last, start, end, self.maps[map_start:map_end])

    def from_the_end(self) -> Iterator[Chunk]:
        """Yield all chunks, the last of the file first."""
        return self.chunks(range(len(self.table) - 1, -1, -1))

    def between(self, first_ns: int, last_ns: int) -> Iterator[Chunk]:
        """Yield the chunks that hold messages of this stretch of time, in the order of the file."""
        begun, ended = self.table["first_ns"] <= last_ns, self.table["last_ns"] >= first_ns
        return self.chunks(np.flatnonzero(begun & ended).tolist())

    def latest_first(self, last_ns: int) -> Iterator[Chunk]:
        """Yield the chunks that hold messages up to this time, by their last message, the latest first."""
        numbers = np.flatnonzero(self.table["first_ns"] <= last_ns)
        order = np.argsort(self.table["last_ns"][numbers], kind="stable")
        return self.chunks(int(number) for number in numbers[order[::-1]])


def stored_index(file: RecordFile) -> Index | None:
    """Return what a file says at its end; None where it was not closed or its end is damaged."""
    summary = file.summary()
    try:
        return _read(summary) if summary else None
    except (struct.error, ValueError):  # only where it has no checksum
        return None


def scanned_index(file: RecordFile, chunks: Iterable[Record]) -> Index:
    """Return the same of chunks that were come across."""
    rows, maps = [], bytearray()
    for record in chunks:
        first, last = PLACE.unpack(file.read(record.start, PLACE.size))
        map_start = len(maps)
        for channel in sorted(file.channels_behind(record)):
            maps += HOLDS.pack(channel, 0)
        rows.append((first, last, record.start, record.end, map_start, len(maps)))
    return Index(np.array(rows, TABLE), bytes(maps))


def _read(data: bytes) -> Index:
    index = Index(np.empty(0, TABLE), data)
    position, places = 0, []
    while position + HEAD.size <= len(data):
        kind, length = HEAD.unpack_from(data, position)
        if kind == Op.CHUNK_INDEX:
            places.append(position)
        else:
            _take_in(index, kind, data, position + HEAD.size)
        position += HEAD.size + length
    index.table = _table(data, places)
    return index


def _take_in(index: Index, kind: int, data: bytes, position: int) -> None:
    """Note what a record of the summary says of topics, metadata records and attachments."""
    if kind == Op.CHANNEL:
        number, _schema = CHANNEL.unpack_from(data, position)
        index.topics[number] = text_at(data, position + CHANNEL.size)[0]
    elif kind in (Op.METADATA_INDEX, Op.ATTACHMENT_INDEX):
        start, size = PLACE.unpack_from(data, position)
        of = Op.METADATA if kind == Op.METADATA_INDEX else Op.ATTACHMENT
        index.notes.append(Record(of, start + HEAD.size, start + size))


def _table(data: bytes, places: Sequence[int]) -> np.ndarray:
    """Return the chunks whose indexes stand at these places."""
    table = np.empty(len(places), TABLE)
    if not places:
        return table
    if places[-1] + CHUNK_INDEX.itemsize > len(data):
        raise ValueError("a chunk's index is cut off")
    starts = np.array(places)
    octets = np.lib.stride_tricks.sliding_window_view(np.frombuffer(data, np.uint8), CHUNK_INDEX.itemsize)
    rows = octets[starts].view(CHUNK_INDEX)[:, 0]
    table["first_ns"], table["last_ns"] = rows["first_ns"], rows["last_ns"]
    table["start"] = rows["start"] + HEAD.size
    table["end"] = rows["start"] + rows["size"]
    table["map_start"] = starts + CHUNK_INDEX.itemsize
    table["map_end"] = table["map_start"] + rows["map_size"]
    return table
