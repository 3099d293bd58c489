"""A subscriber of the test's own, which keeps the digest of every message that a daq published."""

from collections import defaultdict
from collections.abc import Iterable
from hashlib import sha256
from threading import Thread

from daq import keys
from daq.link import Inbox, Link
from daq.messages import read_header
from daq.messages_pb2 import Event
from daq.rig import Rig

CAPACITY = 8192  # messages that may wait

Digests = dict[str, dict[int, list[bytes]]]
"""For each key and sample index the SHA-256 of each message, in order."""


class Witness:
    """Hears all that a daq, or a player in its place, publishes for the recording; a context manager.

    What it cannot take at once, or begins too late to hear, it fetches from the publisher's cache.

    Args:
        rig: with the ports of its processes, which need not be there yet.
        name: of the process that it stands in for, so that somebody waits for it; empty for none.
    """

    def __init__(self, rig: Rig, name: str = "") -> None:
        self.digests: Digests = {}
        self.newest = 0
        """Sample at which the newest block begins."""
        self._rig = rig
        self._end = -1
        self._over = False
        self._link = Link(connect=[rig.link.endpoint("daq")])
        self._inbox = Inbox(CAPACITY, "wait")
        for key in topics_of_daq(rig.name):
            self._link.subscribe(key, self._inbox, recover=True)
        if name:
            self._link.announce(keys.alive(rig.name, name))
        self._thread = Thread(target=self._listen)
        self._thread.start()

    def __enter__(self) -> "Witness":
        return self

    def __exit__(self, *_: object) -> None:
        self._over = True
        self._thread.join()
        self._inbox.close()
        self._link.close()

    def has_all(self) -> bool:
        """Tell whether the end was heard, and each block and truth up to it."""
        blocks = -(-self._end // self._rig.acquisition.block)  # of which the last may be short
        series = keys.block(self._rig.name), keys.truth(self._rig.name)
        return self._end >= 0 and all(len(self.digests.get(key, ())) == blocks for key in series)

    def _listen(self) -> None:
        while not self._over:
            item = self._inbox.get(0.1)
            if item is not None:
                self._take(*item)

    def _take(self, key: str, payload: bytes) -> None:
        note(self.digests, key, payload)
        if key == keys.block(self._rig.name):
            self.newest = read_header(payload).sample
        elif key == keys.event(self._rig.name, "daq"):
            event = Event.FromString(payload)
            self._end = event.sample if event.kind == "end" else self._end


def topics_of_daq(rig: str) -> tuple[str, ...]:
    """Keys of what the daq's process alone publishes without loss."""
    return (keys.block(rig), keys.truth(rig), keys.summary(rig), keys.event(rig, "daq"))


def digests_of(messages: Iterable[tuple[str, bytes]]) -> Digests:
    """Return the digests of messages that are given as (key, payload)."""
    found: Digests = {}
    for key, payload in messages:
        note(found, key, payload)
    return found


def note(digests: Digests, key: str, payload: bytes) -> None:
    """Add a message's digest."""
    samples = digests.setdefault(key, defaultdict(list))
    samples[read_header(payload).sample].append(sha256(payload).digest())
