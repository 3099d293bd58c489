"""`python -m replay play FILE` publishes a recording in the daq's place."""

import argparse
import os
import sys
from collections.abc import Sequence
from pathlib import Path
from threading import Event as Flag
from threading import Timer
from typing import TYPE_CHECKING

from replay.options import rate, seconds

if TYPE_CHECKING:
    from daq.rig import Rig

STUCK = 15.0  # s after which a player that was told to end gives up on a subscriber that takes nothing


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the player; return its exit code, 2 when it cannot do its work."""
    options = parser().parse_args(arguments)
    try:
        return options.run_process(options)
    except (RuntimeError, ValueError) as error:
        print(f"replay: {error}", file=sys.stderr, flush=True)
        return 2


def parser() -> argparse.ArgumentParser:
    """Return the parser of the command line."""
    made = argparse.ArgumentParser(prog="python -m replay", description=__doc__)
    processes = made.add_subparsers(required=True, metavar="PROCESS")
    play = processes.add_parser(
        "play", help="publish a recording until its end, or until standard input ends"
    )
    play.add_argument(
        "files", nargs="+", type=Path, metavar="FILE", help="recording; its continuations follow it"
    )
    play.add_argument(
        "--rig",
        metavar="NAME|PATH",
        help="rig description with the ports (default: the recording's, free ports)",
    )
    play.add_argument(
        "--rate", type=rate, default=1.0, metavar="N|max", help="times real time, or as fast as it is taken"
    )
    play.add_argument("--start", type=seconds, default=0.0, metavar="S", help="where to begin")
    play.add_argument("--loop", action="store_true", help="begin again at the end")
    play.add_argument("--recorded-twin", action="store_true", help="also what the twin said")
    play.add_argument(
        "--wait-for",
        default="",
        metavar="NAMES",
        help="processes that must be there before the first message, separated by commas",
    )
    play.set_defaults(run_process=_play)
    return made


def _play(options: argparse.Namespace) -> int:
    from daq.parent import follow_parent
    from replay.play import play
    from replay.transport import Transport

    told_to_end = Flag()

    def end() -> None:
        told_to_end.set()
        giving_up = Timer(STUCK, os._exit, (1,))
        giving_up.daemon = True
        giving_up.start()

    rig = _rig(options)
    follow_parent(end)
    transport = Transport(options.rate, loop=options.loop)
    transport.target = options.start
    samples = play(
        rig,
        options.files,
        transport,
        recorded_twin=options.recorded_twin,
        wait_for=[name for name in options.wait_for.split(",") if name],
        told_to_end=told_to_end,
    )
    print(f"replay: {samples} samples played", flush=True)
    return 0


def _rig(options: argparse.Namespace) -> "Rig":
    """Return the rig with ports, free ones where its description leaves them open."""
    from daq.ports import with_free_ports
    from daq.recording import Recording
    from daq.rig import load_rig, rig_from_text

    if options.rig:
        rig = load_rig(options.rig)
    else:
        with Recording(options.files[0]) as recording:
            rig = rig_from_text(recording.rig_toml, str(options.files[0]))
    return with_free_ports(rig)


if __name__ == "__main__":
    sys.exit(main())
