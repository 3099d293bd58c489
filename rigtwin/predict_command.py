"""`rigtwin predict`: what the rotor will come to, by the model run ahead from the twin's estimate."""

import argparse
import json
from math import tau
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from daq.rig import Rig
    from twin.forecast import Forecast, Range

RARELY = 0.05  # share of the runs that may trip a limit


def add_parser(commands: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Add `predict` to the command line."""
    parser = commands.add_parser(
        "predict",
        help="run the model ahead: largest orbit and force to come",
        description="Run the model ahead from the twin's estimate, of the running rig or in a recording, "
        "with what the twin is not sure of drawn by chance. It foretells what holding the speed comes to, "
        "and what the plan's next speed does. Exit code 1: a limit would trip in more than one run of "
        "twenty.",
    )
    parser.add_argument("file", type=Path, nargs="?", metavar="FILE", help="default: the running rig")
    parser.add_argument("--at", type=float, metavar="S", help="moment in the recording, s after its start")
    parser.add_argument("--rig", metavar="NAME", help="which rig, where several run")
    parser.add_argument("--speed", type=float, metavar="HZ", help="speed to go to; default: the plan's next")
    parser.add_argument("--ramp", type=float, metavar="HZ/S", help="with --speed; default: the rig's")
    parser.add_argument("--json", action="store_true", help="print one JSON object, in SI units")
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Foretell; return 1 when a limit would trip."""
    from daq.rig import RigError, rig_from_text
    from daq.runtime import running
    from twin.forecast import course_of, forecast
    from twin.present import of_recording, of_running

    if (options.file is None) != (options.at is None):
        raise RigError("a recording needs --at, the moment to foretell from, and the running rig has none")
    if options.file:
        present = of_recording(options.file, options.at)
    else:
        present = of_running(rig_from_text(running(options.rig)["toml"]))
    rig, values = present.rig, present.values
    found = {"hold": forecast(rig, values)}
    if options.speed is not None:
        found["change"] = forecast(rig, values, course_of(rig, options.speed, options.ramp))
    elif present.next_step:
        step = present.next_step
        found["next step"] = forecast(rig, values, course_of(rig, step.speed_hz, step.ramp_hz_per_s))
    report(rig, present.sample / rig.acquisition.rate, found, options.json)
    return 1 if any(each.trips > RARELY for each in found.values()) else 0


def report(rig: "Rig", time: float, found: "dict[str, Forecast]", as_json: bool) -> None:
    """Print forecasts, made from the estimate at a time (s)."""
    if as_json:
        print(json.dumps({"time": time, **{name: facts(each) for name, each in found.items()}}))
        return
    first = found["hold"]
    print(f"from the estimate at {time:.2f} s, {first.rigs} runs of the model each; in brackets 5 to 95 %:")
    for name, each in found.items():
        print(f"{name:10} {sentence(rig, each)}")


def facts(forecast: "Forecast") -> dict[str, object]:
    """Return a forecast for JSON, in SI units."""
    return {
        name: value._asdict() if hasattr(value, "_asdict") else value
        for name, value in forecast._asdict().items()
    }


def sentence(rig: "Rig", forecast: "Forecast") -> str:
    """Say what a forecast says."""
    limits = rig.limits
    text = (
        f"{forecast.speed / tau:.2f} Hz, {forecast.seconds:.1f} s ahead: orbit "
        f"{between(forecast.radius, 1e6)} µm (trip {1e6 * limits.displacement.trip:.0f} µm), contact force "
        f"{between(forecast.contact_force)} N, transducers {between(forecast.transducer_force)} N "
        f"(trip {limits.force.trip:.0f} N); free at the end in {forecast.free:.0%}"
    )
    return f"{text}; TRIPS in {forecast.trips:.0%}" if forecast.trips else text


def between(found: "Range", scale: float = 1.0) -> str:
    """Write a range."""
    return f"{scale * found.middle:.0f} ({scale * found.low:.0f} to {scale * found.high:.0f})"
