"""Plays a recording as if it were live: publishes the daq's bytes in the daq's place.

Every subscriber gets every message in the order of the file: a publisher that replays waits for slow
subscribers, which a live one never does. Time comes from the log times, or, at the rate `max`, from the
subscribers alone.
"""

import math
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from threading import Event as Flag

from daq import keys
from daq.describe import REPLAY
from daq.link import Link, Publisher, Request
from daq.messages import decode_series
from daq.messages_pb2 import Description, Event, Status
from daq.presence import Presence
from daq.recording import Message, Recording, parts, series_end
from daq.rig import Rig
from daq.runtime import claim

PROCESS = "player"
STATUS_PERIOD = 0.1  # s
PATIENCE = 60.0  # s that the processes waited for may take to come
FAREWELL = 60.0  # s after the end that subscribers may take to read what is still under way
LAST_CALL = 10.0  # s that they may take when the player is told to end
LINGER = 1.0  # s in which the link hands over what a slow subscriber has not taken yet
LOOK = 0.02  # s between two looks at who is still there


class PlayerError(RuntimeError):
    """The recording cannot be played; the message says why and what to do."""


class Player:
    """Publishes one recording, with its continuations.

    Args:
        link: that listens where the daq would, made with `wait_for_room`.
        path: the recording.
        rate: times real time; infinite for as fast as the subscribers take it.
        recorded_twin: whether the recorded estimates, summaries and events of the twin are played too.
    """

    def __init__(self, link: Link, path: Path, rate: float = 1.0, *, recorded_twin: bool = False) -> None:
        self.warnings: list[str] = []
        """What is missing from the recording, in plain words."""
        self._files = [Recording(part) for part in parts(path)]
        self._description = self._files[0].description
        self._link, self._rate = link, rate
        rig = self._description.rig
        self._block, self._event = keys.block(rig), keys.event(rig, "daq")
        self._recorded_twin = recorded_twin
        self._publishers: dict[str, Publisher] = {}
        self._status = link.publish(keys.status(rig, PROCESS))
        self._presence = Presence(rig, link)
        self._reached: dict[str, int] = {}
        self._sample = self._description.first_sample
        self._lag = 0.0
        self._status_due = 0.0
        self._last_event = -1
        self._end_seen = False
        link.subscribe(keys.status(rig, "*"), self._on_status)
        link.serve(keys.description(rig), self._describe)
        for process in (PROCESS, "daq"):
            link.announce(keys.alive(rig, process))

    def wait_for(self, processes: Sequence[str], told_to_end: Flag) -> None:
        """Return when these processes have subscribed. Raises `PlayerError` when they do not come."""
        deadline = time.monotonic() + PATIENCE
        while (missing := self._presence.missing(tuple(processes))) and not told_to_end.wait(LOOK):
            self._tell("waiting")
            if time.monotonic() > deadline:
                raise PlayerError(
                    f"{' and '.join(missing)} did not come within {PATIENCE:.0f} s: nothing was played"
                )

    def play(self, told_to_end: Flag) -> int:
        """Publish until the end of the recording, or until told to end; return the samples played."""
        clock = self._files[0].clock
        begun, first = time.monotonic(), clock.ns(self._description.first_sample)
        for message in self._messages():
            due = begun + (message.log_time - first) / 1e9 / self._rate
            if told_to_end.wait(due - time.monotonic()) if due > time.monotonic() else told_to_end.is_set():
                break
            self._lag = 0.0 if math.isinf(self._rate) else max(0.0, time.monotonic() - due)
            self._publish(message.key, message.payload)
            self._tell("playing")
        if not self._end_seen:
            self._publish_end(told_to_end.is_set())
        return self._sample - self._description.first_sample

    def see_off(self, processes: Sequence[str], told_to_end: Flag) -> None:
        """Stay until everything that was published has been read.

        That is when nobody subscribes to the blocks any more, or when all of `processes` have left or say
        that they have reached the end; bounded in time.
        """
        began = time.monotonic()
        while (elapsed := time.monotonic() - began) < (LAST_CALL if told_to_end.is_set() else FAREWELL):
            blocks = self._publishers.get(self._block)
            if blocks is None or not blocks.has_subscribers:
                return
            known = bool(processes) or told_to_end.is_set()
            if known and elapsed > LINGER and not any(map(self._is_behind, processes)):
                return
            self._tell("ended")
            time.sleep(LOOK)

    def _is_behind(self, process: str) -> bool:
        return process in self._presence and self._reached.get(process, 0) < self._sample

    def close(self) -> None:
        """Close the recording."""
        for recording in self._files:
            recording.close()

    def _messages(self) -> Iterator[Message]:
        """Yield what is to be played; warn of what is not there."""
        for recording in self._files:
            wanted = [topic for topic in recording.topics() if self._is_wanted(topic)]
            yield from recording.messages(*wanted)
            if recording.truncated:
                self.warnings.append(f"{recording.path}: {recording.truncated}; what is intact was played")

    def _is_wanted(self, topic: str) -> bool:
        if keys.topic(topic).message == "Status":
            return False
        return self._recorded_twin or keys.process_of(topic) != "twin"

    def _publish(self, key: str, payload: bytes) -> None:
        if key not in self._publishers:
            self._publishers[key] = self._link.publish(key, wait=True)
        self._publishers[key].put(payload)
        if key == self._block:
            self._sample = series_end(decode_series(payload))
        elif key == self._event:
            event = Event.FromString(payload)
            self._last_event = event.sequence
            self._end_seen = self._end_seen or event.kind == "end"

    def _publish_end(self, stopped: bool) -> None:
        """Tell subscribers of an end that the recording does not hold."""
        event = Event(
            timestamp=self._files[0].clock.ns(self._sample) / 1e9,
            run=self._description.run,
            sample=self._sample,
            sequence=self._last_event + 1,
            source="daq",
            kind="end",
            text="the replay was stopped" if stopped else "the recording breaks off here",
            details={"samples": str(self._sample), "synthesised": "yes"},
        )
        self._publish(self._event, event.SerializeToString(deterministic=True))

    def _describe(self, request: Request) -> None:
        description = Description()
        description.CopyFrom(self._description)
        description.mode = REPLAY
        request.reply(description.SerializeToString(deterministic=True))

    def _on_status(self, key: str, payload: bytes) -> None:
        status = Status.FromString(payload)
        if status.run == self._description.run:
            self._reached[keys.process_of(key)] = status.sample

    def _tell(self, state: str) -> None:
        """Publish the player's status, ten times a second at most."""
        now = time.monotonic()
        if now < self._status_due:
            return
        self._status_due = now + STATUS_PERIOD
        status = Status(
            timestamp=time.time(),
            run=self._description.run,
            sample=self._sample,
            process=PROCESS,
            monotonic_ns=time.monotonic_ns(),
            utc_ns=time.time_ns(),
            state=state,
            samples=self._sample - self._description.first_sample,
            lag=self._lag,
        )
        self._status.put(status.SerializeToString())


def play(
    rig: Rig,
    path: Path,
    rate: float = 1.0,
    *,
    recorded_twin: bool = False,
    wait_for: Sequence[str] = (),
    told_to_end: Flag | None = None,
) -> int:
    """Play a recording on a rig's endpoints and return the samples played.

    Args:
        rig: whose ports are all given.
        path: the recording, or part 1 of one in several parts.
        rate: times real time; infinite for as fast as the subscribers take it.
        recorded_twin: whether what the twin said is played too.
        wait_for: processes that must be there before the first message.
        told_to_end: ends the replay when it is set.

    Raises:
        AlreadyRunning: this rig is live.
        RecordingError: the file cannot be read.
        PlayerError: a process that was waited for did not come.
        LinkError: a port is in use.
    """
    told_to_end = told_to_end or Flag()
    record = {"mode": REPLAY, **rig.link._asdict(), "toml": rig.toml}
    with claim(rig.name, record), Link(listen=[rig.link.endpoint("daq")], wait_for_room=True) as link:
        player = Player(link, path, rate, recorded_twin=recorded_twin)
        try:
            player.wait_for(wait_for, told_to_end)
            samples = player.play(told_to_end)
            player.see_off(wait_for, told_to_end)
        finally:
            player.close()
    for warning in player.warnings:
        print(f"replay: warning: {warning}", flush=True)
    return samples
