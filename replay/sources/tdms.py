"""Reads NI TDMS: columns are `group/channel`, rate and start those of the first waveform."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from daq.optional import optional
from daq.recording import RecordingError
from daq.recording.signals import EXTRA
from replay.channel_map import Layout
from replay.sources import Columns, Source, common_length, sliced


@contextmanager
def opened(path: Path, layout: Layout) -> Iterator[Source]:
    """Give the file's channels, read from the disk as they are asked for."""
    nptdms = optional("nptdms", "TDMS", EXTRA)
    with path.open("rb") as stream:
        try:
            file = nptdms.TdmsFile.open(stream)
        except (ValueError, KeyError) as error:
            raise RecordingError(f"{path} is not readable as TDMS: {error}") from error
        channels = {f"{group.name}/{each.name}": each for group in file.groups() for each in group.channels()}

        def pieces(names: Sequence[str]) -> Iterator[Columns]:
            length = common_length({name: len(channels[name]) for name in names}, path)
            return sliced(lambda name, begin, end: channels[name][begin:end], length, names)

        told: dict[str, Any] = next(
            (each.properties for each in channels.values() if "wf_increment" in each.properties), {}
        )
        step, start = told.get("wf_increment"), told.get("wf_start_time")
        start_ns = None if start is None else int(np.datetime64(start, "ns").astype(np.int64))
        yield Source(tuple(channels), pieces, 1.0 / step if step else None, start_ns)
