"""Writes a stretch of a recording in another file format, piece by piece."""

from collections.abc import Iterator, Sequence
from contextlib import suppress
from itertools import chain
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

from daq.recording import Signals, prepare
from daq.recording.storage import refusal
from daq.rig import RigError, rig_from_text
from daq.rig.channels import Channel
from replay.formats import writer_for
from replay.formats.head import Column, Head
from replay.pieces import Progress, Stretch


class Exported(NamedTuple):
    """What was written."""

    path: Path
    channels: int
    samples: int
    """Of each channel, with those that are missing."""
    rate: float
    """Samples of a channel in a second."""
    gaps: list[tuple[int, int]]
    """First and last index of each stretch that is missing."""
    damage: list[str]
    """What was wrong with the recording, in plain words."""


def export(
    source: str | Path,
    target: str | Path,
    *,
    series: str = "block",
    names: Sequence[str] | None = None,
    first: int = 0,
    last: int | None = None,
    progress: Progress = lambda sample: None,
) -> Exported:
    """Write channels of a recording to a file whose suffix names the format.

    The file appears under its name when it is whole. A long recording is read and written piece by piece.

    Args:
        source: recording; its continuations are taken along.
        target: file to make: .tdms, .h5, .mf4, .mat, .uff, .parquet, .wav or .csv; never overwritten.
        series: block (what was measured), estimate (the twin's), smoothed (its motion with hindsight) or
            truth (an emulated rig's).
        names: channels wanted, in this order; None: all.
        first: index of the first sample wanted.
        last: index of the last sample wanted; None: the last there is.
        progress: called with the sample index behind each piece.

    Raises:
        RecordingError: the source cannot be read, has no such samples or channels, or the target cannot be
            written or is in no format that is known.
        MissingPackage: the format needs a package that is not installed.
    """
    write = writer_for(Path(target))
    with Stretch(source, series, names, first, last) as stretch:
        target = prepare(target)
        pieces = stretch.pieces(progress)
        beginning = next(pieces)
        count = _Count()
        with TemporaryDirectory(prefix=".export-", dir=target.parent) as folder:
            unfinished = Path(folder) / target.name
            try:
                write(unfinished, _head(stretch, beginning), count.through(chain([beginning], pieces)))
                unfinished.rename(prepare(target))
            except OSError as error:
                raise refusal(target, error) from error
        return Exported(
            target,
            len(beginning.names),
            count.samples,
            beginning.column_rate,
            count.gaps,
            stretch.damage,
        )


class _Count:
    """Counts what passes through."""

    def __init__(self) -> None:
        self.samples = 0
        self.gaps: list[tuple[int, int]] = []

    def through(self, pieces: Iterator[Signals]) -> Iterator[Signals]:
        """Yield the pieces."""
        for piece in pieces:
            self.samples += piece.samples.shape[1]
            self.gaps += piece.gaps
            yield piece


def _head(stretch: Stretch, piece: Signals) -> Head:
    """Return what the file says of its samples; `piece` is the first one."""
    description = stretch.description
    known: dict[str, Channel] = {}
    with suppress(RigError):  # a description that this version does not understand: places are not known
        known = {channel.name: channel for channel in rig_from_text(description.toml).channels}
    of_rig = known if stretch.series == "block" else {}
    return Head(
        rig=description.rig,
        run=description.run,
        mode=description.mode,
        series=stretch.series,
        first_sample=piece.first_sample,
        stride=piece.stride,
        index_rate=piece.rate,
        t0_ns=description.t0_ns,
        columns=tuple(
            _column(name, unit, of_rig.get(name)) for name, unit in zip(piece.names, piece.units, strict=True)
        ),
    )


def _column(name: str, unit: str, channel: Channel | None) -> Column:
    if channel is None:
        return Column(name, unit)
    return Column(name, unit, channel.quantity, channel.station, channel.angle_deg, channel.full_scale)
