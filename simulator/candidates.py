"""The places where shaft and backup bearing may touch, each with its numbers: an array for the kernels.

A ball or plain bearing has one such *candidate*, a pinned one has one for each pin. An array of candidates,
shape (8, 6), has a row for each and the columns below. It stands beside the model, because passing the
numbers of eight pins by value would cost each call of a kernel more than the contact itself.
"""

import numpy as np
from numpy.typing import NDArray

from simulator.law import constant_factor
from simulator.numeric import direction
from simulator.rig import MOST_PINS, BackupBearing, BearingKind, Model, Pin

DAMPING_FACTOR = 0  # eta, s/m; the one that changes, see `simulator.contact.latch`
TIP_X, TIP_Y = 1, 2  # m, centre of a pin's tip from the bearing's centre, at rest
STIFFNESS = 3  # N/m^1.5; N/m with Kelvin and Voigt's law
SLIDING, RESTING = 4, 5  # coefficients of friction
COLUMNS = 6


def candidates_of(model: Model) -> NDArray[np.float64]:
    """Return the candidates (8, 6) of a model, with the damping factors that a simulation begins with."""
    bearing = model.backup_bearing
    rows = np.zeros((MOST_PINS, COLUMNS))
    rows[:, DAMPING_FACTOR] = constant_factor(bearing)
    rows[:, STIFFNESS] = bearing.stiffness
    rows[:, SLIDING], rows[:, RESTING] = bearing.friction, bearing.static_friction
    if bearing.kind == BearingKind.PINNED:
        rows[:, TIP_X], rows[:, TIP_Y] = tips(bearing, model.rotor.shaft_radius)
        for pin in bearing.pins:
            put_own(rows[pin.number - 1], pin)
    return rows


def put_own(row: NDArray[np.float64], pin: Pin) -> None:
    """Put the numbers into a candidate's row (6,) that a pin has of its own."""
    if pin.stiffness is not None:
        row[STIFFNESS] = pin.stiffness
    if pin.friction is not None:
        row[SLIDING] = row[RESTING] = pin.friction


def tips(bearing: BackupBearing, shaft_radius: float) -> tuple[list[float], list[float]]:
    """Return x and y (m) of the centres of the pins' tips, counted with rotation.

    The pins are radial and evenly spaced, with spherical tips of radius r_t whose apex is at the clearance,
    and a worn one's at its wear more, from the shaft at rest in the middle.
    """
    distances = [shaft_radius + bearing.pin_tip_radius + bearing.clearance] * MOST_PINS
    for pin in bearing.pins:
        distances[pin.number - 1] += pin.wear
    x, y = direction(bearing.pin_angle_deg)
    turn_x, turn_y = direction(360.0 / bearing.pin_count)
    found_x, found_y = [], []
    for distance in distances:
        found_x.append(distance * x)
        found_y.append(distance * y)
        x, y = x * turn_x - y * turn_y, x * turn_y + y * turn_x
    return found_x, found_y


def for_kernels(model: Model) -> Model:
    """Return the model as the kernels take it beside its candidates, which have the pins' own numbers."""
    return model._replace(backup_bearing=model.backup_bearing._replace(pins=()))
