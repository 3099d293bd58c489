"""The processes of a run: started with a pipe that each holds, ended by closing it.

Every child keeps the reading end of a pipe as its standard input. The end of that pipe is the order to
finish, whether it was closed on purpose or because this process died: each child then does what is safe
for it (the daq brings the rotor to rest, the recorder writes its certificate). Children run in sessions
of their own, so that Ctrl-C in the terminal reaches the supervisor alone.
"""

import os
import subprocess
import sys
import time
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

NICENESS = {"daq": -10, "operator": -10, "recorder": -5, "display": 10}
"""Who goes first on a busy computer: whoever protects the rig, then whoever records, at last whoever shows.
Going before others needs a privilege; without it these processes are as all others.
"""


class Child:
    """One child process with its log file and the pipe that keeps it alive."""

    def __init__(self, name: str, arguments: Sequence[str], folder: Path, niceness: int = 0) -> None:
        self.name = name
        self.arguments = list(arguments)
        self.log = folder / f"{name}.log"
        with self.log.open("ab") as log:
            self._log_start = log.tell()
            # -P keeps the working directory, which may hold a folder named daq or twin, out of the path.
            self._process = subprocess.Popen(
                [sys.executable, "-P", "-m", *self.arguments],
                stdin=subprocess.PIPE,
                stdout=log,
                stderr=subprocess.STDOUT,
                start_new_session=True,
            )
        if niceness:
            set_niceness(self._process.pid, niceness)

    @property
    def pid(self) -> int:
        """Process id."""
        return self._process.pid

    @property
    def exit_code(self) -> int | None:
        """Exit status once the process has ended, negative for a signal; None while it runs."""
        return self._process.poll()

    def order_end(self) -> None:
        """Close the child's pipe: the order to finish in its own way."""
        if self._process.stdin and not self._process.stdin.closed:
            self._process.stdin.close()

    def wait(self, seconds: float) -> bool:
        """Wait until the process has ended; say whether it has."""
        try:
            self._process.wait(seconds)
        except subprocess.TimeoutExpired:
            return False
        return True

    def kill(self) -> None:
        """End the process at once."""
        self._process.kill()
        self._process.wait()

    def said(self) -> list[str]:
        """Lines that this process has written so far."""
        with self.log.open("rb") as log:
            log.seek(self._log_start)
            return log.read().decode(errors="replace").splitlines()

    def last_words(self) -> str:
        """Its last line, for an explanation of why it ended."""
        lines = [line for line in self.said() if line.strip()]
        return lines[-1].strip() if lines else "it said nothing"


def set_niceness(pid: int, niceness: int) -> None:
    """Let a process that leads its session go before (negative) or after others, where the system allows it.

    Linux may schedule whole sessions against each other (sched(7), autogroup); a process' own niceness then
    counts only within its session, so that of the session is set too.
    """
    with suppress(OSError):
        os.setpriority(os.PRIO_PROCESS, pid, niceness)
    with suppress(OSError):
        Path(f"/proc/{pid}/autogroup").write_text(str(niceness))


class Crew:
    """The children of a run, by name."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._children: dict[str, Child] = {}

    def start(self, name: str, *arguments: str) -> Child:
        """Start a child, or start one anew under the same name."""
        child = Child(name, arguments, self.folder, NICENESS.get(name, 0))
        self._children[name] = child
        return child

    def get(self, name: str) -> Child | None:
        """The child of that name, or None where this run has none."""
        return self._children.get(name)

    def ended(self) -> list[Child]:
        """Take out and return the children that have ended."""
        gone = [child for child in self._children.values() if child.exit_code is not None]
        for child in gone:
            del self._children[child.name]
            child.order_end()
        return gone

    def finish(self, order: Sequence[str], seconds: float) -> list[str]:
        """End the children one after another in `order`, then the rest; return who had to be killed."""
        killed = []
        names = [name for name in order if name in self._children]
        names += [name for name in self._children if name not in names]
        deadline = time.monotonic() + seconds
        for name in names:
            child = self._children[name]
            child.order_end()
            if not child.wait(max(1.0, deadline - time.monotonic())):
                child.kill()
                killed.append(name)
        return killed
