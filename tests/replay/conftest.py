"""Fixtures of players on a rig with ports of its own."""

import subprocess
import sys
from pathlib import Path

import pytest

from tests.daq.broadcast import rig_with_ports


@pytest.fixture
def rig(tmp_path):
    """The rig, and the file of its description."""
    return rig_with_ports(tmp_path)


@pytest.fixture
def start(tmp_path, rig):
    """Start players; end those that are left."""
    started = []

    def run(*words: object) -> subprocess.Popen:
        arguments = [sys.executable, "-P", "-m", "replay", "play", *words, "--rig", rig[1]]
        with (tmp_path / f"player{len(started)}.log").open("w") as log:
            process = subprocess.Popen(
                [str(each) for each in arguments],
                stdin=subprocess.PIPE,
                stdout=log,
                stderr=subprocess.STDOUT,
            )
        process.log = Path(log.name)
        started.append(process)
        return process

    yield run
    for process in started:
        process.kill()
        process.stdin.close()
        process.wait()
