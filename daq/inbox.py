"""Bounded queue between the link's threads, which must never wait long, and one consumer thread."""

from queue import Empty, SimpleQueue
from typing import Literal, NamedTuple


class _Message(NamedTuple):
    key: str
    payload: bytes
    dropped_before: int


class Inbox:
    """Messages from the link's callbacks, for one consumer thread.

    Any thread may put; one thread gets. `put` and `get` cost about a microsecond and wake the other side
    at once.

    Args:
        capacity: messages held at most.
        when_full: `wait` makes `put` wait for room, which holds the publisher back through the network;
            `drop_oldest` makes room by dropping the oldest message and counts it.
    """

    def __init__(self, capacity: int, when_full: Literal["wait", "drop_oldest"]) -> None:
        if capacity < 1:
            raise ValueError(f"an inbox of {capacity} messages can hold nothing: use 1 or more")
        self.capacity = capacity
        self.dropped = 0
        """Messages dropped so far; the consumer learns of a drop with the next message it gets."""
        self._waits = when_full == "wait"
        self._closed = False
        self._messages: SimpleQueue[_Message | None] = SimpleQueue()
        self._room: SimpleQueue[None] = SimpleQueue()
        for _ in range(capacity):
            self._room.put(None)

    @property
    def fill(self) -> float:
        """Share of the capacity that is in use, 0 to 1."""
        return min(1.0, self._messages.qsize() / self.capacity)

    @property
    def closed(self) -> bool:
        """Whether `close` was called; messages put before it can still be got."""
        return self._closed

    def put(self, key: str, payload: bytes) -> None:
        """Add a message; after `close`, do nothing."""
        dropped = 0
        if self._waits:
            self._room.get()
        else:
            try:
                self._room.get_nowait()
            except Empty:
                dropped = self._drop_oldest()
        if self._closed:
            self._room.put(None)
            return
        self._messages.put(_Message(key, payload, dropped))

    def get(self, timeout: float | None = None) -> tuple[str, bytes] | None:
        """Return the next key and payload; None when `timeout` (s) is over or all is got after `close`."""
        try:
            message = self._messages.get(timeout=timeout) if timeout != 0 else self._messages.get_nowait()
        except Empty:
            return None
        if message is None:
            self._messages.put(None)
            return None
        self._room.put(None)
        self.dropped += message.dropped_before
        return message.key, message.payload

    def close(self) -> None:
        """Take no more messages and release whoever waits, in `put` or in `get`."""
        self._closed = True
        self._room.put(None)
        self._messages.put(None)

    def _drop_oldest(self) -> int:
        """Take the oldest message out to use its room; return how many drops the new one must report."""
        try:
            oldest = self._messages.get_nowait()
        except Empty:
            return 0
        if oldest is None:
            self._messages.put(None)
            return 0
        return oldest.dropped_before + 1
