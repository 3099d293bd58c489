"""Reads recordings: messages, events, and channels as arrays, of whole, cut-off and damaged files."""

import json
from collections.abc import Callable, Iterator, Sequence
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

from daq import keys
from daq.messages import Series, decode_series
from daq.messages_pb2 import Description, Event
from daq.recording.certificate import Certificate, Check, Ledger
from daq.recording.record_index import Index, scanned_index, stored_index
from daq.recording.records import (
    MAGIC,
    SEAL,
    Damage,
    Op,
    RawMessage,
    Record,
    RecordFile,
    read_attachment,
    read_metadata,
    seal,
    split_chunk,
    unpack_chunk,
)
from daq.recording.signals import Signals, joined, series_end
from daq.recording.storage import RecordingError
from daq.series_layout import SeriesDecoder
from daq.timing import SampleClock

RIG, CHANNELS = "rig.toml", "channels.csv"  # names of the attachments
LATEST = 2**64 - 1  # log time
FACTS = ("run", "first_sample", "rig", "rate", "t0_ns", "t0_uncertainty_ns", "t0_source", "mode")
META = "meta"
"""Name of the metadata record of what people told of the run."""
SERIES_KEYS = {
    "block": keys.block,
    "estimate": keys.estimate,
    "smoothed": keys.smoothed,
    "truth": keys.truth,
}


class Message(NamedTuple):
    """One message of a recording."""

    key: str
    log_time: int
    """ns since 1970 UTC: t0 + sample / rate."""
    sequence: int
    """Block number of a block; of the others, a count within their topic."""
    payload: bytes


class Recording:
    """Reads a recording, as much at a time as is asked for; also one that was cut off or is being written.

    Raises:
        RecordingError: no such file, no MCAP, or no recording of this product.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path).expanduser()
        self.damage: list[str] = []
        """What the reading going on, or the last one, found cut off or damaged, in plain words."""
        self._file = RecordFile(self.path)
        self._topics: dict[int, str] = {}
        self._notes: dict[str, dict[str, str]] = {}
        self._attachments: dict[str, bytes] = {}
        self._more_behind = False
        for record in self._records(heal=True):
            if record.kind == Op.CHUNK:
                break
        self._facts = {name: json.loads(text) for name, text in self._notes.get("description", {}).items()}
        if "run" not in self._facts:
            self._facts = self._facts_from_block()

    def __enter__(self) -> "Recording":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    @property
    def truncated(self) -> str:
        """Why the last reading ended early; empty when it did not."""
        return self.damage[0] if self.damage else ""

    @property
    def complete(self) -> bool:
        """Whether the file was closed in order."""
        return self._file.closed

    @property
    def part(self) -> int:
        """1, or which continuation of an interrupted recording this is."""
        return self._facts.get("part", 1)

    @property
    def rig_toml(self) -> str:
        """The resolved rig description."""
        return self._attachments.get(RIG, b"").decode()

    @cached_property
    def description(self) -> Description:
        """What the daq said of the run; `first_sample` is where this part begins."""
        facts = {name: self._facts[name] for name in FACTS if name in self._facts}
        notes = self._notes
        return Description(
            toml=self.rig_toml, versions=notes.get("versions", {}), meta=notes.get(META, {}), **facts
        )

    @property
    def clock(self) -> SampleClock:
        """Turns the run's sample indices into time."""
        return SampleClock(self.description.t0_ns, self.description.rate)

    @property
    def notes(self) -> dict[str, dict[str, str]]:
        """All sound metadata records, by name."""
        _ = self._index
        return dict(self._notes)

    @cached_property
    def certificate(self) -> Certificate | None:
        """The certificate that was written at the end; None where there is none that is sound."""
        texts = self.notes.get("certificate")
        try:
            return Certificate.from_metadata(texts) if texts else None
        except ValueError:
            return None

    @property
    def fingerprint(self) -> dict[str, str]:
        """What the estimates were made with (`daq.recording.fingerprint`); empty where that is not known."""
        stored = self.certificate
        return stored.fingerprint if stored else self.notes.get("fingerprint", {})

    def messages(self, *topics: str, heal: bool = False) -> Iterator[Message]:
        """Yield the messages, of all topics or of some, in the order of the file.

        Reading ends at the first damage, or with `heal` goes on behind it; `damage` tells.
        """
        wanted = frozenset(topics)
        if heal:
            _ = self._index
        for data in self._chunks(wanted, heal=heal):
            for message in self._of(data):
                if not wanted or message.key in wanted:
                    yield message

    def messages_between(self, *topics: str, first: int = 0, last: int | None = None) -> Iterator[Message]:
        """Yield the messages, of all topics or of some, of samples `first` to `last`, in the file's order.

        Only the chunks that hold them are read; one that is damaged is left out, and `damage` tells.
        """
        begin, end = self._stretch(first, last)
        wanted = frozenset(topics)
        self.damage = list(self._index.damage)
        for chunk in self._index.between(begin, end):
            if self._may_hold(chunk.channels, wanted):
                for message in self._of(self._unpacked(chunk.record)):
                    if begin <= message.log_time <= end and (not wanted or message.key in wanted):
                        yield message

    def topics(self) -> tuple[str, ...]:
        """Return the topics that have messages."""
        if "topics" not in self.notes:
            for _message in self.messages(heal=True):
                pass
        return tuple(self._topics.values())

    def last(self, *topics: str) -> dict[str, Message]:
        """Return the last sound message of each topic; only chunks that can hold one are unpacked."""
        missing = set(topics or self.topics())
        found: dict[str, Message] = {}
        for chunk in self._index.from_the_end():
            if not missing:
                break
            if self._may_hold(chunk.channels, frozenset(missing)):
                newest = {message.key: message for message in self._of(self._unpacked(chunk.record))}
                found |= {topic: newest[topic] for topic in missing & newest.keys()}
                missing -= newest.keys()
        return found

    def events(self) -> list[Event]:
        """Return all events, in the order of the file."""
        topics = [keys.event(self.description.rig, source) for source in ("daq", "operator", "twin")]
        return [Event.FromString(message.payload) for message in self.messages_between(*topics)]

    def series(
        self,
        key: str = "block",
        names: Sequence[str] | None = None,
        *,
        first: int = 0,
        last: int | None = None,
    ) -> Signals:
        """Return channels as one array.

        Args:
            key: block, estimate, smoothed or truth.
            names: channels wanted, in this order; None: all.
            first: index of the first sample wanted.
            last: index of the last sample wanted; None: the last there is.

        Raises:
            RecordingError: there are no such samples, or no such channel.
        """
        return joined(self.pieces(key, first, last), names, first, last, f"{self.path}: {key}")

    def pieces(self, key: str, first: int = 0, last: int | None = None) -> list[Series]:
        """Return the messages of a series that have samples from `first` to `last`, in order.

        They are looked for from the end: the earliest is the last one that does not begin behind `first`.
        Raises RecordingError for another key.
        """
        if key not in SERIES_KEYS:
            raise RecordingError(f"no series is named {key!r}: there are {', '.join(SERIES_KEYS)}")
        topic = SERIES_KEYS[key](self.description.rig)
        begin, end = self._stretch(first, last)
        found, decoder = list[Series](), SeriesDecoder()
        earliest = 0  # log time before which no series is wanted
        self.damage = list(self._index.damage)
        for chunk in self._index.latest_first(end):
            if chunk.last_ns < earliest:
                break
            if not self._may_hold(chunk.channels, frozenset((topic,))):
                continue
            for message in self._of(self._unpacked(chunk.record)):
                if message.key == topic and message.log_time <= end:
                    series = decoder.decode(message.payload)
                    if series_end(series) > first:
                        found.append(series)
                    if message.log_time <= begin:
                        earliest = max(earliest, message.log_time)
        return sorted(found, key=lambda series: series.first_sample)

    def _stretch(self, first: int, last: int | None) -> tuple[int, int]:
        """Return the log times of two samples; the largest that there is where `last` is None."""
        return self.clock.ns(max(0, first)), LATEST if last is None else self.clock.ns(last)

    def check(self, on_block: Callable[[Series], None] | None = None) -> Check:
        """Make the account anew from what the file holds and compare it with the certificate.

        Args:
            on_block: called with each block on the way.
        """
        stored = self.certificate
        ledger, clock = Ledger(self.description.run, self.description.first_sample), self.clock
        block, decoder = keys.block(self.description.rig), SeriesDecoder()
        wrong_times = 0
        for message in self.messages():
            entry = ledger.admit(message.key, message.payload)
            if entry is not None:
                wrong_times += message.log_time != clock.ns(entry.sample)
                if on_block is not None and message.key == block:
                    on_block(decoder.decode(message.payload))
        found = ledger.certificate(
            part=self.part,
            expected=stored.first_sample + stored.expected if stored else None,
            clean=stored.clean if stored else ledger.end_sample is not None,
        )
        if wrong_times:
            self.damage.append(f"{wrong_times} messages do not stand at the time of their samples")
        return Check(*self._verdict(stored, found), found)

    def _verdict(self, stored: Certificate | None, found: Certificate) -> tuple[str, str]:
        if not self.complete:
            return (
                "altered" if self._more_behind else "incomplete",
                self.truncated or "its summary is cut off",
            )
        if self.damage:
            return "altered", self.truncated
        if not self._file.checksum_holds():
            return "altered", "the file's checksum is wrong"
        if stored is None:
            return "no certificate", "rigtwin did not write this file to its end"
        different = stored.differences(found)
        if different:
            return "altered", f"what it holds differs from its certificate in {', '.join(different)}"
        if found.gaps:
            return "incomplete", f"{found.lost} samples are missing in {len(found.gaps)} gaps"
        if not (stored.clean or stored.continued):
            return "incomplete", "the recording ended before the run did"
        return "valid", ""

    @cached_property
    def _index(self) -> Index:
        """Where everything stands; all notes are taken in on the way."""
        before, self.damage = self.damage, []
        index = stored_index(self._file)
        if index is None:
            chunks = (record for record in self._records(heal=True) if record.kind == Op.CHUNK)
            index = scanned_index(self._file, chunks)
        else:
            self._topics |= index.topics
            for record in index.notes:
                self._take_in(record)
        index.damage, self.damage = self.damage, before
        return index

    def _records(self, *, heal: bool) -> Iterator[Record]:
        """Yield the records of the data section and take in those that are not chunks.

        At a damage it ends, or with `heal` goes on at the next sound chunk.
        """
        self.damage = []
        position = sound = len(MAGIC)
        while True:
            try:
                for record in self._file.walk(position):
                    if record.kind == Op.CHUNK:
                        sound = record.end
                    else:
                        self._take_in(record)
                    yield record
                return
            except Damage as error:
                self.damage.append(str(error))
            chunk = self._file.next_chunk(sound)
            self._more_behind = chunk is not None
            if chunk is None or not heal:
                return
            yield chunk
            position = sound = chunk.end

    def _chunks(self, wanted: frozenset[str], *, heal: bool) -> Iterator[bytes]:
        """Yield the records in those chunks that can hold wanted topics."""
        for record in self._records(heal=heal):
            if record.kind == Op.CHUNK and (
                not wanted or self._may_hold(self._file.channels_behind(record), wanted)
            ):
                data = self._unpacked(record)
                if data:
                    yield data
                elif not heal:
                    self._more_behind = self._file.next_chunk(record.end) is not None
                    return

    def _unpacked(self, chunk: Record) -> bytes:
        """Return the records in a chunk; nothing, and a note of the damage, when it is not sound."""
        try:
            return unpack_chunk(self._file.content(chunk))
        except Damage as error:
            self.damage.append(f"the chunk at byte {chunk.start} is damaged: {error}")
            return b""

    def _of(self, data: bytes) -> Iterator[Message]:
        """Yield the messages of an unpacked chunk, learning the topics that it declares."""
        for item in split_chunk(data):
            if not isinstance(item, RawMessage):
                self._topics[item[0]] = item[1]
            elif item.channel in self._topics:
                yield Message(self._topics[item.channel], item.log_time, item.sequence, item.payload)

    def _may_hold(self, channels: set[int], wanted: frozenset[str]) -> bool:
        """Whether a chunk of these channels can hold wanted topics; none known or wanted means all."""
        topics = [self._topics.get(channel) for channel in channels] if wanted else []
        return not topics or any(topic is None or topic in wanted for topic in topics)

    def _take_in(self, record: Record) -> None:
        """Remember a metadata record or an attachment that is sound."""
        try:
            if record.kind == Op.ATTACHMENT:
                name, content = read_attachment(self._file.content(record))
                self._attachments[name] = content
            elif record.kind == Op.METADATA:
                name, texts = read_metadata(self._file.content(record))
                if texts.pop(SEAL, None) != seal(texts):
                    raise Damage("its checksum is wrong")
                self._notes[name] = texts
                if name == "topics":
                    self._topics |= {int(number): topic for number, topic in texts.items()}
        except Damage as error:
            self.damage.append(f"the record at byte {record.start} is damaged: {error}")

    def _facts_from_block(self) -> dict[str, Any]:
        """Make up for a lost description by what the first block tells."""
        for message in self.messages(heal=True):
            if message.key.endswith("/daq/block"):
                series = decode_series(message.payload)
                elapsed = SampleClock(0, series.rate).ns(series.first_sample)
                t0_ns = message.log_time - elapsed
                return {
                    "run": series.run,
                    "rig": message.key.split("/")[1],
                    "rate": series.rate,
                    "t0_ns": t0_ns,
                }
        raise RecordingError(
            f"{self.path} is MCAP, but holds no recording of a rig: it comes from another program, or "
            "was cut off before its first block"
        )
