"""Shows the recordings of a catalogue to people: as a list, or side by side."""

import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from daq.recording import Recording
from replay.catalogue import Entry
from replay.info import utc

UNKNOWN = "?"


def listing(entries: Sequence[Entry]) -> str:
    """Return a line for each recording, the oldest first."""
    head = ("start (UTC)", "s", "rig", "bearing", "Hz", "trips", "lost", "mode", "file")
    rows = [head, *(_row(entry) for entry in sorted(entries, key=lambda entry: entry.t0_ns))]
    return _table(rows, right={1, 4, 5, 6})


def comparison(entries: Sequence[Entry]) -> str:
    """Return what recordings tell, in a column each, and where their rig descriptions differ."""
    columns = [_facts(entry) for entry in entries]
    names = list(dict.fromkeys(name for column in columns for name in column))
    rigs = [_flat(tomllib.loads(_toml(entry.path))) for entry in entries]
    keys = list(dict.fromkeys(key for rig in rigs for key in rig))
    different = [key for key in keys if len({str(rig.get(key)) for rig in rigs}) > 1]
    rows = [
        *((name, *(column.get(name, "-") for column in columns)) for name in names),
        *((key, *(str(rig.get(key, "-")) for rig in rigs)) for key in different),
    ]
    return _table(rows, right=set())


def _row(entry: Entry) -> tuple[str, ...]:
    happened = entry.overview
    return (
        utc(entry.t0_ns)[:19].replace("T", " "),
        UNKNOWN if entry.duration is None else f"{entry.duration:.1f}",
        entry.rig,
        entry.bearing,
        f"{happened.max_speed_hz:.2f}" if happened else UNKNOWN,
        str(len(happened.trips)) if happened else UNKNOWN,
        UNKNOWN if entry.lost is None else str(entry.lost),
        entry.mode,
        str(entry.path) + (f" ({entry.parts} parts)" if entry.parts > 1 else ""),
    )


def _facts(entry: Entry) -> dict[str, str]:
    """Return what a recording tells, by what people call it."""
    happened = entry.overview
    facts = {
        "file": str(entry.path),
        "rig": entry.rig,
        "mode": entry.mode,
        "start (UTC)": utc(entry.t0_ns)[:19].replace("T", " "),
        "duration": UNKNOWN if entry.duration is None else f"{entry.duration:.3f} s",
        "lost": UNKNOWN if entry.lost is None else f"{entry.lost} samples",
        "size": f"{entry.bytes / 1e6:.1f} MB",
        "largest speed": f"{happened.max_speed_hz:.2f} Hz" if happened else UNKNOWN,
        "largest radius": f"{happened.radius_maximum * 1e6:.0f} µm" if happened else UNKNOWN,
        "largest force": f"{happened.force_maximum:.1f} N" if happened else UNKNOWN,
        "trips": (", ".join(happened.trips) or "none") if happened else UNKNOWN,
    }
    counts = happened.events if happened else {}
    return facts | {f"events {kind}": str(count) for kind, count in sorted(counts.items())} | entry.meta


def _toml(path: Path) -> str:
    with Recording(path) as recording:
        return recording.rig_toml


def _flat(tables: Any, place: str = "") -> dict[str, Any]:
    """Return the values of nested tables by their full keys; a row of an array goes by its name."""
    if isinstance(tables, list) and all(isinstance(row, dict) and "name" in row for row in tables):
        tables = {row["name"]: row for row in tables}
    if not isinstance(tables, dict):
        return {place: tables}
    found: dict[str, Any] = {}
    for key, value in tables.items():
        found |= _flat(value, f"{place}.{key}" if place else key)
    return found


def _table(rows: Sequence[Sequence[str]], right: set[int]) -> str:
    """Return rows with their columns under one another, those of the numbers `right` with their ends."""
    widths = [max(len(row[column]) for row in rows) for column in range(len(rows[0]))]
    lines = []
    for row in rows:
        cells = [
            text.rjust(widths[at]) if at in right else text.ljust(widths[at]) for at, text in enumerate(row)
        ]
        lines.append("  ".join(cells).rstrip())
    return "\n".join(lines)
