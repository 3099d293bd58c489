"""`rigtwin plan ...`: list, show, check and perform test plans."""

import argparse
import json
from contextlib import suppress
from dataclasses import replace
from math import tau
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from rigtwin.live import add_rig_options, rig_of

if TYPE_CHECKING:
    from daq.commanding.plan import Plan
    from daq.rig import Rig


class Peaks(NamedTuple):
    """What a plan comes to on the rig's model."""

    samples: int
    radius: float  # m, at the backup bearing
    force: float  # N, resultant of the transducers
    speed_hz: float
    aborted: str  # why the plan was cut short; empty when it was not


def add_parser(commands: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Add `plan` to the command line."""
    parser = commands.add_parser(
        "plan",
        help="repeatable tests: list, show, check, run, resume",
        description="A plan says what a rig shall do, step by step, in one TOML file.",
    )
    verbs = parser.add_subparsers(title="verbs", metavar="VERB", required=True)
    for name, run, what in (
        ("list", run_list, "the plans that come with rigtwin"),
        ("show", run_show, "print the steps of a plan"),
        ("check", run_check, "check a plan against a rig and perform it on the rig's model"),
    ):
        verb = verbs.add_parser(name, help=what)
        if name != "list":
            verb.add_argument("plan", metavar="NAME|PATH", help="shipped name or TOML file")
        add_rig_options(verb)
        if name == "check":
            verb.add_argument(
                "--found",
                type=Path,
                metavar="FILE",
                help="perform it with the parameters that the twin found: a rig file of `rigtwin twin "
                "--rig-out`, or a recording with estimates",
            )
        verb.add_argument("--json", action="store_true", help="print JSON")
        verb.set_defaults(run=run)
    perform = verbs.add_parser("run", help="perform a plan on the running rig")
    perform.add_argument("plan", metavar="NAME|PATH", help="shipped name or TOML file")
    resume = verbs.add_parser("resume", help="go on with the plan that was cut short, from its last step on")
    for verb, order in ((perform, run_run), (resume, run_resume)):
        verb.add_argument("--rig", metavar="NAME", help="which rig, where several run")
        verb.set_defaults(run=order)


def run_list(options: argparse.Namespace) -> int:
    """Print the shipped plans that the rig can perform, with their durations on it."""
    from daq.commanding.plan import PlanError, load_plan, shipped_plans

    rig, plans = rig_of(options), []
    for name in shipped_plans():
        with suppress(PlanError):  # it asks for more than this rig has
            plans.append(load_plan(name, rig))
    if options.json:
        print(json.dumps([_facts(plan, rig) for plan in plans]))
        return 0
    for plan in plans:
        print(f"{plan.name:16} {plan.expected_duration(rig):5.0f} s  {plan.description}")
    return 0


def _facts(plan: "Plan", rig: "Rig") -> dict[str, object]:
    """What is known of a plan without performing it."""
    return {
        "name": plan.name,
        "description": plan.description,
        "steps": len(plan.steps),
        "expected_duration": plan.expected_duration(rig),
    }


def run_show(options: argparse.Namespace) -> int:
    """Print each step with the time at which it begins."""
    from daq.commanding.plan import load_plan
    from daq.commanding.plan_steps import lasting, sentence, speed_after

    rig = rig_of(options)
    plan = load_plan(options.plan, rig)
    now, speed_hz, rows = 0.0, 0.0, []
    for step in plan.steps:
        rows.append({"begins": now, "does": sentence(step)})
        now += lasting(step, speed_hz, rig)
        speed_hz = speed_after(step, speed_hz)
    if options.json:
        print(json.dumps(_facts(plan, rig) | {"steps": rows}))
        return 0
    print(f"{plan.name}: {plan.description}")
    for number, row in enumerate(rows, 1):
        print(f"{number:4}  {row['begins']:7.2f} s  {row['does']}")
    print(f"      {now:7.2f} s  end")
    return 0


def run_check(options: argparse.Namespace) -> int:
    """Check a plan, and perform it on the model; return 1 when it is refused or trips the limits."""
    from daq.backend import make_backend
    from daq.commanding.plan import PlanError, check_device, load_plan
    from daq.rig.limits import NO_LIMIT
    from daq.rig.toml_source import find

    rig, found = rig_as_found(options)
    find(options.plan, "plan")
    try:
        plan = load_plan(options.plan, rig)
        check_device(plan, rig, make_backend(rig.acquisition.backend).capabilities)
    except PlanError as error:
        print(json.dumps({"valid": False, "error": str(error)}) if options.json else error)
        return 1
    peaks = perform_on_model(rig, plan) if rig.model else None
    if options.json:
        trips = {name: limit.trip for name, limit in rig.limits._asdict().items() if limit != NO_LIMIT}
        model = peaks._asdict() if peaks else None
        facts = {"valid": True, **_facts(plan, rig), "model": model, "trips": trips, "found": found}
        print(json.dumps(facts))
    else:
        print(f"{plan.name} is valid on {rig.name}: about {plan.expected_duration(rig):.1f} s")
        if found:
            print(f"with {', '.join(found)} as found in {options.found}")
        print(_said(peaks, rig))
    return 1 if peaks and peaks.aborted else 0


def rig_as_found(options: argparse.Namespace) -> tuple["Rig", dict[str, float]]:
    """Return the rig that the options name, and which of its parameters are those that the twin found.

    With any, its model is the described one, whatever the emulated rig hides from the twin.
    """
    if options.found is None:
        return rig_of(options), {}
    from replay.found import found_values

    found = found_values(options.found)
    options.set = [*(f"{key}={value!r}" for key, value in found.items()), *options.set]
    return replace(rig_of(options), actual=None), found


def run_run(options: argparse.Namespace) -> int:
    """Give a plan to the operator of the running rig; return 1 when it is refused."""
    from daq.commanding.plan import load_plan
    from daq.rig import rig_from_text, toml_source
    from daq.runtime import running

    rig = rig_from_text(running(options.rig)["toml"])
    load_plan(options.plan, rig)
    return order(rig, "plan", {"toml": toml_source.read(toml_source.find(options.plan, "plan"))})


def run_resume(options: argparse.Namespace) -> int:
    """Let the operator of the running rig go on with its plan; return 1 when it is refused."""
    from daq.rig import rig_from_text
    from daq.runtime import running

    return order(rig_from_text(running(options.rig)["toml"]), "resume", {})


def order(rig: "Rig", name: str, texts: dict[str, str]) -> int:
    """Send an order that concerns plans and say what the operator answers."""
    from rigtwin.command import send

    answer = send(rig, name, {}, texts)
    print(answer.text if answer.accepted else f"refused: {answer.text}")
    return 0 if answer.accepted else 1


def perform_on_model(rig: "Rig", plan: "Plan") -> Peaks:
    """Perform a plan on the rig's model as the live daq would, and return what it comes to."""
    from rich.console import Console
    from rich.progress import Progress

    from daq import keys
    from daq.messages_pb2 import Summary
    from daq.offline import perform

    summaries: list[Summary] = []
    key = keys.summary(rig.name)

    def note(topic: str, payload: bytes) -> None:
        if topic == key:
            summaries.append(Summary.FromString(payload))

    with Progress(console=Console(stderr=True), transient=True) as bar:
        expected = plan.expected_duration(rig) * rig.acquisition.rate
        task = bar.add_task(f"{plan.name} on the model of {rig.name}", total=expected)
        outcome = perform(
            rig, plan, note, run="check", t0_ns=0, progress=lambda sample: bar.update(task, completed=sample)
        )
    return Peaks(
        outcome.samples,
        max(summary.radius_maximum for summary in summaries),
        max(summary.force_maximum for summary in summaries),
        max(summary.speed_hz for summary in summaries),
        outcome.aborted,
    )


def _said(peaks: Peaks | None, rig: "Rig") -> str:
    """Say what a plan comes to on the model."""
    if peaks is None:
        return "the rig has no model to perform it on"
    limits = rig.limits
    reached = (
        f"on the model it reaches {1e6 * peaks.radius:.0f} µm of {1e6 * limits.displacement.trip:.0f} µm, "
        f"{peaks.force:.0f} N of {limits.force.trip:.0f} N, "
        f"{peaks.speed_hz:.1f} Hz of {limits.speed.trip / tau:.1f} Hz"
    )
    return (
        f"{reached}; it does not complete: {peaks.aborted}" if peaks.aborted else f"{reached}; no limit trips"
    )
