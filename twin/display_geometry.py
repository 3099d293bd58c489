"""Geometry of the orbit view: where the shaft's centre can go, and where the sensors say that it is."""

from collections.abc import Sequence
from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from daq.guard import Plane, displacement_planes, force_planes
from daq.rig import Rig
from simulator.clearance import bearing_edge

RULER_DIVISIONS = 3  # marks on each half axis of the orbit view, about

Points = NDArray[np.float64]
Item = TypeVar("Item")


class Sensors(NamedTuple):
    """Rows of a block that the display draws; None or empty where the rig has no such channel."""

    displacement: Plane | None
    force: Plane | None
    angle: int | None
    speed: int | None
    speed_command: int | None


def sensors_of(rig: Rig) -> Sensors:
    """Find the channels that the display draws, by quantity, with the geometry that the protection uses."""
    channels = tuple(rig.channels)
    station = rig.model.rotor.bearing_station if rig.model else None
    speeds = [row for row, channel in enumerate(channels) if channel.quantity == "speed"]
    commands = [row for row in speeds if channels[row].name.endswith("_command")]
    measured = [row for row in speeds if row not in commands]
    angles = [row for row, channel in enumerate(channels) if channel.quantity == "angle"]
    return Sensors(
        displacement=_first(displacement_planes(channels, station)),
        force=_first(force_planes(channels)),
        angle=_first(angles),
        speed=_first(measured),
        speed_command=_first(commands),
    )


def project(samples: NDArray[np.float32], plane: Plane) -> Points:
    """Return the vector (2, n) that sensors measure, from samples (n_channels, n)."""
    return (plane.weights @ samples[plane.rows]).astype(np.float64)


def view_radius(rig: Rig) -> float:
    """Return half the width of the orbit view in m: the bearing's edge or the trip level, with a margin."""
    reaches = [np.abs(strip).max() for strip in bearing_edge(rig.model)] if rig.model else []
    if np.isfinite(rig.limits.displacement.trip):
        reaches.append(rig.limits.displacement.trip)
    if not reaches:
        widest = [channel.full_scale for channel in rig.channels if channel.quantity == "displacement"]
        reaches.append(max(widest, default=1e-3))
    return 1.2 * float(max(reaches))


def ruler(reach: float) -> Points:
    """Return round positions, symmetric about 0 and without it, that mark an axis from -reach to reach."""
    magnitude = 10.0 ** np.floor(np.log10(reach / RULER_DIVISIONS))
    step = next(m for m in (1.0, 2.0, 5.0, 10.0) if m * magnitude * (RULER_DIVISIONS + 1) > reach) * magnitude
    marks = np.arange(1, int(reach / step) + 1) * step
    return np.concatenate((-marks[::-1], marks))


def _first(found: Sequence[Item]) -> Item | None:
    return found[0] if found else None
