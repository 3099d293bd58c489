"""Tells what is in a recording: as a plain dictionary, as text, and in one line."""

from collections.abc import Callable
from contextlib import suppress
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from daq.messages import Series
from daq.messages_pb2 import Event, Severity
from daq.recording import Check, parts
from daq.recording.notes import notes_of
from daq.recording.recorded_run import RecordedRun
from daq.rig import rig_from_text
from replay import found

__all__ = ["brief", "info", "parts", "text"]

EVENTS = 20  # shown as text
STRETCHES = 10


class Peaks:
    """Smallest and largest value of each channel of the blocks, in the channels' units."""

    def __init__(self) -> None:
        self.names: tuple[str, ...] = ()
        self.units: tuple[str, ...] = ()
        self._low = self._high = np.empty(0, np.float32)

    def take(self, series: Series) -> None:
        """Take in a block."""
        low, high = series.samples.min(axis=1), series.samples.max(axis=1)
        if series.names != self.names:
            self.names, self.units = series.names, series.units
            self._low, self._high = low, high
        self._low, self._high = np.fmin(self._low, low), np.fmax(self._high, high)

    def rows(self, toml: str) -> list[dict[str, Any]]:
        """Return name, unit, minimum, maximum and how people want to see it, of each channel."""
        display = display_units(toml)
        columns = zip(self.names, self.units, self._low.tolist(), self._high.tolist(), strict=True)
        return [
            {"name": name, "unit": unit, "minimum": low, "maximum": high, **display(name, unit)}
            for name, unit, low, high in columns
        ]


def info(path: str | Path) -> dict[str, Any]:
    """Return what is in a recording and its continuations, the account made anew.

    SI units; times in s since sample 0.

    Raises:
        RecordingError: no such file, or no recording.
    """
    with RecordedRun(path) as run:
        description = run.description
        peaks = Peaks()
        check = run.check(peaks.take)
        account = check.certificate
        rate = description.rate
        return {
            "file": str(run.path),
            "bytes": sum(file.path.stat().st_size for file in run.files),
            "rig": description.rig,
            "mode": description.mode,
            "run": description.run,
            "part": run.files[0].part,
            "continuations": [str(part) for part in parts(run.path)[1:]],
            "start": utc(description.t0_ns),
            "start_uncertainty": description.t0_uncertainty_ns / 1e9,
            "start_source": description.t0_source,
            "rate": rate,
            "first_sample": account.first_sample,
            "samples": account.received,
            "lost": account.lost,
            "duration": account.expected / rate,
            "gaps": [list(gap) for gap in account.gaps],
            "left_out": [list(stretch) for stretch in account.left_out],
            "late_blocks": account.late,
            "channels": peaks.rows(description.toml),
            "events": [_event(event, rate) for event in run.events()],
            "messages": account.messages,
            "twin": found.facts(found.last_summary(run.files[-1])),
            "certificate": _certificate(run, check),
            "digests": {"file": account.file_digest, "signals": account.signal_digests},
            "versions": dict(description.versions),
            "meta": dict(description.meta),
            "notes": [note._asdict() for note in notes_of(run.path)],
        }


def text(facts: dict[str, Any]) -> str:
    """Return what `info` found for people to read, in the channels' display units."""
    accuracy = f"{facts['start_uncertainty'] * 1e3:.3g} ms ({facts['start_source']})"
    lines = [
        f"file         {facts['file']} ({facts['bytes'] / 1e6:.1f} MB)",
        f"rig          {facts['rig']}, {facts['mode'] or 'mode not known'}, run {facts['run']}{_part(facts)}",
        f"start        {facts['start']} within {accuracy}",
        f"duration     {facts['duration']:.3f} s at {facts['rate']:g} Hz",
        f"samples      {facts['samples']} of each channel, {facts['lost']} lost",
        *_stretch_lines("gap", facts["gaps"], "gaps"),
        *_stretch_lines("left out", facts["left_out"], "stretches left out"),
        f"late blocks  {facts['late_blocks']}",
        f"certificate  {_verdict(facts)}",
        f"digest       {facts['digests']['file']}",
        "",
        f"{'channel':24}{'minimum':>14}{'maximum':>14}",
        *map(_channel_line, facts["channels"]),
        "",
        *_told_lines(facts),
        *_event_lines(facts),
        *found.lines(facts["twin"]),
    ]
    return "\n".join(lines)


def brief(path: str | Path) -> str:
    """Return a recording in one line."""
    facts = info(path)
    return (
        f"{facts['file']}: {facts['duration']:.1f} s of {facts['rig']}, {facts['samples']} samples, "
        f"{facts['lost']} lost, certificate {_verdict(facts)}"
    )


def display_units(toml: str) -> Callable[[str, str], dict[str, Any]]:
    """Return a function that gives a channel's display unit and how many of it make one SI unit."""
    known: dict[str, tuple[str, float]] = {}
    with suppress(ValueError):  # a description that this version does not understand: SI units are shown
        known = {each.name: (each.display_unit, each.display_scale) for each in rig_from_text(toml).channels}

    def display(name: str, unit: str) -> dict[str, Any]:
        display_unit, scale = known.get(name, (unit, 1.0))
        return {"display_unit": display_unit, "display_scale": scale}

    return display


def utc(ns: int) -> str:
    """Return ns since 1970 as UTC in ISO 8601, to the microsecond."""
    return datetime.fromtimestamp(ns // 10**9, UTC).replace(microsecond=ns % 10**9 // 1000).isoformat()


def _certificate(run: RecordedRun, check: Check) -> dict[str, Any]:
    stored = run.files[-1].certificate
    return {
        "verdict": check.verdict,
        "reason": check.reason,
        "expected": check.certificate.expected,
        "received": check.certificate.received,
        "clean": check.certificate.clean,
        "closed": all(file.complete for file in run.files),
        "fingerprint": stored.fingerprint if stored else {},
    }


def _event(event: Event, rate: float) -> dict[str, Any]:
    return {
        "time": event.sample / rate,
        "sample": event.sample,
        "severity": Severity.Name(event.severity),
        "source": event.source,
        "kind": event.kind,
        "text": event.text,
        "details": dict(event.details),
    }


def _verdict(facts: dict[str, Any]) -> str:
    verdict, reason = facts["certificate"]["verdict"], facts["certificate"]["reason"]
    return f"{verdict}: {reason}" if reason else verdict


def _part(facts: dict[str, Any]) -> str:
    names = [Path(name).name for name in facts["continuations"]]
    return (f", part {facts['part']}" if facts["part"] > 1 else "") + (
        f", goes on in {', '.join(names)}" if names else ""
    )


def _stretch_lines(name: str, stretches: list[list[int]], several: str) -> list[str]:
    lines = [f"{name:13}samples {first} to {last}" for first, last in stretches[:STRETCHES]]
    left = len(stretches) - STRETCHES
    return [*lines, f"{'':13}and {left} more {several}"] if left > 0 else lines


def _channel_line(row: dict[str, Any]) -> str:
    low, high = row["minimum"] * row["display_scale"], row["maximum"] * row["display_scale"]
    return f"{row['name']:24}{low:14.6g}{high:14.6g} {row['display_unit']}"


def _told_lines(facts: dict[str, Any]) -> list[str]:
    """Return what people told of the run, then and later."""
    lines = [f"{key:12} {value}" for key, value in facts["meta"].items()]
    for note in facts["notes"]:
        told = "".join(f" {key}={value}" for key, value in note["meta"].items())
        lines.append(f"note         {note['utc']} {note['who']}: {note['text']}{told}")
    return [*lines, ""] if lines else []


def _event_lines(facts: dict[str, Any]) -> list[str]:
    events = facts["events"]
    lines = [
        f"{event['time']:10.3f} s  {event['source']:9}{event['kind']:12}{event['text']}"
        for event in events[:EVENTS]
    ]
    more = (
        [f"             and {len(events) - EVENTS} more events; --json gives all"]
        if len(events) > EVENTS
        else []
    )
    return [f"{len(events)} events", *lines, *more]
