"""What was written to a device in a recorded run: what moved it, at the samples of its effect."""

from collections.abc import Iterable
from math import tau
from typing import NamedTuple

from daq.backend import HitOutput, Output, RestOutput, SpeedOutput
from daq.messages_pb2 import Event
from daq.rig import Rig

RESTS = ("stop", "trip", "lease_lost", "end")


class Written(NamedTuple):
    """One output."""

    written: int
    """Sample that the device had reached when it was written."""
    effect: int
    """Sample at which it takes effect."""
    output: Output


def outputs_of(events: Iterable[Event], rig: Rig) -> list[Written]:
    """Return the outputs that took effect, by their samples; a rest cancels what was still to come."""
    found: list[Written] = []
    for event in sorted(events, key=lambda event: event.sample):
        output = _output(event, rig) if event.source == "daq" else None
        if output is None:
            continue
        if isinstance(output, RestOutput):
            found = [each for each in found if each.effect <= event.sample]
        found.append(Written(event.sample, int(event.details["effect_sample"]), output))
    return sorted(found, key=lambda each: each.effect)


def _output(event: Event, rig: Rig) -> Output | None:
    """Return what an event says was written; None when nothing was."""
    details = event.details
    if "effect_sample" not in details:
        return None
    if event.kind == "speed":
        ramp = float(details.get("ramp_hz_per_s", rig.command.default_ramp_hz_per_s))
        return SpeedOutput(float(details["speed_hz"]) * tau, ramp * tau)
    if event.kind == "hit":
        solenoid = details.get("solenoid") or rig.solenoid_names[0]
        return HitOutput(solenoid, float(details["force"]), float(details["duration"]))
    return RestOutput(rig.safe_state.ramp) if event.kind in RESTS else None
