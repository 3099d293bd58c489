"""Test plans: what a rig shall do, step by step, read from TOML and validated against the rig.

`PlanRunner` is the one interpreter of a plan: the operator drives it with the live stream's sample
index, `simulate` and `plan check` with the simulated one, so that a plan does the same everywhere.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, NamedTuple

from daq import toml_source
from daq.rig import Rig
from simulator.validation import NAME, Pattern, Quantity, RigError, nearest, tuple_at


class PlanError(ValueError):
    """A plan that cannot be performed: the message names file, step, key, value and what is allowed."""


class WaitStep(NamedTuple):
    """`do = "wait"`: go on as it is."""

    duration: Annotated[float, Quantity("s", 0.0, 1e6, "how long")]
    note: str | None = None


class SpeedStep(NamedTuple):
    """`do = "speed"`: ramp to a speed; the next step comes when the ramp is over."""

    speed_hz: Annotated[float, Quantity("Hz", 0.0, 1e5, "speed at the ramp's end")]
    ramp_hz_per_s: Annotated[float | None, Quantity("Hz/s", 0.01, 1e5, "ramp; the rig's default if none")] = (
        None
    )
    note: str | None = None


class HitStep(NamedTuple):
    """`do = "hit"`: one half-sine pulse of a solenoid; the next step comes at once."""

    solenoid: str
    force: Annotated[float, Quantity("N", 0.0, 1e7, "peak of the pulse")]
    duration: Annotated[float, Quantity("s", 1e-4, 1.0, "length of the pulse")]
    note: str | None = None


class MarkStep(NamedTuple):
    """`do = "mark"`: write a text into the recording."""

    text: Annotated[str, Pattern(r".{1,500}", "a text of 1 to 500 characters on one line")]
    note: str | None = None


class Stair(NamedTuple):
    """`do = "stair"`: speeds in equal steps, up or down, each held for a while.

    It stands for a speed step and a wait for each level, both ends included. With `solenoid`, `force` and
    `hit_duration` each wait is divided by a hit half-way.
    """

    from_hz: Annotated[float, Quantity("Hz", 0.0, 1e5, "first speed")]
    to_hz: Annotated[float, Quantity("Hz", 0.0, 1e5, "last speed")]
    step_hz: Annotated[float, Quantity("Hz", 1e-3, 1e5, "from level to level; it divides the whole")]
    dwell: Annotated[float, Quantity("s", 1e-3, 1e6, "how long each speed is held")]
    ramp_hz_per_s: Annotated[float | None, Quantity("Hz/s", 0.01, 1e5, "ramp; the rig's default if none")] = (
        None
    )
    solenoid: str | None = None
    force: Annotated[float | None, Quantity("N", 0.0, 1e7, "peak of the hit at each level")] = None
    hit_duration: Annotated[float | None, Quantity("s", 1e-4, 1.0, "length of the hit at each level")] = None
    note: str | None = None

    def levels(self) -> list[float]:
        """Speeds in order, Hz. Raises `RigError` when the step does not divide the whole."""
        count = round(abs(self.to_hz - self.from_hz) / self.step_hz)
        if count > MOST_LEVELS:
            raise RigError(f"step_hz = {self.step_hz:g} makes {count + 1} levels, above {MOST_LEVELS}")
        if abs(count * self.step_hz - abs(self.to_hz - self.from_hz)) > 1e-6:
            way = f"{self.from_hz:g} to {self.to_hz:g} Hz"
            raise RigError(f"step_hz = {self.step_hz:g} does not divide the way from {way}")
        slope = (self.to_hz - self.from_hz) / max(count, 1)
        return [round(self.from_hz + number * slope, 9) for number in range(count + 1)]

    def steps(self) -> list["Step"]:
        """Plain steps that it stands for."""
        hit = self._hit()
        rest = [WaitStep(self.dwell)] if hit is None else [WaitStep(0.5 * self.dwell)]
        held: list[Step] = [*rest] if hit is None else [*rest, hit, *rest]
        found: list[Step] = []
        for hz in self.levels():
            found += [SpeedStep(hz, self.ramp_hz_per_s, self.note), *held]
        return found

    def _hit(self) -> "HitStep | None":
        """Hit at each level. Raises `RigError` when it is half described."""
        given = (self.solenoid, self.force, self.hit_duration)
        if given == (None, None, None):
            return None
        if self.solenoid is None or self.force is None or self.hit_duration is None:
            raise RigError("a hit at each level needs all of solenoid, force and hit_duration")
        return HitStep(self.solenoid, self.force, self.hit_duration)


MOST_LEVELS = 10_000
Step = WaitStep | SpeedStep | HitStep | MarkStep
STEPS: dict[str, type[Step | Stair]] = {
    "wait": WaitStep,
    "speed": SpeedStep,
    "hit": HitStep,
    "mark": MarkStep,
    "stair": Stair,
}


class PlanHead(NamedTuple):
    """Table `[plan]`: what the plan is called."""

    name: NAME
    description: str


@dataclass(frozen=True)
class Plan:
    """A validated plan."""

    name: str
    description: str
    steps: tuple[Step, ...]

    def expected_duration(self, rig: Rig) -> float:
        """Return how long the plan takes from rest, in seconds."""
        runner = PlanRunner(self, rig)
        return sum(runner.take(step) for step in self.steps)


class Action(NamedTuple):
    """A step that begins: the command to send, if any, and what to say about it."""

    number: int  # of the step, from 1
    sample: int  # at which the step is due
    command: str  # speed, hit or mark; empty for a wait
    values: dict[str, float]
    texts: dict[str, str]
    text: str  # one plain sentence for the event log


class PlanRunner:
    """Performs a plan against a sample index; no I/O, no clock.

    Call `due(sample)` as the index advances and carry out the actions it returns. The first call sets the
    sample at which the plan begins; each further step is due when the one before is over by the plan, not by
    when `due` was called, so coarse calls do not add up to a drift. Call `abort` when a command was refused
    or the rig tripped: nothing more is due then.

    Args:
        plan: what to do.
        rig: for its rate and default ramp.
        speed_hz: set-point at the plan's beginning.
    """

    def __init__(self, plan: Plan, rig: Rig, speed_hz: float = 0.0) -> None:
        self.plan = plan
        self.finished = False
        self.aborted: str | None = None  # reason
        self._rate = rig.acquisition.rate
        self._default_ramp = rig.command.default_ramp_hz_per_s
        self._speed_hz = speed_hz
        self._next = 0  # number of steps begun
        self._start: int | None = None
        self._elapsed = 0.0  # s of the plan after which the next step is due

    def due(self, sample: int) -> list[Action]:
        """Return the actions of the steps that are due at `sample`, in order."""
        if self._start is None:
            self._start = sample
        actions = []
        while not self.finished and sample >= self.next_sample:
            if self._next == len(self.plan.steps):
                self.finished = True
            else:
                actions.append(self._begin())
        return actions

    @property
    def next_sample(self) -> int:
        """Sample at which the next step, or the plan's end, is due; 0 before the first `due`."""
        return (self._start or 0) + round(self._elapsed * self._rate)

    def abort(self, reason: str) -> None:
        """End the plan here."""
        if not self.finished:
            self.finished = True
            self.aborted = reason

    def take(self, step: Step) -> float:
        """Take note of a step that begins and return how long it takes, in seconds."""
        if isinstance(step, WaitStep):
            return step.duration
        if isinstance(step, SpeedStep):
            change = abs(step.speed_hz - self._speed_hz)
            self._speed_hz = step.speed_hz
            return change / (step.ramp_hz_per_s or self._default_ramp)
        return 0.0

    def _begin(self) -> Action:
        """Begin the next step."""
        step, sample = self.plan.steps[self._next], self.next_sample
        self._next += 1
        self._elapsed += self.take(step)
        text = f"step {self._next} of {len(self.plan.steps)}: {sentence(step)}"
        return Action(self._next, sample, *_command(step), text)


def _command(step: Step) -> tuple[str, dict[str, float], dict[str, str]]:
    """Return command, values and texts of a step."""
    if isinstance(step, SpeedStep):
        ramp = {} if step.ramp_hz_per_s is None else {"ramp_hz_per_s": step.ramp_hz_per_s}
        return "speed", {"speed_hz": step.speed_hz} | ramp, {}
    if isinstance(step, HitStep):
        return "hit", {"force": step.force, "duration": step.duration}, {"solenoid": step.solenoid}
    if isinstance(step, MarkStep):
        return "mark", {}, {"text": step.text}
    return "", {}, {}


def sentence(step: Step) -> str:
    """Say what a step does, with its note."""
    if isinstance(step, WaitStep):
        said = f"wait {step.duration:g} s"
    elif isinstance(step, SpeedStep):
        ramp = "the default ramp" if step.ramp_hz_per_s is None else f"{step.ramp_hz_per_s:g} Hz/s"
        said = f"{step.speed_hz:g} Hz by {ramp}"
    elif isinstance(step, HitStep):
        said = f"solenoid {step.solenoid} hits with {step.force:g} N for {1e3 * step.duration:g} ms"
    else:
        said = f"mark: {step.text}"
    return f"{said} ({step.note})" if step.note else said


def shipped_plans() -> list[str]:
    """Return the names of the plans that come with the product."""
    return list(toml_source.shipped("plan"))


def load_plan(name_or_path: str | Path, rig: Rig) -> Plan:
    """Read a plan, by shipped name or by path, and validate it against the rig. Raises `PlanError`."""
    try:
        path = toml_source.find(name_or_path, "plan")
        text = toml_source.read(path)
    except RigError as error:
        raise PlanError(str(error)) from error
    return plan_from_text(text, rig, str(path))


def plan_from_text(text: str, rig: Rig, source: str = "plan") -> Plan:
    """Make a plan of TOML text and validate it against the rig. Raises `PlanError`."""
    try:
        tables = toml_source.parse(text, source)
    except RigError as error:
        raise PlanError(str(error)) from error
    try:
        return _plan(tables, rig)
    except RigError as error:
        raise PlanError(f"{source}: {error}") from error


def _plan(tables: Mapping[str, Any], rig: Rig) -> Plan:
    """Validate the tables of a plan."""
    for name in tables:
        if name not in ("plan", "step"):
            raise RigError(f"[{name}] is not a table of a plan{nearest(name, ('plan', 'step'), 'it has')}")
    if "plan" not in tables:
        raise RigError("table [plan] is missing; it holds: name, description")
    head = tuple_at(PlanHead, tables["plan"], "[plan]")
    rows = tables.get("step", [])
    if not isinstance(rows, list) or not rows:
        raise RigError("there is no [[step]]; a plan has at least one")
    numbered = [(number, step) for number, row in enumerate(rows, 1) for step in _steps(row, number, rig)]
    plan = Plan(head.name, head.description, tuple(step for _, step in numbered))
    _check_hits(plan, [number for number, _ in numbered], rig)
    return plan


def _steps(row: Any, number: int, rig: Rig) -> list[Step]:
    """Validate one row and return the steps that it stands for."""
    place = f"[[step]] {number}"
    if not isinstance(row, Mapping) or "do" not in row:
        raise RigError(f"{place} lacks do: one of {', '.join(STEPS)}")
    kind = row["do"]
    if not isinstance(kind, str) or kind not in STEPS:
        raise RigError(f"{place} do = {kind!r} is not a step{nearest(str(kind), STEPS, 'the steps are')}")
    step: Step | Stair = tuple_at(STEPS[kind], {key: row[key] for key in row if key != "do"}, place)
    if not isinstance(step, Stair):
        _check_step(step, place, rig)
        return [step]
    try:
        steps = step.steps()
    except RigError as error:
        raise RigError(f"{place} {error}") from error
    for each in steps:
        _check_step(each, place, rig)
    return steps


def _check_step(step: Step, place: str, rig: Rig) -> None:
    """Check a step against what the rig allows."""
    if isinstance(step, SpeedStep):
        _at_most(
            step.speed_hz, rig.command.max_speed_hz, f"{place} speed_hz", f"{rig.name} [command] max_speed_hz"
        )
        allowed = f"{rig.name} [command] max_ramp_hz_per_s"
        _at_most(step.ramp_hz_per_s or 0.0, rig.command.max_ramp_hz_per_s, f"{place} ramp_hz_per_s", allowed)
    if isinstance(step, HitStep):
        try:
            solenoid = rig.solenoid(step.solenoid)
        except RigError as error:
            raise RigError(f'{place} solenoid = "{step.solenoid}": {rig.name}: {error}') from error
        owner = f"{rig.name} [[solenoid]] {solenoid.name}"
        _at_most(step.force, solenoid.max_force, f"{place} force", f"{owner} max_force")
        _at_most(step.duration, solenoid.max_duration, f"{place} duration", f"{owner} max_duration")


def _check_hits(plan: Plan, numbers: list[int], rig: Rig) -> None:
    """Refuse a hit that would begin before the one before is over; `numbers` are the steps' rows."""
    runner = PlanRunner(plan, rig)
    now = busy_until = 0.0
    for number, step in zip(numbers, plan.steps, strict=True):
        if isinstance(step, HitStep):
            if now < busy_until:
                raise RigError(
                    f"[[step]] {number} hits {now:g} s after the beginning, while the hit before lasts "
                    f"until {busy_until:g} s; put a wait between them"
                )
            busy_until = now + step.duration
        now += runner.take(step)


def _at_most(value: float, limit: float, place: str, allowed: str) -> None:
    """Refuse a value above what the rig allows."""
    if value > limit:
        raise RigError(f"{place} = {value:g} is above {limit:g}, {allowed}")
