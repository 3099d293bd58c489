"""The tables of a plan."""

from daq.plan import STEPS, PlanHead, load_plan, shipped_plans
from daq.rig import load_rig
from docs.generate.fields import section
from docs.generate.markdown import table

MEANINGS = {
    "solenoid": "name of one of the rig's",
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
    return "\n\n".join([head, *steps])


def shipped() -> str:
    """Return the plans that come with the product."""
    rig = load_rig("thesis-ball")
    plans = [load_plan(name, rig) for name in shipped_plans()]
    rows = [[f"`{plan.name}`", f"{plan.expected_duration(rig):.0f} s", plan.description] for plan in plans]
    return table(("name", "lasts", "does"), rows)
