"""What an operator does: holds the lease, performs a plan, passes commands on; no link, no clock, no threads.

The owner feeds it the daq's summaries (its clock), the daq's events and the commands of people, all from one
thread, and renews the lease as long as there is one.
"""

from collections.abc import Callable, Mapping
from typing import NamedTuple

from daq.commanding.plan import Plan, PlanError, plan_from_text
from daq.commanding.plan_runner import Action, PlanRunner
from daq.events import EventCounter
from daq.link import LinkError, NoAnswer
from daq.messages_pb2 import INFO, WARNING, Answer, Command, Event, Severity, Status, Summary
from daq.rig import Rig

PLANNING = ("plan", "resume")
"""Commands that the operator itself obeys: perform a plan given as TOML, go on with one that was cut."""
KEPT = ("arm", "speed", "hit", "reset", "record", *PLANNING)
"""Commands that a running plan keeps for itself; stop, trip and mark are always passed on."""
DISARMING = ("trip", "lease_lost", "stop", "end")
"""Kinds of the daq's events after which nobody holds the lease."""
DATED_BY_READ = ("trip", "end")
"""Of these, the ones dated by the samples read, which are a little behind the device's clock."""
DISORDER = 0.1
"""s by which such an event may be dated before the lease and still concern it."""
PATIENCE = 5.0
"""s of the stream for which a plan waits for the daq to answer its first command."""


class Clock(NamedTuple):
    """The stream's present: run id, index reached, and UTC of sample 0 in s since 1970."""

    run: str
    sample: int
    t0: float


class Operation:
    """Operates one rig.

    Args:
        rig: the rig.
        plan: performed as soon as the stream runs; None waits for commands.
        ask: sends a command to the daq and returns its answer; raises `LinkError` when there is none.
        publish: takes the payload of each of the operator's events.
    """

    def __init__(
        self, rig: Rig, plan: Plan | None, ask: Callable[[Command], Answer], publish: Callable[[bytes], None]
    ) -> None:
        self.lease = ""  # empty when not held
        self._rig = rig
        self._plan = plan  # to be performed or being performed
        self._runner: PlanRunner | None = None
        self._step = 0
        self._left: Plan | None = None  # what is left of the plan that was cut short
        self._ask = ask
        self._publish = publish
        self._events = EventCounter("operator")
        self._clock: Clock | None = None
        self._first_sample = 0  # index at which this run was first seen
        self._lease_sample = 0

    @property
    def state(self) -> str:
        """`waiting` for the stream, `plan`, `armed` or `idle`."""
        if self._clock is None:
            return "waiting"
        if self._plan:
            return "plan"
        return "armed" if self.lease else "idle"

    def advance(self, summary: Summary) -> None:
        """Take a summary of the stream as the time, and do what the plan has due."""
        sample = summary.first_sample + summary.n_samples
        if self._clock is None or summary.run != self._clock.run:
            self._begin_run(summary.run, sample)
        t0 = summary.timestamp - summary.first_sample / self._rig.acquisition.rate
        self._clock = Clock(summary.run, sample, t0)
        if self._plan and not self._runner:
            self._start_plan(self._plan)
        if self._runner:
            self._runner.watch(summary)
            self._perform(self._runner, sample)

    def heed(self, event: Event) -> None:
        """Take note of an event of the daq: whatever disarms the rig ends lease and plan."""
        if event.kind not in DISARMING or not (self.lease or self._runner):
            return
        margin = DISORDER * self._rig.acquisition.rate if event.kind in DATED_BY_READ else 0
        if event.sample > self._lease_sample - margin:
            self.lease = ""
            self._end_plan(event.text)

    def serve(self, command: Command) -> Answer:
        """Pass a person's command on under the operator's lease, unless a plan runs; return the answer."""
        if self._plan and command.name in KEPT:
            text = f"plan {self._plan.name} is running: only stop, trip and mark until it is over"
            self._emit("refused", f"{command.name} refused to {command.who or 'someone'}: {text}", WARNING)
            return Answer(accepted=False, text=text, sample=self._clock.sample if self._clock else 0)
        if command.name in PLANNING:
            return self._take_plan(command)
        command.lease = self.lease
        if command.name == "arm":  # by hand: only a plan that is read here is named
            command.texts.pop("plan", None)
            command.values.pop("longest_hit", None)
        try:
            answer = self._ask(command)
        except LinkError as error:
            return Answer(accepted=False, text=f"the daq does not answer: {error}")
        if answer.accepted and command.name == "arm":
            self._take_lease(answer)
        if answer.accepted and command.name in ("stop", "trip"):
            self.lease = ""
            self._end_plan(f"{command.name} by {command.who}")
        answer.lease = ""
        return answer

    def _take_plan(self, command: Command) -> Answer:
        """Arm for a plan, or the rest of the one that was cut short; it begins with the next block."""
        if self._clock is None:
            return Answer(text="the run has not started yet")
        if self.lease:
            return Answer(text="the rig is armed by hand: stop it first", sample=self._clock.sample)
        try:
            plan = (
                self._left if command.name == "resume" else plan_from_text(command.texts["toml"], self._rig)
            )
        except PlanError as error:
            return Answer(text=str(error), sample=self._clock.sample)
        if plan is None:
            return Answer(text="no plan was cut short: there is nothing to resume", sample=self._clock.sample)
        try:
            answer = self._arm(plan)
        except LinkError as error:
            return Answer(text=f"the daq does not answer: {error}", sample=self._clock.sample)
        if not answer.accepted:
            return Answer(text=f"arming was refused: {answer.text}", sample=self._clock.sample)
        text = f"plan {plan.name}: {len(plan.steps)} steps, about {plan.expected_duration(self._rig):.0f} s"
        self._emit(command.name, f"{command.who}: {text}", details={"who": command.who})
        self._begin_plan(plan, answer)
        return Answer(accepted=True, text=text, sample=self._clock.sample)

    def end(self, reason: str) -> None:
        """Bring the rotor to rest and give the lease back."""
        if self._plan:
            self._end_plan(reason)
        elif self.lease:
            self._stop("operator")

    def status(self) -> Status:
        """Return the operator's status; the caller adds clocks and CPU share."""
        run, sample, t0 = self._clock or Clock("", 0, 0.0)
        timestamp = t0 + sample / self._rig.acquisition.rate
        return Status(timestamp=timestamp, run=run, sample=sample, process="operator", state=self.state)

    def _begin_run(self, run: str, sample: int) -> None:
        """Begin with a run's first summary; a lease of an earlier run is worth nothing."""
        if self._clock:
            self.lease = ""
            self._end_plan("the daq was started anew")
        self._clock = None
        self._first_sample = sample

    def _start_plan(self, plan: Plan) -> None:
        """Arm the rig and begin the plan that the operator was started with."""
        clock = self._now()
        try:
            answer = self._arm(plan)
        except NoAnswer as error:  # the link for commands may be up a little later than the stream
            if clock.sample - self._first_sample > PATIENCE * self._rig.acquisition.rate:
                self._end_plan(f"the daq does not answer: {error}")
            return
        except LinkError as error:
            self._end_plan(f"the daq does not answer: {error}")
            return
        if not answer.accepted:
            self._end_plan(f"arming was refused: {answer.text}")
            return
        self._begin_plan(plan, answer)

    def _arm(self, plan: Plan) -> Answer:
        """Ask for the lease for a plan; the daq refuses what its device must not do. Raises `LinkError`."""
        arm = Command(name="arm", who=f"plan {plan.name}")
        arm.texts["plan"], arm.values["longest_hit"] = plan.name, plan.longest_hit
        return self._ask(arm)

    def _begin_plan(self, plan: Plan, armed: Answer) -> None:
        """Take the lease and the plan; its first step is due with the next block."""
        self._take_lease(armed)
        self._plan, self._runner = plan, PlanRunner(plan, self._rig)
        self._step = 0
        duration = plan.expected_duration(self._rig)
        details = {"plan": plan.name, "steps": len(plan.steps), "expected_duration": f"{duration:g}"}
        self._emit("plan_start", f"plan {plan.name} begins, about {duration:.0f} s", details=details)

    def _perform(self, runner: PlanRunner, sample: int) -> None:
        """Carry out the steps that are due."""
        for action in runner.due(sample):
            self._step = action.number
            details = {"step": action.number, "due": action.sample, **action.values, **action.texts}
            self._emit("step", action.text, details=details)
            refusal = self._refusal(action)
            if refusal:
                self._end_plan(f"{action.text}: {refusal}")
                return
        if runner.finished:
            self._end_plan(runner.aborted or "")

    def _refusal(self, action: Action) -> str:
        """Send a step's command; return why it was refused, or nothing."""
        if not action.command:
            return ""
        command = Command(name=action.command, who=self._who(), lease=self.lease)
        command.values.update(action.values)
        command.texts.update(action.texts)
        try:
            answer = self._ask(command)
        except LinkError as error:
            return f"the daq does not answer: {error}"
        return "" if answer.accepted else answer.text

    def _end_plan(self, reason: str) -> None:
        """End the plan, completed or for a reason; stop the rotor if the lease is still held."""
        plan, self._plan, runner, self._runner = self._plan, None, self._runner, None
        if not plan:
            return
        if runner:
            self._left = plan.rest_from(self._step) if reason else None
        if self.lease:
            self._stop(f"plan {plan.name}")
        details = {"plan": plan.name, "completed": "no" if reason else "yes", "steps_begun": self._step}
        text = f"plan {plan.name} was cut short: {reason}" if reason else f"plan {plan.name} is completed"
        self._emit(
            "plan_end", text, WARNING if reason else INFO, details | ({"reason": reason} if reason else {})
        )

    def _stop(self, who: str) -> None:
        """Send stop and drop the lease; without an answer the daq revokes it by itself."""
        try:
            self._ask(Command(name="stop", who=who, lease=self.lease))
        except LinkError:
            self._emit("refused", "the daq does not answer to stop; the lease is given up", WARNING)
        self.lease = ""

    def _take_lease(self, answer: Answer) -> None:
        self.lease = answer.lease
        self._lease_sample = answer.sample

    def _who(self) -> str:
        return f"plan {self._plan.name}" if self._plan else "operator"

    def _now(self) -> Clock:
        return self._clock or Clock("", 0, 0.0)

    def _emit(
        self, kind: str, text: str, severity: Severity = INFO, details: Mapping[str, object] | None = None
    ) -> None:
        """Publish an event at the present sample; before the stream runs there is none to relate it to."""
        if self._clock is None:
            return
        run, sample, t0 = self._clock
        timestamp = t0 + sample / self._rig.acquisition.rate
        self._publish(self._events.make(kind, text, sample, severity, details, run=run, timestamp=timestamp))
