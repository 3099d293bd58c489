"""`rigtwin live`: supervise a run of daq, recorder, twin, display and operator."""

import argparse
from datetime import UTC, datetime
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable

    from daq.commanding.plan import Plan
    from daq.rig import Rig
    from rigtwin.supervisor import Supervisor

FOLDER = Path("recordings")
END_ORDER = ("operator", "daq", "recorder", "twin", "display")


def add_parser(commands: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Add `live` to the command line."""
    parser = commands.add_parser(
        "live",
        help="run the rig: acquire, protect, record, twin, show",
        description="Run the rig (the emulated one unless its description names a device): acquire, protect, "
        "publish, record, run the twin beside it and show it. Ctrl-C ends the run in order: the rotor is "
        "brought to rest and the recording is closed and certified.",
    )
    add_rig_options(parser)
    parser.add_argument(
        "--plan", help="plan to perform: a shipped name, a TOML file, or none (default: the rig's)"
    )
    parser.add_argument("--duration", type=float, metavar="S", help="end the run after this many seconds")
    where = parser.add_mutually_exclusive_group()
    where.add_argument(
        "--record", type=Path, metavar="PATH", help="recording to write (default: recordings/...)"
    )
    parser.add_argument(
        "--rotate",
        metavar="SIZE|TIME",
        help="begin a new file of the recording whenever one is so large: 2GB, 500MB, 10min, 1h",
    )
    where.add_argument("--no-record", action="store_true", help="keep no recording")
    add_meta_option(parser)
    add_view_option(parser)
    parser.set_defaults(run=run)


def add_rig_options(parser: argparse.ArgumentParser) -> None:
    """Add the options that say which rig, and with which changes."""
    parser.add_argument(
        "--rig", default="thesis-ball", metavar="NAME|PATH", help="rig (default: thesis-ball)"
    )
    parser.add_argument("--seed", type=int, metavar="N", help="seed of the emulated rig's noise")
    parser.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="TABLE.KEY=VALUE",
        help="change the rig description for this run, e.g. emulator.actual.rotor.unbalance_angle=2.1",
    )


def add_meta_option(parser: argparse.ArgumentParser) -> None:
    """Add the option that tells of the run."""
    parser.add_argument(
        "--meta",
        action="append",
        default=[],
        metavar="KEY=VALUE",
        help="goes into the recording, as operator=anna; usual are specimen, purpose, mounted_masses",
    )


def add_view_option(parser: argparse.ArgumentParser) -> None:
    """Add the option that says how to show the run."""
    parser.add_argument(
        "--view",
        choices=("web", "native", "none"),
        default="web",
        help="viewer: a local web page (default), ...",
    )


def rig_of(options: argparse.Namespace) -> "Rig":
    """Load the rig that the options name, with their changes."""
    from daq.rig import load_rig

    seed = [] if options.seed is None else [f"emulator.seed={options.seed}"]
    return load_rig(options.rig, [*seed, *options.set])


def run(options: argparse.Namespace) -> int:
    """Run the rig; return 0 when all went as planned, 1 when the plan was cut short or something failed."""
    from daq.backend import check_known
    from daq.ports import check_free, with_free_ports
    from daq.recording.metadata import metadata_of
    from daq.recording.rotation import rotation
    from daq.runtime import refuse_second
    from rigtwin.supervisor import StopRequest

    rig = rig_of(options)
    check_known(rig.acquisition.backend)
    plan = plan_of(options, rig)
    metadata_of(options.meta)
    if options.rotate:
        rotation(options.rotate)  # refused now rather than by the recorder
    refuse_second(rig.name)
    check_free(rig)
    rig = with_free_ports(rig)
    path = None if options.no_record else new_recording(options.record, rig.name)
    with TemporaryDirectory(prefix="rigtwin-") as folder, StopRequest() as stop:
        supervisor = start(rig, plan, path, options, Path(folder))
        over = end_condition(supervisor, plan, options.duration)
        try:
            supervisor.run(stop, over)
            if supervisor.monitor.picture.aborted:  # by a trip or a refusal; not by the end that we order now
                supervisor.failed = supervisor.monitor.picture.plan_over or ""
        finally:
            if stop.made:
                supervisor.screen.line("ending in order: rotor to rest, recording closed")
            supervisor.finish(END_ORDER)
    return report(supervisor, path)


def plan_of(options: argparse.Namespace, rig: "Rig") -> "Plan | None":
    """The plan to perform. Without an option that is the rig's own, but only on an emulated rig."""
    from daq.commanding.plan import load_plan

    if options.plan == "none" or (options.plan is None and not (rig.emulated and rig.plan)):
        return None
    return load_plan(options.plan or rig.plan, rig)


def new_recording(path: Path | None, rig: str) -> Path:
    """The recording to write, which must not exist, in a folder that can be written."""
    from daq.recording import prepare

    if path is None:
        path = FOLDER / f"{rig}-{datetime.now(UTC):%Y%m%dT%H%M%SZ}.mcap"
    return prepare(path)


def start(
    rig: "Rig", plan: "Plan | None", path: Path | None, options: argparse.Namespace, folder: Path
) -> "Supervisor":
    """Start the processes of the run."""
    from rigtwin.crew import Crew
    from rigtwin.supervisor import Supervisor, write_rig

    supervisor = Supervisor(rig, Crew(folder), essential=["daq"], recording=path is not None)
    greet(supervisor, rig, plan, path)
    toml = write_rig(rig, folder)
    waits = ["operator"]
    if path is not None:
        status = supervisor.monitor.endpoint
        recorder = ["twin", "record", "--rig", toml, "--file", str(path), "--connect", status]
        recorder += ["--rotate", options.rotate] if options.rotate else []
        supervisor.add("recorder", recorder, again=lambda: [*recorder, *next_part_options(path)])
        waits.append("recorder")
    if rig.twin.model != "none":
        supervisor.add("twin", ["twin", "observe", "--rig", toml])
        waits.append("twin")
    meta = [f"--meta={setting}" for setting in options.meta]
    supervisor.add("daq", ["daq", "acquire", "--rig", toml, "--wait-for", ",".join(waits), *meta])
    operator = ["daq", "operate", "--rig", toml]
    planned = ["--plan", options.plan or rig.plan] if plan else []
    supervisor.add("operator", [*operator, *planned], again=lambda: operator)  # nothing moves by itself
    if options.view != "none":
        start_display(supervisor, options.view, toml)
    return supervisor


def greet(supervisor: "Supervisor", rig: "Rig", plan: "Plan | None", path: Path | None) -> None:
    """Say what is about to run."""
    mode = "EMULATED" if rig.emulated else "LIVE"
    supervisor.screen.line(f"{mode} {rig.name}: {rig.description}")
    if plan is None:
        order = "command arm" if rig.emulated else "plan run PLAN"
        supervisor.screen.line(f"no plan: nothing moves until `rigtwin {order}`; Ctrl-C ends the run")
    else:
        supervisor.screen.line(
            f"plan {plan.name}, about {plan.expected_duration(rig):.0f} s: {plan.description}"
        )
    if path is not None:
        supervisor.screen.line(f"recording {path}")
    compiling = " (the first start compiles the model, which takes about half a minute)" if rig.model else ""
    supervisor.screen.line(f"starting{compiling}")


def start_display(supervisor: "Supervisor", view: str, toml: str) -> None:
    """Start the display and print its address; without one the run goes on."""
    from daq.link import free_ports

    grpc, web = free_ports(2)
    arguments = [
        "twin",
        "display",
        "--rig",
        toml,
        "--view",
        view,
        "--grpc-port",
        str(grpc),
        "--web-port",
        str(web),
    ]
    supervisor.add("display", arguments)
    if view == "web":
        supervisor.announce("display", "http://", "watch it at ")


def next_part_options(path: Path) -> list[str]:
    """Options of a recorder that goes on where the one before it ended."""
    from twin.recorder import next_part

    _path, part, after = next_part(path)
    return ["--part", str(part), "--after", str(after)]


def end_condition(
    supervisor: "Supervisor", plan: "Plan | None", duration: float | None
) -> "Callable[[], bool]":
    """Return a function that says whether the run is over by itself."""
    picture = supervisor.monitor.picture

    def over() -> bool:
        planned = plan is not None and picture.plan_over is not None
        return planned or (duration is not None and picture.time >= duration)

    return over


def report_recording(supervisor: "Supervisor", path: Path) -> None:
    """Say what was recorded; a run that began and was not recorded has failed."""
    from replay.info import brief

    if path.exists():
        supervisor.screen.line(brief(path))
        supervisor.screen.line(f"see it again: rigtwin replay {path}")
    elif supervisor.monitor.picture.time > 0.0:
        supervisor.failed = supervisor.failed or f"nothing was recorded in {path}"


def report(supervisor: "Supervisor", path: Path | None) -> int:
    """Say what came of the run; return the exit code."""
    screen = supervisor.screen
    if path is not None:
        report_recording(supervisor, path)
    if supervisor.failed:
        screen.line(f"the run did not go as planned: {supervisor.failed}")
    return 1 if supervisor.failed else 0
