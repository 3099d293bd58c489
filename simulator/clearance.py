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
    order; neighbours meet in cusps, or leave a way out when their pins are too far apart.
    """
    bearing = model.backup_bearing
    if bearing.kind != BearingKind.PINNED:
        return [circle(bearing.clearance)]
    reach = model.rotor.shaft_radius + bearing.pin_tip_radius
    return [pin_arc(bearing, reach, number) for number in range(bearing.pin_count)]


def circle(radius: float) -> Points:
    """Return a closed circle about the origin, shape (n, 2)."""
    angle = np.linspace(0.0, tau, CIRCLE_POINTS)
    return radius * np.column_stack((np.cos(angle), np.sin(angle)))


def pin_arc(bearing: BackupBearing, reach: float, number: int) -> Points:
    """Return where the shaft's centre is when the shaft touches one pin, shape (n, 2) in m.

    `reach` R is the shaft's and the tip's radius together. Seen from the bearing's centre, the point at an
    angle a from the pin's axis is at D cos a - sqrt(R^2 - D^2 sin^2 a), D being R and the pin's gap.
    """
    distance = pin_distance(bearing, reach, number)
    from_axis = np.linspace(
        -pin_share(bearing, reach, number, -1), pin_share(bearing, reach, number, 1), ARC_POINTS
    )
    inside = np.maximum(reach**2 - (distance * np.sin(from_axis)) ** 2, 0.0)
    radius = distance * np.cos(from_axis) - np.sqrt(inside)
    angle = from_axis + radians(bearing.pin_angle_deg) + number * tau / bearing.pin_count
    return radius[:, np.newaxis] * np.column_stack((np.cos(angle), np.sin(angle)))


def pin_distance(bearing: BackupBearing, reach: float, number: int) -> float:
    """Return how far a pin's tip has its centre from the bearing's, m."""
    worn = number % bearing.pin_count == bearing.worn_pin - 1
    return reach + bearing.clearance + (bearing.pin_wear if worn else 0.0)


def pin_share(bearing: BackupBearing, reach: float, number: int, side: int) -> float:
    """Return the angle (rad, positive) from a pin's axis to where its arc ends, towards a neighbour.

    That is where the circles of radius `reach` about both tips' centres meet, on the inner side; where
    they do not, it is where the shaft's centre passes the pin as closely as it can.
    """
    own = pin_distance(bearing, reach, number)
    other = pin_distance(bearing, reach, number + side)
    between = tau / bearing.pin_count  # towards either side alike: an angle's size, not its sign
    widest = asin(min(1.0, reach / own))
    # In the frame of the own pin's axis: its tip at (own, 0), the neighbour's at other * (cos, sin).
    to_x, to_y = other * cos(between) - own, other * sin(between)
    apart = hypot(to_x, to_y)
    if apart >= 2.0 * reach:
        return min(widest, between)
    height = sqrt(reach**2 - 0.25 * apart**2) / apart
    meetings = [
        (own + 0.5 * to_x + sign * height * to_y, 0.5 * to_y - sign * height * to_x) for sign in (1, -1)
    ]
    x, y = min(meetings, key=lambda place: hypot(*place))
    return atan2(y, x)
