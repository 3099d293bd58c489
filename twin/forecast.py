"""What the rotor will come to if the speed is held or changed: the model ahead of time, from an estimate."""

from collections.abc import Mapping, Sequence
from math import tau
from typing import NamedTuple

import numpy as np

from daq.rig import Rig, RigError
from twin.branches import Branch, Peaks
from twin.ensemble import drawn

RIGS = 16  # drawn about the estimate
SETTLING = 3.0  # s that the speed is held, at its new value if there is one
QUIET = 0.5  # s without contact at the end that count as free
MARGINS = (0.05, 0.5, 0.95)  # quantiles


class Course(NamedTuple):
    """What is to be done: hold the speed, or ramp to another and hold that."""

    speed: float  # rad/s
    ramp: float  # rad/s2


class Range(NamedTuple):
    """What nineteen rigs of twenty stay above, every other one, and nineteen of twenty stay below."""

    low: float
    middle: float
    high: float


class Forecast(NamedTuple):
    """What an ensemble of runs came to."""

    speed: float  # rad/s, at the end
    seconds: float  # that the model ran ahead
    rigs: int
    radius: Range  # m, largest of the shaft's centre at the backup bearing
    contact_force: Range  # N, largest normal force
    transducer_force: Range  # N, largest resultant
    free: float  # share of the rigs without contact at the end
    trips: float  # share of the rigs that trip the limits of displacement or force


def forecast(rig: Rig, values: Mapping[str, float], course: Course | None = None, seed: int = 0) -> Forecast:
    """Run the rigs that an estimate allows ahead, and return what they come to.

    Args:
        rig: with a model.
        values: one column of an estimate by row name.
        course: None holds the present speed.
        seed: of the draws; equal arguments give equal forecasts.

    Raises:
        RigError: the rig has no model.
        SimulationError: a rig diverges.
    """
    if rig.model is None:
        raise RigError(f"{rig.name} has no model: there is nothing to run ahead")
    speed, seconds = values["speed"], SETTLING
    if course:
        seconds += abs(course.speed - speed) / course.ramp
        speed = course.speed
    peaks = []
    for each in drawn(rig.model, values, RIGS, seed):
        branch = Branch(each, rig.acquisition.rate)
        if course:
            branch.set_speed(course.speed, course.ramp)
        peaks.append(branch.run(seconds))
    return summed_up(rig, speed, seconds, peaks)


def summed_up(rig: Rig, speed: float, seconds: float, peaks: Sequence[Peaks]) -> Forecast:
    """Return what runs amount to."""
    columns = np.array(peaks).T
    radius, contact, transducer = (Range(*np.quantile(column, MARGINS).tolist()) for column in columns[:3])
    return Forecast(
        speed,
        seconds,
        len(peaks),
        radius,
        contact,
        transducer,
        float(np.mean(columns[3] >= QUIET)),
        float(np.mean([peak.trip(rig.limits) for peak in peaks])),
    )


def course_of(rig: Rig, speed_hz: float, ramp_hz_per_s: float | None = None) -> Course:
    """Return the course to a speed (Hz) by a ramp (Hz/s), by default the rig's. Raises `RigError`."""
    ramp = rig.command.default_ramp_hz_per_s if ramp_hz_per_s is None else ramp_hz_per_s
    for value, name, highest, unit in (
        (speed_hz, "speed", rig.command.max_speed_hz, "Hz"),
        (ramp, "ramp", rig.command.max_ramp_hz_per_s, "Hz/s"),
    ):
        if not 0.0 <= value <= highest or (name == "ramp" and value == 0.0):
            raise RigError(f"{name} = {value:g} {unit} is not within {rig.name}'s 0 to {highest:g} {unit}")
    return Course(tau * speed_hz, tau * ramp)
