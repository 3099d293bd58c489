"""The recorder process: writes what daq, twin and operator publish into a recording, and nothing else.

It hears everything losslessly: what it cannot take at once, or misses while it is stopped, it fetches from
the publishers' caches. It ends when the daq's end event and everything before it are in the file, or when
the daq is gone. A recorder that takes over from a killed one writes the next part, from the first sample
that the earlier parts lack.
"""

import argparse
import sys
import time
from collections.abc import Iterable, Sequence
from pathlib import Path
from threading import Event as Flag

from google.protobuf.message import DecodeError

from daq import keys
from daq.link import Inbox, Link, LinkError
from daq.link.presence import Presence
from daq.messages import MessageError, decode_series, read_header
from daq.messages_pb2 import Description, Status
from daq.parent import follow_parent
from daq.ports import as_it_runs
from daq.recording import Recording, RecordingError, RecordingWriter, part_path, parts, prepare, series_end
from daq.recording.certificate import SERIES, Certificate
from daq.recording.rotation import Rotation, rotation
from daq.recording.withheld import Withheld
from daq.rig import Rig, load_rig

PROCESS = "recorder"
CAPACITY = 8192  # messages that may wait: about 15 s of a run
SHORT = 120.0  # s for which the disk must have room, or the recorder warns
ALARM = 0.5  # share of the capacity from which on the recorder says that it falls behind
STATUS_PERIOD = 0.1  # s
LOOK = 0.02  # s between two looks at the clock while nothing comes
DESCRIBED = 20.0  # s that the daq has to describe the run after its first message
DAQ_DRAIN = 4.0  # s after the end that missing samples may take to come; the daq stays a little longer
TWIN_DRAIN = 15.0  # s after the end that the last estimates may take to come
QUIET = 0.3  # s without news after which nothing more is expected
GONE = 2.0  # s without a daq after which the run is over
ORPHANED = 10.0  # s without any message after which a recorder that was told to end does not wait


class RecorderError(RuntimeError):
    """The recorder cannot begin; the message says why and what to do."""


class Recorder:
    """Records one run, or what is left of it.

    Args:
        rig: with the ports of its processes.
        link: connected to them.
        path: the recording; part 2 and later go to files beside it.
        part: 1, or which continuation this is.
        after: last sample that the earlier parts hold; -1 for none.
        rotation: how large a part may become.
    """

    def __init__(
        self,
        rig: Rig,
        link: Link,
        path: Path,
        part: int = 1,
        after: int = -1,
        rotation: Rotation | None = None,
    ) -> None:
        self.path = prepare(part_path(path, part))
        self.writer: RecordingWriter | None = None
        self.closed: list[Certificate] = []
        """Accounts of the parts that were closed."""
        self._withheld: Withheld | None = None  # what comes while recording is off
        self._rotation = rotation or Rotation()
        self._stays = ""  # why it goes on in a part that is full
        self._rig, self._link = rig, link
        self._whole = path
        self._part, self._after = part, after
        self._inbox = Inbox(CAPACITY, "wait")
        self._presence = Presence(rig.name, link)
        self._status = link.publish(keys.status(rig.name, PROCESS))
        self._quiet_topics = {
            keys.status(rig.name, process) for process in ("daq", "twin", "operator", PROCESS)
        }
        self._unreadable = 0
        self._saw_daq = False
        self._heard = time.monotonic()
        self._daq_gone = self._ended = 0.0  # when that was first seen
        self._status_due = 0.0
        self._wall, self._cpu = time.monotonic(), time.process_time()
        for topic in keys.TOPICS:
            if topic.recorded:
                key = topic.pattern.replace("rig/*/", f"rig/{rig.name}/", 1)
                link.subscribe(key, self._inbox, recover=topic.delivery is keys.Delivery.LOSSLESS)
        self._token = link.announce(keys.alive(rig.name, PROCESS))

    def run(self, told_to_end: Flag) -> None:
        """Record until the run is over.

        Args:
            told_to_end: set when nobody waits for the recorder any longer.

        Raises:
            RecordingError: the disk refuses; what is there is readable.
            RecorderError: the daq does not describe the run.
        """
        try:
            while not self._is_over(told_to_end):
                self._step()
        except RecordingError as error:
            self._tell(str(error))
            raise
        finally:
            self._inbox.close()
            if self.writer is not None:
                self._close(self.writer)

    def _step(self) -> None:
        item = self._inbox.get(LOOK)
        if item is not None:
            self._take(*item)
        elif self.writer is not None:
            self.writer.tick()
        if time.monotonic() >= self._status_due:
            self._tell(self._alarm())

    def _take(self, key: str, payload: bytes) -> None:
        is_status = key in self._quiet_topics
        if not is_status:
            self._heard = time.monotonic()
        if self.writer is None and not is_status:
            self.writer = self._begin()
        if self.writer is not None and self._withheld is not None:
            try:
                for message in self._withheld.release(key, payload):
                    self.writer.add(*message)
            except (MessageError, DecodeError, KeyError) as error:
                self._unreadable += 1
                if self._unreadable == 1:
                    print(
                        f"recorder: a message of {key} is not readable and is left out: {error}", flush=True
                    )

        self._rotate_if_due(self.writer)

    def _close(self, writer: RecordingWriter) -> None:
        """Close the last part; where the run's end was not seen, with what was held back to the last."""
        clean = writer.ledger.end_sample is not None
        try:
            for message in self._withheld.all_held() if self._withheld and not clean else ():
                writer.add(*message)
        finally:
            self.closed.append(writer.close(clean=clean))

    def _rotate_if_due(self, writer: RecordingWriter | None) -> None:
        """Close the part that is full and go on in the next one, from the sample behind its last.

        Where the next one cannot be made, all the rest goes into this one.
        """
        if writer is None or writer.ledger.end_sample is not None or writer.failure is not None:
            return
        if not self._rotation.is_due(self._seconds(writer), writer.size):
            return
        end = writer.ledger.end_of("Block")
        if end <= writer.description.first_sample:  # nothing but what is withheld has come
            return
        following = Description()
        following.CopyFrom(writer.description)
        following.first_sample = end
        path = part_path(self._whole, self._part + 1)
        try:
            self.writer = RecordingWriter(path, following, part=self._part + 1)
        except RecordingError as error:
            self._rotation, self._stays = Rotation(), f"no next part: {error}; going on in {writer.path.name}"
            return
        self._part += 1
        self.writer.ledger.leave_out(*writer.ledger.held())
        self.closed.append(writer.close(expected=end, clean=False, continued=True))

    def _alarm(self) -> str:
        """Return what threatens the recording, in plain words; empty when nothing does."""
        if self._inbox.fill > ALARM:
            return "falling behind"
        writer = self.writer
        seconds = self._seconds(writer) if writer else 0.0
        left = writer.space * seconds / writer.size if writer else 0.0
        if writer is None or seconds < 1.0 or left > SHORT:
            return self._stays
        return f"the disk is nearly full: {writer.space / 1e6:.0f} MB are left, for about {left:.0f} s"

    def _seconds(self, writer: RecordingWriter) -> float:
        """Return how much of the run a part holds, s."""
        description = writer.description
        return (writer.ledger.end_of("Block") - description.first_sample) / description.rate

    def _begin(self) -> RecordingWriter:
        """Open the file once the run has begun and the daq can tell when."""
        description = self._description()
        description.first_sample = self._after + 1
        writer = RecordingWriter(self.path, description, part=self._part)
        self._withheld = Withheld(description.toml, description.rate)
        if self._part > 1:
            writer.ledger.leave_out(*held(part_path(self._whole, part) for part in range(1, self._part)))
        return writer

    def _description(self) -> Description:
        deadline = time.monotonic() + DESCRIBED
        while True:
            try:
                return Description.FromString(self._link.ask(keys.description(self._rig.name), b""))
            except LinkError as error:
                if time.monotonic() > deadline:
                    raise RecorderError(
                        f"the daq does not describe the run ({error}): nothing is recorded"
                    ) from error
                time.sleep(LOOK)

    def _is_over(self, told_to_end: Flag) -> bool:
        now = time.monotonic()
        if self.writer is not None and self.writer.ledger.end_sample is not None:
            self._ended = self._ended or now
            return self._is_drained(now - self._ended, now - self._heard > QUIET)
        if "daq" in self._presence:
            self._saw_daq, self._daq_gone = True, 0.0
        elif self._saw_daq:
            self._daq_gone = self._daq_gone or now
            if now - max(self._daq_gone, self._heard) > GONE:
                return True
        return told_to_end.is_set() and now - self._heard > (ORPHANED if self.writer else GONE)

    def _is_drained(self, elapsed: float, quiet: bool) -> bool:
        """Whether everything up to the run's end is there, or will not come any more."""
        assert self.writer is not None
        ledger = self.writer.ledger
        end = ledger.end_sample or 0
        has_blocks = not ledger.gaps(end)
        has_truth = not ledger.end_of("Truth") or ledger.reaches("Truth", end)
        if elapsed < DAQ_DRAIN and not (has_blocks and has_truth and quiet):
            return False
        if not self._token.closed:
            self._link.announce(keys.alive(self._rig.name, keys.RECORDED))  # the daq waits for nothing else
            self._token.close()
        if "twin" not in self._presence or elapsed > TWIN_DRAIN:
            return True
        return ledger.reaches("Estimate", end) and quiet

    def _tell(self, alarm: str) -> None:
        """Publish the recorder's status; print an alarm when it begins."""
        now, cpu = time.monotonic(), time.process_time()
        writer = self.writer
        status = Status(
            timestamp=time.time(),
            run=writer.ledger.run if writer else "",
            sample=writer.ledger.end_of("Block") if writer else 0,
            process=PROCESS,
            monotonic_ns=time.monotonic_ns(),
            utc_ns=time.time_ns(),
            state=alarm or ("recording" if writer else "waiting"),
            samples=sum(part.received for part in self.closed) + (writer.samples if writer else 0),
            lost=sum(part.lost for part in self.closed) + (writer.lost if writer else 0),
            queue_fill=self._inbox.fill,
            cpu=(cpu - self._cpu) / max(now - self._wall, 1e-9),
        )
        self._wall, self._cpu = now, cpu
        self._status_due = now + STATUS_PERIOD
        self._status.put(status.SerializeToString())


def next_part(path: str | Path) -> tuple[Path, int, int]:
    """Return file, number and last recorded sample (-1: none) for a recorder that takes over.

    Args:
        path: the recording, as it was named at first.
    """
    existing = [part for part in parts(path) if part.exists()]
    ends, _events = held(existing)
    after = max((end for topic, end in ends.items() if topic.endswith("/daq/block")), default=0) - 1
    return part_path(path, len(existing) + 1), len(existing) + 1, after


def held(files: Iterable[Path]) -> tuple[dict[str, int], set[bytes]]:
    """Return what parts of a recording hold.

    Returns:
        For each topic of samples the index behind its last one, and the payloads of the events.
    """
    ends: dict[str, int] = {}
    events: set[bytes] = set()
    for path in files:
        try:
            recording = Recording(path)
        except RecordingError:
            continue  # it was cut off before its first block
        with recording:
            sorts = {topic: keys.topic(topic).message for topic in recording.topics()}
            told = [topic for topic, kind in sorts.items() if kind == "Event"]
            if told:
                events.update(message.payload for message in recording.messages(*told))
            counted = [topic for topic, kind in sorts.items() if kind not in ("Event", "Status")]
            for topic, message in recording.last(*counted).items() if counted else ():
                ends[topic] = behind(sorts[topic], message.payload)
    return ends, events


def behind(kind: str, payload: bytes) -> int:
    """Return the index behind what a message tells of."""
    return series_end(decode_series(payload)) if kind in SERIES else read_header(payload).sample + 1


def record(
    rig: Rig,
    path: Path,
    part: int,
    after: int,
    rotation: Rotation,
    more: Sequence[str],
    told_to_end: Flag,
) -> int:
    """Record a run; return 0 when its end was seen and 1 when it was not."""
    endpoints = [rig.link.endpoint(name) for name in ("daq", "twin", "operator")]
    with Link(connect=[*endpoints, *more]) as link:
        recorder = Recorder(rig, link, path, part, after, rotation)
        recorder.run(told_to_end)
    if not recorder.closed:
        print("recorder: nothing was recorded: no run began", flush=True)
        return 0
    *others, last = recorder.closed
    rest = f" and {len(others)} more part{'s' * (len(others) > 1)}" if others else ""
    end = "" if last.clean else ", without the end of the run"
    print(
        f"recorder: {sum(part.received for part in recorder.closed)} samples recorded, "
        f"{sum(part.lost for part in recorder.closed)} lost, in {recorder.path}{rest}{end}",
        flush=True,
    )
    return 0 if last.clean else 1


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the recorder process; return its exit code."""
    options = parser().parse_args(arguments)
    told_to_end = Flag()
    follow_parent(told_to_end.set)
    try:
        rig = as_it_runs(load_rig(options.rig))
        parting = rotation(options.rotate) if options.rotate else Rotation()
        return record(rig, options.file, options.part, options.after, parting, options.connect, told_to_end)
    except RecordingError as error:
        print(f"recorder: {error}", file=sys.stderr, flush=True)
        return 1
    except (ValueError, RuntimeError) as error:
        print(f"recorder: {error}", file=sys.stderr, flush=True)
        return 2


def parser() -> argparse.ArgumentParser:
    """Return the parser of the recorder's command line."""
    made = argparse.ArgumentParser(prog="python -m twin record", description=__doc__)
    made.add_argument("--rig", required=True, metavar="NAME|PATH", help="rig description, with its ports")
    made.add_argument("--file", required=True, type=Path, metavar="FILE", help="recording to write")
    made.add_argument("--part", type=int, default=1, metavar="N", help="which continuation of it to write")
    made.add_argument(
        "--after", type=int, default=-1, metavar="SAMPLE", help="last sample that the parts before hold"
    )
    made.add_argument(
        "--rotate",
        default="",
        metavar="SIZE|TIME",
        help="go on in a new part when one is as large, 2GB, 10min",
    )
    made.add_argument(
        "--connect",
        action="append",
        default=[],
        metavar="ENDPOINT",
        help="one more process to connect to, which then hears the recorder's status",
    )
    return made
