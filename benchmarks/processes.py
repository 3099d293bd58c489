"""Share of a core that each process of a live run takes at real time, with impacts, on the shipped rig.

Processor time is taken from the operating system (Linux, /proc) between two moments of the run, so that
loading programs is left out.
"""

import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from benchmarks.report import Figure, parser, show

BEGIN, SECONDS = "step 2", 5.0  # measured from the plan's second step on, s
CHAIN = ("daq", "recorder", "twin", "operator")
NAMES = {"acquire": "daq", "operate": "operator", "observe": "twin", "record": "recorder"}


def shares(view: str, folder: Path) -> dict[str, float]:
    """Run live once and return each process' mean share of a core."""
    path, output = folder / f"{view}.mcap", folder / f"{view}.txt"
    command = ["-m", "rigtwin", "live", "--plan", "impacts", "--view", view, "--record", str(path)]
    with (
        output.open("w") as said,
        subprocess.Popen([sys.executable, "-P", *command], stdout=said, cwd=folder) as live,
    ):
        while BEGIN not in output.read_text():
            if live.poll() is not None:
                raise SystemExit(output.read_text())
            time.sleep(0.05)
        children = processes_of(live.pid)
        before, started = {name: cpu_time(pid) for name, pid in children.items()}, time.monotonic()
        time.sleep(SECONDS)
        after, elapsed = {name: cpu_time(pid) for name, pid in children.items()}, time.monotonic() - started
    return {name: (after[name] - before[name]) / elapsed for name in children}


def processes_of(parent: int) -> dict[str, int]:
    """Return the process ids of a run by name."""
    found = {}
    for status in Path("/proc").glob("[0-9]*/stat"):
        try:
            words = (status.parent / "cmdline").read_text().split("\0")
            if int(status.read_text().rsplit(")", 1)[1].split()[1]) == parent and words[4:5]:
                found[NAMES.get(words[4], words[4])] = int(status.parent.name)
        except OSError:
            continue
    return found


def cpu_time(pid: int) -> float:
    """Return the processor time that a process has used, s."""
    fields = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def main() -> None:
    options = parser(__doc__).parse_args()
    with tempfile.TemporaryDirectory() as folder:
        plain, shown = shares("none", Path(folder)), shares("web", Path(folder))
    figures = {f"cpu_{name}": Figure(plain[name], "core", 1.0, "one core") for name in CHAIN}
    figures["cpu_chain"] = Figure(sum(plain[name] for name in CHAIN), "core", 1.0, "one core")
    figures["cpu_display"] = Figure(shown["display"], "core", 1.0, "one core")
    show(figures, options.json)


if __name__ == "__main__":
    main()
