"""MATLAB, version 5 files: a single-precision column for each channel, NaN where samples are missing.

The struct `about` holds rate, start and origin, structs `unit`, `station_m` and `angle_deg` by channel, and
`gaps`: first and last index of each missing stretch. The format has room for 2 GiB a variable, 5.9 h at
25 kHz; one channel at a time is in memory.
"""

import re
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from daq.recording import RecordingError, Signals
from replay.formats.head import Head
from replay.formats.spool import Spool

LARGEST = 2**31 - 1024  # bytes of a variable
LONGEST = 63  # letters of a name


def write(path: Path, head: Head, pieces: Iterable[Signals]) -> None:
    """Write the file, variable by variable."""
    from scipy.io import savemat

    with Spool(path.parent, pieces) as spool, path.open("xb") as file:
        if len(spool) * 4 > LARGEST:
            raise RecordingError(
                f"{path}: {len(spool)} samples a channel are more than a .mat file has room for: export to "
                ".h5, which MATLAB reads with h5read, or a shorter stretch"
            )
        savemat(file, {"about": _about(head, spool.gaps)}, long_field_names=True)
        for number, name in enumerate(variables(head)):
            samples = np.concatenate([*spool.row(number)])
            savemat(file, {name: samples}, long_field_names=True, oned_as="column")


def variables(head: Head) -> list[str]:
    """Return the channels' names as MATLAB allows them, each one different."""
    names: list[str] = []
    for column in head.columns:
        name = re.sub(r"\W", "_", column.name, flags=re.ASCII)[: LONGEST - 4]
        name = name if name[:1].isalpha() else f"c_{name}"
        names.append(name if name not in names else f"{name}_{len(names)}")
    return names


def _about(head: Head, gaps: list[tuple[int, int]]) -> dict[str, Any]:
    about: dict[str, Any] = {**head.facts(), "gaps": np.array(gaps, float).reshape(-1, 2)}
    for fact in ("unit", "station_m", "angle_deg"):
        columns = zip(variables(head), head.columns, strict=True)
        about[fact] = {name: column.facts()[fact] for name, column in columns if fact in column.facts()}
    return {name: value for name, value in about.items() if not (isinstance(value, dict) and not value)}
