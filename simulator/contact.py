"""Contact between shaft and backup bearing: its geometry, and what `simulator.law` makes of it.

Everything is at the bearing's plane S, in the inertial frame, SI units. A *candidate* is a place where
shaft and wall may touch: see `simulator.candidates`. Its
normal points from the shaft's centre to the wall, its tangent is the normal turned by +90 degrees.

References are to the thesis' articles P1 and P3, cleaned of misprints. Geometry and law are chosen by number
in the bearing's parameters (`kind`, `law`, `damping_mode`), never by a function argument, so that a kernel is
compiled once.
"""

from math import sqrt
from typing import NamedTuple

import numpy as np

from simulator.candidates import DAMPING_FACTOR, RESTING, SLIDING, STIFFNESS, TIP_X, TIP_Y
from simulator.compile import inlined
from simulator.law import LATCHED, Surface, friction, latched_factor, normal_force
from simulator.rig import BackupBearing, BearingKind, Model
from simulator.state import State

BALL = int(BearingKind.BALL)
PINNED = int(BearingKind.PINNED)


class Contact(NamedTuple):
    """What the backup bearing does to the rotor; the house gets the opposite force."""

    force_x: float  # N, on the rotor at plane S
    force_y: float  # N
    moment_x: float  # N m, generalised: station times force, plus the axial friction's
    moment_y: float  # N m
    shaft_torque: float  # N m, about the shaft's axis, positive with positive speed
    ring_torque: float  # N m, on the inner ring
    normal: float  # N, sum over the candidates
    penetration: float  # m, the deepest; negative: the gap that is left


@inlined
def candidate_count(bearing: BackupBearing) -> int:
    """Return the number of places where shaft and bearing may touch."""
    return bearing.pin_count if bearing.kind == PINNED else 1


@inlined
def wall(
    bearing: BackupBearing, candidates: np.ndarray, shaft_radius: float, index: int, x: float, y: float
) -> tuple[float, float, float]:
    """Return one candidate's unit normal (x, y) and penetration (m; negative: gap).

    (x, y) is the shaft's centre relative to the house's, m. A shaft exactly in the middle of a ring has no
    normal: zeros.
    """
    if bearing.kind == PINNED:
        return pin_wall(bearing, candidates, shaft_radius, index, x, y)
    radius = sqrt(x * x + y * y)
    if radius == 0.0:
        return 0.0, 0.0, -bearing.clearance
    return x / radius, y / radius, radius - bearing.clearance


@inlined
def pin_wall(
    bearing: BackupBearing, candidates: np.ndarray, shaft_radius: float, index: int, x: float, y: float
) -> tuple[float, float, float]:
    """Return normal and penetration at the spherical tip of pin `index`, counted with rotation."""
    reach = shaft_radius + bearing.pin_tip_radius
    to_x = candidates[index, TIP_X] - x
    to_y = candidates[index, TIP_Y] - y
    length = sqrt(to_x * to_x + to_y * to_y)
    if length == 0.0:
        return 0.0, 0.0, reach
    return to_x / length, to_y / length, reach - length


@inlined
def surface_of(bearing: BackupBearing, candidates: np.ndarray, index: int) -> Surface:
    """Return what a candidate's contact is made of."""
    return Surface(
        bearing.law,
        candidates[index, STIFFNESS],
        bearing.damping,
        candidates[index, SLIDING],
        candidates[index, RESTING],
        bearing.slip_speed,
        bearing.stribeck_speed,
    )


@inlined
def ring_radius(model: Model) -> float:
    """Return the radius (m) at which a spinning inner ring is touched; zero where nothing spins."""
    bearing = model.backup_bearing
    return bearing.clearance + model.rotor.shaft_radius if bearing.kind == BALL else 0.0


@inlined
def relative_motion(model: Model, state: State) -> tuple[float, float, float, float]:
    """Return place (m) and velocity (m/s) of the shaft's centre relative to the house's, at plane S."""
    station = model.rotor.bearing_station
    return (
        station * state.tilt_x - state.house_x,
        station * state.tilt_y - state.house_y,
        station * state.tilt_rate_x - state.house_rate_x,
        station * state.tilt_rate_y - state.house_rate_y,
    )


@inlined
def slip(
    model: Model, state: State, nx: float, ny: float, along_t: float
) -> tuple[float, float, float, float]:
    """Return the slip at a contact with normal (nx, ny), and the lever of the axial friction.

    `along_t` is the relative velocity of the centres along the tangent. Slip is shaft minus wall: along
    the tangent, with both spins, and along the shaft, from tilting (m/s). The lever (m) leads from the
    axis through the pivot to the contact.
    """
    radius = model.rotor.shaft_radius
    lever_x = model.rotor.bearing_station * state.tilt_x + radius * nx
    lever_y = model.rotor.bearing_station * state.tilt_y + radius * ny
    slip_t = along_t + state.speed * radius - state.ring_speed * ring_radius(model)
    slip_z = -(lever_x * state.tilt_rate_x + lever_y * state.tilt_rate_y)
    return slip_t, slip_z, lever_x, lever_y


@inlined
def candidate_contact(model: Model, candidates: np.ndarray, index: int, state: State) -> Contact:
    """Return what one candidate does to the rotor (P3 eq 10, 17-19 with Newton's third law for the signs)."""
    rotor, bearing = model.rotor, model.backup_bearing
    x, y, rate_x, rate_y = relative_motion(model, state)
    nx, ny, depth = wall(bearing, candidates, rotor.shaft_radius, index, x, y)
    surface = surface_of(bearing, candidates, index)
    factor = candidates[index, DAMPING_FACTOR]
    normal = normal_force(surface, factor, depth, rate_x * nx + rate_y * ny)
    if normal == 0.0:
        return Contact(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, depth)
    slip_t, slip_z, lever_x, lever_y = slip(model, state, nx, ny, rate_y * nx - rate_x * ny)
    along_t, along_z = friction(surface, normal, slip_t, slip_z)
    force_x = -normal * nx - along_t * ny
    force_y = -normal * ny + along_t * nx
    return Contact(
        force_x,
        force_y,
        rotor.bearing_station * force_x - lever_x * along_z,
        rotor.bearing_station * force_y - lever_y * along_z,
        along_t * rotor.shaft_radius,
        -along_t * ring_radius(model),
        normal,
        depth,
    )


@inlined
def contact_force(model: Model, candidates: np.ndarray, state: State) -> Contact:
    """Return what the backup bearing does to the rotor in a state.

    `candidates` (8, 6) are those of the model: see `simulator.candidates`.
    """
    total = candidate_contact(model, candidates, 0, state)
    for index in range(1, candidate_count(model.backup_bearing)):
        total = together(total, candidate_contact(model, candidates, index, state))
    return total


@inlined
def together(a: Contact, b: Contact) -> Contact:
    """Return the sum of two contacts, with the deeper one's penetration."""
    return Contact(
        a.force_x + b.force_x,
        a.force_y + b.force_y,
        a.moment_x + b.moment_x,
        a.moment_y + b.moment_y,
        a.shaft_torque + b.shaft_torque,
        a.ring_torque + b.ring_torque,
        a.normal + b.normal,
        max(a.penetration, b.penetration),
    )


@inlined
def penetration(model: Model, candidates: np.ndarray, state: State) -> float:
    """Return the deepest candidate's penetration, m; negative: the gap that is left."""
    x, y, _, _ = relative_motion(model, state)
    bearing, radius = model.backup_bearing, model.rotor.shaft_radius
    deepest = wall(bearing, candidates, radius, 0, x, y)[2]
    for index in range(1, candidate_count(bearing)):
        deepest = max(deepest, wall(bearing, candidates, radius, index, x, y)[2])
    return deepest


@inlined
def latch(model: Model, state: State, candidates: np.ndarray) -> None:
    """Bring the open candidates' damping factors, s/m, up to date; call it before each substep.

    Mode `fixed`: they stay what they are. Mode `latched`: an open candidate's is that of a closing at this
    moment's speed (P3 eq 21), so that a closing keeps that of its last open substep until it opens.
    """
    bearing = model.backup_bearing
    if bearing.damping_mode != LATCHED:
        return
    x, y, rate_x, rate_y = relative_motion(model, state)
    for index in range(candidate_count(bearing)):
        nx, ny, depth = wall(bearing, candidates, model.rotor.shaft_radius, index, x, y)
        if depth <= 0.0:
            closing = rate_x * nx + rate_y * ny
            candidates[index, DAMPING_FACTOR] = latched_factor(bearing.law, bearing.restitution, closing)


@inlined
def beyond_pins(model: Model, state: State) -> bool:
    """Tell whether the shaft is where the pinned bearing has no wall any more, behind its pins."""
    bearing = model.backup_bearing
    if bearing.kind != PINNED:
        return False
    x, y, _, _ = relative_motion(model, state)
    reach = bearing.clearance + bearing.pin_length
    return x * x + y * y > reach * reach
