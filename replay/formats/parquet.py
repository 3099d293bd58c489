"""Apache Parquet: a column `time` in s since the run's sample 0 and one for each channel.

Missing samples are NaN. A channel's unit and place are metadata of its field; what holds for all, and
`gaps`, the first and last index of each missing stretch, are metadata of the file.
"""

import json
from collections.abc import Iterable
from pathlib import Path

import pyarrow as pa
from pyarrow import parquet

from daq.recording import Signals
from replay.formats.head import Head


def write(path: Path, head: Head, pieces: Iterable[Signals]) -> None:
    """Write the file, a row group for each piece."""
    schema = pa.schema(
        [
            pa.field("time", pa.float64(), metadata={"unit": "s"}),
            *(
                pa.field(column.name, pa.float32(), metadata=_texts(column.facts()))
                for column in head.columns
            ),
        ],
        metadata=_texts(head.facts()),
    )
    gaps: list[tuple[int, int]] = []
    with parquet.ParquetWriter(path, schema, compression="zstd") as writer:
        for piece in pieces:
            writer.write_table(pa.table([pa.array(piece.time), *map(pa.array, piece.samples)], schema))
            gaps += piece.gaps
        writer.add_key_value_metadata({"gaps": json.dumps(gaps)})


def _texts(facts: dict[str, str | float]) -> dict[str, str]:
    return {name: str(value) for name, value in facts.items()}
