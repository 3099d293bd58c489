"""A plan performed without a network, as fast as the computer goes: what `simulate` and `plan check` run."""

from collections.abc import Callable
from typing import NamedTuple

from daq.acquisition import Acquisition
from daq.backend import make_backend
from daq.events import Publish
from daq.messages_pb2 import Answer, Command
from daq.plan import Action, Plan, PlanRunner
from daq.rig import Rig

WHO = "plan"
REST_TIME = 15.0
"""s that the rotor is given to come to rest at the end."""


class Outcome(NamedTuple):
    """What came of a plan: samples made, and why it was cut short (empty when it was not)."""

    samples: int
    aborted: str


def perform(
    rig: Rig,
    plan: Plan,
    publish: Publish,
    *,
    run: str,
    t0_ns: int,
    begun: Callable[[Acquisition], object] = lambda acquisition: None,
    progress: Callable[[int], object] = lambda sample: None,
) -> Outcome:
    """Perform a plan on the rig's emulator and publish what the live daq would.

    Args:
        rig: whose backend must be the emulator.
        plan: what to do.
        publish: takes key and payload of each message, in order.
        run: run id.
        t0_ns: UTC given to sample 0, ns since 1970; equal inputs then give equal bytes.
        begun: called once when sample 0 is about to be read, before any block is published.
        progress: called with the sample index after each read.
    """
    backend = make_backend(rig.acquisition.backend, paced=False)
    backend.open(rig)
    try:
        acquisition = Acquisition(rig, backend, publish, run=run, t0_ns=t0_ns)
        acquisition.begin()
        begun(acquisition)
        aborted = _perform_steps(acquisition, PlanRunner(plan, rig), progress)
        _come_to_rest(acquisition, progress)
        acquisition.end()
    finally:
        backend.close()
    return Outcome(acquisition.sample, aborted)


def _perform_steps(acquisition: Acquisition, runner: PlanRunner, progress: Callable[[int], object]) -> str:
    lease = acquisition.serve(Command(name="arm", who=WHO)).lease
    while not runner.finished:
        for action in runner.due(acquisition.sample):
            answer = _begin_step(acquisition, action, lease)
            if not answer.accepted:
                runner.abort(f"{action.text}: {answer.text}")
        acquisition.step()
        progress(acquisition.sample)
        if acquisition.first_out:
            runner.abort(f"tripped: {acquisition.first_out}")
    return runner.aborted or ""


def _begin_step(acquisition: Acquisition, action: Action, lease: str) -> Answer:
    if not action.command:
        return Answer(accepted=True)
    command = Command(name=action.command, who=WHO, lease=lease, values=action.values, texts=action.texts)
    return acquisition.serve(command)


def _come_to_rest(acquisition: Acquisition, progress: Callable[[int], object]) -> None:
    acquisition.rest()
    latest = acquisition.sample + round(REST_TIME * acquisition.rig.acquisition.rate)
    while not acquisition.at_rest and acquisition.sample < latest:
        acquisition.step()
        progress(acquisition.sample)
