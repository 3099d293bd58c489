"""`python -m twin observe|record|display`: the processes that follow a run without touching it."""

import sys
from collections.abc import Callable, Sequence

USAGE = """usage: python -m twin PROCESS ...

Processes that follow a run of a rig; each explains itself with --help:
  observe   run the contact model alongside the stream and publish its estimate
  record    write everything that is published into a recording
  display   show the run in a browser page or in the viewer's window
"""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the process that the first argument names; return its exit code, 2 when there is none."""
    name, *rest = list(sys.argv[1:] if arguments is None else arguments) or [""]
    if name in ("-h", "--help"):
        print(USAGE, end="")
        return 0
    process = process_named(name)
    if process is None:
        print(f"twin: {name or 'nothing'} is no process of the twin\n{USAGE}", end="", file=sys.stderr)
        return 2
    return process(rest)


def process_named(name: str) -> Callable[[Sequence[str]], int] | None:
    """Return a process' main function; only what it needs is imported."""
    if name == "observe":
        from twin.service import main as observe

        return observe
    if name == "record":
        from twin.recorder import main as record

        return record
    if name == "display":
        from twin.display_service import main as display

        return display
    return None


if __name__ == "__main__":
    sys.exit(main())
