"""Reads HDF5: columns are one-dimensional data sets of numbers, named by their path.

Rate and start are the attributes `rate_hz` and `start` of the file or of the group that holds the first
column.
"""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from daq.optional import optional
from daq.recording import RecordingError
from daq.recording.signals import EXTRA
from replay.channel_map import Layout
from replay.sources import Columns, Source, common_length, ns_of, sliced

NUMBERS = "fiu"  # kinds of data


@contextmanager
def opened(path: Path, layout: Layout) -> Iterator[Source]:
    """Give the file's data sets, read from the disk as they are asked for."""
    h5py = optional("h5py", "HDF5", EXTRA)
    try:
        file = h5py.File(path)
    except OSError as error:
        raise RecordingError(f"{path} is not readable as HDF5: {error}") from error
    with file:
        columns: dict[str, Any] = {}

        def note(name: str, thing: Any) -> None:
            if isinstance(thing, h5py.Dataset) and thing.ndim == 1 and thing.dtype.kind in NUMBERS:
                columns[name] = thing

        file.visititems(note)

        def pieces(names: Sequence[str]) -> Iterator[Columns]:
            length = common_length({name: len(columns[name]) for name in names}, path)
            return sliced(lambda name, begin, end: columns[name][begin:end], length, names)

        told = dict(file.attrs)
        for column in list(columns.values())[:1]:
            told |= dict(column.parent.attrs)
        rate = told.get("rate_hz")
        yield Source(
            tuple(columns), pieces, None if rate is None else float(rate), ns_of(str(told.get("start", "")))
        )
