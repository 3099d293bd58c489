"""Plays a recording as if it were live: publishes the daq's bytes in the daq's place.

Every subscriber gets every message in the order of the file: a publisher that replays waits for slow
subscribers, which a live one never does. Time comes from the log times, or, at the rate `max`, from the
subscribers alone.
"""

import math
import time
from collections.abc import Iterator, Sequence
from threading import Event as Flag

from daq import keys
from daq.commanding.orders import CommandOrder, Orders
from daq.describe import REPLAY
from daq.events import SOURCE, EventCounter
from daq.link import Link, Publisher, Request
from daq.link.presence import Presence
from daq.messages import decode_series
from daq.messages_pb2 import Answer, Description, Event, Status
from daq.recording import Message, series_end
from daq.recording.recorded_run import RecordedRun
from daq.series_layout import SeriesDecoder
from daq.timing import NS
from replay.transport import Transport

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
    """Publishes recordings of one rig, one after another.

    Args:
        link: that listens where the daq would, made with `wait_for_room`.
        control: link that listens where the daq would hear commands.
        runs: the recordings, at least one.
        transport: rate and loop.
        recorded_twin: whether the recorded estimates, summaries and events of the twin are played too.
    """

    def __init__(
        self,
        link: Link,
        control: Link,
        runs: Sequence[RecordedRun],
        transport: Transport,
        *,
        recorded_twin: bool = False,
    ) -> None:
        self.warnings: dict[str, None] = {}
        """What is missing from the recordings, in plain words."""
        self._link, self._runs, self._transport = link, runs, transport
        self._run = runs[0]
        rig = self._run.description.rig
        self._block, self._event = keys.block(rig), keys.event(rig, "daq")
        self._recorded_twin = recorded_twin
        self._publishers: dict[str, Publisher] = {}
        self._blocks = SeriesDecoder()
        self._status = link.publish(keys.status(rig, PROCESS))
        self._presence = Presence(rig, link)
        self._orders = Orders()
        self._reached: dict[str, int] = {}
        self._sample = self._run.description.first_sample
        self._played = 0
        self._lag = 0.0
        self._status_due = 0.0
        self._last_event = -1
        self._end_seen = False
        link.subscribe(keys.status(rig, "*"), self._on_status)
        link.serve(keys.description(rig), self._describe)
        self._orders.take_commands(control, rig, transport.commands)
        for each in (link, control):
            for process in (PROCESS, "daq"):
                each.announce(keys.alive(rig, process))

    def wait_for(self, processes: Sequence[str], told_to_end: Flag) -> None:
        """Return when these processes have subscribed. Raises `PlayerError` when they do not come."""
        deadline = time.monotonic() + PATIENCE
        while (missing := self._presence.missing(tuple(processes))) and not told_to_end.is_set():
            self._serve(LOOK)
            self._tell("waiting")
            if time.monotonic() > deadline:
                raise PlayerError(
                    f"{' and '.join(missing)} did not come within {PATIENCE:.0f} s: nothing was played"
                )

    def play(self, told_to_end: Flag) -> int:
        """Publish until the end of the last recording, or until told to end; return the samples played."""
        number = 0
        while number < len(self._runs) and not told_to_end.is_set():
            self._turn_to(self._runs[number])
            if self._play_on(told_to_end, is_last=number + 1 == len(self._runs)):
                number += 1
                if self._transport.loop and not self._end_seen:
                    number %= len(self._runs)
                    told_to_end.wait(LOOK)
        if not self._end_seen:
            self._publish_end(told_to_end.is_set())
        return self._played

    def _turn_to(self, run: RecordedRun) -> None:
        """Go on with a recording, where the transport says or at its beginning."""
        self._run = run
        self._reached.clear()
        last = run.last(self._block).get(self._block)
        if last is not None:
            end = series_end(decode_series(last.payload))
            self._transport.duration = run.clock.elapsed_ns(end) / NS
        self._transport.go_on_from(self._transport.target or 0.0)

    def _play_on(self, told_to_end: Flag, *, is_last: bool) -> bool:
        """Publish from where the transport is; return whether the recording's end was reached."""
        t0_ns = self._run.description.t0_ns
        for message in self._messages(round(self._transport.position * self._run.description.rate)):
            position = (message.log_time - t0_ns) / NS
            if not self._wait(position, told_to_end):
                return False
            is_block = message.key == self._block
            if message.key != self._event or not self._is_premature_end(message.payload, is_last):
                self._publish(message.key, message.payload)
            self._transport.passed(position, is_block=is_block)
            self._tell(self._transport.state)
        return True

    def _wait(self, position: float, told_to_end: Flag) -> bool:
        """Wait until a message is due; return False when the replay is to go on elsewhere or to end."""
        while True:
            self._serve(0.0)
            if told_to_end.is_set() or self._transport.target is not None:
                return False
            wait = self._transport.wait(position, time.monotonic())
            if wait <= 0.0:
                self._lag = 0.0 if math.isinf(self._transport.rate) else -wait
                return True
            self._serve(min(wait, LOOK))
            self._tell(self._transport.state)

    def _serve(self, timeout: float) -> None:
        """Wait for a command at most so long, and obey it."""
        order = self._orders.get(timeout)
        if isinstance(order, CommandOrder):
            ended = Answer(text="the replay has ended")
            order.reply(ended if self._end_seen else self._transport.obey(order.command))

    def _is_premature_end(self, payload: bytes, is_last: bool) -> bool:
        """Whether an event tells subscribers of an end after which the replay goes on."""
        return (self._transport.loop or not is_last) and Event.FromString(payload).kind == "end"

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
            self._serve(LOOK)

    def _is_behind(self, process: str) -> bool:
        return process in self._presence and self._reached.get(process, 0) < self._sample

    def _messages(self, first: int) -> Iterator[Message]:
        """Yield what is to be played from a sample on; warn of what is not there."""
        for recording in self._run.files:
            wanted = [topic for topic in recording.topics() if self._is_wanted(topic)]
            if wanted:
                yield from recording.messages_between(*wanted, first=first)
            if recording.truncated:
                self.warnings[f"{recording.path}: {recording.truncated}; what is intact was played"] = None
        self.warnings |= dict.fromkeys(self._run.unreadable)

    def _is_wanted(self, topic: str) -> bool:
        if keys.topic(topic).message == "Status":
            return False
        return self._recorded_twin or keys.process_of(topic) != "twin"

    def _publish(self, key: str, payload: bytes) -> None:
        if key not in self._publishers:
            self._publishers[key] = self._link.publish(key, wait=True)
        self._publishers[key].put(payload)
        if key == self._block:
            first, count = self._blocks.extent(payload)
            self._sample = first + count
            self._played += count
        elif key == self._event:
            event = Event.FromString(payload)
            self._last_event = event.sequence
            self._end_seen = self._end_seen or event.kind == "end"

    def _publish_end(self, stopped: bool) -> None:
        """Tell subscribers of an end that the recording does not hold."""
        payload = EventCounter(SOURCE, self._last_event + 1).make(
            "end",
            "the replay was stopped" if stopped else "the recording breaks off here",
            self._sample,
            details={"samples": self._sample, "synthesised": "yes"},
            run=self._run.description.run,
            timestamp=self._run.clock.ns(self._sample) / 1e9,
        )
        self._publish(self._event, payload)

    def _describe(self, request: Request) -> None:
        """Answer with the description of the run that is named, or of the present one."""
        descriptions = {run.description.run.encode(): run.description for run in self._runs}
        description = Description()
        description.CopyFrom(descriptions.get(request.payload, self._run.description))
        description.mode = REPLAY
        request.reply(description.SerializeToString(deterministic=True))

    def _on_status(self, key: str, payload: bytes) -> None:
        status = Status.FromString(payload)
        if status.run == self._run.description.run:
            self._reached[keys.process_of(key)] = status.sample

    def _tell(self, state: str) -> None:
        """Publish the player's status, ten times a second at most."""
        now = time.monotonic()
        if now < self._status_due:
            return
        self._status_due = now + STATUS_PERIOD
        status = Status(
            timestamp=time.time(),
            run=self._run.description.run,
            sample=self._sample,
            process=PROCESS,
            monotonic_ns=time.monotonic_ns(),
            utc_ns=time.time_ns(),
            state=state,
            samples=self._played,
            lag=self._lag,
        )
        self._status.put(status.SerializeToString())
