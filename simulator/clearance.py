"""Where the shaft's centre can go without contact, as lines to draw."""

from math import asin, atan2, cos, hypot, radians, sin, sqrt, tau

import numpy as np
from numpy.typing import NDArray

from simulator.rig import BackupBearing, BearingKind, Model

CIRCLE_POINTS = 181
ARC_POINTS = 61

Points = NDArray[np.float64]


def bearing_edge(model: Model) -> list[Points]:
    """Return the edge of what the shaft's centre can reach without contact: polylines (n, 2) in m.

    A ball or plain bearing has one circle. A pinned bearing has one arc for each of its pins, in their
    order, but for pins so worn that the others keep the shaft from them; neighbours meet in cusps, or leave
    a way out when their pins are too far apart.
    """
    bearing = model.backup_bearing
    if bearing.kind != BearingKind.PINNED:
        return [circle(bearing.clearance)]
    reach = model.rotor.shaft_radius + bearing.pin_tip_radius
    arcs = ((number, *arc_ends(bearing, reach, number)) for number in range(bearing.pin_count))
    return [pin_arc(bearing, reach, number, first, last) for number, first, last in arcs if first < last]


def least_clearance(bearing: BackupBearing) -> float:
    """Return the radius (m) within which the shaft's centre touches nothing; with long pins, none: 0."""
    if bearing.kind != BearingKind.PINNED:
        return bearing.clearance
    return max(0.0, bearing.clearance + min((0.0, *(pin.wear for pin in bearing.pins))))


def circle(radius: float) -> Points:
    """Return a closed circle about the origin, shape (n, 2)."""
    angle = np.linspace(0.0, tau, CIRCLE_POINTS)
    return radius * np.column_stack((np.cos(angle), np.sin(angle)))


def pin_arc(bearing: BackupBearing, reach: float, number: int, first: float, last: float) -> Points:
    """Return where the shaft's centre is when the shaft touches one pin, shape (n, 2) in m.

    `reach` R is the shaft's and the tip's radius together, `first` and `last` the angles (rad) from the pin's
    axis at which the arc begins and ends. Seen from the bearing's centre, the point at an angle a from the
    axis is at D cos a - sqrt(R^2 - D^2 sin^2 a), D being R and the pin's gap.
    """
    distance = pin_distance(bearing, reach, number)
    from_axis = np.linspace(first, last, ARC_POINTS)
    inside = np.maximum(reach**2 - (distance * np.sin(from_axis)) ** 2, 0.0)
    radius = distance * np.cos(from_axis) - np.sqrt(inside)
    angle = from_axis + radians(bearing.pin_angle_deg) + number * tau / bearing.pin_count
    return radius[:, np.newaxis] * np.column_stack((np.cos(angle), np.sin(angle)))


def pin_distance(bearing: BackupBearing, reach: float, number: int) -> float:
    """Return how far a pin's tip has its centre from the bearing's, m."""
    wear = sum(pin.wear for pin in bearing.pins if pin.number == number + 1)
    return reach + bearing.clearance + wear


def arc_ends(bearing: BackupBearing, reach: float, number: int) -> tuple[float, float]:
    """Return the angles (rad) from a pin's axis between which the shaft reaches that pin before the others.

    The first is not below the last when it never does.
    """
    own = pin_distance(bearing, reach, number)
    last = asin(min(1.0, reach / own))  # where the shaft's centre passes the pin as closely as it can
    first = -last
    for other in range(bearing.pin_count):
        between = (other - number) * tau / bearing.pin_count
        meeting = meeting_angle(own, pin_distance(bearing, reach, other), between, reach)
        if meeting is not None and sin(between) > 0.0:
            last = min(last, meeting)
        elif meeting is not None:
            first = max(first, meeting)
    return first, last


def meeting_angle(own: float, other: float, between: float, reach: float) -> float | None:
    """Return the angle (rad) from a pin's axis to the cusp that it makes with another pin; None without one.

    The tips' centres are `own` and `other` (m) from the bearing's, `between` (rad) apart. The cusp is where
    the circles of radius `reach` about both meet, on the inner side.
    """
    # In the frame of the own pin's axis: its tip at (own, 0), the other's at other * (cos, sin).
    to_x, to_y = other * cos(between) - own, other * sin(between)
    apart = hypot(to_x, to_y)
    if not 0.0 < apart < 2.0 * reach:
        return None
    height = sqrt(reach**2 - 0.25 * apart**2) / apart
    meetings = [
        (own + 0.5 * to_x + sign * height * to_y, 0.5 * to_y - sign * height * to_x) for sign in (1, -1)
    ]
    x, y = min(meetings, key=lambda place: hypot(*place))
    return atan2(y, x)
