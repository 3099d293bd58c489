"""Trip and warning limits, checked on every sample: a pure function of samples, state and limits.

`guard_of(rig)` turns the rig's limits and channels into a `Guard`, `check` takes one read's samples and
the state, and returns the state after it. Nothing here knows a device, a clock or the link, so the same
function answers on old recordings what other limits would have done.

A level counts when it has been exceeded on `persistence` consecutive samples. The first trip latches as
the first-out; later ones do not replace it. A sample that is not a number counts as exceeding. A channel
that protects (displacement, force, speed) and whose sensor is not OK for 10 ms trips too, because a
blind protection is none; any other channel's sensor only warns.
"""

from collections.abc import Iterable, Sequence
from math import cos, hypot, inf, pi, radians, sin
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from daq.channels import Channel
from daq.rig import Rig
from daq.settings import NO_LIMIT
from simulator.validation import RigError

SENSOR_PERSISTENCE = 0.010
"""s: how long a sensor is not OK before it counts."""
WARNING_HOLD = 1.0
"""s below the level before the same warning may be given again."""
SHOWN = {"displacement": (1e6, "µm"), "force": (1.0, "N"), "speed": (0.5 / pi, "Hz")}
"""Factor and unit in which people read each limited quantity."""


class Projection(NamedTuple):
    """A vector in the plane from sensors: x = sum of `x[i]` times row `rows[i]`; y likewise."""

    rows: tuple[int, ...]
    x: tuple[float, ...]
    y: tuple[float, ...]


class Condition(NamedTuple):
    """One limited quantity: the largest length among `planes` against the levels."""

    name: str
    planes: tuple[Projection, ...]
    warn: float
    trip: float
    persistence: int  # samples


class Guard(NamedTuple):
    """All that `check` needs of a rig; the arrays have one row for each channel."""

    conditions: tuple[Condition, ...]
    channels: tuple[str, ...]
    protecting: tuple[bool, ...]
    lowest: NDArray[np.float32]  # (n_channels, 1): least value of a sensor that is OK
    highest: NDArray[np.float32]
    sensor_persistence: int  # samples
    warning_hold: int  # samples


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


def guard_of(rig: Rig) -> Guard:
    """Return the rig's limits in the form that `check` takes."""
    channels = tuple(rig.channels)
    rate = rig.acquisition.rate
    planes = {
        "displacement": displacement_planes(channels, rig.model.rotor.bearing_station if rig.model else None),
        "force": force_planes(channels),
        "speed": speed_planes(channels),
    }
    conditions = tuple(
        Condition(name, planes[name], limit.warn, limit.trip, samples_of(limit.persistence, rate))
        for name, limit in rig.limits._asdict().items()
        if limit is not NO_LIMIT
    )
    for condition in conditions:
        if not condition.planes:
            raise RigError(
                f"[limits.{condition.name}] protects nothing: no {condition.name} channel has an angle_deg "
                "(speed: none is measured)"
            )
    used = {row for condition in conditions for plane in condition.planes for row in plane.rows}
    bounds = np.array([ok_bounds(channel) for channel in channels], dtype=np.float32).reshape(-1, 2)
    return Guard(
        conditions,
        tuple(channel.name for channel in channels),
        tuple(row in used for row in range(len(channels))),
        np.ascontiguousarray(bounds[:, :1]),
        np.ascontiguousarray(bounds[:, 1:]),
        samples_of(SENSOR_PERSISTENCE, rate),
        samples_of(WARNING_HOLD, rate),
    )


def displacement_planes(channels: Sequence[Channel], bearing_station: float | None) -> tuple[Projection, ...]:
    """Return how the shaft's centre follows from the displacement probes.

    With a bearing station all probes are scaled to the bearing's plane (rigid rotor on a pivot, station 0)
    and solved together; without one each plane of probes stands for itself. A plane with fewer than two
    directions gives one projection for each probe, which is the best that can be known.
    """
    groups: dict[float | None, list[tuple[int, float, float]]] = {}
    for row, channel in enumerate(channels):
        if channel.quantity != "displacement" or channel.angle_deg is None:
            continue
        group, scale = channel.station, 1.0
        if bearing_station is not None and channel.station:
            group, scale = bearing_station, bearing_station / channel.station
        groups.setdefault(group, []).append((row, scale, radians(channel.angle_deg)))
    return tuple(plane for probes in groups.values() for plane in solve_plane(probes))


def solve_plane(probes: Sequence[tuple[int, float, float]]) -> tuple[Projection, ...]:
    """Solve probes (row, scale, angle in rad) of one plane for x and y by least squares."""
    directions = np.array([(cos(angle), sin(angle)) for _, _, angle in probes])
    if np.linalg.matrix_rank(directions, tol=1e-6) < 2:
        return tuple(Projection((row,), (scale,), (0.0,)) for row, scale, _ in probes)
    scales = np.array([scale for _, scale, _ in probes])
    inverse = np.linalg.pinv(directions) * scales
    inverse[np.abs(inverse) < 1e-12] = 0.0
    rows = tuple(row for row, _, _ in probes)
    return (Projection(rows, tuple(map(float, inverse[0])), tuple(map(float, inverse[1]))),)


def force_planes(channels: Sequence[Channel]) -> tuple[Projection, ...]:
    """Return the resultant of the force transducers that push along their angles.

    Two opposite transducers share the load with opposite signs, so their signed sum is the force between
    them.
    """
    found = [
        (row, radians(channel.angle_deg))
        for row, channel in enumerate(channels)
        if channel.quantity == "force" and channel.angle_deg is not None
    ]
    if not found:
        return ()
    rows = tuple(row for row, _ in found)
    x = tuple(rounded(cos(angle)) for _, angle in found)
    y = tuple(rounded(sin(angle)) for _, angle in found)
    return (Projection(rows, x, y),)


def speed_planes(channels: Sequence[Channel]) -> tuple[Projection, ...]:
    """Return the measured speeds: channels of quantity speed that are not a command."""
    return tuple(
        Projection((row,), (1.0,), (0.0,))
        for row, channel in enumerate(channels)
        if channel.quantity == "speed" and not channel.name.endswith("_command")
    )


def ok_bounds(channel: Channel) -> tuple[float, float]:
    """Return the least and largest value of a channel whose sensor is OK, in the channel's unit."""
    if channel.ok is None:
        return -inf, inf
    ends = [(volts - channel.offset) / channel.sensitivity for volts in channel.ok]
    return min(ends), max(ends)


def rounded(value: float) -> float:
    """Return the cosine of a right angle as zero."""
    return 0.0 if abs(value) < 1e-12 else value


def samples_of(seconds: float, rate: float) -> int:
    """Return a duration in samples, at least one."""
    return max(1, round(seconds * rate))


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
            return (
                state,
                f"{condition.name} is still {shown(condition.name, now.maximum)}, above the warning level",
            )
    for name, protects, count in zip(guard.channels, guard.protecting, state.not_ok, strict=True):
        if protects and count:
            return state, f"the sensor of {name} is still not OK"
    return state._replace(first_out=None), ""


def magnitude(samples: NDArray[np.float32], planes: Iterable[Projection]) -> NDArray[np.float32]:
    """Return the length of the vector at each sample; of several planes the largest."""
    lengths = [length(samples, plane) for plane in planes]
    return lengths[0] if len(lengths) == 1 else np.maximum.reduce(lengths)


def length(samples: NDArray[np.float32], plane: Projection) -> NDArray[np.float32]:
    """Return the length of one projected vector at each sample."""
    if len(plane.rows) == 1:
        return np.abs(samples[plane.rows[0]]) * np.float32(hypot(plane.x[0], plane.y[0]))
    return np.hypot(combine(samples, plane.rows, plane.x), combine(samples, plane.rows, plane.y))


def combine(
    samples: NDArray[np.float32], rows: Sequence[int], weights: Sequence[float]
) -> NDArray[np.float32]:
    """Return the weighted sum of some rows."""
    total = np.zeros(samples.shape[1], np.float32)
    for row, weight in zip(rows, weights, strict=True):
        if weight:
            total += samples[row] * np.float32(weight)
    return total


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
    """Return the first column at which the run of true values is `needed` long or longer, and the last run."""
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
