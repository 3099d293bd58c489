"""What protection needs of a rig: limits, and how the limited quantities follow from the channels."""

from collections.abc import Iterable, Sequence
from math import cos, inf, isfinite, radians, sin
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from daq.channels import Channel
from daq.rig import Rig
from simulator.validation import RigError

SENSOR_PERSISTENCE = 0.010
"""s: how long a sensor is not OK before it counts."""
WARNING_HOLD = 1.0
"""s below the level before the same warning may be given again."""


class Plane(NamedTuple):
    """A vector in the plane from sensors: (x, y) = `weights` times the rows of the channels."""

    rows: slice | list[int]
    weights: NDArray[np.float32]  # (2, number of rows)


class Condition(NamedTuple):
    """One limited quantity: the largest length among `planes` against the levels."""

    name: str
    planes: tuple[Plane, ...]
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
        if isfinite(limit.trip)
    )
    for condition in conditions:
        if not condition.planes:
            raise RigError(
                f"[limits.{condition.name}] protects nothing: no {condition.name} channel has an angle_deg "
                "(speed: none is measured)"
            )
    used = {
        row for condition in conditions for plane in condition.planes for row in rows_of(plane, len(channels))
    }
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


def displacement_planes(channels: Sequence[Channel], bearing_station: float | None) -> tuple[Plane, ...]:
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


def ok_bounds(channel: Channel) -> tuple[float, float]:
    """Return the least and largest value of a channel whose sensor is OK, in the channel's unit."""
    if channel.ok is None:
        return -inf, inf
    ends = [(volts - channel.offset) / channel.sensitivity for volts in channel.ok]
    return min(ends), max(ends)


def samples_of(seconds: float, rate: float) -> int:
    """Return a duration in samples, at least one."""
    return max(1, round(seconds * rate))


def magnitude(samples: NDArray[np.float32], planes: Iterable[Plane]) -> NDArray[np.float32]:
    """Return the length of the vector at each sample; of several planes the largest."""
    lengths = [length(samples, plane) for plane in planes]
    return lengths[0] if len(lengths) == 1 else np.maximum.reduce(lengths)


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
