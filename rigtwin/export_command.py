"""`rigtwin export FILE -o OUT`: write a recording, or a part of it, in another file format."""

import argparse
from pathlib import Path

SHOWN = 10  # gaps and faults


def add_parser(commands: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Add `export` to the command line."""
    parser = commands.add_parser(
        "export",
        help="write a recording in another file format",
        description="Write channels of a recording with units, rate, start time and places to a file of "
        "another format, which its suffix names: .tdms, .h5, .mf4, .mat, .uff, .parquet, .wav or .csv. "
        "Missing samples stay missing.",
    )
    parser.add_argument("file", type=Path, metavar="FILE")
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="OUT", help="file to write")
    parser.add_argument(
        "--series",
        choices=("block", "estimate", "smoothed", "truth"),
        default="block",
        help="what was measured, the twin's estimates, its motion smoothed by `rigtwin twin --smooth`, or an "
        "emulated rig's truth (default: block)",
    )
    parser.add_argument("--channels", metavar="NAMES", help="some channels only, separated by commas")
    parser.add_argument(
        "--from", dest="begin", type=seconds, default=0.0, metavar="S", help="from this second of the run on"
    )
    parser.add_argument("--to", dest="end", type=seconds, metavar="S", help="up to this second of the run")
    parser.set_defaults(run=run)


def seconds(text: str) -> float:
    """Return a time in the run, in s."""
    try:
        time = float(text)
    except ValueError:
        time = -1.0
    if not 0.0 <= time < float("inf"):
        raise argparse.ArgumentTypeError(f"{text!r} must be seconds since the run's start, 0 or more")
    return time


def run(options: argparse.Namespace) -> int:
    """Export and say what was written and what is missing; return 0."""
    from daq.recording import Recording
    from replay.export import export
    from rigtwin.progress import progress

    with Recording(options.file) as recording:
        rate = recording.description.rate
    first = round(options.begin * rate)
    last = None if options.end is None else round(options.end * rate) - 1
    with progress(options.file, first, last) as advance:
        written = export(
            options.file,
            options.output,
            series=options.series,
            names=options.channels.split(",") if options.channels else None,
            first=first,
            last=last,
            progress=advance,
        )
    size = written.path.stat().st_size / 1e6
    print(
        f"{written.path}: {written.channels} channels of {written.samples / written.rate:.3f} s at "
        f"{written.rate:g} Hz, {size:.1f} MB"
    )
    for fault in written.damage[:SHOWN]:
        print(f"warning: {fault}")
    for gap in written.gaps[:SHOWN]:
        print(f"samples {gap[0]} to {gap[1]} are missing")
    if len(written.gaps) > SHOWN:
        print(f"and {len(written.gaps) - SHOWN} more gaps")
    return 0
