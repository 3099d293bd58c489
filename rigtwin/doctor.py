"""`rigtwin doctor`: check the installation and say what to do."""

import argparse
import ctypes
import json
import os
import shutil
import socket
import sys
import tempfile
import time
from collections.abc import Iterator
from importlib.metadata import PackageNotFoundError, version
from importlib.util import find_spec
from pathlib import Path
from typing import NamedTuple

ROOMS = ("simulator", "analysis", "daq", "twin", "replay", "rigs", "rigtwin")
PACKAGES = ("eclipse-zenoh", "mcap", "numba", "numpy", "protobuf", "rerun-sdk", "scipy")
CLOCK_UNSYNCHRONISED = 5  # adjtimex(2): TIME_ERROR
SPACE = 2e9  # bytes; about an hour of recording


class Finding(NamedTuple):
    """One check: what was looked at, "ok", "warning" or "error", what was found, what to do."""

    check: str
    state: str
    found: str
    remedy: str = ""


def add_parser(commands: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Add `doctor` to the command line."""
    parser = commands.add_parser(
        "doctor", help="check the installation", description="Check the installation and say what to do."
    )
    parser.add_argument("--json", action="store_true", help="print the findings as JSON")
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Print the findings; return 0 when nothing stands in the way, else 1."""
    findings = list(examine())
    if options.json:
        print(json.dumps([finding._asdict() for finding in findings], indent=1))
    else:
        for finding in findings:
            print(f"{finding.state:7} {finding.check:12} {finding.found}")
            if finding.remedy:
                print(f"{'':21}-> {finding.remedy}")
    return 1 if any(finding.state == "error" for finding in findings) else 0


def examine() -> Iterator[Finding]:
    """Make every check, the quick ones first."""
    yield python_version()
    yield from (package_version(name) for name in PACKAGES)
    yield from (shadowed(room) for room in ROOMS)
    yield cores()
    yield disk()
    yield runtime_folder()
    yield loopback()
    yield clock()
    yield viewer()
    yield link()
    yield kernels()


def python_version() -> Finding:
    """Which Python this is; pip refuses one that is too old."""
    return Finding("python", "ok", f"{sys.version.split()[0]} at {sys.executable}")


def package_version(name: str) -> Finding:
    """The package is installed."""
    try:
        return Finding(name, "ok", version(name))
    except PackageNotFoundError:
        return Finding(name, "error", "not installed", "pip install rigtwin")


def shadowed(room: str) -> Finding:
    """Our package of that name is the one that Python finds, from here too.

    The names of the rooms are generic: a folder or file named daq or twin in the working directory would
    be imported instead of ours by `python -m`, so it is worth a warning even where it does no harm yet.
    """
    spec = find_spec(room)
    home = Path(__file__).resolve().parent.parent
    if spec is None or spec.origin is None:
        return Finding(room, "error", "not found", "pip install rigtwin")
    if Path(spec.origin).resolve().parent.parent != home:
        return Finding(room, "error", f"found at {spec.origin}", f"rename that one; ours is under {home}")
    here = Path.cwd()
    if here != home and (
        ((here / room).is_dir() and any((here / room).glob("*.py"))) or (here / f"{room}.py").exists()
    ):
        return Finding(
            room, "warning", f"{here / room} has the same name", "use `rigtwin`, or `python -P -m`"
        )
    return Finding(room, "ok", str(home / room))


def cores() -> Finding:
    """Two cores at least: acquisition must not wait for the display."""
    count = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    if count >= 2:
        return Finding("cores", "ok", f"{count}")
    return Finding("cores", "warning", f"{count}", "on one core use --view none")


def disk() -> Finding:
    """Room for about an hour of recording in the working directory."""
    free = shutil.disk_usage(Path.cwd()).free
    found = f"{free / 1e9:.1f} GB free in {Path.cwd()}"
    if free >= SPACE:
        return Finding("disk", "ok", found)
    return Finding("disk", "warning", found, "an hour of recording takes about 2 GB")


def runtime_folder() -> Finding:
    """The folder of run-time records can be written."""
    from daq.runtime import RuntimeRecordError, runtime_folder

    try:
        place = runtime_folder()
    except RuntimeRecordError as error:
        return Finding("run time", "error", str(error), "set RIGTWIN_RUNTIME_DIR to your own folder")
    try:
        with tempfile.TemporaryFile(dir=place):
            return Finding("run time", "ok", str(place))
    except OSError as error:
        return Finding(
            "run time", "error", f"{place}: {error.strerror}", "set RIGTWIN_RUNTIME_DIR to your own folder"
        )


def loopback() -> Finding:
    """A loopback port can be opened."""
    try:
        with socket.create_server(("127.0.0.1", 0)) as server:
            return Finding("loopback", "ok", f"port {server.getsockname()[1]} opened and closed")
    except OSError as error:
        return Finding("loopback", "error", str(error), "allow programs to listen on 127.0.0.1")


def clock() -> Finding:
    """The host's clock is kept by a time service (adjtimex on Linux) and ticks finely enough."""
    resolution = time.get_clock_info("monotonic").resolution
    if resolution > 1e-4:
        return Finding("clock", "warning", f"monotonic resolution {resolution:g} s", "pacing will be rough")
    if not sys.platform.startswith("linux"):
        return Finding("clock", "ok", f"monotonic resolution {resolution:g} s")
    buffer = ctypes.create_string_buffer(512)  # struct timex with room to spare; modes = 0 only reads
    state = ctypes.CDLL(None).adjtimex(buffer)
    if state == CLOCK_UNSYNCHRONISED:
        return Finding(
            "clock", "warning", "not synchronised", "start a time service; recordings carry UTC of sample 0"
        )
    return Finding("clock", "ok", "synchronised" if state >= 0 else "cannot be asked here")


def viewer() -> Finding:
    """The rerun viewer's program is there, and a screen for it."""
    program = shutil.which(
        "rerun", path=f"{Path(sys.executable).parent}{os.pathsep}{os.environ.get('PATH', '')}"
    )
    if program is None:
        return Finding(
            "viewer",
            "warning",
            "no rerun program found",
            "pip install rerun-sdk; --view web needs a browser only",
        )
    if sys.platform.startswith("linux") and not (
        os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
    ):
        return Finding("viewer", "ok", "web viewer; no screen here for the native one")
    return Finding("viewer", "ok", "web and native")


def link() -> Finding:
    """Two zenoh sessions find each other on loopback and pass a message."""
    from daq.link import Inbox, Link, free_ports

    address = f"tcp/127.0.0.1:{free_ports(1)[0]}"
    inbox = Inbox(4, "drop_oldest")
    with Link(listen=[address]) as ours, Link(connect=[address]) as theirs:
        theirs.subscribe("rig/doctor/ping", inbox)
        publisher = ours.publish("rig/doctor/ping")
        for _ in range(50):
            publisher.put(b"ping")
            if inbox.get(0.1) is not None:
                return Finding("link", "ok", f"zenoh over {address}")
    return Finding(
        "link", "error", f"nothing arrived over {address}", "let no firewall stand between local programs"
    )


def kernels() -> Finding:
    """The model's compiled kernels run; the first time this takes about half a minute."""
    from daq.rig import load_rig
    from simulator.simulation import Simulation, signals_for

    started = time.monotonic()
    rig = load_rig("thesis-ball")
    Simulation(rig.emulated_model, rig.acquisition.rate).advance(signals_for(50))
    return Finding("model", "ok", f"ready after {time.monotonic() - started:.1f} s")
