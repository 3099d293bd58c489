"""Numbered, kept and fetched again: how a subscriber gets every message of a caching publisher.

The publisher numbers its messages from 0 and keeps the newest. The subscriber's consumer thread compares
numbers; where some are missing it asks the publisher for them, piece by piece and at its own pace, before
it goes on. So neither a slow nor a stopped subscriber holds anybody else up: what it cannot take now is
left out and fetched later. A publisher also tells its newest number now and then, which shows a late
subscriber what there was and a lost last message.

Each message carries a checksum, because zenoh 1.10 may deliver one whose end belongs to others: when it
gives up a stopped subscriber's connection in the middle of a message, it sends what is left in its queue.
"""

import secrets
import struct
import time
from collections.abc import Callable, Iterator
from itertools import count
from zlib import crc32

PIECE_BYTES = 256 * 1024
"""A reply to a subscriber ends with the message that reaches this size."""
PATIENCE_S = 5.0
"""How long a subscriber asks a publisher that does not answer before it goes on with a gap."""
PAUSE_S = 0.02

SAMPLED_BYTES = 2048
SAMPLE_STEP = 16
TAIL_BYTES = 64
"""The checksum of a payload larger than the first covers every 16th byte and all of the last 64.

That is a third of the time (10 µs of a block's latency at each end) and enough for the damage that happens:
from some byte on, all the rest belongs to other messages.
"""
STAMP = struct.Struct("<QQI")
RANGE = struct.Struct("<QQ")
ENTRY = struct.Struct("<QII")

Stamp = tuple[int, int, int]
"""What goes along with a message: number of the publisher, number of the message, checksum.

The first two are 0 when the publisher keeps nothing.
"""
Fetch = Callable[[str, int, int, int], bytes | None]
"""(key, publisher, first, end) -> packed messages from number `first` to before `end`; None: no answer."""


class RecoveryError(ValueError):
    """A question for missed messages that is none."""


class Cache:
    """The newest messages of one publisher; one thread keeps, any thread packs."""

    def __init__(self, size: int) -> None:
        self.publisher = secrets.randbits(64)
        self.newest = -1
        """Number of the newest message that is kept; it was handed to the network before."""
        self._size = size
        self._ring: list[tuple[int, bytes, int]] = [(-1, b"", 0)] * size
        self._numbers = count()

    def stamp(self, payload: bytes) -> Stamp:
        """Return the stamp of the next message."""
        number = next(self._numbers)
        return self.publisher, number, _checksum(payload, self.publisher + number)

    def keep(self, payload: bytes, stamp: Stamp) -> None:
        """Keep a message that was sent."""
        _, number, checksum = stamp
        self._ring[number % self._size] = (number, payload, checksum)
        self.newest = number

    def pack(self, wanted: bytes) -> bytes:
        """Return the kept messages of a packed range of numbers, oldest first, as many as one reply takes.

        Raises:
            RecoveryError: that is no range.
        """
        if len(wanted) != RANGE.size:
            raise RecoveryError(f"a range of numbers has {RANGE.size} bytes, not {len(wanted)} bytes")
        first, end = RANGE.unpack(wanted)
        end = min(end, self.newest + 1)
        pieces: list[bytes] = []
        size = 0
        for number in range(max(first, self.newest + 1 - self._size), end):
            kept, payload, checksum = self._ring[number % self._size]
            if kept != number:
                continue
            pieces += (ENTRY.pack(number, len(payload), checksum), payload)
            size += len(payload)
            if size >= PIECE_BYTES:
                break
        return b"".join(pieces)


class Recovery:
    """Puts one subscription's messages in order and fetches those that are missing; for one thread.

    Args:
        fetch: how to ask a publisher for messages.
    """

    def __init__(self, fetch: Fetch) -> None:
        self.missed = 0
        """Messages that no cache could give any more, since the first that was received."""
        self._fetch = fetch
        self._due: dict[int, int] = {}

    def is_due(self, payload: bytes, stamp: Stamp) -> bool:
        """Tell whether a message is whole and the next of its publisher; if so count it as delivered."""
        publisher, number, checksum = stamp
        if self._due.get(publisher, 0) != number or _checksum(payload, publisher + number) != checksum:
            return False
        self._due[publisher] = number + 1
        return True

    def catch_up(self, key: str, stamp: Stamp, payload: bytes | None) -> Iterator[bytes | None]:
        """Yield what is missing before a message and then the message, unless it was delivered before.

        Args:
            key: its key.
            stamp: its stamp.
            payload: the message, which is fetched too when it is not whole; None when the publisher only
                told its newest number.

        Yields:
            Payloads in order; None whenever the publisher did not answer and will be asked again.
        """
        publisher, number, _ = stamp
        in_hand = payload is not None and is_whole(payload, stamp)
        end = number if in_hand else number + 1
        give_up = time.monotonic() + PATIENCE_S
        while (due := self._due.get(publisher, 0)) < end:
            packed = self._fetch(key, publisher, due, end)
            if packed == b"":
                self._advance(publisher, end)
            for kept_number, kept in _unpack(publisher, packed or b""):
                if not self._due.get(publisher, 0) <= kept_number < end:
                    break
                self._advance(publisher, kept_number)
                self._due[publisher] = kept_number + 1
                give_up = time.monotonic() + PATIENCE_S
                yield kept
            if self._due.get(publisher, 0) > due:
                continue
            if time.monotonic() > give_up:
                self._advance(publisher, end)
                break
            yield None
            time.sleep(PAUSE_S)
        if payload is not None and in_hand and self.is_due(payload, stamp):
            yield payload

    def _advance(self, publisher: int, number: int) -> None:
        """Go on to a number; count those in between as missed, unless this is where the stream begins."""
        self.missed += number - self._due.get(publisher, number)
        self._due[publisher] = number


def range_of(first: int, end: int) -> bytes:
    """Return the question for the messages from number `first` to before `end`."""
    return RANGE.pack(first, end)


def is_whole(payload: bytes, stamp: Stamp) -> bool:
    """Tell whether a payload is what its publisher sent under this stamp."""
    publisher, number, checksum = stamp
    return _checksum(payload, publisher + number) == checksum


def stamp_of(payload: bytes) -> Stamp:
    """Return the stamp of a message that is not kept."""
    return 0, 0, _checksum(payload, 0)


def _checksum(payload: bytes, seed: int) -> int:
    """Return the CRC-32 of a payload or of a sample of it, begun with a number that it covers too."""
    if len(payload) > SAMPLED_BYTES:
        payload = payload[::SAMPLE_STEP] + payload[-TAIL_BYTES:]
    return crc32(payload, seed + 1 & 0xFFFFFFFF)


def _unpack(publisher: int, packed: bytes) -> Iterator[tuple[int, bytes]]:
    """Yield number and payload of each packed message, up to the first that is not whole."""
    position = 0
    while position + ENTRY.size <= len(packed):
        number, size, checksum = ENTRY.unpack_from(packed, position)
        position += ENTRY.size
        payload = packed[position : position + size]
        if not is_whole(payload, (publisher, number, checksum)):
            return
        yield number, payload
        position += size
