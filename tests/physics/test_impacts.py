"""Impacts against scipy's DOP853 with located contacts, and the energy's balance through them."""

from math import tau

import numpy as np
import pytest

from simulator.candidates import candidates_of
from simulator.contact import contact_force
from simulator.rig import Model
from simulator.simulation import Simulation
from simulator.state import State
from tests.physics.reference import integrate
from tests.simulator.rigs import changed, hanging, ideal, model_of, signals, state

GAP, STATION = 1.5e-3, 0.211  # m


def closings(normal: np.ndarray, rate: float) -> np.ndarray:
    """Return the times (s) of the samples before each contact's first."""
    return np.flatnonzero((normal[:-1] == 0.0) & (normal[1:] > 0.0)) / rate


def distance(model: Model, a: np.ndarray, b: np.ndarray) -> float:
    """Return how far apart two states' shafts are at the bearing, as a share of the gap."""
    return np.hypot(*(a[:2] - b[:2])) * model.rotor.bearing_station / GAP


@pytest.mark.parametrize("name", ["ball", "plain"])
def test_first_impacts_after_a_drop_from_the_middle(name):
    model, speed = ideal(name), tau * 10.0
    simulation = Simulation(model, state=state(speed=speed))
    truth = signals(simulation, 0.2)
    end, times = integrate(model, state(speed=speed), speed, 0.2)
    found = closings(truth[13], 25000.0)
    assert len(found) == len(times) == 3
    assert all(0.0 <= time - sample <= 1 / 25000 for time, sample in zip(times, found, strict=True))
    # Measured 7e-8; contacts are not located, each entry within a substep costs about 1e-8.
    assert distance(model, end, simulation.state) < 1e-6
    assert simulation.state[8] == pytest.approx(end[8], abs=1e-5)  # rad/s of 60


@pytest.mark.parametrize(("name", "hz"), [("ball", 10.5), ("ball", 12.0), ("pinned", 10.5), ("plain", 12.0)])
def test_a_stretch_of_settled_impacts(name, hz):
    model = ideal(name)
    simulation = Simulation(model, state=hanging(model, hz))
    signals(simulation, 2.0)
    start = simulation.state.copy()
    truth = signals(simulation, 0.2)
    assert truth[13].max() > 5.0
    end, times = integrate(model, start, tau * hz, 0.2)
    assert len(times) >= 2
    assert distance(model, end, simulation.state) < 1e-6  # as above
    assert simulation.state[4:6] == pytest.approx(end[4:6], abs=1e-12)  # m, of some 1e-7


def test_hard_impacts_and_a_stiff_wall():
    # 8.35e7 N/m^1.5 and a throw at 0.5 m/s: 930 N and sticking against the ring, the substep rule's case.
    model = changed(ideal("ball"), backup_bearing={"stiffness": 8.35e7, "damping_factor": 1.45})
    start = state(tilt_rate_x=2.4, tilt_rate_y=0.8, speed=tau * 12.0)
    simulation = Simulation(model, state=start)
    truth = signals(simulation, 0.1)
    assert truth[13].max() > 300.0
    end, times = integrate(model, start, tau * 12.0, 0.1)
    assert len(times) >= 3
    assert distance(model, end, simulation.state) < 1e-5  # measured 8e-7, through six contacts of up to 930 N


def test_p1_s_stiff_contact():
    # k = 2.5e10 N/m^1.5: contacts of 0.6 ms, a few ticks of 40 us.
    model = changed(
        ideal("ball"), backup_bearing={"stiffness": 2.5e10, "damping_factor": 0.25, "friction": 0.2}
    )
    start = state(speed=tau * 10.0)
    simulation = Simulation(model, state=start)
    signals(simulation, 0.1)
    end, times = integrate(model, start, tau * 10.0, 0.1)
    assert len(times) >= 2
    assert distance(model, end, simulation.state) < 5e-5  # measured 7e-6; a contact at 20 us


def energy_and_losses(model: Model, column: np.ndarray) -> tuple[float, float]:
    """Return the rig's energy (J) and the power (W) that it loses, with shaft and ring, from its state."""
    rotor, magnet, house, bearing = model.rotor, model.magnetic_bearing, model.housing, model.backup_bearing
    ux, uy, vx, vy, hx, hy, hvx, hvy, ring, _, speed = column[:11]
    arm = rotor.magnet_station**2
    moment = rotor.coupling_station * rotor.coupling_force
    moment -= rotor.mass * rotor.gravity * rotor.centre_of_mass_station
    spring = 2.0 * house.transducer_stiffness
    energy = (
        0.5 * rotor.inertia * (vx**2 + vy**2) + 0.5 * magnet.stiffness * arm * (ux**2 + uy**2) - moment * uy
    )
    energy += 0.5 * (house.inner_mass + house.outer_mass) * hvx**2 + 0.5 * house.inner_mass * hvy**2
    energy += 0.5 * spring * (hx**2 + hy**2) + 0.5 * bearing.ring_inertia * ring**2
    energy += 0.5 * (model.drive.inertia + rotor.polar_inertia) * speed**2
    lost = magnet.damping * arm * (vx**2 + vy**2) + bearing.ring_damping * ring**2
    lost += 2.0 * house.horizontal_damping * hvx**2 + 2.0 * house.vertical_damping * hvy**2
    q = np.array([STATION * ux - hx, STATION * uy - hy])
    depth = np.hypot(*q) - bearing.clearance
    if depth <= 0.0:
        return energy, lost
    energy += 0.4 * bearing.stiffness * depth**2.5
    # What the contact takes from all that moves, but for what its elastic part stores.
    now = State(*column[:11], 0.0)
    force = contact_force(model, candidates_of(model), now)
    normal_rate = np.dot(q / np.hypot(*q), [STATION * vx - hvx, STATION * vy - hvy])
    given = force.moment_x * vx + force.moment_y * vy - force.force_x * hvx - force.force_y * hvy
    given += force.shaft_torque * speed + force.ring_torque * ring
    return energy, lost - given - bearing.stiffness * depth**1.5 * normal_rate


def test_energy_is_lost_where_the_equations_lose_it():
    # No unbalance and no motor torque: nothing drives the rig but its own spin.
    model = changed(
        model_of("ball"),
        rotor={"unbalance": 0.0},
        drive={"proportional_gain": 0.0, "integral_gain": 0.0},
    )
    start = state(tilt_rate_x=0.9, speed=tau * 12.0)
    rate = 200e3
    truth = signals(Simulation(model, rate=rate, state=start), 0.25)
    assert len(closings(truth[13], rate)) >= 3
    pairs = np.array([energy_and_losses(model, column) for column in truth.T])
    energy, lost = pairs.T
    assert (lost >= -1e-9).all()  # rounding of kilowatts that cancel
    taken = np.concatenate(([0.0], np.cumsum(0.5 * (lost[1:] + lost[:-1])) / rate))
    assert energy[0] - energy[-1] > 0.05  # J
    # Trapezoid rule at 5 us through contacts of 4 ms and house modes of 0.6 ms.
    assert abs(energy - energy[0] + taken).max() < 1e-4 * taken[-1]


def test_ring_is_spun_up_by_impacts_towards_the_shaft_s_surface():
    model = ideal("ball")
    truth = signals(Simulation(model, state=hanging(model, 12.0)), 3.0)
    rolling = tau * 12.0 * 12.5 / 14.0  # rad/s at which the surfaces run together
    assert truth[8].min() >= 0.0
    assert 0.5 * rolling < truth[8].max() < rolling * 1.05  # the shaft's own motion adds a little
