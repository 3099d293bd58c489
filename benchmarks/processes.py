"""Share of a core that each process of a live run takes at real time, with impacts, on the shipped rig.

The shares are those that the processes report of themselves ten times a second, from the recording of the
run; the first seconds, in which programs are loaded, are left out.
"""

import subprocess
import sys
import tempfile
from collections import defaultdict
from pathlib import Path
from statistics import mean

from benchmarks.report import Figure, parser, show
from daq.messages_pb2 import Status
from rigtwin import Recording

WARM_UP = 1.5  # s of the run that are left out
CHAIN = ("daq", "recorder", "twin", "operator")


def shares(view: str, folder: Path) -> dict[str, float]:
    """Run live once and return each process' mean share of a core."""
    path = folder / f"{view}.mcap"
    command = ["-m", "rigtwin", "live", "--plan", "impacts", "--view", view, "--record", str(path)]
    subprocess.run([sys.executable, "-P", *command], check=True, stdout=subprocess.DEVNULL, cwd=folder)
    found = defaultdict(list)
    with Recording(path) as recording:
        rate = recording.description.rate
        for message in recording.messages():
            if message.key.endswith("/status"):
                status = Status.FromString(message.payload)
                if status.sample > WARM_UP * rate:
                    found[status.process].append(status.cpu)
    return {process: mean(values) for process, values in found.items()}


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
