"""Reads a stretch of a recording piece by piece, in order and without a hole, however long it is."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from itertools import chain
from pathlib import Path

import numpy as np

from daq import keys
from daq.messages import Series, decode_series, read_header
from daq.recording import Recording, RecordingError, Signals, parts, series_end
from daq.recording.certificate import SERIES
from daq.recording.reader import SERIES_KEYS
from daq.recording.signals import joined
from daq.series_layout import SeriesDecoder

WINDOW = 1 << 17  # samples of the index that a piece holds at most: 5 s at 25 kHz; no message holds more
Progress = Callable[[int], object]


class Stretch:
    """Channels of one series of a recording and its continuations, from one sample to another.

    Args:
        path: recording.
        series: block, estimate, smoothed or truth.
        names: channels wanted, in this order; None: all.
        first: index of the first sample wanted.
        last: index of the last sample wanted; None: the last there is.

    Raises:
        RecordingError: the file cannot be read, or has no such series.
    """

    def __init__(
        self,
        path: str | Path,
        series: str = "block",
        names: Sequence[str] | None = None,
        first: int = 0,
        last: int | None = None,
    ) -> None:
        if series not in SERIES_KEYS:
            raise RecordingError(f"no series is named {series!r}: there are {', '.join(SERIES_KEYS)}")
        self.files = [Recording(part) for part in parts(path)]
        self.path = self.files[0].path
        self.description = self.files[0].description
        self.series = series
        self.first = first
        self.end = max(map(_end, self.files))
        """Index behind the last sample that can be there."""
        if last is not None:
            self.end = min(self.end, last + 1)
        self._names = names
        self._topic = SERIES_KEYS[series](self.description.rig)

    def __enter__(self) -> "Stretch":
        return self

    def __exit__(self, *_: object) -> None:
        for file in self.files:
            file.close()

    @property
    def damage(self) -> list[str]:
        """What was found cut off or damaged, in plain words."""
        return [f"{file.path}: {fault}" for file in self.files for fault in file.damage]

    def pieces(self, progress: Progress = lambda sample: None) -> Iterator[Signals]:
        """Yield what is there, from its first sample to its last, with NaN where samples are missing.

        Args:
            progress: called with the index behind each piece.

        Raises:
            RecordingError: there are no such samples, or no such channel.
        """
        expected: int | None = None
        for found in self._windows():
            first = self.first if expected is None else expected
            piece = joined(found, self._names, first, self.end - 1, f"{self.path}: {self.series}")
            if not piece.samples.shape[1]:
                continue
            if expected is not None:
                yield from _missing(piece, expected)
            yield piece
            expected = piece.first_sample + piece.stride * piece.samples.shape[1]
            progress(expected)
        if expected is None:
            raise RecordingError(
                f"{self.path}: no samples of {self.series} from index {self.first} to {self.end - 1}"
            )

    def _windows(self) -> Iterator[list[Series]]:
        """Yield the messages of one window after the other, by their first sample."""
        decoder = SeriesDecoder()
        for begin in range(max(0, self.first - WINDOW), self.end, WINDOW):
            last = min(begin + WINDOW, self.end) - 1
            messages = (file.messages_between(self._topic, first=begin, last=last) for file in self.files)
            window = [decoder.decode(message.payload) for message in chain.from_iterable(messages)]
            found = [series for series in window if series_end(series) > self.first]
            if found:
                yield sorted(found, key=lambda series: series.first_sample)


def _end(file: Recording) -> int:
    """Return an index that no sample of a file is at or behind."""
    stored = file.certificate
    if stored is not None:
        return stored.first_sample + stored.expected
    last = [(keys.topic(topic).message in SERIES, message.payload) for topic, message in file.last().items()]
    ends = [
        series_end(decode_series(payload)) if is_series else read_header(payload).sample + 1
        for is_series, payload in last
    ]
    return max(ends, default=0)


def _missing(following: Signals, expected: int) -> Iterator[Signals]:
    """Yield NaN from `expected` to the piece that follows; the first of these pieces names the gap."""
    gaps: tuple[tuple[int, int], ...] = ((expected, following.first_sample - 1),)
    for begin in range(expected, following.first_sample, WINDOW):
        end = min(begin + WINDOW, following.first_sample)
        columns = -(-(end - begin) // following.stride)
        samples = np.full((len(following.names), columns), np.nan, np.float32)
        yield replace(following, first_sample=begin, samples=samples, gaps=gaps)
        gaps = ()
