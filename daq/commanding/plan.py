"""Test plans: what a rig shall do, step by step, read from TOML and validated against the rig.

The steps are in `daq.commanding.plan_steps`, what performs them in `daq.commanding.plan_runner`.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

from daq.backend import Capabilities, no_pulse
from daq.commanding.plan_steps import (
    MOST_STEPS,
    STEPS,
    Abort,
    HitStep,
    Plan,
    RepeatStep,
    SpeedStep,
    Stair,
    Step,
    lasting,
    speed_after,
)
from daq.rig import Rig, toml_source
from simulator.validation import NAME, RigError, nearest, tuple_at

__all__ = ["Plan", "PlanError", "PlanHead", "check_device", "load_plan", "plan_from_text", "shipped_plans"]

TABLES = ("plan", "step", "abort")


class PlanError(ValueError):
    """A plan that cannot be performed: the message names file, step, key, value and what is allowed."""


class PlanHead(NamedTuple):
    """Table `[plan]`: what the plan is called."""

    name: NAME
    description: str


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


def check_device(plan: Plan, rig: Rig, capabilities: Capabilities) -> None:
    """Refuse a plan with a hit that the rig's device would not end by itself. Raises `PlanError`."""
    if not plan.longest_hit:
        return
    if reason := no_pulse(capabilities, plan.longest_hit):
        raise PlanError(f"{plan.name} hits, but on the backend {rig.acquisition.backend} {reason}")


def _plan(tables: Mapping[str, Any], rig: Rig) -> Plan:
    """Validate the tables of a plan."""
    for name in tables:
        if name not in TABLES:
            raise RigError(f"[{name}] is not a table of a plan{nearest(name, TABLES, 'it has')}")
    if "plan" not in tables:
        raise RigError("table [plan] is missing; it holds: name, description")
    head = tuple_at(PlanHead, tables["plan"], "[plan]")
    rows = tables.get("step", [])
    if not isinstance(rows, list) or not rows:
        raise RigError("there is no [[step]]; a plan has at least one")
    groups: list[list[Step]] = []  # the steps that each row stands for
    numbered: list[tuple[int, Step]] = []  # with the row that they come from
    for number, row in enumerate(rows, 1):
        groups.append(_steps(row, number, rig, groups))
        numbered += [(number, step) for step in groups[-1]]
        if len(numbered) > MOST_STEPS:
            raise RigError(f"[[step]] {number} makes more than {MOST_STEPS} steps of the plan")
    aborts = tuple(
        tuple_at(Abort, row, f"[[abort]] {number}") for number, row in enumerate(tables.get("abort", []), 1)
    )
    plan = Plan(head.name, head.description, tuple(step for _, step in numbered), aborts)
    _check_hits(plan, [number for number, _ in numbered], rig)
    return plan


def _steps(row: Any, number: int, rig: Rig, before: list[list[Step]]) -> list[Step]:
    """Validate one row and return the steps that it stands for; `before` are those of the rows before."""
    place = f"[[step]] {number}"
    if not isinstance(row, Mapping) or "do" not in row:
        raise RigError(f"{place} lacks do: one of {', '.join(STEPS)}")
    kind = row["do"]
    if not isinstance(kind, str) or kind not in STEPS:
        raise RigError(f"{place} do = {kind!r} is not a step{nearest(str(kind), STEPS, 'the steps are')}")
    step = tuple_at(STEPS[kind], {key: row[key] for key in row if key != "do"}, place)
    if isinstance(step, RepeatStep):
        if step.last > len(before):
            raise RigError(f"{place} last = {step.last}, but there are only {len(before)} rows before it")
        repeated = [each for group in before[-step.last :] for each in group]
        if step.times * len(repeated) > MOST_STEPS:
            raise RigError(f"{place} makes more than {MOST_STEPS} steps of the plan")
        return step.times * repeated
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
    now = busy_until = speed_hz = 0.0
    for number, step in zip(numbers, plan.steps, strict=True):
        if isinstance(step, HitStep):
            if now < busy_until:
                raise RigError(
                    f"[[step]] {number} hits {now:g} s after the beginning, while the hit before lasts "
                    f"until {busy_until:g} s; put a wait between them"
                )
            busy_until = now + step.duration
        now += lasting(step, speed_hz, rig)
        speed_hz = speed_after(step, speed_hz)


def _at_most(value: float, limit: float, place: str, allowed: str) -> None:
    """Refuse a value above what the rig allows."""
    if value > limit:
        raise RigError(f"{place} = {value:g} is above {limit:g}, {allowed}")
