"""`rigtwin rig ...`: list, show, check and begin rig descriptions; scale recordings anew."""

import argparse
import json
from pathlib import Path
from typing import TYPE_CHECKING

from rigtwin.setup_command import HELP, add_options

if TYPE_CHECKING:
    from daq.rig import Rig


def add_parser(commands: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Add `rig` to the command line."""
    parser = commands.add_parser(
        "rig",
        help="rig descriptions: list, show, check, init, setup, recalibrate",
        description="A rig is described by one TOML file. Copy a shipped one with `rigtwin rig init`.",
    )
    verbs = parser.add_subparsers(title="verbs", metavar="VERB", required=True)
    listing = verbs.add_parser("list", help="the rigs that come with rigtwin")
    listing.set_defaults(run=run_list)
    show = verbs.add_parser("show", help="print a rig description with everything resolved")
    _add_rig(show)
    show.set_defaults(run=run_show)
    check = verbs.add_parser("check", help="check a rig description")
    _add_rig(check)
    check.set_defaults(run=run_check)
    for verb in (listing, show, check):
        verb.add_argument("--json", action="store_true", help="print JSON")
    init = verbs.add_parser("init", help="begin a rig description as a copy of a shipped one")
    init.add_argument("path", type=Path, metavar="FILE.toml", help="file to write; it must not exist")
    init.add_argument(
        "--from", dest="source", default="thesis-ball", metavar="NAME", help="default: thesis-ball"
    )
    init.set_defaults(run=run_init)
    add_options(verbs.add_parser("setup", help=HELP))
    anew = verbs.add_parser("recalibrate", help="scale a recording anew with other calibrations")
    anew.add_argument("file", type=Path, metavar="FILE", help="recording; it is not changed")
    anew.add_argument(
        "--rig", required=True, metavar="NEW.toml", help="description whose channels have the new calibration"
    )
    anew.add_argument("-o", "--output", type=Path, required=True, metavar="OUT", help="recording to write")
    anew.set_defaults(run=run_recalibrate)


def _add_rig(parser: argparse.ArgumentParser) -> None:
    """Add the arguments that name a rig and change it."""
    parser.add_argument("rig", metavar="NAME|PATH", help="shipped name or TOML file")
    parser.add_argument(
        "--set", action="append", default=[], metavar="TABLE.KEY=VALUE", help="change a value"
    )


def run_list(options: argparse.Namespace) -> int:
    """Print names and descriptions of the shipped rigs."""
    from daq.rig import load_rig, shipped_rigs

    rigs = [load_rig(name) for name in shipped_rigs()]
    if options.json:
        print(
            json.dumps([{"name": rig.name, "description": rig.description, "plan": rig.plan} for rig in rigs])
        )
        return 0
    for rig in rigs:
        print(f"{rig.name:19} {rig.description}")
    return 0


def run_show(options: argparse.Namespace) -> int:
    """Print the resolved description."""
    import tomllib

    from daq.rig import load_rig

    toml = load_rig(options.rig, options.set).toml
    print(
        json.dumps(tomllib.loads(toml), default=str) if options.json else toml,
        end="\n" if options.json else "",
    )
    return 0


def run_check(options: argparse.Namespace) -> int:
    """Check a description; return 1 when it is wrong."""
    from datetime import date

    from daq.commanding.plan import PlanError, load_plan
    from daq.rig import RigError, load_rig
    from daq.rig.toml_source import find
    from daq.rig_warnings import warnings

    find(options.rig, "rig")
    try:
        rig = load_rig(options.rig, options.set)
        if rig.plan:
            load_plan(rig.plan, rig)
    except (RigError, PlanError) as error:
        print(json.dumps({"valid": False, "error": str(error)}) if options.json else error)
        return 1
    doubts = warnings(rig, date.today())
    if options.json:
        print(json.dumps({"valid": True, "rig": rig.name, "warnings": doubts}))
        return 0
    for doubt in doubts:
        print(f"warning: {doubt}")
    print(summary(rig))
    return 0


def summary(rig: "Rig") -> str:
    """Say in one line what a valid description describes."""
    acquisition = rig.acquisition
    return (
        f"{rig.name} is valid: {len(rig.channels)} channels at {acquisition.rate:g} Hz, "
        f"backend {acquisition.backend}, {len(rig.solenoids)} solenoid(s), twin {rig.twin.model}, "
        f"plan {rig.plan or 'none'}"
    )


def run_init(options: argparse.Namespace) -> int:
    """Copy a shipped description, comments and all, under the name of the new file."""
    from daq.rig import RigError
    from daq.rig.toml_source import find, read
    from simulator.validation import NAME, value_of

    source, path = find(options.source, "rig"), options.path
    if path.suffix != ".toml":
        raise RigError(f"{path} must end in .toml, as {path.with_suffix('.toml')}")
    text = read(source).replace(f'name = "{source.stem}"', f'name = "{path.stem}"', 1)
    value_of(NAME, path.stem, f"{path}: name")
    try:
        with path.open("x", encoding="utf-8") as file:
            file.write(text)
    except FileExistsError:
        raise RigError(f"{path} exists already; rigtwin overwrites nothing, choose another name") from None
    except OSError as error:
        raise RigError(f"{path} cannot be written: {error.strerror}") from None
    print(f"{path} is a copy of {source.stem}; edit it, then: rigtwin rig check {path}")
    return 0


def run_recalibrate(options: argparse.Namespace) -> int:
    """Scale a recording anew and say what came of it."""
    from daq.rig import load_rig
    from replay.info import brief
    from replay.recalibrate import recalibrate
    from rigtwin.progress import progress

    with progress(options.file) as advance:
        recalibrate(options.file, load_rig(options.rig), options.output, advance)
    print(brief(options.output))
    return 0
