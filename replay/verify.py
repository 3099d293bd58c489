"""Proves a recording: runs the twin over its blocks again and compares with the recorded estimates."""

from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from daq.messages import Series
from daq.recording import Check
from daq.recording.fingerprint import numeric_fingerprint
from replay.comparison import Comparison, Difference, Scales
from replay.history import History, RepeatableRun
from replay.rerun import Progress, Repetition

BOUND = 1e-6
"""Share of a channel's largest magnitude by which an estimate computed on another computer may differ."""

WHOLE, NOT_KNOWN = "fingerprint", "not known"
IDENTICAL, EQUIVALENT, DIFFERENT = "identical", "equivalent", "different"
SHOWN = 5  # notes of one sort as text


class VerifyError(ValueError):
    """There is nothing to verify; the message says what to do."""


@dataclass(frozen=True)
class Verdict:
    """What came of running the twin again.

    Attributes:
        file: the recording.
        verdict: identical, equivalent or different.
        reason: why it is not better, in plain words.
        estimates: messages compared.
        sessions: processes of the twin that were repeated.
        same_fingerprint: whether it was recorded with the numeric fingerprint of this computer.
        changed: what differs in the fingerprint, (recorded, here) by name.
        bound: share of a channel's largest magnitude that counts as equivalent.
        largest: largest difference, as such a share.
        first: the first difference that counts, None when there is none.
        notes: what could not be repeated or is missing, in plain words.
    """

    file: str
    verdict: str
    reason: str
    estimates: int
    sessions: int
    same_fingerprint: bool
    changed: dict[str, tuple[str, str]]
    bound: float
    largest: float
    first: Difference | None
    notes: tuple[str, ...]

    def to_json(self) -> dict[str, Any]:
        """Return the fields as JSON takes them."""
        first = self.first.to_json() if self.first else None
        largest = self.largest if self.largest < float("inf") else None
        return asdict(self) | {"first": first, "largest": largest}


def verify(path: str | Path, progress: Progress = lambda sample: None) -> Verdict:
    """Run the twin over a recording's blocks as it ran live, and compare the estimates.

    Args:
        path: recording; its continuations are taken along.
        progress: called with the index behind each block.

    Raises:
        RecordingError: the recording cannot be read.
        VerifyError: it holds no estimates.
        RigError: its rig description is lost or not understood.
    """
    with RepeatableRun(path) as run:
        checks = run.check_files()
        altered = [check for check in checks if check.verdict == "altered"]
        history = run.history()
        if not history.end:
            raise VerifyError(
                f"{path} holds no estimates to verify: `rigtwin twin {path} -o OUT` makes one that does"
            )
        changed = changes(run)
        comparison = Comparison(BOUND, scales(run))
        if not altered:
            compare(run, Repetition(run, history, progress), comparison)
        return judge(run, comparison, history, changed, checks)


def scales(run: RepeatableRun) -> Scales:
    """Return the largest magnitude of each channel of the recorded estimates."""
    found = Scales()
    for series in run.decoded("estimate"):
        found.take(series)
    return found


def compare(run: RepeatableRun, repetition: Repetition, comparison: Comparison) -> None:
    """Compare each recorded estimate with that of the process of the twin that made it."""
    blocks = repetition.blocks()
    ahead: dict[int, dict[int, Series]] = {}
    reached = latest = -1
    for recorded in run.decoded("estimate"):
        while reached < recorded.first_sample and (made := next(blocks, None)) is not None:
            reached = made[0]
            ahead[reached] = made[1]
        candidates = ahead.pop(recorded.first_sample, {})
        number = comparison.nearest(recorded, candidates)
        if number is None:
            comparison.missing(recorded)
            continue
        if (
            number > repetition.current
        ):  # the one before had died: what follows its last estimate it never made
            repetition.current = number
            ahead = {sample: found for sample, found in ahead.items() if sample < latest}
        latest = max(latest, recorded.first_sample)
        comparison.take(recorded, candidates[number])
    comparison.unrecorded = sum(bool(found) for sample, found in ahead.items() if sample < latest)


def changes(run: RepeatableRun) -> dict[str, tuple[str, str]]:
    """Return in what the recording's numeric fingerprints differ from this computer's."""
    here = numeric_fingerprint()
    found: dict[str, tuple[str, str]] = {}
    for file in run.files:
        told = file.fingerprint
        if not told:
            return {WHOLE: (NOT_KNOWN, here["functions"])}
        for name in here | told:
            before, now = told.get(name, NOT_KNOWN), here.get(name, NOT_KNOWN)
            if before != now:
                found[name] = before, now
    return found


def judge(
    run: RepeatableRun,
    comparison: Comparison,
    history: History,
    changed: dict[str, tuple[str, str]],
    checks: list[Check],
) -> Verdict:
    """Return the verdict."""
    altered = [check.reason for check in checks if check.verdict == "altered"]
    first = comparison.beyond if changed else comparison.unequal
    if altered:
        verdict, reason = DIFFERENT, f"the recording was altered: {altered[0]}; nothing was compared"
    elif first is not None:
        verdict, reason = DIFFERENT, _why(first, bool(changed))
    elif changed:
        equal = "; every bit is equal" if comparison.unequal is None else ""
        verdict = EQUIVALENT
        reason = f"{_where(changed)}{equal}"
    else:
        verdict, reason = IDENTICAL, ""
    return Verdict(
        file=str(run.path),
        verdict=verdict,
        reason=reason,
        estimates=comparison.compared,
        sessions=len(history.sessions),
        same_fingerprint=not changed,
        changed=changed,
        bound=comparison.bound,
        largest=comparison.largest,
        first=first,
        notes=tuple(_notes(run, comparison, history, checks)),
    )


def text(verdict: Verdict) -> str:
    """Return a verdict for people to read."""
    lines = [f"{verdict.file}: {verdict.verdict}" + (f": {verdict.reason}" if verdict.reason else "")]
    if verdict.estimates:
        lines.append(
            f"{verdict.estimates} estimates compared; largest difference {verdict.largest:.2g} of a "
            f"channel's largest magnitude, the bound on another computer is {verdict.bound:.0e}"
        )
    if verdict.first is not None:
        lines.append(f"first difference: {verdict.first}")
    lines += [
        f"{name}: recorded with {before}, here {now}" for name, (before, now) in verdict.changed.items()
    ]
    return "\n".join([*lines, *verdict.notes])


def _where(changed: dict[str, tuple[str, str]]) -> str:
    if WHOLE in changed:
        return "the numeric fingerprint that it was recorded with is not known"
    return f"recorded with another numeric fingerprint ({', '.join(changed)})"


def _why(first: Difference, other_computer: bool) -> str:
    if not first.channel:
        return "the twin does not make the same messages of the same blocks"
    if other_computer:
        return "the twin's answer differs by more than another computer explains"
    return "the twin gives another answer on a computer of the same numeric fingerprint"


def _notes(
    run: RepeatableRun, comparison: Comparison, history: History, checks: list[Check]
) -> Iterator[str]:
    """Yield what could not be repeated, and what is not whole."""
    for file, check in zip(run.files, checks, strict=True):
        if check.verdict not in ("valid", "altered"):
            yield f"{file.path.name} is {check.verdict}: {check.reason}"
    if comparison.unrecorded:
        yield f"estimates that the twin made but the recording lacks: {comparison.unrecorded}"
    stretches = history.unseen(run.blocks)
    for first, last in stretches[:SHOWN]:
        yield (
            f"samples {first} to {last} reached the twin but not the recording: what follows cannot be "
            "repeated exactly"
        )
    if len(stretches) > SHOWN:
        yield f"and {len(stretches) - SHOWN} more such stretches"
