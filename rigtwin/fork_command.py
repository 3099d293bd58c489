"""`rigtwin fork`: what would have happened, from some time of a recording on."""

import argparse
from pathlib import Path


def add_parser(commands: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Add `fork` to the command line."""
    parser = commands.add_parser(
        "fork",
        help="simulate on from a recording's estimated state, with changes",
        description="Go on from the twin's estimated state at a time of a recording, in the simulator, and "
        "record what would have happened. The recorded commands that follow go on. Look at both with "
        "`rigtwin view FILE OUT`.",
    )
    parser.add_argument("file", type=Path, metavar="FILE")
    parser.add_argument("--at", type=float, required=True, metavar="T", help="s of the recording")
    parser.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="TABLE.KEY=VALUE",
        help="change the rig, as rotor.unbalance=1e-4; or at T hit with command.hit=N, or go to "
        "command.speed=HZ in place of the recorded speeds",
    )
    parser.add_argument(
        "--for",
        dest="seconds",
        type=float,
        metavar="S",
        help="how long (default: to the end of the recording)",
    )
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="OUT", help="recording to write")
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Fork and say what came of it."""
    from replay.fork import fork
    from replay.info import brief
    from rigtwin.progress import progress

    with progress(options.file) as advance:
        fork(options.file, options.output, options.at, options.set, seconds=options.seconds, progress=advance)
    print(brief(options.output))
    print(f"see both: rigtwin view {options.file} {options.output}")
    return 0
