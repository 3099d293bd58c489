"""`rigtwin replay FILE ...`: play recordings as if they were live, with twin and display beside them."""

import argparse
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

from replay.options import pace, rate, seconds
from rigtwin.keyboard import Keyboard
from rigtwin.live import add_view_option, start_display
from rigtwin.replay_control import LEGEND, Keys

if TYPE_CHECKING:
    from daq.rig import Rig
    from rigtwin.supervisor import Supervisor

END_ORDER = ("player", "twin", "display")


def add_parser(commands: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Add `replay` to the command line."""
    parser = commands.add_parser(
        "replay",
        help="play recordings as if they were live",
        description="Publish a recording's bytes as the daq did, or those of several of one rig, one after "
        "another. The twin runs anew on them, unless its recorded estimates are asked for. "
        "`rigtwin command pause, resume, step, seek, rate, loop` steers it, and so do keys in its terminal.",
    )
    parser.add_argument("files", nargs="+", type=Path, metavar="FILE")
    parser.add_argument(
        "--rate",
        type=rate,
        default=1.0,
        metavar="N|max",
        help="times real time, from 0.01 on, or max: as fast as the subscribers take it",
    )
    parser.add_argument(
        "--start", type=seconds, default=0.0, metavar="S", help="where in the recording to begin"
    )
    parser.add_argument("--loop", action="store_true", help="begin again at the end")
    parser.add_argument(
        "--recorded-twin", action="store_true", help="play the recorded estimates; start no twin"
    )
    add_view_option(parser)
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Play the recording; return 0 when all of it was played, 1 when something failed."""
    from daq.ports import with_free_ports
    from daq.runtime import refuse_second
    from rigtwin.supervisor import StopRequest

    rig = recorded_rig(options.files[0])
    refuse_second(rig.name)
    rig = with_free_ports(rig)
    with TemporaryDirectory(prefix="rigtwin-") as folder, StopRequest() as stop, Keyboard() as keyboard:
        supervisor = start(rig, options, Path(folder))
        if keyboard.is_there:
            supervisor.screen.line(LEGEND)
        keys = Keys(rig, keyboard, options.rate)
        try:
            supervisor.run(stop, lambda: steered(supervisor, keys))
        finally:
            supervisor.finish(END_ORDER)
    return 1 if supervisor.failed else 0


def steered(supervisor: "Supervisor", keys: Keys) -> bool:
    """Obey the keys that were pressed and say what came of it; return whether the user has had enough."""
    said = keys.look(supervisor.monitor.picture.state)
    if said:
        supervisor.screen.line(said)
    return keys.ended


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
    names = ", ".join(str(path) for path in options.files)
    supervisor.screen.line(f"REPLAY of {names} ({rig.name}) {pace(options.rate)}")
    toml = write_rig(rig, folder)
    waits = []
    if rig.twin.model != "none" and not options.recorded_twin:
        supervisor.add("twin", ["twin", "observe", "--rig", toml])
        waits.append("twin")
    if options.view != "none":
        waits.append("display")
    if options.view != "none":
        start_display(supervisor, options.view, toml)
    play = ["replay", "play", *map(str, options.files), "--rig", toml]
    play += ["--rate", str(options.rate), "--start", str(options.start)]
    play += ["--loop"] if options.loop else []
    play += ["--recorded-twin"] if options.recorded_twin else []
    supervisor.add("player", [*play, *(["--wait-for", ",".join(waits)] if waits else [])])
    return supervisor
