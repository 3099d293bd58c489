"""The twin's process: takes the daq's blocks from the link, publishes estimates, says how far behind it is.

Live it never falls behind for long: when the newest block that has arrived is `SHED_LAG` ahead, the blocks
between are shed whole, a gap event names them, and the observer starts anew from the newest. A twin that
joins late, or after it was stopped for long, does the same with what the daq's cache hands it. In a
replay the player waits for its subscribers, and nothing is shed.

It ends when the daq's end event and all blocks before it are processed, and stays until the recorder has
fetched what it missed; or when its standard input ends and the daq is gone.
"""

import argparse
import sys
import time
from collections.abc import Sequence
from contextlib import suppress
from threading import Event as Flag

import numpy as np

from daq import keys
from daq.describe import REPLAY
from daq.link import Inbox, Link, LinkError, Publisher
from daq.link.presence import Presence
from daq.messages import MessageError, SeriesEncoder, read_header
from daq.messages_pb2 import Description, Event, Status
from daq.parent import follow_parent
from daq.ports import as_it_runs
from daq.rig import Rig, RigError, load_rig, rig_from_text
from twin.estimation import SOURCE, Twin

__all__ = ["Service", "Twin", "main"]

PROCESS = SOURCE
CAPACITY = 4096  # messages that may wait: more than the daq's cache hands over at once
STATUS_PERIOD = 0.1  # s
LOOK = 0.02  # s between two looks at the clock while nothing comes
SHED_LAG = 1.0  # s behind the newest block from which on blocks are shed
DESCRIBED = 20.0  # s that the daq has to describe the run after its first block
DRAIN = 4.0  # s after the end event that missing blocks may take to come
FAREWELL = 0.3  # s that the last messages have to leave
RECORDER_SILENCE = 0.5  # s without a status after which the recorder is done
LINGER = 15.0  # s that the recorder may take to fetch what it missed
GONE = 2.0  # s without daq and messages after which the run is over, once nobody waits for the twin
ORPHANED = 10.0  # s without messages from a daq that is there, likewise
SHED = "shed: the twin had fallen behind"


class ServiceError(RuntimeError):
    """The twin cannot go on; the message says why and what to do."""


class Outlet:
    """Publishes by key, with the cache that the service table gives to each."""

    def __init__(self, link: Link, names: Sequence[str]) -> None:
        self._publishers: dict[str, Publisher] = {
            key: link.publish(key, cache=keys.topic(key).cache) for key in names
        }

    def __call__(self, key: str, payload: bytes) -> None:
        """Publish one message."""
        self._publishers[key].put(payload)


class Service:
    """Follows a rig's runs: one `Twin` for each.

    Args:
        rig: with the ports of its processes.
        data: link connected to the daq, or to the player in its place.
        own: link that listens where the twin publishes.
    """

    def __init__(self, rig: Rig, data: Link, own: Link) -> None:
        self._rig, self._data = rig, data
        self._block, self._event = keys.block(rig.name), keys.event(rig.name, "daq")
        self._inbox = Inbox(CAPACITY, "wait")
        self._status_key = keys.status(rig.name, PROCESS)
        self._outlet = Outlet(
            own,
            (
                keys.estimate(rig.name),
                keys.twin_summary(rig.name),
                keys.event(rig.name, PROCESS),
                self._status_key,
            ),
        )
        self._twin: Twin | None = None
        self._description = Description()
        self._newest = -1  # first sample of the newest block that has arrived
        self._shed = False  # whether blocks have been shed since the last one that was processed
        self._unreadable = 0
        self._end: tuple[str, int] | None = None  # run that has ended, and the index behind its last sample
        self._ended_at = 0.0
        self._heard = self._recorder_heard = time.monotonic()
        self._has_recorder = False
        self._status_due = 0.0
        self._wall, self._cpu = time.monotonic(), time.process_time()
        self._presence = Presence(rig.name, data)
        own.subscribe(keys.status(rig.name, "recorder"), self._hear_recorder)
        data.subscribe(self._block, self._note_newest)
        data.subscribe(self._block, self._inbox, recover=True)
        data.subscribe(self._event, self._inbox, recover=True)
        self._tokens = [link.announce(keys.alive(rig.name, PROCESS)) for link in (data, own)]

    def run(self, told_to_end: Flag) -> None:
        """Estimate until the run is over.

        Args:
            told_to_end: set when nobody waits for the twin any longer.

        Raises:
            ServiceError: the daq does not describe its run.
            RigError: the run's rig has no model.
        """
        try:
            while not self._is_over(told_to_end.is_set()):
                item = self._inbox.get(LOOK)
                if item is not None:
                    self._take(*item)
                if time.monotonic() >= self._status_due:
                    self._publish_status()
        finally:
            self._inbox.close()

    def _note_newest(self, _key: str, payload: bytes) -> None:
        """Note how far the daq is; called on the link's thread."""
        with suppress(MessageError):
            self._newest = read_header(payload).sample

    def _hear_recorder(self, _key: str, _payload: bytes) -> None:
        self._recorder_heard, self._has_recorder = time.monotonic(), True

    def _take(self, key: str, payload: bytes) -> None:
        """Process one message; one that is not readable is left out and said once."""
        self._heard = time.monotonic()
        try:
            if key == self._event:
                self._take_event(Event.FromString(payload))
            else:
                self._take_block(payload)
        except RigError:
            raise
        except ValueError as error:
            self._unreadable += 1
            if self._unreadable == 1:
                print(f"twin: a message of {key} is left out: {error}", flush=True)

    def _take_event(self, event: Event) -> None:
        """Note the run's end; it may come before the last blocks, even before the first."""
        if event.kind == "end":
            self._end, self._ended_at = (event.run, event.sample), time.monotonic()

    def _take_block(self, payload: bytes) -> None:
        """Estimate over a block, unless it is to be shed."""
        header = read_header(payload)
        twin = self._twin
        if twin is None or header.run != twin.run or self._goes_back(twin, header.sample):
            twin = self._begin(header.run)
        if self._is_behind(header.sample):
            self._shed = True
            return
        for message in twin.process(payload, SHED if self._shed else "not received"):
            self._outlet(*message)
        self._shed = False

    def _goes_back(self, twin: Twin, sample: int) -> bool:
        """Tell whether a replay goes on from an earlier sample, as after a seek or in a loop."""
        return self._description.mode == REPLAY and sample < twin.reached

    def _is_behind(self, sample: int) -> bool:
        """Tell whether a block that begins at `sample` is too old to be worth the time."""
        ahead = self._newest - sample
        return self._description.mode != REPLAY and ahead > SHED_LAG * self._rig.acquisition.rate

    def _begin(self, run: str) -> Twin:
        """Begin a run: with the rig that the daq says it is made with."""
        self._description = self._ask_description(run)
        rig = rig_from_text(self._description.toml, f"description of run {run}")
        self._twin = Twin(rig, run, self._description.t0_ns)
        if self._end and self._end[0] != run:
            self._end = None
        return self._twin

    def _ask_description(self, run: str) -> Description:
        deadline = time.monotonic() + DESCRIBED
        while True:
            try:
                return Description.FromString(self._data.ask(keys.description(self._rig.name), run.encode()))
            except LinkError as error:
                if time.monotonic() > deadline:
                    raise ServiceError(
                        f"the daq does not describe its run ({error}): start the twin again when it answers"
                    ) from error
                time.sleep(LOOK)

    def _is_over(self, told_to_end: bool) -> bool:
        """Tell whether the run has ended and all is done, or nothing is to be expected any more."""
        now = time.monotonic()
        if self._end is not None:
            if not self._is_done(now):
                return False
            for message in self._twin.finish() if self._twin else ():
                self._outlet(*message)
            return self._is_fetched(now)
        quiet = now - self._heard
        return told_to_end and quiet > (ORPHANED if "daq" in self._presence else GONE)

    def _is_done(self, now: float) -> bool:
        """Tell whether every block before the end is processed, or will not come any more."""
        reached = self._twin.reached if self._twin else 0
        end = self._end[1] if self._end else 0
        return reached >= end or now - self._ended_at > DRAIN

    def _is_fetched(self, now: float) -> bool:
        """Tell whether the recorder has had its time to fetch what it missed."""
        since = now - max(self._ended_at, self._heard)
        silent = now - self._recorder_heard > RECORDER_SILENCE
        if self._has_recorder and "daq" in self._presence:
            silent = False  # the daq waits for it: it may have been stopped for long, and come back
        return since > LINGER or (since > FAREWELL and silent)

    def _publish_status(self) -> None:
        now, cpu = time.monotonic(), time.process_time()
        reached = self._twin.reached if self._twin else 0
        behind = max(0.0, (self._newest - reached) / self._rig.acquisition.rate)
        status = Status(
            timestamp=time.time(),
            run=self._twin.run if self._twin else "",
            sample=reached,
            process=PROCESS,
            monotonic_ns=time.monotonic_ns(),
            utc_ns=time.time_ns(),
            state=self._state(),
            samples=self._twin.samples if self._twin else 0,
            lost=self._twin.lost if self._twin else 0,
            lag=behind if self._description.mode == REPLAY else max(behind, self._real_time_lag(reached)),
            queue_fill=self._inbox.fill,
            cpu=(cpu - self._cpu) / max(now - self._wall, 1e-9),
        )
        self._outlet(self._status_key, status.SerializeToString())
        self._wall, self._cpu, self._status_due = now, cpu, now + STATUS_PERIOD

    def _state(self) -> str:
        """Return what the twin is doing, in a word or two."""
        if self._twin is None:
            return "waiting"
        if self._end is not None:
            return "ended"
        return "shedding" if self._shed else "running"

    def _real_time_lag(self, reached: int) -> float:
        """Return how long ago the last estimated sample was taken, s; 0 when no run goes on."""
        if self._twin is None or self._end is not None:
            return 0.0
        return max(0.0, time.time() - self._description.t0_ns * 1e-9 - reached / self._rig.acquisition.rate)


def warm_up(rig: Rig) -> None:
    """Run everything once on a block of zeros, so that all kernels are compiled. Raises `RigError`."""
    encoder = SeriesEncoder("warm-up", rig.acquisition.rate, rig.channels.names, rig.channels.units)
    zeros = np.zeros((len(rig.channels), rig.acquisition.block), dtype=np.float32)
    twin = Twin(rig, "warm-up", 0)
    blocks = -(-int(0.1 * rig.acquisition.rate) // rig.acquisition.block)
    for index in range(blocks):
        twin.process(encoder.encode(0.0, index * rig.acquisition.block, 0, zeros))


def observe(rig: Rig, told_to_end: Flag) -> None:
    """Follow a rig until its run is over.

    Raises:
        RigError: the rig has no model to run alongside.
        NotRunning: the rig leaves its ports open, and it does not run.
        LinkError: the twin's port is in use.
        ServiceError: the daq does not describe its run.
    """
    if rig.twin.model == "none":
        raise RigError(f'{rig.name} has [twin] model = "none": there is nothing to run; leave the twin out')
    rig = as_it_runs(rig)
    warm_up(rig)
    with (
        Link(connect=[rig.link.endpoint("daq")]) as data,
        Link(listen=[rig.link.endpoint("twin")]) as own,
    ):
        service = Service(rig, data, own)
        print("ready", flush=True)
        service.run(told_to_end)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the twin's process; return its exit code."""
    parser = argparse.ArgumentParser(prog="python -m twin observe", description=__doc__)
    parser.add_argument("--rig", required=True, metavar="NAME|PATH", help="rig description, with its ports")
    options = parser.parse_args(arguments)
    told_to_end = Flag()
    follow_parent(told_to_end.set)
    try:
        observe(load_rig(options.rig), told_to_end)
    except (ValueError, RuntimeError) as error:
        print(f"twin: {error}", file=sys.stderr, flush=True)
        return 2
    return 0
