"""`rigtwin view`: look at recordings, or at the rig that is running."""

import argparse
from pathlib import Path


class ViewError(ValueError):
    """The options do not go together; the message says how they do."""


def add_parser(commands: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Add `view` to the command line."""
    parser = commands.add_parser(
        "view",
        help="look at recordings, or at the rig that is running",
        description="Show recordings in the rerun viewer: orbit, forces, displacement, speed, residuals and "
        "events, from beginning to end. Forks are drawn into the picture of the recording they come from. "
        "Without a file, open one more viewer on the rig that is running.",
    )
    parser.add_argument("files", nargs="*", type=Path, metavar="FILE", help="recordings (.mcap)")
    parser.add_argument("--rig", metavar="NAME", help="which running rig, when several run")
    where = parser.add_mutually_exclusive_group()
    where.add_argument(
        "--web", action="store_true", help="a page on this computer for your browser (default)"
    )
    where.add_argument("--native", action="store_true", help="the viewer's own window")
    where.add_argument(
        "--save", type=Path, metavar="OUT.rrd", help="write a file for the viewer, open nothing"
    )
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Show what is asked for; return 0 when the user has seen enough."""
    if options.save:
        return save(options.files, options.save)
    try:
        if options.files:
            show_files(options.files, native=options.native)
        else:
            show_running(options.rig, native=options.native)
    except KeyboardInterrupt:
        print()
    return 0


def save(files: list[Path], target: Path) -> int:
    """Write one picture as a file for the viewer. Raises `ViewError`."""
    if not files:
        raise ViewError("--save writes what a recording shows, and none was named")
    from twin.display_recording import save_recording

    save_recording(files, target)
    print(f"saved {target}")
    return 0


def show_files(files: list[Path], *, native: bool) -> None:
    """Show recordings until the user ends it."""
    from twin.display_recording import show_recording

    show_recording(files, "native" if native else "web")


def show_running(rig: str | None, *, native: bool) -> None:
    """Show the rig that is running: its own page if it serves one, or one more viewer on its display."""
    from daq.runtime import running
    from twin.display_address import find
    from twin.viewer import look_at

    address = find(running(rig)["rig"])
    if native or not address.page:
        look_at([address.data], "native" if native else "web")
    else:
        print(f"open {address.page}")
