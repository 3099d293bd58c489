"""`rigtwin info` and `rigtwin recover`: tell what is in a recording; mend one that was cut off or damaged."""

import argparse
import json
from pathlib import Path


def add_parser(commands: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Add `info` and `recover` to the command line."""
    info = commands.add_parser(
        "info",
        help="tell what is in a recording, and whether it is whole and unaltered",
        description="Tell rig, duration, channels, gaps and events of a recording, count its samples and "
        "compare its bytes with the certificate. Exit code 1: incomplete, altered or without a certificate.",
    )
    info.add_argument("file", type=Path, metavar="FILE")
    info.add_argument("--json", action="store_true", help="print one JSON object, in SI units")
    info.set_defaults(run=run_info)
    recover = commands.add_parser(
        "recover",
        help="mend a recording that was cut off or damaged",
        description="Write everything that is intact to a new recording and say what was lost. Exit code 1: "
        "samples are missing.",
    )
    recover.add_argument("file", type=Path, metavar="FILE")
    recover.add_argument("-o", "--output", type=Path, required=True, metavar="OUT", help="recording to write")
    recover.set_defaults(run=run_recover)


def run_info(options: argparse.Namespace) -> int:
    """Tell what is in a recording; return 1 when it is not valid."""
    from replay.info import info, text

    facts = info(options.file)
    print(json.dumps(facts, indent=2) if options.json else text(facts))
    return 0 if facts["certificate"]["verdict"] == "valid" else 1


def run_recover(options: argparse.Namespace) -> int:
    """Mend a recording; return 1 when samples are missing."""
    from replay.recover import recover, report

    recovered = recover(options.file, options.output)
    print(report(options.file, recovered))
    return 1 if recovered.certificate.gaps else 0
