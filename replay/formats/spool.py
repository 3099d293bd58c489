"""Keeps an export's samples on the disk for formats that hold one channel after the other."""

import tempfile
from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np

from daq.messages import Samples
from daq.recording import Signals


class Spool:
    """The samples of all pieces, to be read channel by channel. A context manager.

    Args:
        folder: where the nameless file is made, which vanishes when it is closed.
        pieces: all of the same channels; they are taken in at once.
    """

    def __init__(self, folder: Path, pieces: Iterable[Signals]) -> None:
        self.gaps: list[tuple[int, int]] = []
        """First and last index of each missing stretch."""
        self._lengths: list[int] = []
        self._n_channels = 0
        self._file = tempfile.TemporaryFile(dir=folder)  # noqa: SIM115 closed on exit
        try:
            for piece in pieces:
                self._n_channels, length = piece.samples.shape
                self._lengths.append(length)
                self.gaps += piece.gaps
                self._file.write(np.ascontiguousarray(piece.samples).data)
        except BaseException:
            self._file.close()
            raise

    def __enter__(self) -> "Spool":
        return self

    def __exit__(self, *_: object) -> None:
        self._file.close()

    def __len__(self) -> int:
        """Samples of each channel."""
        return sum(self._lengths)

    def row(self, number: int) -> Iterator[Samples]:
        """Yield one channel's samples piece by piece."""
        begin = 0
        for length in self._lengths:
            self._file.seek((begin + number * length) * 4)
            yield np.frombuffer(self._file.read(length * 4), np.float32)
            begin += self._n_channels * length
