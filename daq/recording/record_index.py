"""Where a recording's chunks and notes stand, so that a piece of it is read without all that is before it.

A file that was closed in order says so at its end, under a checksum; of any other the records are walked
through once.
"""

import struct
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from daq.recording.records import CHANNEL, HEAD, Op, Record, RecordFile, text_at

CHUNK_INDEX = struct.Struct("<QQQQI")  # times of the first and last message, start, length, bytes of the map
HOLDS = struct.Struct("<HQ")  # an entry of the map: channel, and where the index of its messages stands
PLACE = struct.Struct("<QQ")  # start and length


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

    chunks: list[Chunk] = field(default_factory=list)
    topics: dict[int, str] = field(default_factory=dict)
    notes: list[Record] = field(default_factory=list)
    damage: list[str] = field(default_factory=list)
    """What was found cut off or damaged on the way, in plain words."""

    def between(self, first_ns: int, last_ns: int) -> Iterator[Chunk]:
        """Yield the chunks that hold messages of this stretch of time, in the order of the file."""
        begins = np.array([chunk.first_ns for chunk in self.chunks], np.uint64)
        ends = np.array([chunk.last_ns for chunk in self.chunks], np.uint64)
        for number in np.flatnonzero((begins <= last_ns) & (ends >= first_ns)).tolist():
            yield self.chunks[number]


def stored_index(file: RecordFile) -> Index | None:
    """Return what a file says at its end; None where it was not closed or its end is damaged."""
    summary = file.summary()
    try:
        return _read(summary) if summary else None
    except (struct.error, ValueError):  # only where it has no checksum
        return None


def scanned_chunk(file: RecordFile, record: Record) -> Chunk:
    """Return the same of a chunk that was come across."""
    first, last = PLACE.unpack(file.read(record.start, PLACE.size))
    packed = b"".join(HOLDS.pack(channel, 0) for channel in sorted(file.channels_behind(record)))
    return Chunk(first, last, record.start, record.end, packed)


def _read(data: bytes) -> Index:
    index = Index()
    position = 0
    while position + HEAD.size <= len(data):
        kind, length = HEAD.unpack_from(data, position)
        position += HEAD.size
        if kind == Op.CHUNK_INDEX:
            first, last, start, size, map_size = CHUNK_INDEX.unpack_from(data, position)
            behind = position + CHUNK_INDEX.size
            index.chunks.append(
                Chunk(first, last, start + HEAD.size, start + size, data[behind : behind + map_size])
            )
        elif kind == Op.CHANNEL:
            number, _schema = CHANNEL.unpack_from(data, position)
            index.topics[number] = text_at(data, position + CHANNEL.size)[0]
        elif kind in (Op.METADATA_INDEX, Op.ATTACHMENT_INDEX):
            start, size = PLACE.unpack_from(data, position)
            of = Op.METADATA if kind == Op.METADATA_INDEX else Op.ATTACHMENT
            index.notes.append(Record(of, start + HEAD.size, start + size))
        position += length
    return index
