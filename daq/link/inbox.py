"""Bounded queue between the link's threads, which must never wait long, and one consumer thread."""

import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from queue import Empty, SimpleQueue
from typing import Literal

from daq.link.recovery import Recovery, Stamp

LOOK_AGAIN_S = 0.1
"""Period at which a `put` that waits for room looks whether it still has to."""


_Message = tuple[str, bytes | None, int, Stamp | None, Recovery | None]
"""Key, payload, drops to report, and what recovers the subscription's missing messages."""


def _never() -> bool:
    return False


class Inbox:
    """Messages from the link's callbacks, for one consumer thread.

    Any thread may put; one thread gets. Putting and getting cost about a microsecond and wake the other
    side at once. The link puts messages of publishers that wait and offers all others, so that a full inbox
    never holds up a link that carries other things, such as the fetching of missed messages.

    Args:
        capacity: messages held at most.
        when_full: `wait` makes `put` wait for room, which holds the publisher back through the network, and
            leaves out what is offered; `drop_oldest` makes room by dropping the oldest message.
    """

    def __init__(self, capacity: int, when_full: Literal["wait", "drop_oldest"]) -> None:
        if capacity < 1:
            raise ValueError(f"an inbox of {capacity} messages can hold nothing: use 1 or more")
        self.capacity = capacity
        self._waits = when_full == "wait"
        self._closed = False
        self._messages: SimpleQueue[_Message | None] = SimpleQueue()
        self._room: SimpleQueue[None] = SimpleQueue()
        for _ in range(capacity):
            self._room.put(None)
        self._catching_up: Iterator[tuple[str, bytes] | None] | None = None
        self._dropped = 0
        self._left_out: SimpleQueue[None] = SimpleQueue()

    @property
    def dropped(self) -> int:
        """Messages dropped so far; a drop to make room counts when the next message is got."""
        return self._dropped + self._left_out.qsize()

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

    def offer(
        self, key: str, payload: bytes | None, stamp: Stamp | None = None, recovery: Recovery | None = None
    ) -> None:
        """Add a message without waiting for room.

        Args:
            key: its key.
            payload: its bytes; None to tell the newest number of a publisher.
            stamp: publisher and number, of a message that can be fetched again.
            recovery: what fetches it; then it is left out when there is no room, and `get` fetches it when
                its turn comes. Any other message that finds no room counts as dropped.
        """
        if recovery is None and not self._waits:
            self.put(key, payload or b"")
            return
        try:
            self._room.get_nowait()
        except Empty:
            if recovery is None:
                self.count_drop()
            return
        if not self._closed:
            self._messages.put((key, payload, 0, stamp, recovery))

    def count_drop(self) -> None:
        """Count a message that was dropped before it could be put."""
        self._left_out.put(None)

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
            if dropped or not self._left_out.empty():
                self._collect_drops(dropped)
            if stamp is None or recovery is None:
                return key, payload or b""
            if payload is not None and recovery.is_due(payload, stamp):
                return key, payload
            self._catching_up = _with_key(key, recovery.catch_up(key, stamp, payload))

    def close(self) -> None:
        """Take no more messages and release whoever waits, in `put` or in `get`."""
        self._closed = True
        self._room.put(None)
        self._messages.put(None)

    def _collect_drops(self, dropped: int) -> None:
        """Count what was dropped to make room and what was left out."""
        for _ in range(self._left_out.qsize()):
            self._left_out.get()
            dropped += 1
        self._dropped += dropped

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
                    _, _, dropped_before, _, recovery = oldest
                    return dropped_before + (recovery is None)
                self._messages.put(None)
        return 0


def _remaining(deadline: float | None) -> float | None:
    return None if deadline is None else max(0.0, deadline - time.monotonic())


def _with_key(key: str, payloads: Iterator[bytes | None]) -> Iterator[tuple[str, bytes] | None]:
    for payload in payloads:
        yield None if payload is None else (key, payload)
