"""Samples that come while recording is off, held for as long as a trip may make them wanted."""

import tomllib
from collections import deque
from collections.abc import Iterable

from daq import keys
from daq.events import LEFT_OUT
from daq.messages import BlockStatus, read_header, read_status
from daq.messages_pb2 import Event
from daq.rig.settings import CaptureSettings

CALLS = ("trip", "lease_lost", "failure")
"""Kinds of the daq's events that call for what came before them; each also switches recording on."""
OFF = int(BlockStatus.RECORDING_OFF)


class Withheld:
    """Passes on what is to be recorded, in whatever order series and events come.

    Series with the flag `RECORDING_OFF` are held back for the seconds that a region begins before its
    event, and passed on with a trip; after that time they are dropped.

    Args:
        toml: the rig's description, whose `[capture] before` says how many seconds.
        rate: of the sample index, Hz.
    """

    def __init__(self, toml: str, rate: float) -> None:
        usual = CaptureSettings().before
        self._length = round(float(tomllib.loads(toml).get("capture", {}).get("before", usual)) * rate)
        self._held: deque[tuple[int, str, bytes]] = deque()
        self._calls: list[int] = []  # samples of the events that call for what came before them

    def release(self, key: str, payload: bytes) -> list[tuple[str, bytes]]:
        """Take a message; return the messages (key, payload) that are to be recorded now, in order.

        Raises:
            MessageError: the payload is not what its key promises.
        """
        kind = keys.topic(key).message
        if kind in ("Block", "Truth") and read_status(payload) & OFF:
            sample = read_header(payload).sample
            if any(self._wants(call, sample) for call in self._calls):
                return [(key, payload)]
            self._hold(sample, key, payload)
            return []
        if kind == "Event" and calls(event := Event.FromString(payload)):
            self._calls.append(event.sample)
            wanted = [(name, held) for sample, name, held in self._held if self._wants(event.sample, sample)]
            self._held.clear()
            return [*wanted, (key, payload)]
        return [(key, payload)]

    def _wants(self, call: int, sample: int) -> bool:
        """Tell whether a series that begins at a sample is what an event calls for."""
        return call - self._length <= sample <= call

    def all_held(self) -> list[tuple[str, bytes]]:
        """Return what is held, in order, and hold it no longer."""
        held = [(key, payload) for _sample, key, payload in self._held]
        self._held.clear()
        return held

    def _hold(self, sample: int, key: str, payload: bytes) -> None:
        self._held.append((sample, key, payload))
        while self._held[0][0] < sample - self._length:
            self._held.popleft()


def calls(event: Event) -> bool:
    """Tell whether an event makes what came before it wanted."""
    return event.source == "daq" and event.kind in CALLS


def left_out(events: Iterable[Event]) -> list[tuple[int, int]]:
    """Return (first, last) sample of each stretch that was not to be recorded, as the daq's events tell.

    Of these, what came before a call is recorded nevertheless.
    """
    told = [event.details for event in events if event.source == "daq" and event.kind == LEFT_OUT]
    return sorted((int(details["first"]), int(details["last"])) for details in told)
