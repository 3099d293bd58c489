"""The command line `rigtwin`: finds the command, runs it, turns expected errors into one line.

Only argparse is imported here; each command imports what it needs when it runs, so that help is instant.
"""

import argparse
import sys
from collections.abc import Sequence
from importlib import import_module
from importlib.metadata import version

# Modules that add one or more commands, in the order in which help shows them.
COMMANDS = (
    "rigtwin.live",
    "rigtwin.command",
    "rigtwin.plan_command",
    "rigtwin.rig_command",
    "rigtwin.view_command",
    "rigtwin.simulate_command",
    "rigtwin.replay_command",
    "rigtwin.recording_commands",
    "rigtwin.note_command",
    "rigtwin.recordings_command",
    "rigtwin.verify_command",
    "rigtwin.limits_command",
    "rigtwin.fork_command",
    "rigtwin.export_command",
    "rigtwin.import_command",
    "rigtwin.predict_command",
    "rigtwin.doctor",
)

ROOMS = {"simulator", "analysis", "daq", "twin", "replay", "rigtwin"}

WRONG_USE = 2


def build_parser() -> argparse.ArgumentParser:
    """Return the parser of the whole command line."""
    parser = argparse.ArgumentParser(
        prog="rigtwin",
        description="Data acquisition and digital twin of a rotor test rig.",
        epilog="First time here? `rigtwin live` runs an emulated rig through its resonance.",
    )
    parser.add_argument("--version", action="version", version=f"rigtwin {version('rigtwin')}")
    commands = parser.add_subparsers(title="commands", metavar="COMMAND", required=True)
    for name in COMMANDS:
        import_module(name).add_parser(commands)
    return parser


def expected(error: BaseException) -> bool:
    """Whether an error is one that a user can mend: one of ours, or the operating system's refusal."""
    ours = type(error).__module__.split(".")[0] in ROOMS
    return ours or isinstance(error, PermissionError | FileNotFoundError | IsADirectoryError)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command; return its exit code: 0 done, 1 the answer is no, 2 wrong use."""
    options = build_parser().parse_args(arguments)
    try:
        return options.run(options)
    except BrokenPipeError:  # the reader of our output, such as `head`, has had enough
        sys.stderr.close()
        return 0
    except (ValueError, RuntimeError, OSError) as error:
        if not expected(error):
            raise
        print(f"rigtwin: {error}", file=sys.stderr)
        return WRONG_USE
    except KeyboardInterrupt:
        print("rigtwin: interrupted", file=sys.stderr)
        return 130
