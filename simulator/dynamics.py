"""Equations of motion of rotor, house, ring and shaft, and their integration through one step.

Signs and symbols: the rotor is rigid on a spherical pivot, with small tilts u = (tilt_x, tilt_y), I u'' +
gyroscopic terms = moments, a force F at station l giving the moment l F (P3 eq 7-14). All kernels are pure
functions of SI floats; a `State` goes in and comes out.

Two ways to integrate. `fly` is for a rotor that cannot touch the bearing during the step: rotor by
Runge-Kutta 4 (10 Hz at 40 us: 1e-15 a step), house and ring by their exact maps. `collide` integrates
everything by Runge-Kutta 4, in as many substeps as `contact_substeps` finds necessary. No contact is
located in time: the force is continuously differentiable in the penetration where it closes.
"""

from math import ceil, sqrt
from typing import NamedTuple

import numpy as np

from simulator.candidates import DAMPING_FACTOR
from simulator.compile import inlined, kernel
from simulator.contact import (
    Contact,
    candidate_count,
    contact_force,
    relative_motion,
    ring_radius,
    slip,
    surface_of,
    wall,
)
from simulator.law import KELVIN_VOIGT, normal_damping, normal_force, normal_stiffness
from simulator.numeric import sine_cosine
from simulator.rig import DriveMode, Model, Rotor
from simulator.state import Inputs, State

IDEAL = int(DriveMode.IDEAL)

LEAST_GAP = 20e-9  # m: nearer than that counts as touching
FLIGHT_TURN = 0.05  # rad of the fastest motion in a substep of flight: 3e-9 error a substep
DECAY_TURN = 2.0  # decay of slip and of closing in a substep of contact; unstable above 2.78
CONTACT_TURN = 0.15  # rad of the contact's own frequency in a substep
HOUSE_TURN = 0.45  # rad of the fastest house mode in a substep of contact: its ringing is 1e-6 of the gap
EDGE_SUBSTEPS = 4.0  # of a tick in which a contact opens or closes: the force has no second derivative there
SLIDING = 4.0  # slip speeds that must be left after a tick for friction to be as good as constant in it
NOTHING = 1e-200  # m, m/s, rad/s: numbers that die away further are slow to compute with
SHORTEST_SUBSTEP = 0.625e-6  # s: enough for 3900 N on the thesis rig


class Tick(NamedTuple):
    """Constants of a model at one length of tick; made by `tick_of`."""

    length: float  # s
    house_x_x: float  # exact map of the horizontal house motion through a tick: position from position
    house_x_v: float  # s, position from rate
    house_v_x: float  # 1/s, rate from position
    house_v_v: float  # rate from rate
    house_y_y: float  # the same of the vertical motion
    house_y_v: float
    house_w_y: float
    house_w_w: float
    ring_decay: float  # factor on the ring's speed through a tick
    flight_rate: float  # rad/s, bound on the free rotor's own frequency and damping at rest
    gyroscopic: float  # rad/s more for each rad/s of speed, the unbalance's turning included
    mobility: float  # 1/kg, of the contact point along the tangent, without friction
    approach: float  # 1/kg, of the contact point along the normal
    least_substeps: float  # of a tick with contact: the house's modes ask for it
    most_substeps: float  # of a tick with contact


@inlined
def static_moment(rotor: Rotor) -> float:
    """Return the vertical moment of weight and coupling force, N m."""
    weight = -rotor.mass * rotor.gravity * rotor.centre_of_mass_station
    return weight + rotor.coupling_station * rotor.coupling_force


@inlined
def unbalance_moment(rotor: Rotor, angle: float, speed: float, acceleration: float) -> tuple[float, float]:
    """Return the moment (x, y) of the unbalance, N m (P3 eq 9, with the tangential part)."""
    sine, cosine = sine_cosine(angle + rotor.unbalance_angle)
    moment = rotor.disk_station * rotor.unbalance
    radial, tangential = moment * speed * speed, moment * acceleration
    return radial * cosine + tangential * sine, radial * sine - tangential * cosine


@inlined
def tilt_acceleration(
    model: Model,
    x: float,
    y: float,
    rate_x: float,
    rate_y: float,
    speed: float,
    moment_x: float,
    moment_y: float,
) -> tuple[float, float]:
    """Return the tilt's acceleration (x, y), rad/s2, under moments (N m) of unbalance, contact and solenoid.

    (x, y) is the tilt, rad. Magnetic bearing, pivot spring, gyroscopic moment, weight and coupling force
    are added here (P3 eq 7-14).
    """
    rotor, magnet = model.rotor, model.magnetic_bearing
    arm = rotor.magnet_station * rotor.magnet_station
    stiffness = magnet.stiffness * arm + rotor.pivot_stiffness
    damping = magnet.damping * arm
    gyroscopic = rotor.polar_inertia * speed
    total_x = moment_x - stiffness * x - damping * rate_x - gyroscopic * rate_y
    total_y = moment_y - stiffness * y - damping * rate_y + gyroscopic * rate_x + static_moment(rotor)
    return total_x / rotor.inertia, total_y / rotor.inertia


@inlined
def shaft_acceleration(model: Model, load: float, inputs: Inputs) -> float:
    """Return the shaft's angular acceleration, rad/s2, under the contact's torque `load` (N m)."""
    drive = model.drive
    if drive.mode == IDEAL:
        return inputs.acceleration
    return (inputs.torque + load) / (drive.inertia + model.rotor.polar_inertia)


@inlined
def derivatives(model: Model, candidates: np.ndarray, inputs: Inputs, state: State) -> State:
    """Return the rate of change of each field of the state, with the contact as it is in that state.

    `candidates` (8, 6) are those of the model. The speed error's integral belongs to the controller, which
    works once a tick: its rate is zero here.
    """
    return rates_under(model, contact_force(model, candidates, state), inputs, state)


@inlined
def rates_under(model: Model, force: Contact, inputs: Inputs, state: State) -> State:
    """Return the rate of change of each field of the state under a contact's force."""
    rotor, house = model.rotor, model.housing
    acceleration = shaft_acceleration(model, force.shaft_torque, inputs)
    moment_x, moment_y = unbalance_moment(rotor, state.angle, state.speed, acceleration)
    tilt_x, tilt_y = tilt_acceleration(
        model,
        state.tilt_x,
        state.tilt_y,
        state.tilt_rate_x,
        state.tilt_rate_y,
        state.speed,
        moment_x + force.moment_x + inputs.moment_x,
        moment_y + force.moment_y + inputs.moment_y,
    )
    spring = 2.0 * house.transducer_stiffness
    house_x = -spring * state.house_x - 2.0 * house.horizontal_damping * state.house_rate_x - force.force_x
    house_y = -spring * state.house_y - 2.0 * house.vertical_damping * state.house_rate_y - force.force_y
    return State(
        state.tilt_rate_x,
        state.tilt_rate_y,
        tilt_x,
        tilt_y,
        state.house_rate_x,
        state.house_rate_y,
        house_x / (house.outer_mass + house.inner_mass),
        house_y / house.inner_mass,
        ring_acceleration(model, state.ring_speed, force.ring_torque),
        state.speed,
        acceleration,
        0.0,
    )


@inlined
def ring_acceleration(model: Model, speed: float, torque: float) -> float:
    """Return the inner ring's angular acceleration, rad/s2 (P3 eq 19); zero where no ring spins."""
    bearing = model.backup_bearing
    if ring_radius(model) == 0.0:
        return 0.0
    return (torque - bearing.ring_damping * speed) / bearing.ring_inertia


@inlined
def moved(state: State, duration: float, rate: State) -> State:
    """Return the state after a duration (s) at constant rates."""
    return State(
        state.tilt_x + duration * rate.tilt_x,
        state.tilt_y + duration * rate.tilt_y,
        state.tilt_rate_x + duration * rate.tilt_rate_x,
        state.tilt_rate_y + duration * rate.tilt_rate_y,
        state.house_x + duration * rate.house_x,
        state.house_y + duration * rate.house_y,
        state.house_rate_x + duration * rate.house_rate_x,
        state.house_rate_y + duration * rate.house_rate_y,
        state.ring_speed + duration * rate.ring_speed,
        state.angle + duration * rate.angle,
        state.speed + duration * rate.speed,
        state.speed_error_integral + duration * rate.speed_error_integral,
    )


@kernel
def collide(
    model: Model,
    candidates: np.ndarray,
    first: Inputs,
    middle: Inputs,
    last: Inputs,
    duration: float,
    state: State,
) -> State:
    """Return the state after one Runge-Kutta 4 step of `duration` (s), contact included.

    The inputs are those at the step's beginning, middle and end.
    """
    force = contact_force(model, candidates, state)
    return collide_from(force, model, candidates, first, middle, last, duration, state)


@inlined
def collide_from(
    force: Contact,
    model: Model,
    candidates: np.ndarray,
    first: Inputs,
    middle: Inputs,
    last: Inputs,
    duration: float,
    state: State,
) -> State:
    """Return what `collide` does, from a state whose contact is known."""
    rate = rates_under(model, force, first, state)
    end = moved(state, duration / 6.0, rate)
    for stage in range(1, 4):
        point = moved(state, duration if stage == 3 else 0.5 * duration, rate)
        rate = derivatives(model, candidates, last if stage == 3 else middle, point)
        end = moved(end, duration / (6.0 if stage == 3 else 3.0), rate)
    return end


@inlined
def fly(model: Model, first: Inputs, middle: Inputs, last: Inputs, duration: float, state: State) -> State:
    """Return the state after `duration` (s) without contact, house and ring left as they are.

    The torque is constant, so shaft angle and speed are exact; the tilt takes one Runge-Kutta 4 step.
    """
    rotor = model.rotor
    half = 0.5 * duration
    x, y, rate_x, rate_y = state.tilt_x, state.tilt_y, state.tilt_rate_x, state.tilt_rate_y
    acceleration = shaft_acceleration(model, 0.0, first)
    middle_speed = state.speed + half * acceleration
    last_speed = state.speed + duration * acceleration
    middle_angle = state.angle + half * (state.speed + 0.5 * half * acceleration)
    last_angle = state.angle + duration * (state.speed + half * acceleration)
    mx, my = unbalance_moment(rotor, state.angle, state.speed, acceleration)
    mx, my = mx + first.moment_x, my + first.moment_y
    ax_1, ay_1 = tilt_acceleration(model, x, y, rate_x, rate_y, state.speed, mx, my)
    mx, my = unbalance_moment(rotor, middle_angle, middle_speed, acceleration)
    mx, my = mx + middle.moment_x, my + middle.moment_y
    vx, vy = rate_x + half * ax_1, rate_y + half * ay_1
    ax_2, ay_2 = tilt_acceleration(model, x + half * rate_x, y + half * rate_y, vx, vy, middle_speed, mx, my)
    wx, wy = rate_x + half * ax_2, rate_y + half * ay_2
    ax_3, ay_3 = tilt_acceleration(model, x + half * vx, y + half * vy, wx, wy, middle_speed, mx, my)
    vx, vy = rate_x + duration * ax_3, rate_y + duration * ay_3
    mx, my = unbalance_moment(rotor, last_angle, last_speed, acceleration)
    mx, my = mx + last.moment_x, my + last.moment_y
    ax_4, ay_4 = tilt_acceleration(model, x + duration * wx, y + duration * wy, vx, vy, last_speed, mx, my)
    sixth = duration / 6.0
    return State(
        x + duration * (rate_x + sixth * (ax_1 + ax_2 + ax_3)),
        y + duration * (rate_y + sixth * (ay_1 + ay_2 + ay_3)),
        rate_x + sixth * (ax_1 + 2.0 * (ax_2 + ax_3) + ax_4),
        rate_y + sixth * (ay_1 + 2.0 * (ay_2 + ay_3) + ay_4),
        state.house_x,
        state.house_y,
        state.house_rate_x,
        state.house_rate_y,
        state.ring_speed,
        last_angle,
        last_speed,
        state.speed_error_integral,
    )


@inlined
def settle(tick: Tick, state: State) -> State:
    """Return the state with house and ring moved on by one tick without contact, exactly."""
    return State(
        state.tilt_x,
        state.tilt_y,
        state.tilt_rate_x,
        state.tilt_rate_y,
        faded(tick.house_x_x * state.house_x + tick.house_x_v * state.house_rate_x),
        faded(tick.house_y_y * state.house_y + tick.house_y_v * state.house_rate_y),
        faded(tick.house_v_x * state.house_x + tick.house_v_v * state.house_rate_x),
        faded(tick.house_w_y * state.house_y + tick.house_w_w * state.house_rate_y),
        faded(tick.ring_decay * state.ring_speed),
        state.angle,
        state.speed,
        state.speed_error_integral,
    )


@inlined
def faded(value: float) -> float:
    """Return a number, or zero for one that is next to nothing."""
    return 0.0 if abs(value) < NOTHING else value


@inlined
def may_touch(model: Model, tick: Tick, state: State, depth: float) -> bool:
    """Tell whether the shaft may reach the bearing within a tick; `depth` is the penetration now, m."""
    _, _, rate_x, rate_y = relative_motion(model, state)
    return -depth <= (abs(rate_x) + abs(rate_y)) * tick.length + LEAST_GAP


@inlined
def flight_substeps(tick: Tick, speed: float) -> int:
    """Return how many substeps a tick without contact needs."""
    turn = tick.length * (tick.flight_rate + tick.gyroscopic * abs(speed))
    return max(1, ceil(turn / FLIGHT_TURN))


@inlined
def contact_substeps(model: Model, tick: Tick, candidates: np.ndarray, state: State) -> int:
    """Return how many substeps a tick with contact needs.

    The regularised friction decides: near zero slip it is a damper mu N / slip_speed on the mobility of
    the contact point, and Runge-Kutta 4 is stable up to 2.78. Where the shaft slides through the whole tick,
    friction is as good as constant. The normal force is that of the end of the tick, at the present rate,
    so that a hard closing is seen before it comes. A law whose force jumps at closing closes in the
    shortest substep.
    """
    bearing, radius = model.backup_bearing, model.rotor.shaft_radius
    x, y, rate_x, rate_y = relative_motion(model, state)
    stiffness, damping, sticking, edge, closing = 0.0, 0.0, 0.0, 0.0, False
    for index in range(candidate_count(bearing)):
        nx, ny, depth = wall(bearing, candidates, radius, index, x, y)
        surface, factor = surface_of(bearing, candidates, index), candidates[index, DAMPING_FACTOR]
        rate = rate_x * nx + rate_y * ny
        approached = rate * tick.length
        closing = closing or (depth <= 0.0 < depth + approached)
        if abs(depth) < abs(approached):
            edge = EDGE_SUBSTEPS
        depth += max(approached, 0.0)
        held = max(surface.friction, surface.static_friction) * normal_force(surface, factor, depth, rate)
        braked = held * tick.mobility * tick.length
        slip_t, _, _, _ = slip(model, state, nx, ny, rate_y * nx - rate_x * ny)
        if abs(slip_t) < braked + SLIDING * bearing.slip_speed:
            sticking += braked / bearing.slip_speed
        stiffness = max(stiffness, normal_stiffness(surface, depth))
        damping += normal_damping(surface, factor, depth)
    if closing and bearing.law == KELVIN_VOIGT:
        return ceil(tick.most_substeps)
    decay = max(sticking, damping * tick.approach * tick.length)
    turn = sqrt(stiffness * tick.approach) * tick.length
    needed = max(decay / DECAY_TURN, turn / CONTACT_TURN, edge)
    return ceil(min(max(needed, tick.least_substeps), tick.most_substeps))
