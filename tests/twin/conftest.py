"""Fixtures of recorders on a rig with ports of its own."""

import sys

import pytest

from tests.daq.broadcast import rig_with_ports
from tests.started import started

RECORD = (sys.executable, "-P", "-m", "twin", "record")


@pytest.fixture
def rig(tmp_path):
    """The rig, and the file of its description."""
    return rig_with_ports(tmp_path)


@pytest.fixture
def start(tmp_path, rig):
    """Start recorders; end those that are left."""
    with started(tmp_path, "recorder") as run:
        yield lambda path, *options, before=None: run(
            [*RECORD, "--rig", rig[1], "--file", path, *options], before
        )
