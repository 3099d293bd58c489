"""ASAM MDF 4.1: one channel group with a time channel in s from the start; missing samples are NaN.

Units stand where the format has them, the rest as text: of a channel in its comment, of the file in its
header, as JSON.
"""

import json
from collections.abc import Iterable
from pathlib import Path

import numpy as np

from daq.optional import optional
from daq.recording import Signals
from daq.recording.signals import EXTRA
from replay.formats.head import Head


def write(path: Path, head: Head, pieces: Iterable[Signals]) -> None:
    """Write the file; its package collects the pieces in a file of its own until the end."""
    asammdf = optional("asammdf", "MDF", EXTRA)
    gaps: list[tuple[int, int]] = []
    size = 0
    with asammdf.MDF(version="4.10") as file:
        file.header.abs_time = head.start_ns
        for piece in pieces:
            time = (size + np.arange(piece.samples.shape[1])) / head.rate
            if size == 0:
                file.append(
                    [
                        asammdf.Signal(
                            row, time, column.unit, column.name, comment=json.dumps(column.facts())
                        )
                        for column, row in zip(head.columns, piece.samples, strict=True)
                    ],
                    comment=head.series,
                )
            else:
                file.extend(0, [(time, None), *((row, None) for row in piece.samples)])
            size += len(time)
            gaps += piece.gaps
        file.header.comment = json.dumps(head.facts() | {"gaps": gaps})
        file.save(path)
