"""`rigtwin retrip`: what other limits would have done on an old recording."""

import argparse
import json
from pathlib import Path


def add_parser(commands: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Add `retrip` to the command line."""
    retrip = commands.add_parser(
        "retrip",
        help="tell what other limits would have done on a recording",
        description="Run the protection over the recorded samples, with the limits that they were recorded "
        "with and with others. Exit code 1: the others trip.",
    )
    retrip.add_argument("file", type=Path, metavar="FILE")
    retrip.add_argument(
        "--limits", type=Path, metavar="LIMITS.toml", help="file with tables [limits.*], as a rig description"
    )
    retrip.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="KEY=VALUE",
        help="as limits.force.trip=300 or another key",
    )
    retrip.add_argument("--json", action="store_true", help="print one JSON object, in SI units")
    retrip.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Compare; return 1 when the other limits trip."""
    from replay.retrip import retrip, text
    from rigtwin.progress import progress

    with progress(options.file) as advance:
        answer = retrip(options.file, options.limits, options.set, advance)
    if options.json:
        facts = {
            name: {
                "trips": [trip._asdict() for trip in found.trips],
                "warnings": [warned._asdict() for warned in found.warnings],
                "peaks": found.peaks,
            }
            for name, found in (("recorded", answer.recorded), ("other", answer.other))
        }
        print(json.dumps({"rate": answer.rate, **facts}, indent=2))
    else:
        print(text(answer))
    return 1 if answer.other.trips else 0
