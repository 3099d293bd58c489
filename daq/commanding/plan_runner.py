"""The one interpreter of a plan: no I/O, no clock. The operator drives it, live and simulated."""

from collections import deque
from typing import NamedTuple

from daq.commanding.plan_steps import (
    Abort,
    Plan,
    SettleStep,
    command_of,
    lasting,
    sentence,
    shown,
    speed_after,
)
from daq.messages_pb2 import Summary
from daq.rig import Rig


class Action(NamedTuple):
    """A step that begins: the command to send, if any, and what to say about it."""

    number: int  # of the step, from 1
    sample: int  # at which the step is due
    command: str  # speed, hit or mark; empty for a wait
    values: dict[str, float]
    texts: dict[str, str]
    text: str  # one plain sentence for the event log


class PlanRunner:
    """Performs a plan against a sample index.

    Call `due(sample)` as the index advances and carry out the actions it returns. The first call sets the
    sample at which the plan begins; each further step is due when the one before is over by the plan, not by
    when `due` was called, so coarse calls do not add up to a drift. Call `watch` before with each summary of
    the stream: it ends steps that wait for something to settle, and plans whose abort conditions are met.
    Call `abort` when a command was refused or the rig tripped: nothing more is due then.

    Args:
        plan: what to do.
        rig: for its rate and default ramp.
        speed_hz: set-point at the plan's beginning.
    """

    def __init__(self, plan: Plan, rig: Rig, speed_hz: float = 0.0) -> None:
        self.plan = plan
        self.finished = False
        self.aborted: str | None = None  # reason
        self._rig = rig
        self._rate = rig.acquisition.rate
        self._speed_hz = speed_hz
        self._next = 0  # number of steps begun
        self._start: int | None = None
        self._elapsed = 0.0  # s of the plan after which the next step is due
        self._settling: Settling | None = None
        self._aborts = [AbortWatch(abort, self._rate) for abort in plan.aborts]

    def due(self, sample: int) -> list[Action]:
        """Return the actions of the steps that are due at `sample`, in order."""
        if self._start is None:
            self._start = sample
        actions = []
        while not self.finished and not self._settling and sample >= self.next_sample:
            if self._next == len(self.plan.steps):
                self.finished = True
            else:
                actions.append(self._begin())
        return actions

    def watch(self, summary: Summary) -> None:
        """Look at the stream: end what has settled, abort where the plan says so."""
        if self._start is None or self.finished:
            return
        for each in self._aborts:
            reason = each.judge(summary)
            if reason:
                self.abort(reason)
        if not self._settling:
            return
        outcome = self._settling.judge(summary)
        if outcome is None:
            return
        self._settling = None
        self._elapsed = (summary.first_sample + summary.n_samples - self._start) / self._rate
        if outcome:
            self.abort(outcome)

    @property
    def next_sample(self) -> int:
        """Sample at which the next step, or the plan's end, is due; 0 before the first `due`."""
        return (self._start or 0) + round(self._elapsed * self._rate)

    def abort(self, reason: str) -> None:
        """End the plan here."""
        if not self.finished:
            self.finished = True
            self.aborted = reason

    def _begin(self) -> Action:
        """Begin the next step."""
        step, sample = self.plan.steps[self._next], self.next_sample
        self._next += 1
        if isinstance(step, SettleStep):
            self._settling = Settling(step, sample, self._rate)
        else:
            self._elapsed += lasting(step, self._speed_hz, self._rig)
        self._speed_hz = speed_after(step, self._speed_hz)
        text = f"step {self._next} of {len(self.plan.steps)}: {sentence(step)}"
        return Action(self._next, sample, *command_of(step), text)


class Settling:
    """Waits until a quantity has stayed within a band for a while."""

    def __init__(self, step: SettleStep, sample: int, rate: float) -> None:
        self._step = step
        self._first = sample
        self._rate = rate
        self._seen: deque[tuple[int, float]] = deque()  # first sample and value of each block in the band

    def judge(self, summary: Summary) -> str | None:
        """Return None to go on, an empty text when settled, or why it is given up."""
        if summary.first_sample < self._first:
            return None
        step, end = self._step, summary.first_sample + summary.n_samples
        self._seen.append((summary.first_sample, watched(step.quantity, summary)))
        values = [value for _, value in self._seen]
        while max(values) - min(values) > step.within:
            self._seen.popleft()
            values.pop(0)
        if (end - self._seen[0][0]) / self._rate >= step.hold:
            return ""
        if (end - self._first) / self._rate < step.timeout:
            return None
        band = shown(step.quantity, step.within)
        return f"the {step.quantity} did not settle within {band} in {step.timeout:g} s"


class AbortWatch:
    """Watches one abort condition."""

    def __init__(self, abort: Abort, rate: float) -> None:
        self._abort = abort
        self._rate = rate
        self._since: int | None = None  # first sample above the level

    def judge(self, summary: Summary) -> str:
        """Return why the plan is to be cut short, or nothing."""
        quantity, level, duration = self._abort
        value = watched(quantity, summary)
        if value <= level:
            self._since = None
            return ""
        if self._since is None:
            self._since = summary.first_sample
        if (summary.first_sample + summary.n_samples - self._since) / self._rate < duration:
            return ""
        return f"abort condition: {quantity} {shown(quantity, value)} is above {shown(quantity, level)}"


def watched(quantity: str, summary: Summary) -> float:
    """Return a block's value of what a plan watches: radius in m, force in N, speed in Hz."""
    if quantity == "radius":
        return summary.radius_maximum
    return summary.force_maximum if quantity == "force" else abs(summary.speed_hz)
