"""Trip and warning limits, checked on every sample: a pure function of samples, state and limits.

`daq.guard` turns the rig's limits and channels into a `Guard`; `check` takes one read's samples and the
state, and returns the state after it. Nothing here knows a device, a clock or the link, so the same
function answers on old recordings what other limits would have done.

A level counts when it has been exceeded on `persistence` consecutive samples. The first trip latches as
the first-out; later ones do not replace it. A sample that is not a number counts as exceeding. Where
measurements vote, as many of them as the limit says must exceed together, and one whose sensor is not OK
votes for exceeding. A sensor that is not OK (`daq.sensor_check`) trips by itself where a limit rests on it
without a vote, because a blind protection is none; any other only warns.
"""

from math import inf, pi
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from daq.guard import Condition, Guard, Multiplier, length, magnitude, rows_of, voted
from daq.sensor_check import (
    SensorGuard,
    SensorState,
    SensorVerdict,
    check_sensors,
    initial_sensors,
    not_ok,
    run_lengths,
)

SHOWN = {
    "displacement": (1e6, "µm"),
    "force": (1.0, "N"),
    "speed": (0.5 / pi, "Hz"),
    "speed_rate": (0.5 / pi, "Hz/s"),
}
"""Factor and unit in which people read each limited quantity."""


class Trip(NamedTuple):
    """Why the rig was brought to rest: the latched first-out."""

    cause: str
    sample: int
    text: str


class Warned(NamedTuple):
    """One warning."""

    cause: str
    sample: int
    text: str


class ConditionState(NamedTuple):
    """What is remembered of one condition from read to read."""

    above_trip: int  # consecutive samples above the trip level so far
    above_warn: int
    quiet: int  # samples since a warning's level was last exceeded
    maximum: float  # of the last read
    calm: bool  # whether the last read was nowhere above the warning level
    in_band: int  # consecutive samples with the speed in the multiplier's band
    past: NDArray[np.float32]  # newest samples, as many as the window of a rate; empty after a gap


class ProtectionState(NamedTuple):
    """What `check` remembers from read to read."""

    conditions: tuple[ConditionState, ...]  # in the guard's order
    sensors: SensorState
    next_sample: int  # index with which the next read begins when nothing is lost
    first_out: Trip | None


class Verdict(NamedTuple):
    """The state after a read, the trip that latched in it, the warnings, and whether all sensors are OK."""

    state: ProtectionState
    trip: Trip | None
    warnings: tuple[Warned, ...]
    sensors_ok: bool


def initial_state(guard: Guard) -> ProtectionState:
    """Return the state before the first sample: nothing exceeded, nothing latched."""
    calm = ConditionState(0, 0, guard.warning_hold, 0.0, True, 0, np.empty(0, np.float32))
    return ProtectionState((calm,) * len(guard.conditions), initial_sensors(guard.sensors), 0, None)


def check(samples: NDArray[np.float32], first_sample: int, state: ProtectionState, guard: Guard) -> Verdict:
    """Check one read.

    Args:
        samples: (n_channels, n) in the channels' units, n at least 1.
        first_sample: index of the first column. After a gap the counts go on as if there were none; the
            window of a rate begins anew.
        state: as returned for the read before, or `initial_state`.
        guard: of the rig.
    """
    sensors = check_sensors(samples, state.sensors, guard.sensors)
    found = findings_of(sensors, first_sample, guard.sensors)
    conditions = []
    for condition, before in zip(guard.conditions, state.conditions, strict=True):
        if first_sample != state.next_sample:
            before = before._replace(past=before.past[:0])
        conditions.append(
            check_condition(condition, samples, sensors.bad, first_sample, before, guard.warning_hold, found)
        )
    trips = [finding for finding in found if isinstance(finding, Trip)]
    trip = min(trips, key=lambda candidate: candidate.sample) if trips and state.first_out is None else None
    warnings = tuple(finding for finding in found if isinstance(finding, Warned))
    end = first_sample + samples.shape[1]
    after = ProtectionState(tuple(conditions), sensors.state, end, state.first_out or trip)
    return Verdict(after, trip, warnings, sensors.in_range)


def findings_of(sensors: SensorVerdict, first_sample: int, guard: SensorGuard) -> list[Trip | Warned]:
    """Return what the sensors that have become not OK lead to."""
    found: list[Trip | Warned] = []
    for row, column, text in sensors.faults:
        kind = Trip if guard.trips[row] else Warned
        cause = guard.names[row] if guard.contacts[row] else f"sensor {guard.names[row]}"
        found.append(kind(cause, first_sample + column, text))
    return found


def latch(state: ProtectionState, trip: Trip) -> ProtectionState:
    """Return the state with `trip` as first-out, unless another is latched already."""
    return state if state.first_out else state._replace(first_out=trip)


def reset(state: ProtectionState, guard: Guard) -> tuple[ProtectionState, str]:
    """Return the state without its latch and an empty text, or the same state and why it stays latched.

    A cause lives as long as the last read exceeded a warning level or ended with a sensor that is not OK.
    """
    for condition, now in zip(guard.conditions, state.conditions, strict=True):
        if not now.calm:
            return state, sentence(condition.name, now.maximum, "warning", condition.warn)
    for row in not_ok(state.sensors, guard.sensors):
        if guard.sensors.trips[row]:
            name = guard.sensors.names[row]
            if guard.sensors.contacts[row]:
                return state, f"the safety contact {name} is still open"
            return state, f"the sensor of {name} is still not OK"
    return state._replace(first_out=None), ""


def check_condition(
    condition: Condition,
    samples: NDArray[np.float32],
    bad: NDArray[np.bool_] | None,
    first_sample: int,
    before: ConditionState,
    hold: int,
    found: list[Trip | Warned],
) -> ConditionState:
    """Compare one quantity with its levels; append what counts to `found`, return the new state."""
    values, past = limited(condition, samples, bad, before)
    factors, in_band = raised(condition.multiplier, samples, before.in_band)
    relative = values if factors is None else values / factors
    largest, maximum = float(relative.max()), float(values.max())
    if largest <= condition.warn:
        quiet = min(before.quiet + samples.shape[1], hold)
        return ConditionState(0, 0, quiet, maximum, True, in_band, past)

    def said(column: int, kind: str, level: float) -> str:
        factor = 1.0 if factors is None else float(factors[column])
        return sentence(condition.name, float(values[column]), kind, level * factor)

    reached, above_trip = persisting(relative, condition.trip, before.above_trip, condition.persistence)
    if reached is not None:
        text = said(reached, "trip", condition.trip)
        found.append(Trip(plain(condition.name), first_sample + reached, text))
    reached, above_warn = persisting(relative, condition.warn, before.above_warn, condition.persistence)
    if reached is not None and before.quiet >= hold:
        text = said(reached, "warning", condition.warn)
        found.append(Warned(plain(condition.name), first_sample + reached, text))
    quiet = 0 if reached is not None else min(before.quiet + samples.shape[1], hold)
    return ConditionState(above_trip, above_warn, quiet, maximum, False, in_band, past)


def limited(
    condition: Condition,
    samples: NDArray[np.float32],
    bad: NDArray[np.bool_] | None,
    before: ConditionState,
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Return the limited quantity at each sample, and what the next read needs of this one."""
    lengths = [length(samples, plane) for plane in condition.planes]
    if condition.window:
        joined = np.concatenate([before.past.reshape(len(lengths), -1), lengths], axis=1)
        lengths = list(rates(joined, condition, samples.shape[1]))
        past = joined[:, -condition.window :].copy()
    else:
        past = before.past
    if bad is not None and condition.votes > 1:
        for plane, values in zip(condition.planes, lengths, strict=True):
            values[bad[rows_of(plane, len(samples))].any(axis=0)] = inf
    return voted(lengths, condition.votes), past


def rates(joined: NDArray[np.float32], condition: Condition, count: int) -> NDArray[np.float32]:
    """Return the rate at each of the last `count` samples; 0 as long as the window is not full."""
    found = np.zeros((len(joined), count), np.float32)
    full = min(count, max(0, joined.shape[1] - condition.window))
    if full:
        ends, begins = joined[:, -full:], joined[:, -full - condition.window : -condition.window]
        found[:, -full:] = np.abs(ends - begins) * condition.per_second
    return found


def raised(
    multiplier: Multiplier | None, samples: NDArray[np.float32], in_band: int
) -> tuple[NDArray[np.float64] | None, int]:
    """Return the factor on the levels at each sample, and for how long the speed has been in the band."""
    if multiplier is None:
        return None, 0
    speed = magnitude(samples, multiplier.planes)
    runs = run_lengths((speed >= multiplier.low) & (speed <= multiplier.high), in_band)
    passing = (runs > 0) & (runs <= multiplier.longest)
    return np.where(passing, multiplier.factor, 1.0), int(runs[-1])


def persisting(
    values: NDArray[np.floating], level: float, run: int, persistence: int
) -> tuple[int | None, int]:
    """Return the first column at which `level` was exceeded `persistence` times in a row, and the run."""
    runs = run_lengths(~(values <= level), run)
    reached = runs >= persistence
    return (int(reached.argmax()) if reached.any() else None), int(runs[-1])


def sentence(name: str, value: float, kind: str, level: float) -> str:
    """Say that a level was exceeded, in the units that people read."""
    if value == inf:
        return f"{plain(name)} cannot be told: too few of its sensors are OK"
    return f"{plain(name)} {shown(name, value)} is above the {kind} level of {shown(name, level)}"


def plain(name: str) -> str:
    """Return a limit's name as people say it."""
    return name.replace("_", " ")


def shown(name: str, value: float) -> str:
    """Return a value with the unit that people read."""
    factor, unit = SHOWN[name]
    return f"{value * factor:.4g} {unit}"
