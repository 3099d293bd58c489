"""Lists recordings by what stands at their beginning and end, without reading what lies between."""

import tomllib
from collections.abc import Iterable
from dataclasses import dataclass
from datetime import UTC, date, datetime
from pathlib import Path
from typing import Any

from daq.recording import Recording, RecordingError, parts
from daq.recording.certificate import Certificate
from daq.recording.notes import notes_of
from daq.recording.overview import RECORD, Overview, topics
from replay.info import utc
from simulator.validation import RigError


@dataclass(frozen=True)
class Entry:
    """One recording with its continuations.

    Attributes:
        path: of its first part.
        parts: how many files it has.
        bytes: of all files.
        rig: name.
        bearing: kind of backup bearing; empty when the description does not tell.
        mode: LIVE, EMULATED, ...
        run: run id.
        t0_ns: UTC of sample 0, ns since 1970.
        duration: s; None when a file was not closed and has not been read.
        lost: samples missing; None likewise.
        overview: what happened; None when a file does not tell and has not been read.
        meta: what people told of the run, before and after it; the latest of each key.
    """

    path: Path
    parts: int
    bytes: int
    rig: str
    bearing: str
    mode: str
    run: str
    t0_ns: int
    duration: float | None
    lost: int | None
    overview: Overview | None
    meta: dict[str, str]

    @property
    def day(self) -> date:
        """Day of its start, UTC."""
        return datetime.fromtimestamp(self.t0_ns // 10**9, UTC).date()

    def to_json(self) -> dict[str, Any]:
        """Return the fields in plain types, SI units and Hz."""
        told = self.overview
        return {
            "file": str(self.path),
            "parts": self.parts,
            "bytes": self.bytes,
            "rig": self.rig,
            "bearing": self.bearing,
            "mode": self.mode,
            "run": self.run,
            "start": utc(self.t0_ns),
            "duration": self.duration,
            "lost": self.lost,
            "max_speed_hz": told.max_speed_hz if told else None,
            "radius_maximum": told.radius_maximum if told else None,
            "force_maximum": told.force_maximum if told else None,
            "events": dict(told.events) if told else None,
            "trips": told.trips if told else None,
            "meta": self.meta,
        }


def catalogue(places: Iterable[Path], *, whole: bool = False) -> tuple[list[Entry], list[str]]:
    """Return the recordings in some places, and why other files there are none.

    Args:
        places: files, and folders that are searched through.
        whole: whether a file that does not tell everything is read from its beginning to its end.

    Raises:
        RecordingError: a place does not exist.
    """
    entries, refused = [], []
    for path in find(places):
        try:
            entries.append(entry(path, whole=whole))
        except (RecordingError, RigError) as error:
            refused.append(str(error))
    return entries, refused


def find(places: Iterable[Path]) -> list[Path]:
    """Return the files of recordings: those named, and all in the folders named, without continuations.

    Raises:
        RecordingError: a place does not exist.
    """
    files: list[Path] = []
    for place in places:
        if not place.exists():
            raise RecordingError(f"{place}: no such file or folder")
        files += sorted(place.rglob("*.mcap")) if place.is_dir() else [place]
    continuations = {part for file in files for part in parts(file)[1:]}
    return [file for file in dict.fromkeys(files) if file not in continuations]


def entry(path: Path, *, whole: bool = False) -> Entry:
    """Return what a recording tells of itself.

    Args:
        path: of its first part.
        whole: whether a file that does not tell everything is read from its beginning to its end.

    Raises:
        RecordingError: it is no recording.
        RigError: the notes on it are not readable.
    """
    files = parts(path)
    accounts = []
    for number, file in enumerate(files):
        with Recording(file) as recording:
            if number == 0:
                description, toml = recording.description, recording.rig_toml
            accounts.append(_account(recording, whole))
    meta = dict(description.meta)
    for note in notes_of(path):
        meta |= note.meta
    certificates = [certificate for certificate, _overview in accounts if certificate]
    last = accounts[-1][0]
    return Entry(
        path=path,
        parts=len(files),
        bytes=sum(file.stat().st_size for file in files),
        rig=description.rig,
        bearing=_bearing(toml),
        mode=description.mode,
        run=description.run,
        t0_ns=description.t0_ns,
        duration=(last.first_sample + last.expected) / description.rate if last else None,
        lost=sum(each.lost for each in certificates) if len(certificates) == len(files) else None,
        overview=_together([overview for _certificate, overview in accounts]),
        meta=meta,
    )


def _account(recording: Recording, whole: bool) -> tuple[Certificate | None, Overview | None]:
    """Return the account of one file and what happened in it, as far as it tells."""
    certificate, overview = None, None
    if recording.complete:  # others would be searched through
        certificate = recording.certificate
        told = recording.notes.get(RECORD)
        overview = Overview.from_metadata(told) if told else None
    if whole and certificate is None:
        certificate = recording.check().certificate
    if whole and overview is None:
        overview = Overview()
        for message in recording.messages(*topics(recording.description.rig), heal=True):
            overview.take(message.key, message.payload)
    return certificate, overview


def _together(overviews: list[Overview | None]) -> Overview | None:
    """Return what happened in all parts; None when one does not tell."""
    total = Overview()
    for each in overviews:
        if each is None:
            return None
        total.add(each)
    return total


def _bearing(toml: str) -> str:
    """Return the kind of backup bearing; its table alone is read, since the whole takes ten times as long."""
    table = toml.partition("\n[backup_bearing]\n")[2].partition("\n[")[0]
    try:
        return str(tomllib.loads(table).get("kind", ""))
    except tomllib.TOMLDecodeError:
        return ""
