"""What protection needs of a rig: limits, and how the limited quantities follow from the channels."""

from collections.abc import Iterable, Mapping, Sequence
from math import cos, isfinite, radians, sin, tau
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from daq.rig import Rig
from daq.rig.channels import Channel
from daq.rig.limits import Limit
from daq.sensor_check import SensorGuard, samples_of, sensor_guard
from simulator.validation import RigError

RATE_WINDOW = 0.020
"""s over which the change of a speed is taken."""
LEAST_CROSSING = 0.1
"""Sine of the angle between two probes from which on they see two directions."""
WARNING_HOLD = 1.0
"""s below the level before the same warning may be given again."""


class Plane(NamedTuple):
    """A vector in the plane from sensors: (x, y) = `weights` times the rows of the channels."""

    rows: slice | list[int]
    weights: NDArray[np.float32]  # (2, number of rows)


class Multiplier(NamedTuple):
    """Raises a condition's levels while the speed is in a band: the resonance is passed."""

    factor: float
    low: float  # rad/s
    high: float
    longest: int  # samples in the band in a row after which the levels are as they were
    planes: tuple[Plane, ...]  # the measured speeds


class Condition(NamedTuple):
    """One limited quantity: of the lengths of `planes` at each sample, the `votes`-th largest counts."""

    name: str
    planes: tuple[Plane, ...]
    warn: float
    trip: float
    persistence: int  # samples
    votes: int = 1
    window: int = 0  # samples over which its change is what is limited; 0: the quantity itself
    per_second: float = 1.0  # turns the change over the window into a rate
    multiplier: Multiplier | None = None


class Guard(NamedTuple):
    """All that `check` needs of a rig."""

    conditions: tuple[Condition, ...]
    sensors: SensorGuard
    warning_hold: int  # samples


def guard_of(rig: Rig) -> Guard:
    """Return the rig's limits in the form that `check` takes. Raises `RigError`."""
    conditions = tuple(
        condition_of(name, limit, rig) for name, limit in rig.limits._asdict().items() if isfinite(limit.trip)
    )
    alone = [
        row
        for condition in conditions
        if condition.votes == 1
        for plane in condition.planes
        for row in rows_of(plane, len(rig.channels))
    ]
    rate = rig.acquisition.rate
    sensors = sensor_guard(tuple(rig.channels), rate, alone)
    return Guard(conditions, sensors, samples_of(WARNING_HOLD, rate))


def condition_of(name: str, limit: Limit, rig: Rig) -> Condition:
    """Return one limit with the sensors on which it rests. Raises `RigError`."""
    planes, rate = planes_of(name, limit.votes, rig), rig.acquisition.rate
    if not planes:
        quantity = name.partition("_")[0]
        raise RigError(
            f"[limits.{name}] protects nothing: no {quantity} channel has an angle_deg "
            "(speed: none is measured)"
        )
    if limit.votes > len(planes):
        raise RigError(
            f"[limits.{name}] votes = {limit.votes}, but there are only {len(planes)} independent "
            "measurements"
        )
    window = samples_of(RATE_WINDOW, rate) if name == "speed_rate" else 0
    return Condition(
        name,
        planes,
        limit.warn,
        limit.trip,
        samples_of(limit.persistence, rate),
        limit.votes,
        window,
        rate / window if window else 1.0,
        multiplier_of(name, limit, rig),
    )


def multiplier_of(name: str, limit: Limit, rig: Rig) -> Multiplier | None:
    """Return what raises a limit's levels; None when nothing does. Raises `RigError`."""
    if limit.multiplier_hz is None:
        return None
    speeds = speed_planes(tuple(rig.channels))
    if not speeds:
        raise RigError(f"[limits.{name}] multiplier_hz needs a channel that measures the speed")
    low, high = (tau * hz for hz in limit.multiplier_hz)
    longest = samples_of(limit.multiplier_time, rig.acquisition.rate)
    return Multiplier(limit.multiplier, low, high, longest, speeds)


def planes_of(name: str, votes: int, rig: Rig) -> tuple[Plane, ...]:
    """Return the measurements of a limited quantity."""
    channels = tuple(rig.channels)
    if name == "displacement":
        station = rig.model.rotor.bearing_station if rig.model else None
        return displacement_planes(channels, station, apart=votes > 1)
    return force_planes(channels) if name == "force" else speed_planes(channels)


def displacement_planes(
    channels: Sequence[Channel], bearing_station: float | None, apart: bool = False
) -> tuple[Plane, ...]:
    """Return how the shaft's centre follows from the displacement probes.

    With a bearing station all probes are scaled to the bearing's plane (rigid rotor on a pivot, station 0)
    and solved together; without one each plane of probes stands for itself. A plane with fewer than two
    directions gives one projection for each probe, which is the best that can be known. `apart` gives as
    many independent measurements as there are crossing pairs of probes at one station, for voting.
    """
    groups: dict[object, list[tuple[int, float, float]]] = {}
    for row, channel in enumerate(channels):
        if channel.quantity != "displacement" or channel.angle_deg is None:
            continue
        group: object = channel.station
        scale = 1.0
        if bearing_station is not None and channel.station:
            group, scale = bearing_station, bearing_station / channel.station
        probe = (row, scale, radians(channel.angle_deg))
        if apart:
            group = free_partner(groups, channel.station, probe)
        groups.setdefault(group, []).append(probe)
    return tuple(plane for probes in groups.values() for plane in solve_plane(probes))


def free_partner(
    groups: Mapping[object, Sequence[tuple[int, float, float]]],
    station: float | None,
    probe: tuple[int, float, float],
) -> tuple[float | None, int]:
    """Return the group of a probe at the station that this one crosses and completes, or a new group."""
    number = 0
    while members := groups.get((station, number)):
        if len(members) == 1 and abs(sin(members[0][2] - probe[2])) > LEAST_CROSSING:
            break
        number += 1
    return station, number


def solve_plane(probes: Sequence[tuple[int, float, float]]) -> tuple[Plane, ...]:
    """Solve probes (row, scale, angle in rad) of one plane for x and y by least squares."""
    directions = np.array([(cos(angle), sin(angle)) for _, _, angle in probes])
    if np.linalg.matrix_rank(directions, tol=1e-6) < 2:
        return tuple(plane_of([(row, scale, 0.0)]) for row, scale, _ in probes)
    x, y = np.linalg.pinv(directions) * np.array([scale for _, scale, _ in probes])
    rows = [row for row, _, _ in probes]
    return (plane_of(list(zip(rows, x.tolist(), y.tolist(), strict=True))),)


def force_planes(channels: Sequence[Channel]) -> tuple[Plane, ...]:
    """Return the resultant of the force transducers that push along their angles.

    Two opposite transducers share the load with opposite signs, so their signed sum is the force between
    them.
    """
    found = [
        (row, cos(radians(channel.angle_deg)), sin(radians(channel.angle_deg)))
        for row, channel in enumerate(channels)
        if channel.quantity == "force" and channel.angle_deg is not None
    ]
    return (plane_of(found),) if found else ()


def speed_planes(channels: Sequence[Channel]) -> tuple[Plane, ...]:
    """Return the measured speeds: channels of quantity speed that are not a command."""
    return tuple(
        plane_of([(row, 1.0, 0.0)])
        for row, channel in enumerate(channels)
        if channel.quantity == "speed" and not channel.name.endswith("_command")
    )


def magnitude(samples: NDArray[np.float32], planes: Iterable[Plane]) -> NDArray[np.float32]:
    """Return the length of the vector at each sample; of several planes the largest."""
    return voted([length(samples, plane) for plane in planes], 1)


def voted(lengths: Sequence[NDArray[np.float32]], votes: int) -> NDArray[np.float32]:
    """Return at each sample the `votes`-th largest; what is not a number counts as the largest."""
    if len(lengths) == 1:
        return lengths[0]
    if votes == 1:
        return np.maximum.reduce(lengths)
    return np.sort(lengths, axis=0)[-votes]


def length(samples: NDArray[np.float32], plane: Plane) -> NDArray[np.float32]:
    """Return the length of one vector at each sample."""
    x, y = plane.weights @ samples[plane.rows]
    return np.hypot(x, y)


def plane_of(sensors: Sequence[tuple[int, float, float]]) -> Plane:
    """Return the plane of sensors (row, weight in x, weight in y)."""
    rows = [row for row, _, _ in sensors]
    weights = np.array([[x for _, x, _ in sensors], [y for _, _, y in sensors]], np.float32)
    weights[np.abs(weights) < 1e-12] = 0.0
    adjacent = rows == list(range(rows[0], rows[0] + len(rows)))
    return Plane(slice(rows[0], rows[0] + len(rows)) if adjacent else rows, weights)


def rows_of(plane: Plane, n_channels: int) -> Sequence[int]:
    """Return the rows of a plane's sensors."""
    return range(n_channels)[plane.rows] if isinstance(plane.rows, slice) else plane.rows
