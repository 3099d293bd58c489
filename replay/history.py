"""What the live twin saw of a run, as far as its recording tells: when it began, what it did not see."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from heapq import heappop, heappush
from pathlib import Path

from daq import keys
from daq.messages import Series
from daq.messages_pb2 import Event
from daq.recording import Check, Message, Recording, RecordingError, parts, series_end
from daq.recording.certificate import Coverage
from daq.recording.reader import SERIES_KEYS
from daq.recording.recorded_run import RecordedRun
from daq.series_layout import SeriesDecoder

NOT_RECEIVED = "not received"


@dataclass
class Session:
    """One process of the twin.

    Attributes:
        start: sample at which its first block begins.
        gaps: (first, last, cause) of the samples after that which it did not see.
    """

    start: int
    gaps: list[tuple[int, int, str]] = field(default_factory=list)

    def saw(self, sample: int) -> bool:
        """Whether the block that begins at a sample was among those that it processed, while it lived."""
        return sample >= self.start and not any(first <= sample <= last for first, last, _ in self.gaps)

    def cause(self, sample: int) -> str:
        """Return why samples before the block that begins at `sample` were missing."""
        return next((cause for _first, last, cause in self.gaps if last + 1 == sample), NOT_RECEIVED)


@dataclass
class History:
    """What a recording tells of the live twin.

    Attributes:
        sessions: its processes, in the order in which they ran.
        end: index behind the last recorded estimate; 0 when there is none.
    """

    sessions: list[Session]
    end: int = 0

    def unseen(self, blocks: Coverage) -> list[tuple[int, int]]:
        """Return the stretches that the twin saw although the recording lacks them."""
        known = [gap for session in self.sessions for gap in session.gaps]
        begin = min((session.start for session in self.sessions), default=0)
        return [
            (first, last)
            for first, last in blocks.gaps(begin, self.end)
            if not any(low <= first and last <= high for low, high, _cause in known)
        ]


class RepeatableRun(RecordedRun):
    """A recorded run from its beginning, over which the twin can be run again.

    Raises:
        RecordingError: a file cannot be read, or it is a continuation itself.
    """

    def __init__(self, path: str | Path) -> None:
        super().__init__(path)
        if (part := self.files[0].part) > 1:
            self.close()
            raise RecordingError(
                f"{path} is part {part} of a recording: the twin's state at its beginning comes "
                "from the earlier parts; name the first one"
            )
        self.blocks = Coverage()
        """Samples of the blocks that are there; filled by `check_files`."""

    def check_files(self) -> list[Check]:
        """Compare each file with its certificate, and note which samples there are."""
        return [file.check(self._note) for file in self.files]

    def _note(self, block: Series) -> None:
        self.blocks.add(block.first_sample, series_end(block))

    def decoded(self, key: str) -> Iterator[Series]:
        """Yield the messages of a series, by its name in `SERIES_KEYS`, in the order of the files."""
        decoder = SeriesDecoder()
        for message in self.messages(SERIES_KEYS[key](self.description.rig)):
            yield decoder.decode(message.payload)

    def in_order(self, messages: Iterable[Message]) -> Iterator[Message]:
        """Yield blocks by their sample index, although one may have come late; after `check_files`."""
        holes = dict(self.blocks.gaps(0, self.blocks.end))
        expected, held, decoder = 0, list[tuple[int, int, Message]](), SeriesDecoder()
        for message in messages:
            series = decoder.decode(message.payload)
            heappush(held, (series.first_sample, series_end(series), message))
            while held and held[0][0] <= holes.get(expected, expected - 1) + 1:
                _first, end, following = heappop(held)
                expected = max(expected, end)
                yield following
        while held:
            yield heappop(held)[2]

    def history(self) -> History:
        """Return what is told of the twin. Its events need not stand beside its estimates in the file."""
        rig = self.description.rig
        sessions: list[Session] = []
        for message in self.messages(keys.event(rig, "twin")):
            event = Event.FromString(message.payload)
            if event.kind == "start":
                sessions.append(Session(event.sample))
            elif event.kind == "gap" and sessions:
                details = event.details
                sessions[-1].gaps.append((int(details["first"]), int(details["last"]), details["cause"]))
        stretches = Coverage()
        for series in self.decoded("estimate"):
            stretches.add(series.first_sample, series_end(series))
        if stretches.samples and (not sessions or stretches.first < sessions[0].start):
            sessions.insert(0, Session(stretches.first))  # the event of its start was not recorded
        return History(sessions, stretches.end)


def expected_end(path: str | Path) -> int | None:
    """Return the index behind the last sample that a recording's certificate tells of; None without one."""
    with Recording(parts(path)[-1]) as recording:
        stored = recording.certificate
        return stored.first_sample + stored.expected if stored else None
