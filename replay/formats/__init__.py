"""File formats that recordings are exported to: a table of them, each a module with one function `write`.

`write(path, head, pieces)` makes the file at `path` of the pieces, which come in order and without a hole:
where samples are missing they hold NaN. It reads one piece at a time, takes the missing stretches from the
pieces, and closes what it opened also when it is interrupted; its caller removes the file then.
"""

from collections.abc import Callable, Iterable
from importlib import import_module
from pathlib import Path
from typing import NamedTuple

from daq.recording import RecordingError, Signals
from replay.formats.head import Head

Write = Callable[[Path, Head, Iterable[Signals]], None]


class Format(NamedTuple):
    """A row of the table."""

    suffix: str
    module: str
    """In this package."""
    what: str
    """What people call it."""


FORMATS = (
    Format(".tdms", "tdms", "NI TDMS"),
    Format(".h5", "hdf5", "HDF5"),
    Format(".mf4", "mdf4", "ASAM MDF 4.1"),
    Format(".mat", "matlab", "MATLAB, version 5"),
    Format(".uff", "uff58", "Universal File Format 58, binary"),
    Format(".parquet", "parquet", "Apache Parquet"),
    Format(".wav", "wav", "WAV, 32 bit floating point"),
    Format(".csv", "csv", "comma-separated text"),
)


def writer_for(path: Path) -> Write:
    """Return the function that writes the format which a file's name asks for.

    Raises:
        RecordingError: no format has this suffix.
    """
    for row in FORMATS:
        if path.suffix.lower() == row.suffix:
            write: Write = import_module(f"{__name__}.{row.module}").write
            return write
    known = ", ".join(row.suffix for row in FORMATS)
    raise RecordingError(f"{path}: the suffix {path.suffix!r} is no format to export to: choose of {known}")
