"""`rigtwin note`: remark on a recording later, in a file beside it."""

import argparse
import getpass
from pathlib import Path


def add_parser(commands: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Add `note` to the command line."""
    note = commands.add_parser(
        "note",
        help="write a later note beside a recording",
        description="Append a note to FILE.notes.toml beside the recording, which itself is never changed.",
    )
    note.add_argument("file", type=Path, metavar="FILE")
    note.add_argument("text")
    note.add_argument("--meta", action="append", default=[], metavar="KEY=VALUE", help="as that of `live`")
    note.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Append the note and say where."""
    from daq.recording.metadata import metadata_of
    from daq.recording.notes import add_note

    path = add_note(options.file, getpass.getuser(), options.text, metadata_of(options.meta))
    print(f"noted in {path}")
    return 0
