"""What a recording holds and what it lacks, counted in one way while it is written and when it is checked.

Completeness comes from the sample index of the blocks alone, never from what the network reports. A
message that was there already is left out; one that comes late is taken where it fits a gap.
"""

import hashlib
import json
import struct
from bisect import bisect_right
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, field
from typing import NamedTuple

from daq import keys
from daq.events import LEFT_OUT
from daq.messages import TIMING_FLAGS, BlockStatus, decode_series, read_header
from daq.messages_pb2 import Event
from daq.recording.fingerprint import numeric_fingerprint
from daq.series_layout import HeaderLayout, Layout, variable

DIGESTED = {"Block": "block", "Estimate": "estimate", "Smoothed": "smoothed", "Truth": "truth"}
SERIES = tuple(DIGESTED)
QUALITY = ~int(TIMING_FLAGS)
LATE = int(BlockStatus.LATE)
SIGNAL = struct.Struct("<QIII")


@dataclass(frozen=True)
class Certificate:
    """What was to be recorded, what was, and digests of it. Indices and counts are in samples.

    Attributes:
        part: 1, or which continuation of an interrupted recording this is.
        first_sample: index at which this part begins.
        expected: samples from there to the end of the run, as far as the end is known.
        received: samples that are there.
        gaps: (first, last) index of each stretch that is missing, `left_out` not counted.
        late: blocks that came late although nothing was lost.
        messages: number of messages of each topic.
        file_digest: SHA-256 of all payloads in the order of the file.
        signal_digests: SHA-256 of the samples of each series, without run id and wall time.
        fingerprint: what the numbers depend on, see `daq.recording.fingerprint`.
        clean: whether the run's end was seen.
        continued: whether the recorder went on in the next part.
        left_out: (first, last) index of each stretch that is not there because it was not to be recorded.
    """

    part: int
    first_sample: int
    expected: int
    received: int
    gaps: tuple[tuple[int, int], ...]
    late: int
    messages: dict[str, int]
    file_digest: str
    signal_digests: dict[str, str]
    clean: bool
    fingerprint: dict[str, str] = field(default_factory=dict)
    continued: bool = False
    left_out: tuple[tuple[int, int], ...] = ()

    @property
    def lost(self) -> int:
        """Samples that are missing although they were to be recorded."""
        return self.expected - self.received - length(self.left_out)

    def differences(self, other: "Certificate") -> list[str]:
        """Return the names of the fields in which two accounts of the same messages differ."""
        counted = ("first_sample", "received", "gaps", "left_out", "late", "messages")
        digests = ("file_digest", "signal_digests")
        return [name for name in counted + digests if getattr(self, name) != getattr(other, name)]

    def to_metadata(self) -> dict[str, str]:
        """Return the fields as text, as a recording stores them."""
        return {name: json.dumps(value) for name, value in asdict(self).items()}

    @classmethod
    def from_metadata(cls, texts: dict[str, str]) -> "Certificate":
        """Read the fields from a recording's text.

        Raises:
            ValueError: the text is no certificate.
        """
        try:
            values = {name: json.loads(text) for name, text in texts.items()}
            for name in {"gaps", "left_out"} & values.keys():
                values[name] = tuple((first, last) for first, last in values[name])
            return cls(**values)
        except (TypeError, KeyError) as error:
            raise ValueError(f"the certificate is not readable: {error}") from error


class Check(NamedTuple):
    """What came of comparing a recording with its certificate."""

    verdict: str
    """valid, incomplete, altered, or no certificate."""
    reason: str
    """Why, in plain words; empty when valid."""
    certificate: Certificate
    """The account, made anew from what the file holds."""


class Coverage:
    """Stretches of the sample index, joined where they touch."""

    def __init__(self) -> None:
        self._firsts: list[int] = []
        self._ends: list[int] = []

    @property
    def end(self) -> int:
        """Index after the last sample that is there; 0 when there is none."""
        return self._ends[-1] if self._ends else 0

    @property
    def first(self) -> int:
        """Index of the first sample that is there; 0 when there is none."""
        return self._firsts[0] if self._firsts else 0

    @property
    def samples(self) -> int:
        """How many samples are there."""
        return sum(self._ends) - sum(self._firsts)

    def add(self, first: int, end: int) -> bool:
        """Add samples `first` to `end - 1`; return False when all of them were there."""
        if self._ends and first == self._ends[-1] and end > first:
            self._ends[-1] = end
            return True
        return self._insert(first, end)

    def gaps(self, first: int, end: int) -> list[tuple[int, int]]:
        """Return the (first, last) index of each stretch between `first` and `end - 1` that is missing."""
        missing = []
        for begin, stop in zip(self._firsts, self._ends, strict=True):
            if min(begin, end) > first:
                missing.append((first, min(begin, end) - 1))
            first = max(first, stop)
        if end > first:
            missing.append((first, end - 1))
        return missing

    def stretches(self) -> list[tuple[int, int]]:
        """Return first sample and end of each stretch, in order."""
        return list(zip(self._firsts, self._ends, strict=True))

    def joined(self, other: "Coverage") -> "Coverage":
        """Return what is in this or in the other."""
        both = Coverage()
        for first, end in sorted([*self.stretches(), *other.stretches()]):
            both.add(first, end)
        return both

    def _insert(self, first: int, end: int) -> bool:
        place = bisect_right(self._firsts, first)
        if (place and self._ends[place - 1] >= end) or end <= first:
            return False
        start = place
        if place and self._ends[place - 1] >= first:
            start, first = place - 1, self._firsts[place - 1]
        stop = start
        while stop < len(self._firsts) and self._firsts[stop] <= end:
            end = max(end, self._ends[stop])
            stop += 1
        self._firsts[start:stop] = [first]
        self._ends[start:stop] = [end]
        return True


class Entry(NamedTuple):
    """A message that belongs in the recording."""

    sample: int
    """Sample index that it refers to."""
    sequence: int
    """Block number of a block; of the others, a count within their topic."""


class Ledger:
    """Takes the messages of one run, says which belong in the recording, and keeps the account.

    Args:
        run: run id; messages of another run are left out. Empty: the first message's.
        first_sample: index at which this part of the recording begins.
    """

    def __init__(self, run: str = "", first_sample: int = 0) -> None:
        self.run = run
        self.first_sample = first_sample
        self.end_sample: int | None = None
        """Samples of the whole run, once the daq has told its end."""
        self._coverage: dict[str, Coverage] = {}
        self._left_out = Coverage()  # samples that the daq said were not to be recorded
        self._messages: Counter[str] = Counter()
        self._kinds: dict[str, str] = {}
        self._last_sample: dict[str, int] = {}
        self._events: set[bytes] = set()
        self._skip: dict[str, int] = {}
        self._late = 0
        self._block = 0
        self._header = HeaderLayout(run)
        self._layouts: dict[str, Layout] = {}
        self._file = hashlib.sha256()
        self._signals = {name: hashlib.sha256() for name in SERIES}

    @property
    def blocks(self) -> Coverage:
        """Samples of the blocks that were taken."""
        return self.covered("Block")

    def covered(self, kind: str) -> Coverage:
        """Return which samples a series has: of a kind of `SERIES`."""
        return self._coverage.setdefault(kind, Coverage())

    def end_of(self, kind: str) -> int:
        """Return the index behind the last sample of a series, in this part or in those before."""
        before = (end for key, end in self._skip.items() if keys.topic(key).message == kind)
        return max(self.covered(kind).end, *before, 0)

    def reaches(self, kind: str, end: int) -> bool:
        """Whether a series is there, or was left out, up to the last block before `end`."""
        return max(self.end_of(kind), self._left_out.end) > end - max(self._block, 1)

    def held(self) -> tuple[dict[str, int], set[bytes]]:
        """Return what the next part is to leave out, as `leave_out` takes it."""
        ends = {key: last + 1 for key, last in self._last_sample.items()}
        ends |= {key: self.end_of(kind) for key, kind in self._kinds.items() if kind in SERIES}
        return self._skip | ends, self._events

    def gaps(self, end: int) -> list[tuple[int, int]]:
        """Return the (first, last) index of each stretch of blocks before `end` that is lost."""
        return self.blocks.joined(self._left_out).gaps(self.first_sample, end)

    def left_out(self, end: int) -> list[tuple[int, int]]:
        """Return the (first, last) index of each stretch before `end` that is not there and was not to be."""
        return [
            gap
            for begin, stop in self._left_out.stretches()
            for gap in self.blocks.gaps(max(begin, self.first_sample), min(stop, end))
        ]

    def leave_out(self, ends: Mapping[str, int], events: Iterable[bytes]) -> None:
        """Leave out what an earlier part of the recording holds.

        Args:
            ends: for each topic, the index before which its messages are there already.
            events: payloads of the events that are there already.
        """
        self._skip.update(ends)
        self._events.update(events)
        for payload in self._events:
            self._note_left_out(Event.FromString(payload))

    def admit(self, key: str, payload: bytes) -> Entry | None:
        """Take a message; return None when it is of another run or was there already.

        Raises:
            MessageError: the payload is not what the key promises.
            KeyError: the key is no topic of a rig.
        """
        kind = self._kinds.get(key)
        if kind is None:
            kind = self._kinds[key] = keys.topic(key).message
        if kind in SERIES:
            entry = self._admit_series(key, kind, payload)
        else:
            sample = self._sample(payload)
            entry = None
            if sample is not None and self._is_new(key, kind, sample, payload):
                entry = Entry(sample, self._messages[key])
        if entry is not None:
            self._messages[key] += 1
            self._file.update(payload)
        return entry

    def certificate(
        self, *, part: int, expected: int | None, clean: bool, continued: bool = False
    ) -> Certificate:
        """Return the account.

        Args:
            part: which part of the recording this is.
            expected: samples of the whole run; None: what the daq told, or up to the last that is there.
            clean: whether the run's end was seen.
            continued: whether the next part follows.
        """
        end = next((known for known in (expected, self.end_sample) if known is not None), self.blocks.end)
        end = max(end, self.blocks.end, self.first_sample)
        gaps, left_out = self.gaps(end), self.left_out(end)
        digests = {
            DIGESTED[kind]: digest.hexdigest()
            for kind, digest in self._signals.items()
            if self.covered(kind).samples
        }
        expected = end - self.first_sample
        return Certificate(
            part=part,
            first_sample=self.first_sample,
            expected=expected,
            received=expected - length(gaps) - length(left_out),
            gaps=tuple(gaps),
            late=self._late,
            messages=dict(sorted(self._messages.items())),
            file_digest=self._file.hexdigest(),
            signal_digests=digests,
            clean=clean,
            fingerprint=numeric_fingerprint(),
            continued=continued,
            left_out=tuple(left_out),
        )

    def _of_this_run(self, run: str) -> bool:
        if not self.run:
            self.run, self._header = run, HeaderLayout(run)
        return run == self.run

    def _sample(self, payload: bytes) -> int | None:
        """Return the sample index of a message; None when it is of another run."""
        sample = self._header.read(payload)
        if sample is not None:
            return sample
        _timestamp, run, sample = read_header(payload)
        return sample if self._of_this_run(run) else None

    def _admit_series(self, key: str, kind: str, payload: bytes) -> Entry | None:
        layout = self._layouts.get(key)
        found = layout.read(payload) if layout else None
        if found is None:
            series = decode_series(payload)
            if not self._of_this_run(series.run):
                return None
            found = variable(series)
            self._layouts[key] = Layout(series)
        first, columns = found.first_sample, found.shape[1]
        if first < self._skip.get(key, 0):
            return None
        if not self.covered(kind).add(first, first + columns * self._layouts[key].stride):
            return None
        digest = self._signals[kind]
        digest.update(SIGNAL.pack(first, found.status & QUALITY, *found.shape) + found.labels)
        digest.update(found.samples)
        sequence = self._messages[key]
        if kind == "Block":
            self._block = self._block or columns
            self._late += bool(found.status & LATE)
            sequence = first // self._block
        return Entry(first, sequence)

    def _is_new(self, key: str, kind: str, sample: int, payload: bytes) -> bool:
        if kind == "Event":
            return self._is_new_event(payload)
        if kind == "Status":
            return True
        new = sample >= self._skip.get(key, 0) and sample > self._last_sample.get(key, -1)
        if new:
            self._last_sample[key] = sample
        return new

    def _is_new_event(self, payload: bytes) -> bool:
        """Compare whole events: a process that was started anew counts its events from 0 again."""
        event = Event.FromString(payload)
        if payload in self._events:
            return False
        self._events.add(payload)
        self._note_left_out(event)
        if event.source == "daq" and event.kind == "end":
            self.end_sample = int(event.details.get("samples", self.blocks.end))
        return True

    def _note_left_out(self, event: Event) -> None:
        if event.source == "daq" and event.kind == LEFT_OUT:
            self._left_out.add(int(event.details["first"]), int(event.details["last"]) + 1)


def length(stretches: Iterable[tuple[int, int]]) -> int:
    """Return the number of samples in stretches (first, last)."""
    return sum(last - first + 1 for first, last in stretches)
