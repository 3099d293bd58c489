"""How the model's accelerations change with its state: the matrices of small deviations."""

import numpy as np

from simulator.compile import kernel
from simulator.contact import Contact, contact_force, ring_radius
from simulator.rig import Model
from simulator.state import State
from twin.layout import CONTACT_PARAMETERS, FREE_INPUTS, HOUSE, HOUSE_RATE, RING, TILT, TILT_RATE
from twin.linear import clear
from twin.parameters import varied, vary_candidates

PLACE_STEP = 1e-8  # m, of the differences that give the contact's slopes
RATE_STEP = 1e-6  # m/s
RING_STEP = 1e-3  # rad/s
LOG_STEP = 1e-5  # of a parameter's logarithm


@kernel
def free_rates(model: Model, speed: float, rates: np.ndarray) -> None:
    """Set `rates` (DYNAMIC, DYNAMIC): z' = rates z of all that moves, without contact; `speed` rad/s."""
    rotor, house = model.rotor, model.housing
    arm = rotor.magnet_station * rotor.magnet_station
    stiffness = (model.magnetic_bearing.stiffness * arm + rotor.pivot_stiffness) / rotor.inertia
    damping = model.magnetic_bearing.damping * arm / rotor.inertia
    gyroscopic = rotor.polar_inertia * speed / rotor.inertia
    clear(rates)
    for axis in range(2):
        rates[TILT + axis, TILT_RATE + axis] = 1.0
        rates[TILT_RATE + axis, TILT + axis] = -stiffness
        rates[TILT_RATE + axis, TILT_RATE + axis] = -damping
        rates[HOUSE + axis, HOUSE_RATE + axis] = 1.0
        mass = house_mass(model, axis)
        house_damping = house.horizontal_damping if axis == 0 else house.vertical_damping
        rates[HOUSE_RATE + axis, HOUSE + axis] = -2.0 * house.transducer_stiffness / mass
        rates[HOUSE_RATE + axis, HOUSE_RATE + axis] = -2.0 * house_damping / mass
    rates[TILT_RATE, TILT_RATE + 1] = -gyroscopic
    rates[TILT_RATE + 1, TILT_RATE] = gyroscopic
    if ring_radius(model) > 0.0:
        rates[RING, RING] = -model.backup_bearing.ring_damping / model.backup_bearing.ring_inertia


@kernel
def house_mass(model: Model, axis: int) -> float:
    """Return the mass (kg) that moves with the house along x (axis 0: both houses) or y (the inner one)."""
    house = model.housing
    return house.inner_mass + house.outer_mass if axis == 0 else house.inner_mass


@kernel
def input_rates(model: Model, inputs: np.ndarray) -> None:
    """Set `inputs` (DYNAMIC, 4 or more): what a moment (N m) and a contact force (N) do to the rates."""
    rotor = model.rotor
    clear(inputs)
    for axis in range(2):
        inputs[TILT_RATE + axis, axis] = 1.0 / rotor.inertia
        inputs[TILT_RATE + axis, 2 + axis] = rotor.bearing_station / rotor.inertia
        inputs[HOUSE_RATE + axis, 2 + axis] = -1.0 / house_mass(model, axis)


@kernel
def contact_slopes(model: Model, candidates: np.ndarray, state: State, slopes: np.ndarray) -> Contact:
    """Set the first five columns of `slopes` (5, n) of the contact in `state`, and return the contact there.

    Rows: moment along x, y, force along x, y, torque on the ring. Columns: place along x, y (m) and
    velocity along x, y (m/s) of the shaft in the house, ring speed (rad/s). The axial friction's own
    dependence on the tilt is left out.
    """
    here = contact_force(model, candidates, state)
    x, y = state.house_x, state.house_y
    rate_x, rate_y = state.house_rate_x, state.house_rate_y
    for column in range(5):
        step = PLACE_STEP if column < 2 else RATE_STEP if column < 4 else RING_STEP
        there = contact_force(
            model,
            candidates,
            State(
                state.tilt_x,
                state.tilt_y,
                state.tilt_rate_x,
                state.tilt_rate_y,
                x - step if column == 0 else x,
                y - step if column == 1 else y,
                rate_x - step if column == 2 else rate_x,
                rate_y - step if column == 3 else rate_y,
                state.ring_speed + step if column == 4 else state.ring_speed,
                state.angle,
                state.speed,
                0.0,
            ),
        )
        set_slope(here, there, step, slopes, column)
    return here


@kernel
def parameter_slopes(
    model: Model, candidates: np.ndarray, state: State, here: Contact, slopes: np.ndarray, work: np.ndarray
) -> None:
    """Set the columns of `slopes` (5, 9) from the sixth on: how the contact changes with its parameters.

    They are ln stiffness, ln damping, ln friction and clearance (m); `here` is the contact in `state`, and
    `work` (8, 6) is scratch.
    """
    more = 1.0 + LOG_STEP
    vary_candidates(model, candidates, more, 1.0, 1.0, 0.0, work)
    set_slope(here, contact_force(model, work, state), LOG_STEP, slopes, 5)
    vary_candidates(model, candidates, 1.0, more, 1.0, 0.0, work)
    set_slope(here, contact_force(varied(model, more, 0.0), work, state), LOG_STEP, slopes, 6)
    vary_candidates(model, candidates, 1.0, 1.0, more, 0.0, work)
    set_slope(here, contact_force(model, work, state), LOG_STEP, slopes, 7)
    vary_candidates(model, candidates, 1.0, 1.0, 1.0, PLACE_STEP, work)
    set_slope(here, contact_force(varied(model, 1.0, PLACE_STEP), work, state), PLACE_STEP, slopes, 8)


@kernel
def set_slope(here: Contact, there: Contact, step: float, slopes: np.ndarray, column: int) -> None:
    """Set one column of `slopes` (5, n) to the difference of two contacts over `step`."""
    slopes[0, column] = (there.moment_x - here.moment_x) / step
    slopes[1, column] = (there.moment_y - here.moment_y) / step
    slopes[2, column] = (there.force_x - here.force_x) / step
    slopes[3, column] = (there.force_y - here.force_y) / step
    slopes[4, column] = (there.ring_torque - here.ring_torque) / step


@kernel
def add_contact(model: Model, slopes: np.ndarray, rates: np.ndarray) -> None:
    """Add the contact's `slopes` (5, 5) to the matrix `rates` (DYNAMIC, DYNAMIC) of free flight."""
    for axis in range(2):
        add_row(model, slopes[axis], 1.0 / model.rotor.inertia, rates[TILT_RATE + axis])
        add_row(model, slopes[2 + axis], -1.0 / house_mass(model, axis), rates[HOUSE_RATE + axis])
    if ring_radius(model) > 0.0:
        add_row(model, slopes[4], 1.0 / model.backup_bearing.ring_inertia, rates[RING])


@kernel
def add_row(model: Model, slope: np.ndarray, scale: float, row: np.ndarray) -> None:
    """Add `scale` times one row of slopes (5,), by place and velocity in the house, to a row (DYNAMIC,)."""
    station = model.rotor.bearing_station
    for axis in range(2):
        row[TILT + axis] += scale * station * slope[axis]
        row[TILT_RATE + axis] += scale * station * slope[2 + axis]
        row[HOUSE + axis] -= scale * slope[axis]
        row[HOUSE_RATE + axis] -= scale * slope[2 + axis]
    row[RING] += scale * slope[4]


@kernel
def add_parameters(model: Model, slopes: np.ndarray, inputs: np.ndarray) -> None:
    """Set the contact parameters' columns of `inputs` (DYNAMIC, INPUTS) from their `slopes` (5, 9)."""
    spins = ring_radius(model) > 0.0
    for parameter in range(CONTACT_PARAMETERS):
        column, slope = FREE_INPUTS + parameter, 5 + parameter
        for axis in range(2):
            inputs[TILT_RATE + axis, column] = slopes[axis, slope] / model.rotor.inertia
            inputs[HOUSE_RATE + axis, column] = -slopes[2 + axis, slope] / house_mass(model, axis)
        if spins:
            inputs[RING, column] = slopes[4, slope] / model.backup_bearing.ring_inertia
