"""Bounded queue between the link's threads, which must never wait long, and one consumer thread."""

import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from queue import Empty, SimpleQueue
from typing import Literal

from daq.recovery import Recovery, Stamp

LOOK_AGAIN_S = 0.1
"""Period at which a `put` that waits for room looks whether it still has to."""


_Message = tuple[str, bytes | None, int, Stamp | None, Recovery | None]
"""Key, payload, drops to report, and what recovers the subscription's missing messages."""


def _never() -> bool:
    return False


class Inbox:
    """Messages from the link's callbacks, for one consumer thread.

    Any thread may put; one thread gets. Putting and getting cost about a microsecond and wake the other
    side at once. Messages of a subscription that recovers are left out when there is no room, whatever
    `when_full` says: `get` fetches them from the publisher's cache when their turn comes.

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
        self._catching_up: Iterator[tuple[str, bytes] | None] | None = None

    @property
    def fill(self) -> float:
        """Share of the capacity that is in use, 0 to 1."""
        return min(1.0, self._messages.qsize() / self.capacity)

    @property
    def closed(self) -> bool:
        """Whether `close` was called; messages put before it can still be got."""
        return self._closed

    def put(self, key: str, payload: bytes, abandoned: Callable[[], bool] = _never) -> None:
        """Add a message; after `close`, do nothing.

        Args:
            key: its key.
            payload: its bytes.
            abandoned: tells a `put` that waits for room that it need not wait any longer.
        """
        dropped = 0
        if self._waits:
            if not self._wait_for_room(abandoned):
                return
        elif not self._closed:
            dropped = self._make_room()
        if not self._closed:
            self._messages.put((key, payload, dropped, None, None))

    def offer(self, key: str, payload: bytes | None, stamp: Stamp, recovery: Recovery) -> None:
        """Add a message that can be fetched again, or the newest number alone; leave it out when full."""
        try:
            self._room.get_nowait()
        except Empty:
            return
        if not self._closed:
            self._messages.put((key, payload, 0, stamp, recovery))

    def get(self, timeout: float | None = None) -> tuple[str, bytes] | None:
        """Return the next key and payload.

        While missed messages are fetched this may take half a second longer than `timeout`.

        Args:
            timeout: s; None waits without an end.

        Returns:
            None when the time is over, or when all is got after `close`.
        """
        deadline = None if timeout is None else time.monotonic() + timeout
        while True:
            if self._catching_up is not None:
                for due in self._catching_up:
                    if due is not None or self._closed or _remaining(deadline) == 0.0:
                        return due
                self._catching_up = None
                timeout = _remaining(deadline)
            try:
                message = self._messages.get(timeout=timeout)
            except Empty:
                return None
            if message is None:
                self._messages.put(None)
                return None
            self._room.put(None)
            key, payload, dropped, stamp, recovery = message
            if dropped:
                self.dropped += dropped
            if stamp is None or recovery is None:
                return key, payload or b""
            if payload is not None and recovery.is_due(stamp):
                return key, payload
            self._catching_up = _with_key(key, recovery.catch_up(key, stamp, payload))

    def close(self) -> None:
        """Take no more messages and release whoever waits, in `put` or in `get`."""
        self._closed = True
        self._room.put(None)
        self._messages.put(None)

    def _wait_for_room(self, abandoned: Callable[[], bool]) -> bool:
        """Wait until a message may be put; tell whether it may."""
        while not self._closed:
            try:
                self._room.get(timeout=LOOK_AGAIN_S)
            except Empty:
                if abandoned():
                    return False
            else:
                return True
        return False

    def _make_room(self) -> int:
        """Take the room of a new message, the oldest message's if need be; return the drops to report."""
        while not self._closed:
            with suppress(Empty):
                self._room.get_nowait()
                return 0
            with suppress(Empty):
                oldest = self._messages.get_nowait()
                if oldest is not None:
                    return oldest[2] + 1
                self._messages.put(None)
        return 0


def _remaining(deadline: float | None) -> float | None:
    return None if deadline is None else max(0.0, deadline - time.monotonic())


def _with_key(key: str, payloads: Iterator[bytes | None]) -> Iterator[tuple[str, bytes] | None]:
    for payload in payloads:
        yield None if payload is None else (key, payload)
