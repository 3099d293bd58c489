"""Comma-separated text: lines that begin with #, a line of names with units, and a line for each sample.

Time is in s since the run's sample 0. Numbers have the digits that give them back exactly. The fields of
missing samples are empty.
"""

import json
from collections.abc import Iterable
from pathlib import Path

import pyarrow as pa
from pyarrow import csv

from daq.recording import Signals
from replay.formats.head import Head


def write(path: Path, head: Head, pieces: Iterable[Signals]) -> None:
    """Write the file."""
    names = ["time [s]", *(f"{column.name} [{column.unit}]" for column in head.columns)]
    schema = pa.schema([(names[0], pa.float64()), *((name, pa.float32()) for name in names[1:])])
    with path.open("xb") as file:
        for name, value in head.facts().items():
            file.write(f"# {name}: {value}\n".encode())
        for column in head.columns:
            file.write(f"# channel {column.name}: {json.dumps(column.facts())}\n".encode())
        options = csv.WriteOptions(quoting_style="none", quoting_header="none")
        with csv.CSVWriter(file, schema, write_options=options) as writer:
            for piece in pieces:
                rows = [
                    pa.array(row, from_pandas=True) for row in piece.samples
                ]  # NaN becomes an empty field
                writer.write_table(pa.table([pa.array(piece.time), *rows], schema))
