"""Makes a recording of another program's file, so that its samples are replayed and twinned as live ones."""

from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from numpy.typing import NDArray

from daq.describe import IMPORTED, describe
from daq.events import EventLog
from daq.guard import guard_of
from daq.messages import BlockStatus, Samples
from daq.messages_pb2 import WARNING
from daq.recording import RecordingError, RecordingWriter, prepare
from daq.recording.certificate import Certificate
from daq.recording.storage import refusal
from daq.rig import Rig
from daq.stream import Stream
from daq.timing import StartTime
from replay.channel_map import ChannelMap, Layout
from replay.pieces import Progress
from replay.sources import Source, open_source, resolve

SAME_RATE = 1e-6  # share by which a told rate may differ from the rig's
UNEVEN = 0.5  # samples by which a time may differ from its index


def import_file(
    source: str | Path,
    target: str | Path,
    rig: Rig,
    channel_map: ChannelMap,
    progress: Progress = lambda sample: None,
) -> Certificate:
    """Write a recording with the samples of a TDMS, HDF5 or CSV file.

    A sample for which any column has no value is left out: it becomes a gap, as in a live recording. The
    recording appears under its name when it is whole.

    Args:
        source: file to read, piece by piece.
        target: recording to make; never overwritten.
        rig: what the samples were measured on; its rate is that of the file.
        channel_map: from `load_map`, for this rig's channels.
        progress: called with the sample index behind each piece.

    Raises:
        RecordingError: the source cannot be read or does not fit, or the target cannot be written.
        MissingPackage: the format needs a package that is not installed.
    """
    path, target = Path(source).expanduser(), prepare(target)
    with (
        open_source(path, channel_map.layout) as opened,
        TemporaryDirectory(prefix=".import-", dir=target.parent) as folder,
    ):
        _check_rate(opened, channel_map.layout, rig, path)
        start = _start(opened, channel_map, path)
        description = describe(rig, f"{rig.name}-imported-{start.t0_ns}", start, emulated=False)
        description.mode = IMPORTED
        unfinished = Path(folder) / target.name
        try:
            with RecordingWriter(unfinished, description) as writer:
                writer.note("imported", {"source": path.name, "map": channel_map.text})
                importer = _Importer(rig, start, writer)
                for values in _values(opened, channel_map, rig, path):
                    importer.take(values)
                    progress(importer.sample)
                importer.end()
                if not importer.sample:
                    raise RecordingError(f"{path}: there are no samples")
                certificate = writer.close(expected=importer.sample)
            unfinished.rename(prepare(target))
        except OSError as error:
            raise refusal(target, error) from error
    return certificate


class _Importer:
    """Publishes samples into a recording as an acquisition does."""

    def __init__(self, rig: Rig, start: StartTime, writer: RecordingWriter) -> None:
        self.sample = 0
        """Index of the next sample."""
        run, self._rate = writer.ledger.run, rig.acquisition.rate
        self._stream = Stream(rig, guard_of(rig), run, start, writer.add)
        self._events = EventLog(rig, run, start, writer.add)
        self._published = 0  # index behind the last sample that was there
        self._events.add("start", f"run {run} of {rig.name} was imported", 0, details={"run": run})

    def take(self, values: Samples) -> None:
        """Publish (n_channels, n) samples but those where a channel has no value."""
        for first, end in _stretches(np.isfinite(values).all(axis=0)):
            index, status = self.sample + first, 0
            if index > self._published:
                self._note_gap(self._published, index - 1)
                status = int(BlockStatus.GAP_BEFORE)
            self._stream.add(values[:, first:end], index, status)
            self._published = self.sample + end
        self.sample += values.shape[1]

    def end(self) -> None:
        """Publish what is left and the run's end."""
        self._stream.flush()
        if self.sample > self._published:
            self._note_gap(self._published, self.sample - 1)
        text = f"run ended after {self.sample / self._rate:.2f} s"
        self._events.add("end", text, self.sample, details={"samples": self.sample})

    def _note_gap(self, first: int, last: int) -> None:
        missing, cause = last - first + 1, "the imported file has no values"
        text = f"{missing} samples missing ({missing / self._rate:.3f} s): {cause}"
        self._events.add("gap", text, first, WARNING, {"first": first, "last": last, "cause": cause})


def _values(source: Source, channel_map: ChannelMap, rig: Rig, path: Path) -> Iterator[Samples]:
    """Yield the rig's channels in SI units, (n_channels, n)."""
    wanted = channel_map.sources
    columns = [resolve(name, source, path) for name in wanted]
    time = channel_map.layout.time
    begin, origin = 0, 0.0
    for piece in source.pieces(columns):
        readings = dict(zip(wanted, piece, strict=True))
        if time:
            origin = origin if begin else float(readings[time][0])
            _check_even(readings[time] - origin, begin, rig.acquisition.rate, path)
        yield channel_map.channels(readings, piece.shape[1])
        begin += piece.shape[1]


def _stretches(there: Any) -> list[tuple[int, int]]:
    """Return first and end of each stretch of samples that are there, of booleans (n,)."""
    edges = np.flatnonzero(np.diff(there.astype(np.int8), prepend=0, append=0))
    return [(int(first), int(end)) for first, end in edges.reshape(-1, 2)]


def _check_rate(source: Source, layout: Layout, rig: Rig, path: Path) -> None:
    """Compare the file's rate, or the map's, with the rig's."""
    told, rate = layout.rate or source.rate, rig.acquisition.rate
    if told is None and layout.time is None:
        raise RecordingError(
            f"{path} does not say its sample rate: write rate or time, the name of a column, into the map"
        )
    if told is not None and abs(told - rate) > SAME_RATE * rate:
        raise RecordingError(
            f"{path} has {told:g} samples a second, {rig.name} {rate:g}: set acquisition.rate, "
            "read and block of the rig description to fit the file"
        )


def _check_even(times: NDArray[np.float64], begin: int, rate: float, path: Path) -> None:
    """Refuse times (s since the first) that are not those of the samples."""
    error = np.abs(times * rate - np.arange(begin, begin + len(times)))
    wrong = np.flatnonzero(error > UNEVEN)
    if wrong.size:
        raise RecordingError(
            f"{path}: sample {begin + wrong[0]} stands at {times[wrong[0]]:.6g} s, which does not fit "
            f"{rate:g} samples a second: resample the file, or correct the rig's rate"
        )


def _start(source: Source, channel_map: ChannelMap, path: Path) -> StartTime:
    """Return when the first sample was, by the map, the file or, failing these, the file's date."""
    if channel_map.start_ns is not None:
        return StartTime(channel_map.start_ns, 0, "channel map")
    if source.start_ns is not None:
        return StartTime(source.start_ns, 0, "imported file")
    return StartTime(path.stat().st_mtime_ns, 0, "date of the imported file")
