"""Fixtures of players on a rig with ports of its own."""

import sys

import pytest

from tests.daq.broadcast import rig_with_ports
from tests.started import started

PLAY = (sys.executable, "-P", "-m", "replay", "play")


@pytest.fixture
def rig(tmp_path):
    """The rig, and the file of its description."""
    return rig_with_ports(tmp_path)


@pytest.fixture
def start(tmp_path, rig):
    """Start players; end those that are left."""
    with started(tmp_path, "player") as run:
        yield lambda *words: run([*PLAY, *words, "--rig", rig[1]])
