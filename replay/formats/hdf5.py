"""HDF5: a group named as the series with a data set for each channel; missing samples are NaN.

What holds for all stands as attributes of the group, a channel's unit and place as those of its data set;
`gaps` is a data set of the first and last index of each missing stretch. MATLAB reads it with `h5read`.
"""

from collections.abc import Iterable
from pathlib import Path

import numpy as np

from daq.optional import optional
from daq.recording import Signals
from daq.recording.signals import EXTRA
from replay.formats.head import Head

CHUNK = 65536  # samples that lie together


def write(path: Path, head: Head, pieces: Iterable[Signals]) -> None:
    """Write the file; its data sets grow with each piece."""
    h5py = optional("h5py", "HDF5", EXTRA)
    with h5py.File(path, "x") as file:
        group = file.create_group(head.series)
        group.attrs.update(head.facts())
        sets = []
        for column in head.columns:
            data = group.create_dataset(column.name, (0,), np.float32, maxshape=(None,), chunks=(CHUNK,))
            data.attrs.update(column.facts())
            sets.append(data)
        gaps: list[tuple[int, int]] = []
        for piece in pieces:
            for data, row in zip(sets, piece.samples, strict=True):
                size = data.shape[0]
                data.resize((size + len(row),))
                data[size:] = row
            gaps += piece.gaps
        file["gaps"] = np.array(gaps, np.int64).reshape(-1, 2)
