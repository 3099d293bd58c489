from math import hypot, log, pi, sqrt

import numpy as np
import pytest

from simulator.candidates import DAMPING_FACTOR
from simulator.contact import (
    beyond_pins,
    contact_force,
    latch,
    penetration,
    wall,
)
from simulator.law import friction, normal_force, normal_stiffness
from simulator.state import State
from tests.simulator.rigs import candidates, changed, ideal, model_of, rebound, state

DIRECTIONS = np.linspace(0.0, 2.0 * pi, 25)


def state_at(x: float, y: float, model, **fields: float) -> State:
    """Return a state with the shaft's centre at (x, y), m, in the bearing's plane."""
    station = model.rotor.bearing_station
    return State(*state(tilt_x=x / station, tilt_y=y / station, **fields))


def test_ring_normal_points_outwards_and_penetration_counts_from_the_clearance():
    bearing, places = model_of("ball").backup_bearing, candidates(model_of("ball"))
    for angle in DIRECTIONS:
        nx, ny, depth = wall(bearing, places, 12.5e-3, 0, 1.6e-3 * np.cos(angle), 1.6e-3 * np.sin(angle))
        assert (nx, ny) == pytest.approx((np.cos(angle), np.sin(angle)), abs=1e-15)
        assert depth == pytest.approx(0.1e-3, abs=1e-18)  # rounding of 1.6e-3
    assert wall(bearing, places, 12.5e-3, 0, 0.0, 0.0) == (0.0, 0.0, -1.5e-3)


def test_pins_leave_the_clearance_on_the_diagonals_and_a_cusp_on_the_axes():
    model = model_of("pinned")
    diagonal = 1.5e-3 * sqrt(0.5)
    reach = 12.5e-3 + 4e-3
    distance = reach + 1.5e-3
    cusp = distance / sqrt(2.0) - sqrt(reach**2 - distance**2 / 2.0)
    assert cusp == pytest.approx(2.228e-3, abs=1e-6)  # the specification's number, to its digits
    # Rounding only: distances of 18 mm subtract to nothing.
    for x, y in ((1, 1), (-1, 1), (-1, -1), (1, -1)):
        place = state_at(x * diagonal, y * diagonal, model)
        assert penetration(model, candidates(model), place) == pytest.approx(0.0, abs=1e-16)
    for x, y in ((1, 0), (0, 1), (-1, 0), (0, -1)):
        place = state_at(x * cusp, y * cusp, model)
        assert penetration(model, candidates(model), place) == pytest.approx(0.0, abs=1e-16)
        beyond = state_at(x * (cusp + 1e-5), y * (cusp + 1e-5), model)
        force = contact_force(model, candidates(model), beyond)
        sideways = force.force_y if x else force.force_x
        assert abs(sideways) < 1e-9 * force.normal  # two equal pins press straight back
        assert force.force_x * x + force.force_y * y < 0.0


def test_pin_normals_point_from_the_shaft_to_the_tip_s_centre():
    bearing, places = model_of("pinned").backup_bearing, candidates(model_of("pinned"))
    signs = [(1, 1), (-1, 1), (-1, -1), (1, -1)]
    for index, (x, y) in enumerate(signs):
        nx, ny, depth = wall(bearing, places, 12.5e-3, index, 0.0, 0.0)
        assert (nx, ny) == pytest.approx((x * sqrt(0.5), y * sqrt(0.5)))
        assert depth == pytest.approx(-1.5e-3)


def test_leaving_the_pins_behind_is_told():
    model = model_of("pinned")
    assert not beyond_pins(model, state_at(3.4e-3, 0.0, model))
    assert beyond_pins(model, state_at(0.0, -3.6e-3, model))
    assert not beyond_pins(model_of("ball"), state_at(3.6e-3, 0.0, model))


def test_normal_force_never_pulls():
    bearing = model_of("ball").backup_bearing
    assert normal_force(bearing, 2.1, 1e-4, 0.0) == pytest.approx(5e7 * 1e-6)
    assert normal_force(bearing, 2.1, 1e-4, 0.1) == pytest.approx(5e7 * 1e-6 * 1.315)
    assert normal_force(bearing, 2.1, 1e-4, -1.0) == 0.0
    assert normal_force(bearing, 2.1, -1e-9, 1.0) == 0.0


def test_normal_stiffness_is_the_slope_of_the_force():
    bearing = model_of("ball").backup_bearing
    slope = (normal_force(bearing, 0.0, 1.001e-4, 0.0) - normal_force(bearing, 0.0, 0.999e-4, 0.0)) / 0.002e-4
    assert normal_stiffness(bearing, 1e-4) == pytest.approx(
        slope, rel=1e-6
    )  # third-order term of the difference
    assert normal_stiffness(bearing, -1e-4) == 0.0


def test_friction_dissipates_at_every_sliding_direction():
    bearing = model_of("ball").backup_bearing
    for angle in DIRECTIONS:
        for speed in (0.0, 1e-6, 5e-3, 0.1, 10.0):
            slip_t, slip_z = speed * np.cos(angle), speed * np.sin(angle)
            along_t, along_z = friction(bearing, 100.0, slip_t, slip_z)
            assert along_t * slip_t + along_z * slip_z <= 0.0
            bound = 0.4 * 100.0 * speed / hypot(speed, 5e-3)  # Coulomb, regularised
            assert hypot(along_t, along_z) == pytest.approx(bound, rel=1e-12)


def test_friction_pushes_a_turning_shaft_backwards_and_brakes_it():
    model = model_of("ball")
    force = contact_force(model, candidates(model, 2.1), state_at(0.0, -1.6e-3, model, speed=60.0))
    assert force.force_x < 0.0  # at the bottom the shaft's surface moves to +x
    assert force.force_y == pytest.approx(force.normal)
    assert force.shaft_torque < 0.0
    assert force.ring_torque > 0.0
    assert force.ring_torque / 14e-3 == pytest.approx(-force.shaft_torque / 12.5e-3)


@pytest.mark.parametrize("name", ["ball", "plain"])
def test_sliding_along_the_wall_loses_energy(name):
    # The centres move along the wall only, so nothing goes into the elastic part: all power is friction's.
    model = model_of(name)
    random = np.random.default_rng(1)
    for _ in range(300):
        angle, along = random.uniform(0.0, 2.0 * pi), random.normal(0.0, 0.3) / 0.211
        now = state_at(
            1.65e-3 * np.cos(angle),
            1.65e-3 * np.sin(angle),
            model,
            tilt_rate_x=-along * np.sin(angle),
            tilt_rate_y=along * np.cos(angle),
            speed=random.normal(0.0, 60.0),
            ring_speed=random.normal(0.0, 60.0),
        )
        force = contact_force(model, candidates(model), now)
        power = force.moment_x * now.tilt_rate_x + force.moment_y * now.tilt_rate_y
        power += force.shaft_torque * now.speed + force.ring_torque * now.ring_speed
        assert power < 0.0


def test_axial_slip_takes_its_share_of_the_friction():
    # The shaft rolls on the ring without slip, but tilts into the wall: friction is along the shaft alone.
    model = model_of("ball")
    now = state_at(1.6e-3, 0.0, model, tilt_rate_x=0.5, speed=56.0, ring_speed=50.0)
    force = contact_force(model, candidates(model), now)
    lever = 1.6e-3 + 12.5e-3
    slip = lever * 0.5
    along = 0.4 * force.normal * slip / hypot(slip, 5e-3)
    assert force.force_y == pytest.approx(0.0, abs=1e-12)
    assert force.moment_x == pytest.approx(-0.211 * force.normal - lever * along)


def test_latched_damping_is_that_of_the_closing():
    model = changed(model_of("ball"), backup_bearing={"damping_mode": 1, "restitution": 0.71})
    places = candidates(model)
    latch(model, state_at(1.4e-3, 0.0, model, tilt_rate_x=0.1 / 0.211), places)
    assert places[0, DAMPING_FACTOR] == pytest.approx(0.29 / 0.1)
    latch(model, state_at(1.6e-3, 0.0, model, tilt_rate_x=0.2 / 0.211), places)
    assert places[0, DAMPING_FACTOR] == pytest.approx(0.29 / 0.1)  # closed: held
    latch(model, state_at(1.4e-3, 0.0, model, tilt_rate_x=-0.1 / 0.211), places)
    assert places[0, DAMPING_FACTOR] == pytest.approx(0.29 / 0.01)  # opening: the lowest speed counts


def restitution_root(factor: float, speed: float) -> float:
    """Solve lam v (1 + e) = ln((1 + lam v) / (1 - e lam v)), Hunt and Crossley's outcome, by bisection."""
    a = 1.5 * factor * speed
    low, high = 1e-9, min(1.0, (1.0 - 1e-12) / a)
    for _ in range(200):
        e = 0.5 * (low + high)
        if a * (1.0 + e) > log((1.0 + a) / (1.0 - e * a)):
            low = e
        else:
            high = e
    return e


@pytest.mark.parametrize(("factor", "speed"), [(1.45, 0.2), (2.1, 0.2), (2.1, 0.05), (0.1, 0.3)])
def test_restitution_is_hunt_and_crossley_s(factor, speed):
    # Residual motion of the "rigid" house (1e6 kg against 1.7 kg) changes the outcome by 2e-6.
    model = changed(ideal("plain"), backup_bearing={"damping_factor": factor})
    assert rebound(model, speed) == pytest.approx(restitution_root(factor, speed), abs=5e-6)
    if (factor, speed) == (1.45, 0.2):
        assert rebound(model, speed) == pytest.approx(0.774, abs=5e-4)  # the specification's three digits


@pytest.mark.parametrize("speed", [0.02, 0.2])
def test_latched_restitution_does_not_depend_on_the_speed(speed):
    # The latched factor is (1 - c_e) / v, so lam v and with it the root are the same at each speed.
    model = changed(ideal("plain"), backup_bearing={"damping_mode": 1, "restitution": 0.71})
    assert rebound(model, speed) == pytest.approx(restitution_root(0.29, 1.0), abs=5e-6)
