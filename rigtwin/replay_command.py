"""`rigtwin replay FILE`: play a recording as if it were live, with twin and display beside it."""

import argparse
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

from rigtwin.live import add_view_option, start_display

if TYPE_CHECKING:
    from daq.rig import Rig
    from rigtwin.supervisor import Supervisor

END_ORDER = ("player", "twin", "display")


def add_parser(commands: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Add `replay` to the command line."""
    parser = commands.add_parser(
        "replay",
        help="play a recording as if it were live",
        description="Publish a recording's bytes as the daq did. The twin runs anew on them, unless its "
        "recorded estimates are asked for.",
    )
    parser.add_argument("file", type=Path, metavar="FILE")
    parser.add_argument(
        "--rate",
        default="1",
        metavar="N|max",
        help="times real time, or max: as fast as the subscribers take it",
    )
    parser.add_argument(
        "--recorded-twin", action="store_true", help="play the recorded estimates; start no twin"
    )
    add_view_option(parser)
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Play the recording; return 0 when all of it was played, 1 when something failed."""
    from daq.ports import with_free_ports
    from rigtwin.supervisor import StopRequest

    rig = with_free_ports(recorded_rig(options.file))
    with TemporaryDirectory(prefix="rigtwin-") as folder, StopRequest() as stop:
        supervisor = start(rig, options, Path(folder))
        try:
            supervisor.run(stop, lambda: False)
        finally:
            supervisor.finish(END_ORDER)
    return 1 if supervisor.failed else 0


def recorded_rig(path: Path) -> "Rig":
    """The rig description that travels with a recording."""
    from daq.recording import Recording
    from daq.rig import rig_from_text

    return rig_from_text(Recording(path).description.toml, str(path))


def start(rig: "Rig", options: argparse.Namespace, folder: Path) -> "Supervisor":
    """Start player, twin and display."""
    from rigtwin.crew import Crew
    from rigtwin.supervisor import Supervisor, write_rig

    supervisor = Supervisor(rig, Crew(folder), essential=["player"], recording=False)
    supervisor.screen.line(f"REPLAY of {options.file} ({rig.name}) at {options.rate} times real time")
    toml = write_rig(rig, folder)
    waits, recorded = [], ["--recorded-twin"] if options.recorded_twin else []
    if rig.twin.model != "none" and not options.recorded_twin:
        supervisor.add("twin", ["twin", "observe", "--rig", toml])
        waits.append("twin")
    if options.view != "none":
        waits.append("display")
    if options.view != "none":
        start_display(supervisor, options.view, toml)
    play = ["replay", "play", str(options.file), "--rig", toml, "--rate", options.rate, *recorded]
    supervisor.add("player", [*play, *(["--wait-for", ",".join(waits)] if waits else [])])
    return supervisor
