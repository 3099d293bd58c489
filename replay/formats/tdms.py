"""NI TDMS: a group named as the series, its channels as waveforms; missing samples are NaN.

Properties: `wf_start_time`, `wf_increment` and `unit_string` as LabVIEW and DIAdem read them, quantity,
station and angle of a channel; of the group `gaps`, the first and last index of each missing stretch.
"""

import json
from collections.abc import Iterable
from pathlib import Path

from daq.optional import optional
from daq.recording import Signals
from daq.recording.signals import EXTRA
from replay.formats.head import Head


def write(path: Path, head: Head, pieces: Iterable[Signals]) -> None:
    """Write the file, a segment for each piece."""
    nptdms = optional("nptdms", "TDMS", EXTRA)
    waveform = {"wf_start_time": head.start, "wf_start_offset": 0.0, "wf_increment": 1.0 / head.rate}
    properties = [
        waveform | {"unit_string": column.unit} | column.facts() if column.unit else waveform | column.facts()
        for column in head.columns
    ]
    gaps: list[tuple[int, int]] = []
    with nptdms.TdmsWriter(path) as writer:
        writer.write_segment(nptdms.RootObject(head.facts()), nptdms.GroupObject(head.series))
        for piece in pieces:
            writer.write_segment(
                nptdms.ChannelObject(head.series, column.name, row, said)
                for column, row, said in zip(head.columns, piece.samples, properties, strict=True)
            )
            properties = [{} for _ in head.columns]
            gaps += piece.gaps
        writer.write_segment(nptdms.GroupObject(head.series, {"gaps": json.dumps(gaps)}))
