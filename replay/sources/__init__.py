"""Files of other programs that recordings are made of: a table of formats, each a module with `opened`.

`opened(path, layout)` is a context manager that gives a `Source`, from which columns are read in pieces.
"""

from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager
from importlib import import_module
from pathlib import Path
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from daq.recording import RecordingError
from replay.channel_map import Layout
from simulator.validation import nearest

PIECE = 1 << 17  # samples of a channel that are read at a time

Columns = npt.NDArray[np.float64]
MODULES = {".tdms": "tdms", ".h5": "hdf5", ".hdf5": "hdf5", ".csv": "csv", ".txt": "csv"}


class Source(NamedTuple):
    """What a file holds."""

    names: tuple[str, ...]
    """Of its columns; those in folders or groups with their path."""
    pieces: Callable[[Sequence[str]], Iterator[Columns]]
    """Yields some columns as (n_columns, n), piece after piece; NaN where there is no value."""
    rate: float | None = None
    """Hz, where the file says it."""
    start_ns: int | None = None
    """UTC of the first sample in ns since 1970, where the file says it."""


def open_source(path: Path, layout: Layout) -> AbstractContextManager[Source]:
    """Open a file of the format that its suffix names.

    Raises:
        RecordingError: no such file, or no format that can be read.
        MissingPackage: the format needs a package that is not installed.
    """
    if path.suffix.lower() not in MODULES:
        known = ", ".join(MODULES)
        raise RecordingError(f"{path}: the suffix {path.suffix!r} cannot be imported: choose of {known}")
    if not path.is_file():
        raise RecordingError(f"{path}: no such file")
    opened: Callable[[Path, Layout], AbstractContextManager[Source]]
    opened = import_module(f"{__name__}.{MODULES[path.suffix.lower()]}").opened
    return opened(path, layout)


def resolve(wanted: str, source: Source, path: Path) -> str:
    """Return the column of that name; path and unit may be left out where one column alone is meant.

    Raises:
        RecordingError: there is no such column, or several.
    """
    if wanted in source.names:
        return wanted
    meant = [name for name in source.names if wanted in (name.rpartition("/")[2], name.partition(" [")[0])]
    if len(meant) == 1:
        return meant[0]
    if meant:
        raise RecordingError(f"{path}: {wanted!r} can be {' or '.join(meant)}: write one of them in the map")
    raise RecordingError(f"{path}: no column {wanted!r}{nearest(wanted, source.names, 'it has')}")


def sliced(read: Callable[[str, int, int], Columns], length: int, names: Sequence[str]) -> Iterator[Columns]:
    """Yield pieces of columns of equal length that are read by name, first and end."""
    for begin in range(0, length, PIECE):
        end = min(begin + PIECE, length)
        yield np.array([read(name, begin, end) for name in names], np.float64)


def common_length(lengths: dict[str, int], path: Path) -> int:
    """Return how long all columns are. Raises `RecordingError` when they differ."""
    if len(set(lengths.values())) > 1:
        told = ", ".join(f"{name} {length}" for name, length in lengths.items())
        raise RecordingError(f"{path}: the columns differ in length: {told}")
    return next(iter(lengths.values()))


def ns_of(text: str) -> int | None:
    """Return a date and time, UTC in ISO 8601, in ns since 1970; None when it is none, or before then."""
    try:
        ns = int(np.datetime64(text.removesuffix("Z").removesuffix("+00:00"), "ns").astype(np.int64))
    except ValueError:
        return None
    return ns if ns >= 0 else None
