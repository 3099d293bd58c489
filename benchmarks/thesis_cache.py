"""Runs that are kept: each result lies in the user's cache folder under a digest of all it is made of."""

import hashlib
import os
import pickle
import sys
from collections.abc import Callable, Mapping
from functools import cache
from multiprocessing import get_context
from pathlib import Path
from typing import Any, NamedTuple

import analysis
import simulator
from benchmarks import thesis_runs
from simulator.compile import owned, user_cache


class Job(NamedTuple):
    """A function of this package and what it is called with."""

    function: Callable[..., Any]
    arguments: tuple[Any, ...]

    def digest(self) -> str:
        """Name of the result: function, arguments and the sources behind them."""
        text = f"{self.function.__qualname__}{self.arguments!r}{sources()}"
        return hashlib.sha256(text.encode()).hexdigest()[:24]

    def result(self, path: Path) -> Any:
        """Return the result that is kept in a file, or run and keep it there."""
        if path.is_file() and owned(path):
            return pickle.loads(path.read_bytes())
        found = self.function(*self.arguments)
        scratch = path.with_suffix(f".{os.getpid()}")
        scratch.write_bytes(pickle.dumps(found))
        scratch.replace(path)
        return found


NOT_RUN = ("rig.py", "checks.py", "validation.py", "sensors.py", "instruments.py")
"""Files of the simulator that no run needs."""


@cache
def sources() -> str:
    """Return a digest of the simulator, the analysis and the experiments."""
    folders = [Path(str(package.__file__)).parent for package in (simulator, analysis)]
    files = [path for folder in folders for path in sorted(folder.glob("*.py")) if path.name not in NOT_RUN]
    files.append(Path(thesis_runs.__file__))
    return hashlib.sha256(b"\0".join(path.read_bytes() for path in files)).hexdigest()


def performed(jobs: Mapping[str, Job], processes: int) -> dict[str, Any]:
    """Return the result of each job; those that are not kept yet run in `processes` processes."""
    folder = user_cache() / "rigtwin" / "thesis"
    folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    found = {}
    paths = {name: folder / f"{job.digest()}.pickle" for name, job in jobs.items()}
    with get_context("spawn").Pool(processes) as pool:
        waiting = {name: pool.apply_async(job.result, (paths[name],)) for name, job in jobs.items()}
        for number, (name, result) in enumerate(waiting.items(), 1):
            found[name] = result.get()
            print(f"\r{number}/{len(jobs)} runs", end="", file=sys.stderr, flush=True)
    print(file=sys.stderr)
    return found
