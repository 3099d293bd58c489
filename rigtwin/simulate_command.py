"""`rigtwin simulate PLAN -o FILE`: a plan on the emulated rig, faster than real time, without a network."""

import argparse
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from rigtwin.live import add_meta_option, add_rig_options, rig_of

if TYPE_CHECKING:
    from daq.commanding.plan import Plan
    from daq.offline import Outcome
    from daq.rig import Rig


def add_parser(commands: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Add `simulate` to the command line."""
    parser = commands.add_parser(
        "simulate",
        help="perform a plan on the emulated rig, faster than real time",
        description="Perform a plan on the emulated rig, through acquisition, protection and twin, faster "
        "than real time and without a network. The recording is like a live one.",
    )
    parser.add_argument("plan", metavar="PLAN", help="shipped name or TOML file; see `rigtwin plan list`")
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="FILE", help="recording to write")
    parser.add_argument("--no-twin", action="store_true", help="acquire only")
    add_meta_option(parser)
    add_rig_options(parser)
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Simulate and say what came of it; return 1 when the plan was cut short."""
    from rich.console import Console
    from rich.progress import Progress

    from daq.commanding.plan import load_plan
    from daq.recording.metadata import metadata_of
    from replay.info import brief

    rig = rig_of(options)
    plan = load_plan(options.plan, rig)
    expected = round(plan.expected_duration(rig) * rig.acquisition.rate)
    with Progress(console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(f"{plan.name} on {rig.name}", total=expected)
        started = time.monotonic()
        outcome = simulate(
            rig,
            plan,
            options.output,
            twin=not options.no_twin,
            meta=metadata_of(options.meta),
            progress=lambda sample: bar.update(task, completed=sample),
        )
    seconds = outcome.samples / rig.acquisition.rate
    print(f"{seconds:.1f} s of {rig.name} simulated in {time.monotonic() - started:.1f} s")
    print(brief(options.output))
    if outcome.aborted:
        print(f"the plan was cut short: {outcome.aborted}")
    return 1 if outcome.aborted else 0


def simulate(
    rig: "Rig",
    plan: "Plan",
    path: str | Path,
    *,
    twin: bool = True,
    meta: Mapping[str, str] | None = None,
    progress: Callable[[int], object] = lambda sample: None,
) -> "Outcome":
    """Perform a plan on the emulated rig and record it with the twin's estimates.

    Args:
        rig: from `load_rig`; its backend must be the emulator.
        plan: from `load_plan`.
        path: recording to write; an existing file is refused.
        twin: whether the twin runs beside it.
        meta: what people tell of the run.
        progress: called with the sample index after each read.

    Returns:
        Samples made, and why the plan was cut short, if it was.

    Raises:
        RecordingError: the file cannot be written.
        BackendError: the rig is not an emulated one.
    """
    from daq import keys
    from daq.describe import describe
    from daq.offline import perform
    from daq.recording import RecordingWriter
    from daq.recording.withheld import Withheld
    from daq.timing import StartTime
    from twin.service import Twin

    start = StartTime(time.time_ns(), 0, "simulated")
    run_id = f"{rig.name}-simulated-{start.t0_ns}"
    observer = Twin(rig, run_id, start.t0_ns) if twin and rig.twin.model != "none" else None
    block, withheld = keys.block(rig.name), Withheld(rig.toml, rig.acquisition.rate)
    with RecordingWriter(path, describe(rig, run_id, start, emulated=True, meta=meta)) as writer:

        def record(key: str, payload: bytes) -> None:
            for message in withheld.release(key, payload):
                writer.add(*message)
            if key == block and observer is not None:
                for estimated in observer.process(payload):
                    writer.add(*estimated)

        outcome = perform(rig, plan, record, run=run_id, t0_ns=start.t0_ns, progress=progress)
        for made in observer.finish() if observer else ():
            writer.add(*made)
        writer.close(expected=outcome.samples, clean=True)
    return outcome
