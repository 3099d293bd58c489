"""What the daq says of a run: the message that answers `daq/description` and stands in every recording."""

import platform
from collections.abc import Mapping
from importlib.metadata import PackageNotFoundError, version

from daq.messages_pb2 import Description
from daq.rig import Rig
from daq.timing import StartTime

PACKAGES = ("rigtwin", "numpy", "numba", "eclipse-zenoh", "mcap", "protobuf")
LIVE, EMULATED, IMPORTED, REPLAY = "LIVE", "EMULATED", "IMPORTED", "REPLAY"
FORK = "-fork-"  # between the name of a run and the sample at which a fork leaves it


def describe(
    rig: Rig, run: str, start: StartTime, emulated: bool, meta: Mapping[str, str] | None = None
) -> Description:
    """Return the description of a run that has started; `meta` is what people tell of it."""
    return Description(
        timestamp=start.timestamp(0, rig.acquisition.rate),
        run=run,
        first_sample=0,
        rig=rig.name,
        toml=rig.toml,
        rate=rig.acquisition.rate,
        t0_ns=start.t0_ns,
        t0_uncertainty_ns=start.uncertainty_ns,
        t0_source=start.source,
        mode=EMULATED if emulated else LIVE,
        versions=versions(),
        meta=meta,
    )


def versions() -> dict[str, str]:
    """Return the versions of Python and of the packages that a run hangs on."""
    found = {"python": platform.python_version()}
    for package in PACKAGES:
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            continue
    return found


def run_of_fork(run: str, sample: int) -> str:
    """Return the name of the run that goes on from a sample of another one."""
    return f"{run}{FORK}{sample}"


def run_before_forks(run: str) -> str:
    """Return the run that a fork, or a fork of a fork, comes from; any other run's own name."""
    return run.partition(FORK)[0]
