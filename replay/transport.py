"""How a replay goes on: rate, pause, steps, loop and seeks; no link and no clock of its own."""

import math
from collections.abc import Callable

from daq.messages_pb2 import Answer, Command
from replay.options import SLOWEST, pace

PATIENT = 3600.0  # s: a wait that somebody ends


class TransportError(ValueError):
    """A command that is refused; the message is the answer to whoever asked."""


class Transport:
    """Says when each message is due and obeys the commands of whoever watches.

    Args:
        rate: times real time; infinite for as fast as the subscribers take it.
        loop: whether the replay begins again at its end.
    """

    def __init__(self, rate: float = 1.0, *, loop: bool = False) -> None:
        self.rate = rate
        self.loop = loop
        self.paused = False
        self.target: float | None = None
        """s since sample 0 at which the replay is to go on; None: where it is."""
        self.position = 0.0
        """s since sample 0 of the last message."""
        self.duration = math.inf
        """s since sample 0 at which the recording ends."""
        self._steps = 0
        self._anchor: tuple[float, float] | None = None  # when a position was due
        self._commands: dict[str, Callable[[Command], str]] = {
            "pause": self._pause,
            "resume": self._resume,
            "step": self._step,
            "seek": self._seek,
            "rate": self._set_rate,
            "loop": self._set_loop,
        }

    @property
    def commands(self) -> tuple[str, ...]:
        """Names of the commands that are obeyed."""
        return tuple(self._commands)

    @property
    def state(self) -> str:
        """What the replay is doing, in a word or two."""
        return ("paused" if self.paused else "playing") + (" in a loop" if self.loop else "")

    def wait(self, position: float, now: float) -> float:
        """Return how many s later than `now` a message is due; 0 or less when it is.

        Args:
            position: of the message, s since sample 0.
            now: s of a clock that never goes back.
        """
        if self.paused:
            self._anchor = None
            return 0.0 if self._steps else PATIENT
        if self._anchor is None:
            self._anchor = (now, position)
        began, first = self._anchor
        return began + (position - first) / self.rate - now

    def passed(self, position: float, *, is_block: bool) -> None:
        """Note that a message was published."""
        self.position = position
        if is_block and self._steps:
            self._steps -= 1

    def go_on_from(self, position: float) -> None:
        """Note that the replay is now at another place."""
        self.position, self.target, self._anchor = position, None, None
        if self.paused:
            self._steps = max(self._steps, 1)  # to show what is there

    def obey(self, command: Command) -> Answer:
        """Perform a command and return its answer."""
        try:
            return Answer(accepted=True, text=self._commands[command.name](command))
        except TransportError as error:
            return Answer(text=str(error))

    def _pause(self, _command: Command) -> str:
        self.paused, self._steps = True, 0
        return f"paused at {self.position:.3f} s"

    def _resume(self, _command: Command) -> str:
        self.paused, self._anchor = False, None
        return f"going on from {self.position:.3f} s {pace(self.rate)}"

    def _step(self, command: Command) -> str:
        count = command.values.get("blocks", 1.0)
        if not (count >= 1.0 and count.is_integer()):
            raise TransportError(f"step takes a whole number of blocks from 1 on, not {count:g}")
        self.paused = True
        self._steps += int(count)
        return f"{count:.0f} block{'s' if count > 1 else ''} on from {self.position:.3f} s, then paused"

    def _seek(self, command: Command) -> str:
        if "by" in command.values:
            target = (self.position if self.target is None else self.target) + command.values["by"]
            target = min(max(target, 0.0), self.duration)
        else:
            target = command.values.get("seconds", math.nan)
        if not 0.0 <= target <= self.duration:
            raise TransportError(
                f"seek takes a time from 0 to {self.duration:.3f} s, the recording's end, not {target:g} s"
            )
        self.target = target
        return f"at {target:.3f} s, {self.state}"

    def _set_rate(self, command: Command) -> str:
        rate = command.values.get("times", math.nan)
        if not rate >= SLOWEST:
            raise TransportError(f"rate takes {SLOWEST:g} or more times real time, or max, not {rate:g}")
        self.rate, self._anchor = rate, None
        return pace(self.rate)

    def _set_loop(self, command: Command) -> str:
        self.loop = command.values.get("on", 1.0) > 0.0
        return "beginning again at the end" if self.loop else "ending at the end"
