"""`rigtwin command ...` and `rigtwin shutdown`: talk to the rig that is running."""

import argparse
import getpass
import json
import os
import signal
import time
from math import radians
from typing import TYPE_CHECKING

from rigtwin import replay_control

if TYPE_CHECKING:
    from daq.messages_pb2 import Answer
    from daq.rig import Rig

END_WAIT = 60.0  # s that an orderly end may take
TIMEOUT = 2.0  # s for an answer
DURATION = 0.010  # s of a hit
UNLEASED = ("stop", "trip", "mark")  # whoever may command may stop


def add_parser(commands: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Add `command` and `shutdown` to the command line."""
    parser = commands.add_parser(
        "command",
        help="talk to the running rig or replay: arm, speed, hit, stop, trip, reset, mark; pause, seek, ...",
        description="Talk to the rig that is running, or to the replay. Whoever may command may stop: stop "
        "and trip need no lease.",
    )
    parser.add_argument("--rig", metavar="NAME", help="which rig, where several run")
    parser.add_argument("--json", action="store_true", help="print the answer as JSON")
    parser.set_defaults(run=run)
    names = parser.add_subparsers(title="commands", metavar="NAME", dest="name", required=True)
    names.add_parser("arm", help="take the lease, so that the rotor may move")
    speed = names.add_parser("speed", help="go to a speed by a ramp")
    speed.add_argument("speed_hz", type=float, metavar="HZ")
    speed.add_argument("--ramp", type=float, dest="ramp_hz_per_s", metavar="HZ/S", help="default: the rig's")
    hit = names.add_parser("hit", help="hit the shaft with a solenoid")
    hit.add_argument("--solenoid", default="", help="default: the rig's first")
    how = hit.add_mutually_exclusive_group(required=True)
    how.add_argument("--force", type=float, metavar="N", help="peak of the half sine")
    how.add_argument(
        "--advised",
        action="store_true",
        help="search for the hit that frees the rotor from impacts, and do it; exit code 1: no hit helps",
    )
    hit.add_argument("--duration", type=float, metavar="S", help="default: 0.010")
    hit.add_argument(
        "--angle", type=float, metavar="DEG", help="shaft angle at which it begins; default: now"
    )
    names.add_parser("stop", help="bring the rotor to rest and disarm; recording goes on")
    names.add_parser("trip", help="bring the rotor to rest at once and latch it")
    names.add_parser("reset", help="clear a latched trip whose cause is gone")
    mark = names.add_parser("mark", help="write a remark into the recording")
    mark.add_argument("text")
    replay_control.add_commands(names)

    shutdown = commands.add_parser("shutdown", help="end the running rig in order")
    shutdown.add_argument("--rig", metavar="NAME", help="which rig, where several run")
    shutdown.set_defaults(run=run_shutdown)


def run(options: argparse.Namespace) -> int:
    """Send one command to the operator of the running rig, to the daq when there is none, or to a replay."""
    from daq.rig import rig_from_text
    from daq.runtime import running

    record = running(options.rig)
    replay_control.refuse_other_mode(record, options.name)
    rig = rig_from_text(record["toml"])
    if options.name in replay_control.NAMES:
        return report(replay_control.send(rig, options.name, replay_control.values_of(options)), options.json)
    if options.name == "hit" and options.advised:
        return run_advised(options, rig)
    return report(send(rig, options.name, *arguments_of(options, rig)), options.json)


def run_advised(options: argparse.Namespace, rig: "Rig") -> int:
    """Search for the hit that frees the rotor and send it; return 1 when there is none."""
    from daq.commanding.commands import CommandError
    from daq.messages_pb2 import Answer
    from rigtwin.advised_hit import arguments, search

    if options.solenoid or options.angle is not None or options.duration is not None:
        raise CommandError("--advised chooses the whole hit: leave --solenoid, --duration and --angle out")
    advice, said, sample = search(rig)
    if advice.hit is None:
        return report(Answer(text=said, sample=sample), options.json, "no hit")
    if not options.json:
        print(said)
    return report(send(rig, "hit", *arguments(advice.hit)), options.json)


def report(answer: "Answer", as_json: bool, refusal: str = "refused") -> int:
    """Print an answer; return 1 when it is no."""
    if as_json:
        print(json.dumps({"accepted": answer.accepted, "text": answer.text, "sample": answer.sample}))
    else:
        print(answer.text if answer.accepted else f"{refusal}: {answer.text}")
    return 0 if answer.accepted else 1


def arguments_of(options: argparse.Namespace, rig: "Rig") -> tuple[dict[str, float], dict[str, str]]:
    """The command's numbers and texts as messages carry them."""
    names = ("speed_hz", "ramp_hz_per_s", "force", "duration")
    values = {name: value for name in names if (value := getattr(options, name, None)) is not None}
    texts = {"text": options.text} if options.name == "mark" else {}
    if options.name == "hit":
        values.setdefault("duration", DURATION)
        if options.angle is not None:
            values["angle"] = radians(options.angle % 360.0)
        texts["solenoid"] = options.solenoid or next(iter(rig.solenoid_names), "")
    return values, texts


def send(rig: "Rig", name: str, values: dict[str, float], texts: dict[str, str]) -> "Answer":
    """Ask the operator, which holds the lease; stop, trip and mark reach the daq even when it is gone."""
    from daq import keys
    from daq.link import Link, NoAnswer
    from daq.messages_pb2 import Answer, Command

    message = Command(name=name, who=getpass.getuser(), values=values, texts=texts).SerializeToString()
    with Link(connect=[rig.link.endpoint(port) for port in ("operator", "control")]) as link:
        try:
            reply = link.ask(keys.operator_command(rig.name, name), message, timeout=TIMEOUT)
        except NoAnswer:
            if name not in UNLEASED:
                raise
            reply = link.ask(keys.command(rig.name, name), message, timeout=TIMEOUT)
    return Answer.FromString(reply)


def run_shutdown(options: argparse.Namespace) -> int:
    """Ask the running rig's daq to end in order, and wait until it has."""
    from daq.runtime import running

    record = running(options.rig)
    os.kill(record["pid"], signal.SIGTERM)
    deadline = time.monotonic() + END_WAIT
    while time.monotonic() < deadline:
        if not alive(record["pid"]):
            print(f"{record['rig']} has ended")
            return 0
        time.sleep(0.1)
    print(f"{record['rig']} (process {record['pid']}) is still ending after {END_WAIT:.0f} s")
    return 1


def alive(pid: int) -> bool:
    """Whether a process of that id exists."""
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return True
