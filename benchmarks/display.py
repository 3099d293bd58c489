"""What showing one rig costs at real time: the display's share of a core, its memory and what it sends.

A made-up run with all channels and the twin's estimate is published at real time over a real link. A
program that writes all it is sent into a file stands for the viewer.
"""

import os
import subprocess
import tempfile
import time
from pathlib import Path

from benchmarks.report import Figure, parser, show
from daq import keys
from tests.twin.display_process import Display, Source, rig_on_free_ports
from tests.twin.drawn_run import messages
from twin.display_address import find
from twin.viewer import HOST, program

WARM_UP = 3.0  # s that are left out
SECONDS = 20.0
MINUTE = 60.0


def measured(folder: Path) -> dict[str, Figure]:
    """Run once and return the figures."""
    rig = rig_on_free_ports()
    sent = folder / "sent.rrd"
    run = list(messages(rig, "run", WARM_UP + SECONDS))
    per_second = len(run) / (WARM_UP + SECONDS)
    raw = sum(len(payload) for key, payload in run if key in (keys.block(rig.name), keys.estimate(rig.name)))
    with Source(rig) as source, Display(rig, folder) as display:
        display.address()
        source.wait_for_display()
        with viewer(find(rig.name).data, sent):
            pid = display.process.pid
            source.publish(run[: round(WARM_UP * per_second)], speed=1.0)
            wall, cpu, size = time.monotonic(), cpu_time(pid), sent.stat().st_size
            source.publish(run[round(WARM_UP * per_second) :], speed=1.0)
            wall, cpu = time.monotonic() - wall, cpu_time(pid) - cpu
            time.sleep(1.0)
            size = sent.stat().st_size - size
            memory = memory_used(pid)
        display.end()
    incoming = raw * MINUTE / (WARM_UP + SECONDS) / 1e6
    return {
        "cpu_display": Figure(cpu / wall, "core", 1.0, "one core"),
        "sent_a_minute": Figure(size * MINUTE / SECONDS / 1e6, "MB", incoming, "what it takes in"),
        "memory": Figure(memory / 1e6, "MB", 256.0, "what is kept for late viewers at most"),
    }


class viewer:  # noqa: N801 - reads as a function in `with`
    """A program that takes all that the display sends and writes it into a file."""

    def __init__(self, address: str, target: Path) -> None:
        command = [program(), "--bind", HOST, "--port", "auto", "--save", str(target), address]
        environment = {**os.environ, "RERUN_APP_ONLY": "true"}
        self._process = subprocess.Popen(
            command, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
        )
        deadline = time.monotonic() + 30.0
        while not target.exists() and time.monotonic() < deadline:
            time.sleep(0.05)

    def __enter__(self) -> "viewer":
        return self

    def __exit__(self, *_: object) -> None:
        self._process.terminate()
        self._process.wait()


def cpu_time(pid: int) -> float:
    """CPU time in s that a process has used, in all its threads."""
    words = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(words[11]) + int(words[12])) / os.sysconf("SC_CLK_TCK")


def memory_used(pid: int) -> int:
    """Resident memory of a process in bytes."""
    return int(Path(f"/proc/{pid}/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")


def main() -> None:
    options = parser(__doc__).parse_args()
    with tempfile.TemporaryDirectory() as folder:
        os.environ["RIGTWIN_RUNTIME_DIR"] = folder
        show(measured(Path(folder)), options.json)


if __name__ == "__main__":
    main()
