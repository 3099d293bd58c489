"""Masses screwed to the rotor, beside the unbalance that it has of itself."""

from collections.abc import Iterable
from math import atan2, cos, hypot, radians, sin
from typing import Annotated, NamedTuple

from simulator.rig import Rotor
from simulator.validation import NAME, Quantity


class UnbalanceMass(NamedTuple):
    """A row `[[unbalance_mass]]`: an extra mass in any plane of the rotor."""

    name: NAME
    mass: Annotated[float, Quantity("kg", 0.0, 1e3, "of what is added")]
    radius: Annotated[float, Quantity("m", 0.0, 5.0, "from the shaft's axis to its centre")]
    angle_deg: Annotated[float, Quantity("deg", -360.0, 360.0, "from the encoder's zero, with rotation")]
    station: Annotated[float, Quantity("m", -5.0, 5.0, "plane, from the pivot towards the magnet")]


def with_masses(rotor: Rotor, masses: Iterable[UnbalanceMass]) -> Rotor:
    """Return the rotor with masses added: unbalance as a vector, weight and inertias.

    The rotor is rigid on its pivot, so that a mass in one plane acts as one in the disk's, scaled by the
    ratio of the stations. The transverse inertia stays that of a symmetric rotor.
    """
    for mass in masses:
        rotor = with_mass(rotor, mass)
    return rotor


def with_mass(rotor: Rotor, added: UnbalanceMass) -> Rotor:
    """Return the rotor with one mass added."""
    total = rotor.mass + added.mass
    weight = rotor.mass * rotor.centre_of_mass_station + added.mass * added.station
    round_axis = added.mass * added.radius**2
    across = added.mass * added.station**2 + 0.5 * round_axis
    heavier = rotor._replace(
        mass=total,
        centre_of_mass_station=weight / total,
        inertia=rotor.inertia + across,
        polar_inertia=rotor.polar_inertia + round_axis,
    )
    share = added.station / rotor.disk_station
    return with_unbalance(heavier, added.mass * added.radius * share, added.angle_deg)


def with_unbalance(rotor: Rotor, size: float, angle_deg: float) -> Rotor:
    """Return the rotor with an unbalance (kg m) at an angle in the disk's plane added to its own."""
    if size == 0.0:
        return rotor
    own, added = rotor.unbalance_angle, radians(angle_deg)
    x = rotor.unbalance * cos(own) + size * cos(added)
    y = rotor.unbalance * sin(own) + size * sin(added)
    return rotor._replace(unbalance=hypot(x, y), unbalance_angle=atan2(y, x))
