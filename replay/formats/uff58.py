"""Universal File Format, data set 58 (function at nodal degree of freedom), binary: one for each channel.

Samples are single precision, NaN where they are missing. The channel's number is the response node, its
angle the direction where that is one of the axes. The format gives the sampling interval six digits; the
exact rate stands in ID line 5, first and last index of each missing stretch in ID line 4, as far as they
fit. Format: Structural Dynamics Research Laboratory, University of Cincinnati, "Universal File Formats".
"""

from collections.abc import Iterable
from pathlib import Path

from daq.recording import Signals
from replay.formats.head import Column, Head
from replay.formats.spool import Spool

LINE = 80  # letters
DATA_TYPES = {"displacement": 8, "velocity": 11, "acceleration": 12, "force": 13, "temperature": 5}
DIRECTIONS = {0.0: 1, 90.0: 2, 180.0: -1, 270.0: -2}  # by the angle: +x, +y, -x, -y
TIME = 17  # kind of data: time
TIME_RESPONSE = 1  # kind of function
SINGLE = 2  # kind of number: real, four bytes
LITTLE_ENDIAN, IEEE = 1, 2
HEADER_LINES = 11


def write(path: Path, head: Head, pieces: Iterable[Signals]) -> None:
    """Write the file, a data set for each channel."""
    with Spool(path.parent, pieces) as spool, path.open("xb") as file:
        for number, column in enumerate(head.columns):
            lines = _header(head, column, number + 1, len(spool), spool.gaps)
            file.write("".join(f"{line}\n" for line in lines).encode("ascii", "replace"))
            for piece in spool.row(number):
                file.write(piece.astype("<f4", copy=False).data)
            file.write(b"\n    -1\n")


def _header(head: Head, column: Column, node: int, size: int, gaps: list[tuple[int, int]]) -> list[str]:
    """Return what stands before a channel's samples."""
    place = ", ".join(f"{name} {value:g}" for name, value in _place(column).items())
    direction = DIRECTIONS.get((column.angle_deg or 0.0) % 360.0, 0) if column.angle_deg is not None else 0
    kind = DATA_TYPES.get(column.quantity, 0)
    missing = " ".join(f"{first}-{last}" for first, last in gaps)
    texts = [
        f"{column.name} {place}",
        f"rig {head.rig}, {head.series}, run {head.run}",
        f"{head.start}Z",
        f"missing samples: {missing or 'none'}",
        f"rate {head.rate!r} Hz, first sample {head.first_sample}, step {head.stride}, {head.mode}",
    ]
    step = 1.0 / head.rate
    return [
        f"{-1:6d}",
        f"{58:6d}b{LITTLE_ENDIAN:6d}{IEEE:6d}{HEADER_LINES:12d}{4 * size:12d}{0:6d}{0:6d}{0:12d}{0:12d}",
        *(text[:LINE].ljust(LINE) for text in texts),
        f"{TIME_RESPONSE:5d}{node:10d}{0:5d}{0:10d}"
        f" {'NONE':10}{node:10d}{direction:4d} {'NONE':10}{0:10d}{0:4d}",
        f"{SINGLE:10d}{size:10d}{1:10d}{0.0:13.5e}{step:13.5e}{0.0:13.5e}",
        _axis(TIME, "Time", "s"),
        _axis(kind, column.name, column.unit),
        _axis(0, "NONE", "NONE"),
        _axis(0, "NONE", "NONE"),
    ]


def _axis(kind: int, label: str, unit: str) -> str:
    return f"{kind:10d}{0:5d}{0:5d}{0:5d} {label[:20]:20} {unit[:20]:20}"


def _place(column: Column) -> dict[str, float]:
    known = {"station_m": column.station, "angle_deg": column.angle_deg}
    return {name: value for name, value in known.items() if value is not None}
