"""Notes on a recording that come later than the run: a TOML file beside it, which only grows.

The recording itself is never touched, so that its certificate stays true.
"""

from collections.abc import Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import NamedTuple

from daq.recording import RecordingError
from daq.rig import toml_source

SUFFIX = ".notes.toml"


TEXTS = ("utc", "who", "text")


class Note(NamedTuple):
    """One later note: when, by whom, what, and `key=value` texts as those of the recording."""

    utc: str  # ISO 8601
    who: str
    text: str
    meta: dict[str, str]


def sidecar(recording: str | Path) -> Path:
    """Return the file of a recording's notes, `run.notes.toml` beside `run.mcap`."""
    path = Path(recording).expanduser()
    return path.with_name(path.stem + SUFFIX)


def notes_of(recording: str | Path) -> list[Note]:
    """Return the notes on a recording, oldest first. Raises `RigError` when the file is no TOML."""
    path = sidecar(recording)
    if not path.exists():
        return []
    rows = toml_source.parse(toml_source.read(path), str(path)).get("note", [])
    return [
        Note(**{key: str(row.get(key, "")) for key in TEXTS}, meta=dict(row.get("meta", {}))) for row in rows
    ]


def add_note(recording: str | Path, who: str, text: str, meta: Mapping[str, str]) -> Path:
    """Append a note and return the file. Raises `RecordingError` when there is no such recording."""
    if not Path(recording).expanduser().is_file():
        raise RecordingError(f"{recording} does not exist: name the recording that the note is about")
    notes_of(recording)  # a file that somebody broke is not made longer
    row = {"utc": datetime.now(UTC).isoformat(timespec="seconds"), "who": who, "text": text}
    path = sidecar(recording)
    with path.open("a", encoding="utf-8") as file:
        file.write(f"[[note]]\n{toml_source.dump(row)}[note.meta]\n{toml_source.dump(meta)}\n")
    return path
