"""Readers that are not ours, in Rust and JavaScript, find in a recording what ours finds."""

import json
import os
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from daq import keys
from daq.messages_pb2 import Summary
from daq.recording import Recording
from recordings.reference import REFERENCES
from tests.conftest import require
from tests.recordings.make_fixture import FOLDER

BALL = REFERENCES[0].path
RIG = "thesis-ball"
SCRIPT = Path(__file__).with_name("read_with_node.cjs")
PACKAGES = ("@mcap/core", "@mcap/nodejs", "fzstd", "protobufjs")


PLOTTED = {  # what the how-to promises that programs for MCAP files plot without a plug-in
    "daq/summary": {"speed_hz", "radius_maximum", "force_maximum"},
    "daq/summary/force_top": {"mean", "rms", "minimum", "maximum"},
    "twin/summary": {"amplitude_1x", "orbit_maximum", "contact_force_maximum", "impacts", "residual_rms"},
}


def has_packages() -> bool:
    node = shutil.which("node")
    found = f"for (const each of {json.dumps(PACKAGES)}) require(each)"
    return node is not None and subprocess.run([node, "-e", found], capture_output=True).returncode == 0


@pytest.mark.parametrize("path", [BALL, *sorted(FOLDER.glob("*.mcap"))], ids=lambda path: path.stem)
def test_javascript_reads_the_same_numbers(path):
    require(has_packages(), f"node and, in a folder that NODE_PATH names, {', '.join(PACKAGES)}")
    said = subprocess.run(["node", SCRIPT, path], capture_output=True, text=True, timeout=120, env=os.environ)
    assert said.returncode == 0, said.stderr
    found = json.loads(said.stdout)
    with Recording(path) as recording:
        signals = recording.series()
        assert found["counts"] == recording.certificate.messages
        summaries = recording.messages(keys.summary(recording.description.rig))
        speeds = [Summary.FromString(message.payload).speed_hz for message in summaries]
    assert list(found["channels"]) == list(signals.names)
    for name, unit in zip(signals.names, signals.units, strict=True):
        last = float(signals[name][-1])
        assert found["channels"][name] == {"unit": unit, "count": len(signals[name]), "last": last}
    assert found["speeds"] == speeds
    assert {"description", "versions", "certificate"} <= set(found["notes"])
    for topic in found["counts"]:
        assert PLOTTED.get(topic.removeprefix(f"rig/{RIG}/"), set()) <= set(found["numbers"][topic])
    assert f"rig/{RIG}/daq/summary" in found["counts"]


def test_rust_reads_the_same_numbers():
    chunk = pytest.importorskip("rerun.chunk")
    reader = chunk.McapReader(BALL, decoders=["protobuf"], include_topic_regex=[r"daq/(block|summary)$"])
    forces: dict[int, list[float]] = {}  # by the first sample: its chunks may come in any order
    speeds: dict[int, float] = {}
    for piece in reader.stream():
        batch = piece.to_record_batch()
        for name in batch.schema.names:
            if name.endswith(":message"):
                rows = [row for rows in batch.column(name).to_pylist() for row in rows]
                if "Block" in name:
                    forces |= {row["first_sample"]: row["channels"][2]["samples"] for row in rows}
                else:
                    speeds |= {row["first_sample"]: row["speed_hz"] for row in rows}
    with Recording(BALL) as recording:
        joined = np.concatenate([np.float32(forces[first]) for first in sorted(forces)])
        np.testing.assert_array_equal(joined, recording.series()["force_top"])
        summaries = [Summary.FromString(message.payload) for message in recording.messages(keys.summary(RIG))]
    assert speeds == {summary.first_sample: summary.speed_hz for summary in summaries}
