"""What other limits would have done on an old recording: the protection run again over its samples.

The protection is a pure function of samples and state, so the answer is what the daq itself would have
found on the same samples. The rig went on as it did, though: after a trip that did not happen then, what
follows is what the rig did untripped.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from daq.guard import Guard, guard_of
from daq.messages import Samples
from daq.protection import Trip, Warned, check, initial_state, reset, shown
from daq.recording import RecordingError
from daq.rig import Rig, RigError, rig_from_text, toml_source, with_overrides
from replay.history import RepeatableRun
from replay.rerun import Progress, rig_of


class Found(NamedTuple):
    """What one set of limits makes of a run."""

    trips: list[Trip]  # each would have been first-out, had the one before been reset when its cause was gone
    warnings: list[Warned]
    peaks: dict[str, float]  # largest value of each limited quantity, SI


class Answer(NamedTuple):
    """What the recorded limits and the others make of the same samples."""

    rate: float
    recorded: Found
    other: Found


def retrip(
    path: str | Path,
    limits: str | Path | None = None,
    settings: Sequence[str] = (),
    progress: Progress = lambda sample: None,
) -> Answer:
    """Run the protection over a recording with its own limits and with others.

    Args:
        path: recording; its continuations are taken along.
        limits: TOML file with tables `[limits.*]`, which replace those of the recorded rig key by key; a
            whole rig description will do.
        settings: `table.key=value`, applied after that.
        progress: called with the index behind each block.

    Raises:
        RecordingError: the recording cannot be read, or its blocks are not those of its rig.
        RigError: the limits are not valid for the rig.
    """
    with RepeatableRun(path) as run:
        rig = rig_of(run)
        other = with_overrides(with_limits(rig, limits) if limits else rig, settings)
        run.check()
        watches = [Watch(guard_of(rig)), Watch(guard_of(other))]
        for block in run.decoded("block"):
            if block.names != rig.channels.names:
                raise RecordingError(f"{run.path}: the blocks' channels are not those of its rig description")
            for watch in watches:
                watch.add(block.samples, block.first_sample)
            progress(block.first_sample + block.samples.shape[1])
    return Answer(rig.acquisition.rate, *(watch.found for watch in watches))


def with_limits(rig: Rig, path: str | Path) -> Rig:
    """Return the rig with the limits of a file. Raises `RigError`."""
    tables = toml_source.parse(toml_source.read(Path(path).expanduser()), str(path))
    if "limits" not in tables:
        raise RigError(f"{path} has no table [limits.displacement], [limits.force], ...")
    merged = toml_source.merge(toml_source.parse(rig.toml, rig.name), {"limits": tables["limits"]})
    return rig_from_text(toml_source.dump(merged), str(path))


class Watch:
    """The protection over successive blocks, reset as soon as it may be."""

    def __init__(self, guard: Guard) -> None:
        self.found = Found([], [], {condition.name: 0.0 for condition in guard.conditions})
        self._guard = guard
        self._state = initial_state(guard)

    def add(self, samples: Samples, first_sample: int) -> None:
        """Check one block."""
        verdict = check(samples, first_sample, self._state, self._guard)
        trips, warnings, peaks = self.found
        trips += [verdict.trip] if verdict.trip else []
        warnings += verdict.warnings
        for condition, now in zip(self._guard.conditions, verdict.state.conditions, strict=True):
            peaks[condition.name] = max(peaks[condition.name], now.maximum)
        self._state = verdict.state
        if self._state.first_out:
            self._state, _refused = reset(self._state, self._guard)


def text(answer: Answer) -> str:
    """Say what the other limits would have done, beside what the recorded ones do."""
    lines = [*_said("the recorded limits", answer.recorded, answer.rate)]
    lines += _said("the other limits", answer.other, answer.rate)
    peaks = ", ".join(
        f"{name.replace('_', ' ')} {shown(name, peak)}" for name, peak in answer.other.peaks.items()
    )
    return "\n".join([*lines, f"largest: {peaks}"])


def _said(which: str, found: Found, rate: float) -> list[str]:
    """Say what one set of limits makes of the run."""
    if not found.trips:
        return [f"{which} do not trip; {len(found.warnings)} warnings"]
    head = f"{which} trip {len(found.trips)} times, {len(found.warnings)} warnings; first:"
    return [head, *(f"  at {trip.sample / rate:9.4f} s: {trip.text}" for trip in found.trips[:3])]
