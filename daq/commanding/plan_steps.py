"""The steps of a plan: what each says, which command it sends, how people read it."""

from dataclasses import dataclass
from math import radians
from typing import Annotated, Literal, NamedTuple

from daq.rig import Rig
from simulator.validation import Pattern, Quantity, RigError

SHOWN = {"radius": (1e6, "µm"), "force": (1.0, "N"), "speed": (1.0, "Hz")}
"""Factor and unit in which people read what a plan watches."""


def shown(quantity: str, value: float) -> str:
    """Return a watched value with the unit that people read."""
    factor, unit = SHOWN[quantity]
    return f"{factor * value:.4g} {unit}"


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
    angle_deg: Annotated[
        float | None, Quantity("deg", 0.0, 360.0, "shaft angle at which it begins; at once if none")
    ] = None
    note: str | None = None


class MarkStep(NamedTuple):
    """`do = "mark"`: write a text into the recording."""

    text: Annotated[str, Pattern(r".{1,500}", "a text of 1 to 500 characters on one line")]
    note: str | None = None


class RecordStep(NamedTuple):
    """`do = "record"`: switch recording off or on again; the next step comes at once.

    While it is off no samples are recorded, but all events and summaries; protection is as ever. A trip, a
    stop and the plan's end switch it on again, and a trip records what came before it too.
    """

    switch: Literal["on", "off"]
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


class SettleStep(NamedTuple):
    """`do = "settle"`: go on as it is until a quantity has stayed within a band, or cut the plan short."""

    quantity: Literal["radius", "force", "speed"]
    within: Annotated[float, Quantity("m, N or Hz", 0.0, 1e7, "width of the band in which it has to stay")]
    hold: Annotated[float, Quantity("s", 1e-3, 1e6, "for how long")]
    timeout: Annotated[float, Quantity("s", 1e-3, 1e6, "after which the plan is cut short")]
    note: str | None = None


class RepeatStep(NamedTuple):
    """`do = "repeat"`: perform the rows before it again."""

    last: Annotated[int, Quantity("rows", 1, 1000, "how many of the rows before it")]
    times: Annotated[int, Quantity("1", 1, 10_000, "how often again")]


class Abort(NamedTuple):
    """Row `[[abort]]`: what cuts the plan short, well before the limits of the rig trip."""

    quantity: Literal["radius", "force", "speed"]
    above: Annotated[float, Quantity("m, N or Hz", 0.0, 1e7, "level of the largest value in a block")]
    duration: Annotated[float, Quantity("s", 0.0, 1e6, "for how long")] = 0.0


MOST_STEPS = 100_000
MOST_LEVELS = 10_000
Step = WaitStep | SpeedStep | HitStep | MarkStep | RecordStep | SettleStep
Row = Step | Stair | RepeatStep
STEPS: dict[str, type[Row]] = {
    "wait": WaitStep,
    "speed": SpeedStep,
    "hit": HitStep,
    "mark": MarkStep,
    "record": RecordStep,
    "settle": SettleStep,
    "stair": Stair,
    "repeat": RepeatStep,
}


@dataclass(frozen=True)
class Plan:
    """A validated plan."""

    name: str
    description: str
    steps: tuple[Step, ...]
    aborts: tuple[Abort, ...] = ()

    @property
    def longest_hit(self) -> float:
        """Length of the longest hit, s; 0 for a plan without hits."""
        return max((step.duration for step in self.steps if isinstance(step, HitStep)), default=0.0)

    def expected_duration(self, rig: Rig) -> float:
        """Return how long the plan takes from rest, in seconds, where everything settles at once."""
        total = speed_hz = 0.0
        for step in self.steps:
            total += lasting(step, speed_hz, rig)
            speed_hz = speed_after(step, speed_hz)
        return total

    def rest_from(self, number: int) -> "Plan":
        """Return what is left of the plan from a step (from 1) on, after coming back to where it was."""
        done, left = self.steps[: number - 1], self.steps[number - 1 :]
        speed_hz, note = 0.0, "back to where the plan was"
        for step in done:
            speed_hz = speed_after(step, speed_hz)
        back: list[Step] = [SpeedStep(speed_hz, note=note)] if speed_hz else []
        if [step.switch for step in done if isinstance(step, RecordStep)][-1:] == ["off"]:
            back.append(RecordStep("off", note))
        return Plan(self.name, self.description, (*back, *left), self.aborts)


def lasting(step: Step, speed_hz: float, rig: Rig) -> float:
    """Return how long a step takes from a speed on, s; what settles does so at once."""
    if isinstance(step, WaitStep):
        return step.duration
    if isinstance(step, SettleStep):
        return step.hold
    if isinstance(step, SpeedStep):
        change = abs(step.speed_hz - speed_hz)
        return change / (step.ramp_hz_per_s or rig.command.default_ramp_hz_per_s)
    return 0.0


def speed_after(step: Step, speed_hz: float) -> float:
    """Return the set-point after a step, Hz."""
    return step.speed_hz if isinstance(step, SpeedStep) else speed_hz


def command_of(step: Step) -> tuple[str, dict[str, float], dict[str, str]]:
    """Return command, values and texts of a step."""
    if isinstance(step, SpeedStep):
        ramp = {} if step.ramp_hz_per_s is None else {"ramp_hz_per_s": step.ramp_hz_per_s}
        return "speed", {"speed_hz": step.speed_hz} | ramp, {}
    if isinstance(step, HitStep):
        angle = {} if step.angle_deg is None else {"angle": radians(step.angle_deg)}
        return "hit", {"force": step.force, "duration": step.duration} | angle, {"solenoid": step.solenoid}
    if isinstance(step, MarkStep):
        return "mark", {}, {"text": step.text}
    if isinstance(step, RecordStep):
        return "record", {}, {"switch": step.switch}
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
        said += "" if step.angle_deg is None else f" at {step.angle_deg:g} deg"
    elif isinstance(step, SettleStep):
        said = (
            f"until the {step.quantity} stays within {shown(step.quantity, step.within)} for {step.hold:g} s"
        )
    elif isinstance(step, RecordStep):
        said = f"recording {step.switch}"
    else:
        said = f"mark: {step.text}"
    return f"{said} ({step.note})" if step.note else said
