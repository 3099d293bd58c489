"""Reads the records of an MCAP file, whole, cut off or damaged, without loading the file.

The format's own readers need a sound end of the file, or end at the first damage; this one checks each
chunk's checksum and finds the next sound chunk behind a damage. Format: https://mcap.dev/spec
"""

import json
import os
import struct
import weakref
import zlib
from collections.abc import Iterator
from enum import IntEnum
from pathlib import Path
from threading import local
from typing import NamedTuple

import zstandard

from daq.recording.storage import RecordingError


class Op(IntEnum):
    """Kinds of record."""

    HEADER = 0x01
    FOOTER = 0x02
    SCHEMA = 0x03
    CHANNEL = 0x04
    MESSAGE = 0x05
    CHUNK = 0x06
    MESSAGE_INDEX = 0x07
    CHUNK_INDEX = 0x08
    ATTACHMENT = 0x09
    ATTACHMENT_INDEX = 0x0A
    STATISTICS = 0x0B
    METADATA = 0x0C
    METADATA_INDEX = 0x0D
    SUMMARY_OFFSET = 0x0E
    DATA_END = 0x0F


KINDS = frozenset(Op)
SEAL = "crc32"  # key of the checksum in our metadata records
MAGIC = b"\x89MCAP0\r\n"
WINDOW = 1 << 20  # bytes that are read or searched at a time
LARGEST_CHUNK = 1 << 28  # bytes; one that says it is larger is damaged

HEAD = struct.Struct("<BQ")  # kind and length of a record
SIZE = struct.Struct("<I")
FOOTER = struct.Struct("<QQI")  # where the summary and its offsets begin, checksum
FOOTER_SIZE = HEAD.size + FOOTER.size + len(MAGIC)  # from the footer's first byte to the end of the file
CHUNK = struct.Struct("<QQQI")  # times of the first and last message, uncompressed size, checksum
CHANNEL = struct.Struct("<HH")  # channel and schema
MESSAGE = struct.Struct("<HIQQ")  # channel, sequence, log time, publish time
LONG = struct.Struct("<Q")
ZSTD = b"\x04\0\0\0zstd"
ZSTD_AT = HEAD.size + CHUNK.size  # from a chunk's first byte to the name of its compression
DATA_AT = CHUNK.size + len(ZSTD) + LONG.size  # from the beginning of its content to the compressed data


class _Own(local):
    """A decompressor for each thread: making one takes half as long as unpacking a chunk with it."""

    def __init__(self) -> None:
        self.decompressor = zstandard.ZstdDecompressor()


_own = _Own()


class Damage(ValueError):
    """Bytes that are not what was written."""


class Record(NamedTuple):
    """Where a record's content stands in the file."""

    kind: int
    start: int
    end: int


class RawMessage(NamedTuple):
    """A message as it stands in a chunk."""

    channel: int
    sequence: int
    log_time: int
    payload: bytes


class RecordFile:
    """An MCAP file, read in pieces; several walks through it may go on at once.

    Raises:
        RecordingError: no such file, or it is not MCAP.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        if path.is_dir():
            raise RecordingError(f"{path} is a folder: name a recording in it")
        try:
            self._fd = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
        except FileNotFoundError:
            raise RecordingError(f"{path}: no such file") from None
        except OSError as error:
            raise RecordingError(f"{path} cannot be read: {error.strerror}") from error
        self.close = weakref.finalize(self, os.close, self._fd)
        """Closes the file, once; happens by itself when nobody holds it any longer."""
        self.size = os.fstat(self._fd).st_size
        self._window = b""
        self._window_at = 0
        if self.read(0, len(MAGIC)) != MAGIC:
            what = "is empty" if self.size == 0 else "is not an MCAP file"
            raise RecordingError(
                f"{path} {what}: recordings are made by `rigtwin live` and `rigtwin simulate`"
            )
        self.closed = self.size > FOOTER_SIZE and self.read(self.size - len(MAGIC), len(MAGIC)) == MAGIC

    def read(self, position: int, size: int) -> bytes:
        """Return up to `size` bytes from `position` on."""
        offset = position - self._window_at
        if not (offset >= 0 and offset + size <= len(self._window)):
            content = os.pread(self._fd, max(size, WINDOW // 16), position)
            self._window, self._window_at, offset = content, position, 0
        return self._window[offset : offset + size]

    def content(self, record: Record) -> bytes:
        """Return a record's content."""
        return self.read(record.start, record.end - record.start)

    def walk(self, position: int = len(MAGIC)) -> Iterator[Record]:
        """Yield the records from `position` on, up to the end of the data.

        Raises:
            Damage: a record is not sound, or the file ends before its data does.
        """
        while True:
            head = self.read(position, HEAD.size + DATA_AT)
            if len(head) < HEAD.size:
                raise Damage(f"it ends at byte {self.size} without having been closed")
            kind, length = HEAD.unpack_from(head)
            record = Record(kind, position + HEAD.size, position + HEAD.size + length)
            if record.end > self.size and not self.closed:
                raise Damage(f"it is cut off at byte {self.size}")
            if kind not in KINDS or record.end > self.size or self._is_disguised(record, head):
                raise Damage(f"the record at byte {position} is damaged")
            if kind == Op.DATA_END:
                return
            yield record
            position = record.end

    def next_chunk(self, position: int) -> Record | None:
        """Return the first sound chunk that begins at `position` or behind it."""
        search = position + ZSTD_AT
        while search < self.size:
            window = self.read(search, WINDOW)
            found = window.find(ZSTD)
            if found < 0:
                search += max(1, len(window) - len(ZSTD) + 1)
                continue
            chunk = self._chunk_at(search + found - ZSTD_AT)
            if chunk is not None and self._is_sound(chunk):
                return chunk
            search += found + 1
        return None

    def channels_behind(self, record: Record) -> set[int]:
        """Return which channels a chunk holds, by the indexes behind it; empty when there are none."""
        channels: set[int] = set()
        position = record.end
        while True:
            head = self.read(position, HEAD.size + 2)
            if len(head) < HEAD.size + 2 or head[0] != Op.MESSAGE_INDEX:
                return channels
            _kind, length = HEAD.unpack_from(head)
            channels.add(int.from_bytes(head[HEAD.size :], "little"))
            position += HEAD.size + length

    def summary(self) -> bytes | None:
        """Return the summary of a file that was closed; None when there is none or its checksum is wrong."""
        footer_at = self.size - FOOTER_SIZE
        footer = self.read(footer_at, FOOTER_SIZE) if self.closed else b""
        if len(footer) < FOOTER_SIZE or footer[0] != Op.FOOTER:
            return None
        start, _offsets, crc = FOOTER.unpack_from(footer, HEAD.size)
        if not HEAD.size + SIZE.size < start <= footer_at:
            return None
        data = os.pread(self._fd, footer_at - start, start)
        covered = footer[: HEAD.size + FOOTER.size - SIZE.size]
        return data if crc in (0, zlib.crc32(covered, zlib.crc32(data))) else None

    def checksum_holds(self) -> bool:
        """Whether the data and the summary of a closed file have the checksums that stand in it."""
        summary = self.summary()
        if summary is None:
            return False
        end = self.size - FOOTER_SIZE - len(summary) - HEAD.size - SIZE.size
        kind, length = HEAD.unpack(self.read(end, HEAD.size))
        (crc,) = SIZE.unpack(self.read(end + HEAD.size, SIZE.size))
        return (kind, length) == (Op.DATA_END, SIZE.size) and crc in (0, self._crc(0, end))

    def _is_disguised(self, record: Record, head: bytes) -> bool:
        """Whether a record is a chunk although it says otherwise, or a chunk whose two lengths differ."""
        is_chunk = head[ZSTD_AT : ZSTD_AT + len(ZSTD)] == ZSTD
        if record.kind != Op.CHUNK:
            return is_chunk
        return is_chunk and record.end - record.start != DATA_AT + _compressed_size(head)

    def _chunk_at(self, position: int) -> Record | None:
        """Return the chunk at `position`, its length taken from within: either length may be damaged."""
        head = self.read(position, HEAD.size + DATA_AT)
        if position < 0 or len(head) < HEAD.size + DATA_AT:
            return None
        kind, length = HEAD.unpack_from(head)
        start = position + HEAD.size
        for inner in (_compressed_size(head), length - DATA_AT):
            end = start + DATA_AT + inner
            if (kind == Op.CHUNK or length == DATA_AT + inner) and start < end <= self.size:
                return Record(Op.CHUNK, start, end)
        return None

    def _is_sound(self, chunk: Record) -> bool:
        try:
            return bool(unpack_chunk(self.content(chunk)))
        except Damage:
            return False

    def _crc(self, position: int, end: int) -> int:
        crc = 0
        while position < end:
            piece = self.read(position, min(WINDOW, end - position))
            if not piece:
                break
            crc = zlib.crc32(piece, crc)
            position += len(piece)
        return crc


def _compressed_size(head: bytes) -> int:
    """Return how many bytes of compressed data a chunk says it has."""
    return LONG.unpack_from(head, HEAD.size + DATA_AT - LONG.size)[0]


def unpack_chunk(content: bytes) -> bytes:
    """Return the records in a chunk, uncompressed and checked.

    Raises:
        Damage: they are not what was written.
    """
    try:
        _first, _last, size, crc = CHUNK.unpack_from(content)
        compression, position = text_at(content, CHUNK.size)
        data = content[position + LONG.size :]
        if compression == "zstd":
            if size > LARGEST_CHUNK or zstandard.frame_content_size(data) not in (size, -1):
                raise Damage("its size is damaged")
            data = _own.decompressor.decompress(data, max_output_size=size)
        elif compression:
            raise Damage(f"its compression {compression!r} is not zstd")
    except (struct.error, UnicodeDecodeError, zstandard.ZstdError, MemoryError) as error:
        raise Damage(str(error)) from error
    if len(data) != size or crc not in (0, zlib.crc32(data)):
        raise Damage("its checksum is wrong")
    return data


def split_chunk(data: bytes) -> Iterator[tuple[int, str] | RawMessage]:
    """Yield what stands in an unpacked chunk: channels as (number, topic), and messages.

    Raises:
        Damage: a record is cut off.
    """
    position, end = 0, len(data)
    try:
        while position < end:
            kind, length = HEAD.unpack_from(data, position)
            start = position + HEAD.size
            position = start + length
            if position > end:
                raise Damage("a record in it is cut off")
            if kind == Op.MESSAGE:
                channel, sequence, log_time, _publish_time = MESSAGE.unpack_from(data, start)
                yield RawMessage(channel, sequence, log_time, data[start + MESSAGE.size : position])
            elif kind == Op.CHANNEL:
                number, _schema = CHANNEL.unpack_from(data, start)
                yield number, text_at(data, start + CHANNEL.size)[0]
    except (struct.error, UnicodeDecodeError) as error:
        raise Damage(str(error)) from error


def read_metadata(content: bytes) -> tuple[str, dict[str, str]]:
    """Return name and texts of a metadata record.

    Raises:
        Damage: it is not readable.
    """
    try:
        name, position = text_at(content, 0)
        position += SIZE.size
        texts = {}
        while position < len(content):
            key, position = text_at(content, position)
            texts[key], position = text_at(content, position)
    except (struct.error, UnicodeDecodeError) as error:
        raise Damage(str(error)) from error
    return name, texts


def read_attachment(content: bytes) -> tuple[str, bytes]:
    """Return name and content of an attachment, checked.

    Raises:
        Damage: it is not what was written.
    """
    try:
        (crc,) = SIZE.unpack(content[-SIZE.size :])
        if crc not in (0, zlib.crc32(content[: -SIZE.size])):
            raise Damage("its checksum is wrong")
        name, position = text_at(content, 2 * LONG.size)
        _media_type, position = text_at(content, position)
    except (struct.error, UnicodeDecodeError) as error:
        raise Damage(str(error)) from error
    return name, content[position + LONG.size : -SIZE.size]


def seal(texts: dict[str, str]) -> str:
    """Return a checksum of a metadata record's texts: the format has none for them."""
    return f"{zlib.crc32(json.dumps(texts, sort_keys=True).encode()):08x}"


def text_at(data: bytes, position: int) -> tuple[str, int]:
    """Return the text that stands at `position` and the position behind it."""
    (size,) = SIZE.unpack_from(data, position)
    start = position + SIZE.size
    if start + size > len(data):
        raise Damage("a text in it is cut off")
    return data[start : start + size].decode(), start + size
