"""Fixtures of recorders on a rig with ports of its own."""

import subprocess
import sys
from pathlib import Path

import pytest

from tests.daq.broadcast import rig_with_ports

RECORD = ("-P", "-m", "twin", "record")


@pytest.fixture
def rig(tmp_path):
    """The rig, and the file of its description."""
    return rig_with_ports(tmp_path)


@pytest.fixture
def start(tmp_path, rig):
    """Start recorders; end those that are left."""
    started = []

    def run(path: Path, *options: object, before=None) -> subprocess.Popen:
        arguments = [sys.executable, *RECORD, "--rig", rig[1], "--file", path, *options]
        with (tmp_path / f"recorder{len(started)}.log").open("w") as log:
            process = subprocess.Popen(
                [str(word) for word in arguments],
                stdin=subprocess.PIPE,
                stdout=log,
                stderr=subprocess.STDOUT,
                preexec_fn=before,
            )
        process.log = Path(log.name)
        started.append(process)
        return process

    yield run
    for process in started:
        process.kill()
        process.stdin.close()
        process.wait()
