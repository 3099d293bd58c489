"""Virtual sensors: what no sensor sees, computed from the observer's state, and how uncertain it is.

A standard deviation is that of the linearised output, sqrt(g P g^T), with the output's gradient g and the
observer's covariance P: in contact g comes from the slopes of the contact law, its parameters included.
"""

from math import atan2, pi, sqrt

import numpy as np

from simulator.compile import inlined, kernel
from simulator.contact import (
    PINNED,
    Contact,
    candidate_contact,
    candidate_count,
    contact_force,
    penetration,
    relative_motion,
    ring_radius,
)
from simulator.rig import Model
from simulator.state import State
from twin.layout import (
    CONTACT_PARAMETERS,
    DYNAMIC,
    HOUSE,
    HOUSE_RATE,
    MOMENT,
    RESIDUAL,
    RING,
    SIZE,
    STIFFNESS,
    TILT,
    TILT_RATE,
    UNBALANCE,
    Memory,
)
from twin.outputs import (
    BAND,
    CONTACT,
    COUPLING,
    DISK,
    MAGNET,
    NORMAL,
    PIN,
    PLACE,
    SHAFT,
    TANGENTIAL,
    UNBALANCE_XY,
    VELOCITY,
)
from twin.parameters import adjusted
from twin.prediction import NEAR, state_of
from twin.proximity import distance_doubt, outward
from twin.slopes import contact_slopes, parameter_slopes
from twin.tracking import ANGLE, SPEED

LOSS, LOSS_SIGMA, LOSS_OPEN = range(3)  # entries of the account of a contact's energy


@kernel
def report(
    described: Model, memory: Memory, column: int, stride: int, step: float, out: np.ndarray, peak: np.ndarray
) -> None:
    """Write states and virtual sensors to column `column` of `out` (n_outputs, n), unless it is negative.

    `described` is the rig's bare model. Keeps the largest normal force (N) and radius (m) in `peak` (2,), and
    the energy of the contact. Called at each sample, `step` seconds apart; each `stride`-th has a column.
    """
    state = state_of(memory.state, memory.shaft)
    if column < 0 and memory.near[0] == 0.0 and memory.near[1] > NEAR:
        memory.energy[LOSS_OPEN] = 1.0
        place = described.rotor.bearing_station * sqrt(state.tilt_x**2 + state.tilt_y**2)
        peak[1] = max(peak[1], place)
        return
    model = adjusted(described, memory)
    force = contact_force(model, memory.candidates, state)
    nx, ny = outward(model, memory.candidates, state)
    residual_x, residual_y, normal = 0.0, 0.0, 0.0
    if force.normal > 0.0:
        residual_x, residual_y = memory.state[RESIDUAL], memory.state[RESIDUAL + 1]
        normal = max(0.0, force.normal - nx * residual_x - ny * residual_y)
    station = model.rotor.bearing_station
    x, y = station * state.tilt_x, station * state.tilt_y
    peak[0] = max(peak[0], normal)
    peak[1] = max(peak[1], sqrt(x * x + y * y))
    force_x, force_y = force.force_x + residual_x, force.force_y + residual_y
    account(model, memory.energy, state, force, force_x, force_y, step)
    if column < 0:
        return
    for i in range(DYNAMIC):
        out[i, column] = memory.state[i]
    put_pair(out, PLACE, column, station, state.tilt_x, state.tilt_y)
    put_pair(out, CONTACT, column, 1.0, force_x, force_y)
    put_pair(out, NORMAL, column, 1.0, normal, force.penetration)
    put_pair(out, UNBALANCE_XY, column, 1.0, memory.state[UNBALANCE], memory.state[UNBALANCE + 1])
    put_pair(out, SHAFT, column, 1.0, memory.shaft[ANGLE], memory.shaft[SPEED])
    put_pair(out, VELOCITY, column, station, state.tilt_rate_x, state.tilt_rate_y)
    put_pair(out, DISK, column, model.rotor.disk_station, state.tilt_x, state.tilt_y)
    put_pair(out, MAGNET, column, model.rotor.magnet_station, state.tilt_x, state.tilt_y)
    put_pair(out, TANGENTIAL, column, 1.0, force_y * nx - force_x * ny, atan2(ny, nx))
    out[TANGENTIAL + 2, column] = memory.energy[LOSS]
    put_bands(model, memory, state, nx, ny, stride * step, out, column)
    put_unbalance(memory, out, column)
    put_coupling(described, memory, out, column)
    if model.backup_bearing.kind == PINNED:
        put_pins(model, memory, state, normal, force.normal, out, column)


@inlined
def put_pair(out: np.ndarray, row: int, column: int, scale: float, x: float, y: float) -> None:
    """Write two values, times `scale`, into consecutive rows of a column."""
    out[row, column] = scale * x
    out[row + 1, column] = scale * y


@kernel
def account(
    model: Model,
    energy: np.ndarray,
    state: State,
    force: Contact,
    force_x: float,
    force_y: float,
    step: float,
) -> None:
    """Add what flows into the contact within a step to its account, begun anew at each closing.

    Rotor, house, shaft and ring lose the power -F q' - T_shaft Omega - T_ring w_r to the contact; what is
    elastic of it comes back before the contact opens.
    """
    if force.normal == 0.0:
        energy[LOSS_OPEN] = 1.0
        return
    if energy[LOSS_OPEN] > 0.0:
        energy[LOSS] = energy[LOSS_SIGMA] = energy[LOSS_OPEN] = 0.0
    _, _, rate_x, rate_y = relative_motion(model, state)
    power = -force_x * rate_x - force_y * rate_y
    power -= force.shaft_torque * state.speed + force.ring_torque * state.ring_speed
    energy[LOSS] += power * step


@kernel
def put_bands(
    model: Model,
    memory: Memory,
    state: State,
    nx: float,
    ny: float,
    period: float,
    out: np.ndarray,
    column: int,
) -> None:
    """Write the standard deviations of motion and contact; `period` (s) is the time between two columns."""
    covariance, station = memory.covariance, model.rotor.bearing_station
    for axis in range(2):
        out[BAND + axis, column] = station * sqrt(covariance[TILT + axis, TILT + axis])
        out[BAND + 2 + axis, column] = station * sqrt(covariance[TILT_RATE + axis, TILT_RATE + axis])
    normal, tangential = contact_bands(model, memory, state, nx, ny)
    out[BAND + 4, column] = normal
    out[BAND + 5, column] = tangential
    out[BAND + 6, column] = distance_doubt(model, covariance, nx, ny, 1.0)
    along = distance_doubt(model, covariance, -ny, nx, 0.0)
    out[BAND + 7, column] = min(pi, along / max(lever(model, memory.candidates, state), 1e-9))
    out[BAND + 8, column] = sqrt(covariance[RING, RING])
    if normal > 0.0:
        _, _, rate_x, rate_y = relative_motion(model, state)
        slip = rate_y * nx - rate_x * ny + state.speed * model.rotor.shaft_radius
        slip -= state.ring_speed * ring_radius(model)
        power = normal * abs(rate_x * nx + rate_y * ny) + tangential * abs(slip)
        memory.energy[LOSS_SIGMA] += power * period
    out[BAND + 9, column] = memory.energy[LOSS_SIGMA]


@kernel
def lever(model: Model, candidates: np.ndarray, state: State) -> float:
    """Return how far the shaft's centre must move along the wall (m) for its normal to turn by one radian."""
    bearing = model.backup_bearing
    if bearing.kind == PINNED:
        return model.rotor.shaft_radius + bearing.pin_tip_radius - penetration(model, candidates, state)
    x, y, _, _ = relative_motion(model, state)
    return sqrt(x * x + y * y)


@kernel
def contact_bands(model: Model, memory: Memory, state: State, nx: float, ny: float) -> tuple[float, float]:
    """Return the standard deviations (N) of normal and tangential force; zero where nothing touches."""
    if penetration(model, memory.candidates, state) <= 0.0:
        return 0.0, 0.0
    slopes, gradient = memory.slopes, memory.vector_work
    here = contact_slopes(model, memory.candidates, state, slopes)
    parameter_slopes(model, memory.candidates, state, here, slopes, memory.varied_work)
    fill_gradient(model, slopes, -nx, -ny, gradient)
    normal = deviation(memory.covariance, gradient)
    fill_gradient(model, slopes, -ny, nx, gradient)
    return normal, deviation(memory.covariance, gradient)


@kernel
def fill_gradient(model: Model, slopes: np.ndarray, along_x: float, along_y: float, out: np.ndarray) -> None:
    """Set `out` (SIZE,) to the gradient of the contact force's component along a direction (x, y)."""
    station = model.rotor.bearing_station
    for i in range(SIZE):
        out[i] = 0.0
    for axis in range(2):
        place = along_x * slopes[2, axis] + along_y * slopes[3, axis]
        rate = along_x * slopes[2, 2 + axis] + along_y * slopes[3, 2 + axis]
        out[TILT + axis], out[TILT_RATE + axis] = station * place, station * rate
        out[HOUSE + axis], out[HOUSE_RATE + axis] = -place, -rate
    out[RING] = along_x * slopes[2, 4] + along_y * slopes[3, 4]
    for i in range(CONTACT_PARAMETERS):
        out[STIFFNESS + i] = along_x * slopes[2, 5 + i] + along_y * slopes[3, 5 + i]
    out[RESIDUAL], out[RESIDUAL + 1] = along_x, along_y


@kernel
def deviation(covariance: np.ndarray, gradient: np.ndarray) -> float:
    """Return sqrt(g P g^T) of a gradient (n,) and a covariance (n, n)."""
    variance = 0.0
    for i in range(gradient.size):
        if gradient[i] != 0.0:
            for j in range(gradient.size):
                variance += gradient[i] * gradient[j] * covariance[i, j]
    return sqrt(max(variance, 0.0))


@kernel
def put_unbalance(memory: Memory, out: np.ndarray, column: int) -> None:
    """Write the unbalance's size and phase with their standard deviations."""
    x, y, covariance = memory.state[UNBALANCE], memory.state[UNBALANCE + 1], memory.covariance
    xx, yy = covariance[UNBALANCE, UNBALANCE], covariance[UNBALANCE + 1, UNBALANCE + 1]
    xy = covariance[UNBALANCE, UNBALANCE + 1]
    size = sqrt(x * x + y * y)
    put_pair(out, TANGENTIAL + 3, column, 1.0, size, atan2(y, x))
    if size == 0.0:
        put_pair(out, BAND + 10, column, 1.0, sqrt(max(xx, yy)), pi)
        return
    along = x * x * xx + 2.0 * x * y * xy + y * y * yy
    across = y * y * xx - 2.0 * x * y * xy + x * x * yy
    out[BAND + 10, column] = sqrt(max(along, 0.0)) / size
    out[BAND + 11, column] = min(pi, sqrt(max(across, 0.0)) / (size * size))


@kernel
def put_coupling(described: Model, memory: Memory, out: np.ndarray, column: int) -> None:
    """Write the coupling's force with its deviations: what the static moment asks for besides the weight."""
    station = described.rotor.coupling_station
    share = 1.0 / station if station != 0.0 else 0.0
    for axis in range(2):
        lift = memory.state[MOMENT + axis] - memory.weight[axis]
        out[COUPLING + axis, column] = share * lift
        out[BAND + 12 + axis, column] = abs(share) * sqrt(memory.covariance[MOMENT + axis, MOMENT + axis])


@kernel
def put_pins(
    model: Model, memory: Memory, state: State, normal: float, law: float, out: np.ndarray, column: int
) -> None:
    """Write each pin's normal force with its standard deviation.

    `normal` is the force that the sensors leave, `law` what the contact law gives (N): where two pins are
    touched, both share what is between.
    """
    for index in range(candidate_count(model.backup_bearing)):
        share = 0.0
        if law > 0.0:
            share = candidate_contact(model, memory.candidates, index, state).normal / law
        put_pair(out, PIN + 2 * index, column, share, normal, out[BAND + 4, column])
