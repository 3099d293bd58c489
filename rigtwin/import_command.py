"""`rigtwin import FILE --rig RIG --map MAP -o OUT`: make a recording of another program's file."""

import argparse
from pathlib import Path


def add_parser(commands: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Add `import` to the command line."""
    parser = commands.add_parser(
        "import",
        help="make a recording of a TDMS, HDF5 or CSV file",
        description="Make a recording of a file of another program, to replay and twin it as a live one. "
        "The map says which of its columns is which channel of the rig.",
    )
    parser.add_argument("file", type=Path, metavar="FILE", help=".tdms, .h5, .hdf5, .csv or .txt")
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="OUT", help="recording to write")
    parser.add_argument("--rig", required=True, metavar="NAME|PATH", help="what it was measured on")
    parser.add_argument(
        "--set", action="append", default=[], metavar="TABLE.KEY=VALUE", help="change the rig description"
    )
    parser.add_argument(
        "--map", type=Path, metavar="MAP", help="TOML file (default: columns are named as the channels)"
    )
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Import and say what came of it; return 0."""
    from rich.console import Console
    from rich.progress import Progress

    from daq.rig import load_rig
    from replay.channel_map import load_map
    from replay.importing import import_file
    from replay.info import brief

    rig = load_rig(options.rig, options.set)
    channel_map = load_map(options.map, rig.channels)
    console = Console(stderr=True)
    with Progress(console=console, transient=True, disable=not console.is_terminal) as bar:
        task = bar.add_task(options.file.name, total=None)
        import_file(
            options.file,
            options.output,
            rig,
            channel_map,
            lambda sample: bar.update(
                task, description=f"{options.file.name}: {sample / rig.acquisition.rate:.0f} s"
            ),
        )
    print(brief(options.output))
    return 0
