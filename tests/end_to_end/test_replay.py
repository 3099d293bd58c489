"""`rigtwin replay` at a terminal: steered by keys and by commands from elsewhere."""

import os
import pty
import subprocess
import sys
import time

import pytest

from daq.describe import LIVE
from daq.runtime import claim
from recordings.reference import REFERENCES
from rigtwin.cli import main
from tests.end_to_end.rig_process import PATIENCE, rigtwin

BALL = REFERENCES[0].path
RIG = "thesis-ball"


class Terminal:
    """A command with a terminal of its own."""

    def __init__(self, *arguments: object, cwd) -> None:
        self.own, other = pty.openpty()
        command = [sys.executable, "-P", "-m", "rigtwin", *map(str, arguments)]
        self.process = subprocess.Popen(command, cwd=cwd, stdin=other, stdout=other, stderr=other)
        os.close(other)
        os.set_blocking(self.own, False)
        self.said = ""

    def press(self, key: str) -> None:
        os.write(self.own, key.encode())

    def wait_for(self, *texts: str) -> str:
        """Read on until it has printed one of `texts`; forget all up to there, and return which."""
        deadline = time.monotonic() + PATIENCE
        while not (found := [text for text in texts if text in self.said]):
            assert time.monotonic() < deadline, f"{texts} were not printed: ...{self.said[-500:]}"
            self.read()
        text = min(found, key=self.said.index)
        self.said = self.said.partition(text)[2]
        return text

    def read(self) -> None:
        time.sleep(0.02)
        try:
            self.said += os.read(self.own, 65536).decode(errors="replace")
        except BlockingIOError:
            pass
        except OSError:  # its other end is closed
            assert self.process.poll() is not None

    def wait(self) -> int:
        deadline = time.monotonic() + PATIENCE
        while self.process.poll() is None:
            assert time.monotonic() < deadline, self.said[-500:]
            self.read()
        return self.process.returncode

    def close(self) -> None:
        self.process.kill()
        self.process.wait()
        os.close(self.own)


@pytest.fixture
def replaying(tmp_path):
    terminal = Terminal("replay", BALL, "--view", "none", "--recorded-twin", "--loop", cwd=tmp_path)
    yield terminal
    terminal.close()


def test_keys_and_commands_steer_it(tmp_path, replaying):
    replaying.wait_for("keys: space pause")
    replaying.wait_for("started")
    replaying.press(" ")
    replaying.wait_for("paused at ")
    sought = rigtwin("command", "seek", "0.5", cwd=tmp_path)
    assert (sought.returncode, sought.stdout) == (0, "at 0.500 s, paused in a loop\n")
    replaying.press("\x1b[D")
    replaying.wait_for("at 0.000 s, paused in a loop")
    replaying.press("-")
    replaying.wait_for("at 0.5 times real time")
    replaying.press(" ")
    while replaying.wait_for("going on from 0.", "paused at ") != "going on from 0.":
        replaying.press(" ")  # pressed before the status that says that it is paused, it paused once more
    armed = rigtwin("command", "arm", cwd=tmp_path)
    assert armed.returncode == 2
    assert "is a replay, in which nothing moves: its commands are pause, resume" in armed.stderr
    wrong = rigtwin("command", "seek", "99", cwd=tmp_path)
    assert wrong.returncode == 1
    assert "refused: seek takes a time from 0 to" in wrong.stdout
    replaying.press("q")
    assert replaying.wait() == 0


def test_a_live_rig_is_not_replayed_into_and_takes_no_commands_of_a_replay(tmp_path, capsys):
    with claim(RIG, {"mode": LIVE}):
        assert main(["replay", str(BALL), "--view", "none"]) == 2
        assert f"rig '{RIG}' is already running" in capsys.readouterr().err
        assert main(["command", "pause"]) == 2
        assert f"pause is for a replay, and {RIG} is LIVE" in capsys.readouterr().err
