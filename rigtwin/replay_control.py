"""How a replay is steered: `rigtwin command pause`, ..., and the same by keys in its terminal."""

import argparse
import getpass
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from replay.options import rate
from rigtwin.keyboard import Keyboard

if TYPE_CHECKING:
    from daq.messages_pb2 import Answer
    from daq.rig import Rig

NAMES = ("pause", "resume", "step", "seek", "rate", "loop")
JUMP = 5.0  # s of a seek by key
LEGEND = "keys: space pause, . step, arrows back and on, - and + rate, l loop, q end"
TIMEOUT = 2.0  # s for an answer


class ReplayControlError(ValueError):
    """A command that the running rig does not know; the message says which it knows."""


def add_commands(names: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Add the commands to a replay to `rigtwin command`."""
    names.add_parser("pause", help="replay: stay where it is")
    names.add_parser("resume", help="replay: go on")
    step = names.add_parser("step", help="replay: play the next blocks, then stay there")
    step.add_argument("blocks", type=int, nargs="?", default=1, metavar="N", help="default: 1")
    seek = names.add_parser("seek", help="replay: go on elsewhere in the recording")
    where = seek.add_mutually_exclusive_group(required=True)
    where.add_argument("seconds", type=float, nargs="?", metavar="S", help="s from the recording's beginning")
    where.add_argument("--by", type=float, metavar="S", help="s from where it is; back where below 0")
    pace = names.add_parser("rate", help="replay: change the rate")
    pace.add_argument("times", type=rate, metavar="N|max", help="times real time, from 0.01 on, or max")
    loop = names.add_parser("loop", help="replay: begin again at the end, or not")
    loop.add_argument("on", nargs="?", choices=("on", "off"), default="on", help="default: on")


def values_of(options: argparse.Namespace) -> dict[str, float]:
    """Return a command's numbers as messages carry them."""
    names = ("blocks", "seconds", "by", "times")
    values = {name: float(value) for name in names if (value := getattr(options, name, None)) is not None}
    return values | ({"on": float(options.on == "on")} if options.name == "loop" else {})


def refuse_other_mode(record: Mapping[str, Any], name: str) -> None:
    """Raise `ReplayControlError` for a replay's command to a rig, or a rig's to a replay."""
    from daq.describe import REPLAY

    is_replay = record["mode"] == REPLAY
    if is_replay and name not in NAMES:
        raise ReplayControlError(
            f"{record['rig']} is a replay, in which nothing moves: its commands are {', '.join(NAMES)}"
        )
    if not is_replay and name in NAMES:
        raise ReplayControlError(f"{name} is for a replay, and {record['rig']} is {record['mode']}")


def send(rig: "Rig", name: str, values: Mapping[str, float]) -> "Answer":
    """Ask the player of a rig's recording. Raises `LinkError` when it does not answer."""
    from daq import keys
    from daq.link import Link
    from daq.messages_pb2 import Answer, Command

    message = Command(name=name, who=getpass.getuser(), values=values).SerializeToString()
    with Link(connect=[rig.link.endpoint("control")]) as link:
        return Answer.FromString(link.ask(keys.command(rig.name, name), message, timeout=TIMEOUT))


class Keys:
    """Turns the keys of a terminal into commands to the player of a rig's recording."""

    def __init__(self, rig: "Rig", keyboard: Keyboard, rate: float) -> None:
        self.ended = False
        """Whether the user has had enough."""
        self._rig, self._keyboard = rig, keyboard
        self._rate = rate

    def look(self, state: str) -> str:
        """Obey the keys that were pressed; return what came of it, empty when nothing.

        Args:
            state: of the player, as its status says.
        """
        pressed = self._keyboard.pressed()
        if pressed == "q":
            self.ended = True
        command = self._command(pressed, state)
        if command is None:
            return ""
        from daq.link import LinkError

        try:
            answer = send(self._rig, *command)
        except LinkError as error:
            return str(error)
        if command[0] == "rate" and answer.accepted:
            self._rate = command[1]["times"]
        return answer.text if answer.accepted else f"refused: {answer.text}"

    def _command(self, pressed: str, state: str) -> tuple[str, dict[str, float]] | None:
        """Return name and numbers of the command that a key stands for."""
        known: dict[str, tuple[str, dict[str, float]]] = {
            " ": ("resume" if "paused" in state else "pause", {}),
            ".": ("step", {}),
            "\x1b[C": ("seek", {"by": JUMP}),
            "\x1b[D": ("seek", {"by": -JUMP}),
            "+": ("rate", {"times": 2.0 * self._rate}),
            "-": ("rate", {"times": 0.5 * self._rate}),
            "l": ("loop", {"on": float("loop" not in state)}),
        }
        return known.get(pressed)
