"""Where the wall is from the shaft, and how well that is known."""

from math import sqrt

import numpy as np

from simulator.compile import kernel
from simulator.contact import candidate_count, relative_motion, surface_of, wall
from simulator.law import normal_stiffness
from simulator.rig import Model
from simulator.state import State
from twin.layout import CLEARANCE, HOUSE, TILT, Memory


@kernel
def depth_doubt(model: Model, memory: Memory, state: State) -> float:
    """Return the standard deviation (m) of the penetration: of place, house and clearance together."""
    nx, ny = outward(model, memory.candidates, state)
    return distance_doubt(model, memory.covariance, nx, ny, 1.0)


@kernel
def distance_doubt(model: Model, covariance: np.ndarray, nx: float, ny: float, clearance: float) -> float:
    """Return the standard deviation (m) of the shaft's place in the house along a direction (x, y).

    With `clearance` 1 it is that of the penetration, in which the clearance is uncertain too.
    """
    station = model.rotor.bearing_station
    columns = (TILT, TILT + 1, HOUSE, HOUSE + 1, CLEARANCE)
    weights = (station * nx, station * ny, -nx, -ny, -clearance)
    variance = 0.0
    for i in range(5):
        for j in range(5):
            variance += weights[i] * weights[j] * covariance[columns[i], columns[j]]
    return sqrt(max(variance, 0.0))


@kernel
def curvature_force(model: Model, candidates: np.ndarray, depth: float, doubt: float) -> float:
    """Return what the contact's force may differ by (N) because it is no straight line within the doubt.

    That is the second term of the force's Taylor series, half N'' times the variance of the penetration
    (`doubt` squared, m2), taken a standard deviation deeper than the estimate (`depth`, m): with it a
    filter that knows the force's slope alone does not believe too early that it knows the clearance.
    """
    deeper = max(depth, 0.0) + doubt
    return (
        0.25
        * normal_stiffness(surface_of(model.backup_bearing, candidates, 0), deeper)
        / deeper
        * doubt
        * doubt
    )


@kernel
def outward(model: Model, candidates: np.ndarray, state: State) -> tuple[float, float]:
    """Return the unit normal (x, y), from shaft to wall, where the shaft is deepest in the bearing."""
    x, y, _, _ = relative_motion(model, state)
    bearing, radius = model.backup_bearing, model.rotor.shaft_radius
    nx, ny, deepest = wall(bearing, candidates, radius, 0, x, y)
    for index in range(1, candidate_count(bearing)):
        other_x, other_y, depth = wall(bearing, candidates, radius, index, x, y)
        if depth > deepest:
            nx, ny, deepest = other_x, other_y, depth
    return nx, ny
