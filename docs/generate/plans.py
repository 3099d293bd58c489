"""The tables of a plan."""

from contextlib import suppress

from daq.commanding.plan import Plan, PlanError, PlanHead, load_plan, shipped_plans
from daq.commanding.plan_steps import STEPS, Abort
from daq.rig import Rig, load_rig, shipped_rigs
from docs.generate.fields import section
from docs.generate.markdown import table

MEANINGS = {
    "solenoid": "name of one of the rig's",
    "switch": "whether samples are recorded from here on",
    "quantity": "radius of the shaft's centre, resultant force, or speed",
    "note": "for people: shown and recorded with the step",
}


def tables() -> str:
    """Return a section for the head and for each kind of step."""
    head = section(PlanHead, "`[plan]`", {"name": "in events;", "description": "one line for people"})
    steps = [
        section(
            kind,
            f'`do = "{name}"`',
            {key: MEANINGS[key] for key in MEANINGS.keys() & set(kind.__annotations__)},
        )
        for name, kind in STEPS.items()
    ]
    abort = section(Abort, "`[[abort]]`", {"quantity": "what is watched"})
    return "\n\n".join([head, *steps, abort])


def shipped() -> str:
    """Return the plans that come with the product, each on the first shipped rig that can perform it."""
    rigs = [load_rig(name) for name in sorted(shipped_rigs(), key=lambda name: name != "thesis-ball")]
    rows = []
    for name in shipped_plans():
        rig, plan = first_suited(name, rigs)
        lasts = f"{plan.expected_duration(rig):.0f} s"
        rows.append([f"`{plan.name}`", f"`{rig.name}`", lasts, plan.description])
    return table(("name", "for example on", "lasts", "does"), rows)


def first_suited(name: str, rigs: list[Rig]) -> tuple[Rig, Plan]:
    """Return the first of the rigs that can perform a plan, and the plan."""
    for rig in rigs:
        with suppress(PlanError):
            return rig, load_plan(name, rig)
    raise PlanError(f"no shipped rig can perform {name}")
