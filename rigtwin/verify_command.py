"""`rigtwin verify` and `rigtwin twin`: run the twin over a recording again, to prove or to replace."""

import argparse
import json
from pathlib import Path


def add_parser(commands: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Add `verify` and `twin` to the command line."""
    verify = commands.add_parser(
        "verify",
        help="prove that today's twin gives a recording's estimates again",
        description="Run the twin over the recorded blocks, as it ran live, and compare with the recorded "
        "estimates: identical, equivalent (on a computer that rounds otherwise) or different. Exit code 1: "
        "different.",
    )
    verify.add_argument("file", type=Path, metavar="FILE")
    verify.add_argument("--json", action="store_true", help="print one JSON object")
    verify.set_defaults(run=run_verify)
    twin = commands.add_parser(
        "twin",
        help="estimate anew over a recording",
        description="Write a recording with the same samples and events, and fresh estimates of the twin "
        "over every block in place of those that it had, if any.",
    )
    twin.add_argument("file", type=Path, metavar="FILE")
    twin.add_argument("-o", "--output", type=Path, required=True, metavar="OUT", help="recording to write")
    twin.add_argument(
        "--smooth",
        action="store_true",
        help="also write the series `smoothed`: displacement and velocity with hindsight, several times as "
        "near between impacts; the estimates stay as they are",
    )
    twin.add_argument(
        "--rig-out",
        type=Path,
        metavar="FOUND.toml",
        help="also write the parameters that the data have told, as a rig description; it must not exist",
    )
    twin.set_defaults(run=run_twin)


def run_verify(options: argparse.Namespace) -> int:
    """Compare; return 1 when the answer is another one."""
    from replay.verify import DIFFERENT, text, verify
    from rigtwin.progress import progress

    with progress(options.file) as advance:
        found = verify(options.file, advance)
    print(json.dumps(found.to_json(), indent=2) if options.json else text(found))
    return 1 if found.verdict == DIFFERENT else 0


def run_twin(options: argparse.Namespace) -> int:
    """Estimate anew and say what came of it."""
    from daq.recording import Recording, RecordingError
    from replay import found
    from replay.info import brief
    from replay.rerun import estimate
    from rigtwin.progress import progress

    if options.rig_out and options.rig_out.exists():
        raise RecordingError(f"{options.rig_out} exists already; rigtwin overwrites nothing, choose another")
    with progress(options.file) as advance:
        estimate(options.file, options.output, advance, options.smooth)
    print(brief(options.output))
    with Recording(options.output) as recording:
        print("\n".join(found.lines(found.facts(found.last_summary(recording)))))
        if options.rig_out:
            write_rig(options.rig_out, found.found_rig(recording))
    return 0


def write_rig(path: Path, text: str) -> None:
    """Write a rig description; an existing file is refused."""
    from daq.recording import RecordingError

    try:
        with path.open("x", encoding="utf-8") as file:
            file.write(text)
    except OSError as error:
        raise RecordingError(f"{path} cannot be written: {error.strerror}") from error
    print(f"{path} holds what was found; compare: rigtwin rig show {path}")
