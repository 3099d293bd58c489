"""Trip and warning limits, checked on every sample: a pure function of samples, state and limits.

`daq.guard` turns the rig's limits and channels into a `Guard`; `check` takes one read's samples and the
state, and returns the state after it. Nothing here knows a device, a clock or the link, so the same
function answers on old recordings what other limits would have done.

A level counts when it has been exceeded on `persistence` consecutive samples. The first trip latches as
the first-out; later ones do not replace it. A sample that is not a number counts as exceeding. A channel
that protects (displacement, force, speed) and whose sensor is not OK for 10 ms trips too, because a
blind protection is none; any other channel's sensor only warns.
"""

from math import pi
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from daq.guard import Condition, Guard, magnitude

SHOWN = {"displacement": (1e6, "µm"), "force": (1.0, "N"), "speed": (0.5 / pi, "Hz")}
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


class ProtectionState(NamedTuple):
    """What `check` remembers from read to read."""

    conditions: tuple[ConditionState, ...]  # in the guard's order
    not_ok: tuple[int, ...]  # for each channel: consecutive samples on which the sensor was not OK
    first_out: Trip | None


class Verdict(NamedTuple):
    """The state after a read, the trip that latched in it, the warnings, and whether all sensors are OK."""

    state: ProtectionState
    trip: Trip | None
    warnings: tuple[Warned, ...]
    sensors_ok: bool


def initial_state(guard: Guard) -> ProtectionState:
    """Return the state before the first sample: nothing exceeded, nothing latched."""
    calm = ConditionState(0, 0, guard.warning_hold, 0.0)
    return ProtectionState((calm,) * len(guard.conditions), (0,) * len(guard.channels), None)


def check(samples: NDArray[np.float32], first_sample: int, state: ProtectionState, guard: Guard) -> Verdict:
    """Check one read.

    Args:
        samples: (n_channels, n) in the channels' units, n at least 1.
        first_sample: index of the first column. After a gap the counts go on as if there were none.
        state: as returned for the read before, or `initial_state`.
        guard: of the rig.
    """
    found: list[Trip | Warned] = []
    conditions = []
    for condition, before in zip(guard.conditions, state.conditions, strict=True):
        values = magnitude(samples, condition.planes)
        conditions.append(check_condition(condition, values, first_sample, before, guard.warning_hold, found))
    not_ok, sensors_ok = check_sensors(samples, first_sample, state.not_ok, guard, found)
    trips = [finding for finding in found if isinstance(finding, Trip)]
    trip = min(trips, key=lambda candidate: candidate.sample) if trips and state.first_out is None else None
    warnings = tuple(finding for finding in found if isinstance(finding, Warned))
    after = ProtectionState(tuple(conditions), not_ok, state.first_out or trip)
    return Verdict(after, trip, warnings, sensors_ok)


def latch(state: ProtectionState, trip: Trip) -> ProtectionState:
    """Return the state with `trip` as first-out, unless another is latched already."""
    return state if state.first_out else state._replace(first_out=trip)


def reset(state: ProtectionState, guard: Guard) -> tuple[ProtectionState, str]:
    """Return the state without its latch and an empty text, or the same state and why it stays latched.

    A cause lives as long as the last read exceeded a warning level or found a sensor that is not OK.
    """
    for condition, now in zip(guard.conditions, state.conditions, strict=True):
        if not now.maximum <= condition.warn:
            value = shown(condition.name, now.maximum)
            return state, f"{condition.name} is still {value}, above the warning level"
    for name, protects, count in zip(guard.channels, guard.protecting, state.not_ok, strict=True):
        if protects and count:
            return state, f"the sensor of {name} is still not OK"
    return state._replace(first_out=None), ""


def check_condition(
    condition: Condition,
    values: NDArray[np.float32],
    first_sample: int,
    before: ConditionState,
    hold: int,
    found: list[Trip | Warned],
) -> ConditionState:
    """Compare one quantity with its levels; append what counts to `found`, return the new state."""
    largest = float(values.max())
    reached, above_trip = persisting(
        values, condition.trip, largest, before.above_trip, condition.persistence
    )
    if reached is not None:
        text = sentence(condition.name, float(values[reached]), "trip", condition.trip)
        found.append(Trip(condition.name, first_sample + reached, text))
    reached, above_warn = persisting(
        values, condition.warn, largest, before.above_warn, condition.persistence
    )
    if reached is not None and before.quiet >= hold:
        text = sentence(condition.name, float(values[reached]), "warning", condition.warn)
        found.append(Warned(condition.name, first_sample + reached, text))
    exceeded = reached is not None
    quiet = 0 if exceeded else min(before.quiet + len(values), hold)
    return ConditionState(above_trip, above_warn, quiet, largest)


def check_sensors(
    samples: NDArray[np.float32],
    first_sample: int,
    before: tuple[int, ...],
    guard: Guard,
    found: list[Trip | Warned],
) -> tuple[tuple[int, ...], bool]:
    """Look for sensors outside their OK range; return the counts and whether all are OK now."""
    ok = (samples >= guard.lowest) & (samples <= guard.highest)
    if ok.all():
        return (0,) * len(before), True
    counts = []
    for row, (name, protects) in enumerate(zip(guard.channels, guard.protecting, strict=True)):
        reached, count = consecutive(~ok[row], before[row], guard.sensor_persistence)
        counts.append(count)
        if reached is None or before[row] >= guard.sensor_persistence:
            continue
        kind = Trip if protects else Warned
        value = float(samples[row, reached])
        text = f"the sensor of {name} is not OK: its value {value:g} is outside the OK range"
        found.append(kind(f"sensor {name}", first_sample + reached, text))
    return tuple(counts), False


def persisting(
    values: NDArray[np.float32], level: float, largest: float, run: int, persistence: int
) -> tuple[int | None, int]:
    """Return the column at which `level` has been exceeded `persistence` times in a row, and the run."""
    if largest <= level:
        return None, 0
    return consecutive(~(values <= level), run, persistence)


def consecutive(above: NDArray[np.bool_], run: int, needed: int) -> tuple[int | None, int]:
    """Return the first column at which true values are `needed` in a row, and the run at the end."""
    reached = None
    for column, is_above in enumerate(above.tolist()):
        run = run + 1 if is_above else 0
        if run >= needed and reached is None:
            reached = column
    return reached, run


def sentence(name: str, value: float, kind: str, level: float) -> str:
    """Say that a level was exceeded, in the units that people read."""
    return f"{name} {shown(name, value)} is above the {kind} level of {shown(name, level)}"


def shown(name: str, value: float) -> str:
    """Return a value with the unit that people read."""
    factor, unit = SHOWN[name]
    return f"{value * factor:.4g} {unit}"
