"""`rigtwin rig setup`: the guided installation of a rig, which writes a new description."""

import argparse
from datetime import date
from math import tau
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable

    from daq.backend import Backend
    from daq.rig import Rig
    from daq.setup import Findings

HELP = "guided installation: offsets, bearing centre, runout, directions; writes a new description"


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the installation."""
    parser.add_argument("rig", metavar="NAME|PATH", help="description so far: shipped name or TOML file")
    parser.add_argument(
        "-o",
        "--output",
        type=Path,
        metavar="FILE.toml",
        help="file to write (default: NAME-DATE.toml)",
    )
    parser.add_argument("--only-read", action="store_true", help="turn nothing: only offsets and bearing")
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Guide the installation and write what was found."""
    from daq.rig import load_rig
    from daq.setup import Setup

    rig, today = load_rig(options.rig), date.today()
    path = options.output or Path(f"{rig.name}-{today:%Y%m%d}.toml")
    refuse_existing(path)
    setup = Setup(rig, connect, hand_of(rig))
    ask(rig, "The shaft must stand still and free, the encoder's mark at its zero.")
    setup.read()
    print(readings(rig, setup.findings))
    if not options.only_read:
        ask(rig, "Now the rotor turns at 1 Hz, and each solenoid hits with 3 N. Keep your hands off.")
        setup.turn()
        print(motions(rig, setup.findings))
    found = setup.rig(path.stem, today)
    with path.open("x", encoding="utf-8") as file:
        file.write(f"# Set up on {today} by rigtwin, from {rig.name}.\n\n{found.toml}")
    print(f"{path} is written; look at it, then: rigtwin rig check {path}")
    return 0


def refuse_existing(path: Path) -> None:
    """Refuse a file that is there, before anything is measured. Raises `RigError`."""
    from daq.rig import RigError

    if path.exists():
        raise RigError(f"{path} exists already; rigtwin overwrites nothing, name another one with -o")


def connect(rig: "Rig") -> "Backend":
    """Open the rig's device; an emulated one as fast as it goes, with a hand at its shaft."""
    from daq.backend import make_backend
    from daq.commanding.hand import with_hand

    device = make_backend("emulator", paced=False) if rig.emulated else make_backend(rig.acquisition.backend)
    device.open(with_hand(rig) if rig.emulated else rig)
    return device


def hand_of(rig: "Rig") -> "Callable[[Backend], None]":
    """Return what lets the shaft be pushed round: the emulated hand, or a person who is asked to."""
    from daq.commanding.hand import push_round
    from daq.setup import PUSH

    def push(device: "Backend") -> None:
        if rig.emulated:
            push_round(device, rig.acquisition.rate)
        else:
            ask(rig, f"Then push the shaft against the bearing, slowly all the way round, within {PUSH:g} s.")

    return push


def ask(rig: "Rig", what: str) -> None:
    """Tell a person what to see to, and wait; an emulated rig needs nobody."""
    print(what)
    if not rig.emulated:
        input("Press Enter when that is so, Ctrl-C to give up. ")


def readings(rig: "Rig", findings: "Findings") -> str:
    """Say what the channels read at rest, and where the bearing is."""
    lines = [f"{'channel':24}{'mean':>12}{'noise rms':>12}   raw, at rest"]
    lines += [f"{name:24}{mean:12.5g}{noise:12.3g}" for name, (mean, noise) in findings.rest.items()]
    wall = findings.wall
    if not wall:
        return "\n".join(lines)
    x, y = 1e6 * wall.centre
    lines.append(
        f"bearing: centre at {x:.0f} µm, {y:.0f} µm by the old offsets, radius {1e6 * wall.radius:.0f} µm "
        f"at the probes, touched within {1e6 * wall.residual:.0f} µm rms"
    )
    probe = next((each for each in rig.channels.of_quantity("displacement") if each.station), None)
    if rig.model and probe and probe.station:
        clearance = wall.radius * rig.model.rotor.bearing_station / probe.station
        described = rig.model.backup_bearing.clearance
        lines.append(f"clearance: {1e6 * clearance:.0f} µm, described {1e6 * described:.0f} µm")
    return "\n".join(lines)


def motions(rig: "Rig", findings: "Findings") -> str:
    """Say what the slow roll and the hits showed."""
    lines = []
    roll = findings.roll
    if roll:
        lines.append(
            f"slow roll: {roll.speed / tau:.3f} Hz, the encoder counts {'up' if roll.counts_up else 'down'}"
        )
        lines += [
            f"runout of {probe.name}: {1e6 * abs(vector):.1f} µm"
            for probe, vector in zip(rig.channels.of_quantity("displacement"), roll.runout, strict=True)
        ]
    for name, way in findings.hits.items():
        turned = "as described" if way > 0.0 else "the other way: its direction is turned round"
        lines.append(f"solenoid {name}: moved the shaft by {1e6 * abs(way):.0f} µm, {turned}")
    return "\n".join(lines)
