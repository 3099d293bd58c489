"""What recorders in processes of their own said and recorded."""

import subprocess
from pathlib import Path

from daq import keys
from daq.recording import Recording
from tests.daq.recorded_run import RIG


def said(process: subprocess.Popen) -> list[str]:
    return process.log.read_text().splitlines()


def recorded(path: Path) -> list[tuple[str, bytes]]:
    """All messages but the statuses."""
    with Recording(path) as recording:
        return [(m.key, m.payload) for m in recording.messages() if not m.key.endswith("/status")]


def blocks(messages: list[tuple[str, bytes]]) -> list[bytes]:
    return [payload for key, payload in messages if key == keys.block(RIG)]
