"""Recordings: MCAP files of the very bytes that travelled. The only module that uses the mcap package.

A recording's topics are the keys of `daq.keys`, its messages the payloads, its log times
t0 + sample / rate. It carries the rig's description and channel table as attachments, what the messages
mean as protobuf descriptors, and at a clean end a certificate. It is flushed ten times a second and synced
in a helper thread, so that a crash costs at most the last 0.15 s. A file that was cut off or damaged is
read up to the damage, and `recover` saves what stands behind it.
"""

import csv
import io
import json
import time
import tomllib
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

from google.protobuf.descriptor_pb2 import FileDescriptorSet
from mcap.writer import LIBRARY_IDENTIFIER, CompressionType, Writer

from daq import keys, messages_pb2
from daq.messages_pb2 import Description
from daq.recording import overview
from daq.recording.certificate import Certificate, Ledger, length
from daq.recording.fingerprint import numeric_fingerprint
from daq.recording.overview import Overview
from daq.recording.reader import (
    CHANNELS,
    FACTS,
    META,
    RIG,
    Recording,
)
from daq.recording.records import SEAL, seal
from daq.recording.storage import RecordingError, Storage
from daq.timing import SampleClock

CHUNK_SIZE = 256 * 1024  # bytes of messages that are compressed together
FLUSH = 0.1  # s between two flushes


class RecordingWriter:
    """Writes one recording. The caller adds what it receives, and ticks while nothing comes.

    Used as a context manager it closes itself; after an exception as not clean.

    Args:
        path: file to make; its folder is made too, an existing file is never overwritten.
        description: what the daq says of the run; its `first_sample` is where this part begins.
        part: 1, or which continuation of an interrupted recording this is.
        fingerprint: what the estimates are made with; None: this computer's.

    Raises:
        RecordingError: the file cannot be made.
    """

    def __init__(
        self,
        path: str | Path,
        description: Description,
        *,
        part: int = 1,
        fingerprint: dict[str, str] | None = None,
    ) -> None:
        if not description.rate > 0:
            raise RecordingError(
                f"{path}: the run's sample rate is {description.rate} Hz: it must be positive"
            )
        self.description = description
        self.ledger = Ledger(description.run, description.first_sample)
        self.part = part
        self._fingerprint = numeric_fingerprint() if fingerprint is None else fingerprint
        self.failure: RecordingError | None = None
        """Why nothing more is written, once the disk has refused."""
        self._clock = SampleClock(description.t0_ns, description.rate)
        self._topics: dict[str, int] = {}
        self._topics_told = 0
        self._schemas: dict[str, int] = {}
        self._certificate: Certificate | None = None
        self._overview = Overview()
        self._flushed = time.monotonic()
        self._storage = Storage(Path(path))
        self.path = self._storage.path
        self._mcap = Writer(self._storage, CHUNK_SIZE, CompressionType.ZSTD, enable_data_crcs=True)  # type: ignore[arg-type]
        try:
            self._begin(description)
        except RecordingError:
            self._storage.close()
            self.path.unlink(missing_ok=True)  # it holds nothing
            raise

    def __enter__(self) -> "RecordingWriter":
        return self

    def __exit__(self, kind: object, *_: object) -> None:
        self.close(clean=kind is None)

    @property
    def size(self) -> int:
        """Bytes written so far."""
        return self._storage.tell()

    @property
    def space(self) -> float:
        """Bytes that may still be written before the disk is full, as of the last flush."""
        return self._storage.space

    @property
    def samples(self) -> int:
        """Samples of the blocks that were taken so far."""
        return self.ledger.blocks.samples

    @property
    def lost(self) -> int:
        """Samples lost so far between the blocks that were taken."""
        return length(self.ledger.gaps(self.ledger.blocks.end))

    def add(self, key: str, payload: bytes) -> None:
        """Record a message, unless it is of another run or recorded already.

        Raises:
            RecordingError: the disk refuses; said once, then nothing more is written. What was written
                stays readable.
            MessageError: the payload is not what its key promises.
        """
        if self.failure is not None:
            return
        entry = self.ledger.admit(key, payload)
        if entry is None:
            return
        log_time = self._clock.ns(entry.sample)
        self._overview.take(key, payload)
        try:
            topic = self._topics.get(key) or self._register(key)
            self._mcap.add_message(topic, log_time, payload, log_time, entry.sequence)
            self._storage.mark()
        except RecordingError as error:
            self._fail(error)
        self.tick()

    def tick(self) -> None:
        """Flush, when it is time."""
        if time.monotonic() - self._flushed >= FLUSH:
            self.flush()

    def flush(self) -> None:
        """Hand everything to the operating system and ask for it to be synced to the disk.

        Raises:
            RecordingError: the disk refuses.
        """
        if self.failure is not None or self._certificate is not None:
            return
        self._flushed = time.monotonic()
        try:
            if len(self._topics) > self._topics_told:
                self._topics_told = len(self._topics)
                self.note("topics", {str(number): key for key, number in self._topics.items()})
            self._mcap.flush()
            self._storage.mark()
            self._storage.sync()
        except RecordingError as error:
            self._fail(error)

    def note(self, name: str, texts: dict[str, str]) -> None:
        """Write a metadata record, with a checksum by which damage to it is found."""
        self._mcap.add_metadata(name, {**texts, SEAL: seal(texts)})
        self._storage.mark()

    def close(
        self,
        *,
        expected: int | None = None,
        clean: bool = True,
        continued: bool = False,
    ) -> Certificate:
        """Write the certificate and the summary, sync and close; a second call changes nothing.

        Args:
            expected: samples of the whole run; None: what the daq's end event told.
            clean: whether the run's end was seen.
            continued: whether the next part follows.

        Raises:
            RecordingError: the disk refuses, where it had not refused before.
        """
        if self._certificate is not None:
            return self._certificate
        failed_before = self.failure is not None
        account = self.ledger.certificate(
            part=self.part,
            expected=expected,
            clean=clean and not failed_before,
            continued=continued and not failed_before,
        )
        certificate = replace(account, fingerprint=self._fingerprint)
        self._certificate = certificate
        try:
            if not self._storage.broken:
                self.note(overview.RECORD, self._overview.to_metadata())
                self.note("certificate", certificate.to_metadata())
                self._mcap.finish()
                self._storage.mark()
        except RecordingError as error:
            self.failure = self.failure or error
        finally:
            self._storage.close()
        if self.failure is not None and not failed_before:
            raise self.failure
        return certificate

    def _begin(self, description: Description) -> None:
        self._mcap.start(profile="rigtwin", library=f"rigtwin; {LIBRARY_IDENTIFIER}")
        facts = {name: getattr(description, name) for name in FACTS} | {"part": self.part}
        self.note("description", {name: json.dumps(value) for name, value in facts.items()})
        self.note("versions", dict(description.versions))
        if description.meta:
            self.note(META, dict(description.meta))
        self.note("fingerprint", self._fingerprint)
        t0 = description.t0_ns
        self._mcap.add_attachment(t0, t0, RIG, "application/toml", description.toml.encode())
        table = channel_table(description.toml)
        self._mcap.add_attachment(t0, t0, CHANNELS, "text/csv", table.encode())
        self._storage.mark()
        self._storage.sync()

    def _register(self, key: str) -> int:
        name = keys.topic(key).message
        if name not in self._schemas:
            self._schemas[name] = self._mcap.register_schema(f"rigtwin.v1.{name}", "protobuf", _descriptors())
        self._topics[key] = self._mcap.register_channel(key, "protobuf", self._schemas[name])
        return self._topics[key]

    def _fail(self, error: RecordingError) -> None:
        self.failure = error
        raise error


class Recovered(NamedTuple):
    """What `recover` saved."""

    path: Path
    certificate: Certificate
    damage: tuple[str, ...]
    """What was wrong with the source, in plain words."""


def recover(source: str | Path, target: str | Path) -> Recovered:
    """Write every sound message of a cut-off or damaged recording to a new, closed one.

    Raises:
        RecordingError: there is nothing to save, or the target cannot be written.
    """
    with Recording(source) as recording:
        stored = recording.certificate
        made_with = recording.fingerprint
        with RecordingWriter(
            target, recording.description, part=recording.part, fingerprint=made_with
        ) as writer:
            for message in recording.messages(heal=True):
                writer.add(message.key, message.payload)
            damage = tuple(recording.damage)
            writer.note("recovered", {"source": recording.path.name, "damage": json.dumps(damage)})
            certificate = writer.close(
                expected=stored.first_sample + stored.expected if stored else None,
                clean=stored.clean if stored else writer.ledger.end_sample is not None,
                continued=stored.continued if stored else False,
            )
    return Recovered(writer.path, certificate, damage)


def channel_table(toml: str) -> str:
    """Return the `[[channel]]` rows of a rig description as CSV, one column for each key that occurs."""
    rows = tomllib.loads(toml).get("channel", [])
    columns = dict.fromkeys(key for row in rows for key in row)
    table = io.StringIO()
    writer = csv.DictWriter(table, list(columns), lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return table.getvalue()


def _descriptors() -> bytes:
    """Return what any protobuf decoder needs to read the messages."""
    files = FileDescriptorSet()
    messages_pb2.DESCRIPTOR.CopyToProto(files.file.add())
    return files.SerializeToString(deterministic=True)
