"""Helpers to run `rigtwin` as a user does, and to find the processes that it started."""

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path

from tests.conftest import require

PATIENT = ("--set", "command.lease=10")
"""For runs that are not about the lease: two busy cores may hold an operator up for longer than 0.1 s."""
PATIENCE = 120.0  # s: bound on every wait; generous, as two busy cores also compile kernels


def rigtwin(
    *arguments: object, cwd: Path, timeout: float = PATIENCE, through: Sequence[str] = ()
) -> subprocess.CompletedProcess[str]:
    """Run one command to its end, `through` another program that starts it."""
    return subprocess.run(
        [*through, sys.executable, "-P", "-m", "rigtwin", *map(str, arguments)],
        cwd=cwd,
        capture_output=True,
        text=True,
        timeout=timeout,
    )


def info(path: Path) -> dict:
    """What `rigtwin info --json` says of a recording."""
    result = rigtwin("info", path, "--json", cwd=path.parent)
    assert result.returncode in (0, 1), result.stderr
    return json.loads(result.stdout)


class Running:
    """`rigtwin live` (or replay) in the background; killed with its children when the test is over.

    `through` is another program that starts it in its own place.
    """

    def __init__(self, *arguments: object, cwd: Path, through: Sequence[str] = ()) -> None:
        self.output = cwd / f"{arguments[0]}.out"
        with self.output.open("wb") as output:
            self.process = subprocess.Popen(
                [*through, sys.executable, "-P", "-m", "rigtwin", *map(str, arguments)],
                cwd=cwd,
                stdout=output,
                stderr=subprocess.STDOUT,
                stdin=subprocess.DEVNULL,
                start_new_session=True,
            )
        self.children: dict[str, int] = {}

    def __enter__(self) -> "Running":
        return self

    def __exit__(self, *_: object) -> None:
        self.find_children()
        for pid in [self.process.pid, *self.children.values()]:
            with_pid(pid, signal.SIGKILL)
        self.process.wait()

    def said(self) -> str:
        """All that it printed so far."""
        return self.output.read_text(errors="replace")

    def wait_for(self, text: str) -> None:
        """Wait until it has printed `text`."""
        wait_until(lambda: text in self.said() or self.process.poll() is not None, f"{text!r} to be printed")
        assert text in self.said(), self.said()

    def wait_until(self, condition: Callable[[], bool], what: str, seconds: float = PATIENCE) -> None:
        """Wait for a condition while it runs; fail the test with what it printed when that never comes."""
        try:
            wait_until(lambda: condition() or self.process.poll() is not None, what, seconds)
        except AssertionError as error:
            raise AssertionError(f"{error}; it printed:\n{self.said()}") from None
        assert condition(), f"it ended before {what}:\n{self.said()}"

    def wait(self) -> int:
        """Wait for its end and return its exit code."""
        return self.process.wait(PATIENCE)

    def interrupt(self) -> int:
        """Press Ctrl-C, wait for its end, and return its exit code."""
        self.process.send_signal(signal.SIGINT)
        return self.wait()

    def find_children(self) -> dict[str, int]:
        """Process ids of the present children by name; those found before are kept when orphaned."""
        for pid in children_of(self.process.pid):
            words = command_line(pid)
            if "-m" in words:
                module, verb = words[words.index("-m") + 1 :][:2]
                self.children[NAMES.get((module, verb), verb)] = pid
        return self.children

    def child(self, name: str) -> int:
        """Process id of one child, once it is there."""
        wait_until(lambda: name in self.find_children(), f"{name} to start")
        return self.children[name]


NAMES = {
    ("daq", "acquire"): "daq",
    ("daq", "operate"): "operator",
    ("twin", "observe"): "twin",
    ("twin", "record"): "recorder",
    ("twin", "display"): "display",
    ("replay", "play"): "player",
}


def obeying_permissions() -> list[str]:
    """What to start a program through so that it may write only where its user is permitted to.

    Root loses its right to write everywhere; it stays root, in whose folder Python may be.
    """
    if os.geteuid() != 0:
        return []
    require(shutil.which("setpriv") is not None, "setpriv, to give up root's right to write everywhere")
    return ["setpriv", "--bounding-set=-dac_override,-dac_read_search"]


def wait_until(condition: Callable[[], bool], what: str, seconds: float = PATIENCE) -> None:
    """Wait for a condition; fail the test when it never comes."""
    deadline = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < deadline, f"waited {seconds:.0f} s in vain for {what}"
        time.sleep(0.05)


def children_of(parent: int) -> list[int]:
    """Process ids whose parent is `parent` (Linux)."""
    found = []
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            stat = (folder / "stat").read_text()
        except OSError:
            continue
        if int(stat.rsplit(")", 1)[1].split()[1]) == parent:
            found.append(int(folder.name))
    return found


def command_line(pid: int) -> list[str]:
    """The words with which a process was started."""
    try:
        return Path(f"/proc/{pid}/cmdline").read_bytes().decode().split("\0")
    except OSError:
        return []


def with_pid(pid: int, number: signal.Signals) -> None:
    """Send a signal, unless the process is gone."""
    try:
        os.kill(pid, number)
    except ProcessLookupError:
        return


def gone(pid: int) -> bool:
    """Whether a process has ended (a zombie has)."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0] == "Z"
    except OSError:
        return True
