"""Reads comma-separated text: a line of names, then a line for each sample; an empty field is no value.

Lines before the names that begin with # are comments; `# rate_hz: 25000` and `# start: 2026-01-31T12:00:00Z`
among them say when the samples were taken.
"""

import csv
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from itertools import takewhile
from pathlib import Path

import numpy as np
import pyarrow as pa
from pyarrow import csv as arrow_csv

from daq.recording import RecordingError
from replay.channel_map import Layout
from replay.sources import Columns, Source, ns_of

BLOCK = 1 << 23  # bytes of text that are read at a time


@contextmanager
def opened(path: Path, layout: Layout) -> Iterator[Source]:
    """Give the file's columns, read line by line."""
    with path.open(encoding="utf-8-sig", errors="replace", newline="") as file:
        comments = list(takewhile(lambda line: line.startswith("#"), file))
        file.seek(0)
        for _line in comments:
            file.readline()
        names = tuple(name.strip() for name in next(csv.reader(file, delimiter=layout.delimiter), []))
    if not names:
        raise RecordingError(f"{path}: there is no line of names")
    told = {name.strip(): value.strip() for name, _, value in (line[1:].partition(":") for line in comments)}

    def pieces(wanted: Sequence[str]) -> Iterator[Columns]:
        try:
            reader = arrow_csv.open_csv(
                path,
                read_options=arrow_csv.ReadOptions(
                    block_size=BLOCK, skip_rows=len(comments) + 1, column_names=names
                ),
                parse_options=arrow_csv.ParseOptions(delimiter=layout.delimiter),
                convert_options=arrow_csv.ConvertOptions(
                    include_columns=list(dict.fromkeys(wanted)),
                    column_types=dict.fromkeys(wanted, pa.float64()),
                    decimal_point=layout.decimal,
                    null_values=["", "nan", "NaN"],
                ),
            )
            for batch in reader:
                yield np.array([batch.column(name).to_numpy(zero_copy_only=False) for name in wanted])
        except pa.ArrowInvalid as error:
            raise RecordingError(f"{path}: {str(error).splitlines()[0]}") from error

    try:
        rate = float(told["rate_hz"]) if "rate_hz" in told else None
    except ValueError:
        raise RecordingError(f"{path}: rate_hz {told['rate_hz']!r} is not a number") from None
    yield Source(names, pieces, rate, ns_of(told.get("start", "")))
