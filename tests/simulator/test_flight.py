"""Free flight, many samples at once, against closed forms and small steps."""

from itertools import pairwise
from math import tau

import numpy as np
import pytest

from simulator.drive import motor_torque, next_integral
from simulator.dynamics import collide
from simulator.flight_block import BLOCK
from simulator.rig import Solenoid
from simulator.simulation import Simulation, checked, signals_for
from simulator.state import Inputs, State
from tests.simulator.rigs import candidates, changed, hanging, ideal, model_of, signals, state

SOLENOID = Solenoid("horizontal", 0.3035, 180.0, 60.0, 0.05, 20.0)


def in_chunks(model, start: np.ndarray, sizes: list[int], seconds: float) -> np.ndarray:
    """Run with a hit after 1.5 blocks; return the true signals."""
    simulation, parts, turn = Simulation(model, state=start), [], 0
    count, hit = round(seconds * 25000), BLOCK + BLOCK // 2
    while simulation.sample < count:
        if simulation.sample == hit:
            simulation.hit(SOLENOID, 5.0, 0.003)
        size = sizes[turn % len(sizes)]
        following = hit if simulation.sample < hit else count
        parts.append(signals_for(min(size, following - simulation.sample)))
        simulation.advance(parts[-1])
        turn += 1
    return np.concatenate(parts, axis=1)


@pytest.mark.parametrize("of", [ideal, model_of])
@pytest.mark.parametrize(("name", "hz"), [("ball", 8.0), ("ball", 12.0), ("pinned", 11.0)])
def test_calls_of_any_size_give_the_same_bytes(name, hz, of):
    start = hanging(of(name), hz)
    whole = in_chunks(of(name), start, [10**6], 0.4)
    for sizes in ([1], [3, 50, 7], [BLOCK - 1], [BLOCK, 2 * BLOCK + 1]):
        assert np.array_equal(whole, in_chunks(of(name), start, sizes, 0.4))


@pytest.mark.parametrize("of", [ideal, model_of])
def test_what_goes_back_to_a_moment_has_the_same_bytes(of):
    simulation = Simulation(of("ball"), state=hanging(ideal("ball"), 8.0))
    signals(simulation, (7 * BLOCK + 13) / 25000)
    moment = simulation.moment()
    on = signals(simulation, 0.1)
    simulation.back_to(moment)
    assert np.array_equal(on, signals(simulation, 0.1))
    assert np.array_equal(on, signals(Simulation(of("ball"), state=moment.state), 0.1))


@pytest.mark.parametrize("of", [ideal, model_of])
def test_a_command_counts_within_a_block_that_has_begun(of):
    begin, runs = BLOCK + BLOCK // 2, []
    wanted = np.minimum(70.0 + 10.0 * np.maximum(np.arange(5 * BLOCK) - begin, 0) * 4e-5, 70.05)
    for size in (begin, 7, 1):
        simulation, parts = Simulation(of("ball"), state=hanging(of("ball"), 70.0 / tau)), []
        while simulation.sample < 5 * BLOCK:
            if simulation.sample == begin:
                simulation.set_speed(70.05, 10.0)
            following = begin if simulation.sample < begin else 5 * BLOCK
            parts.append(signals_for(min(size, following - simulation.sample)))
            simulation.advance(parts[-1])
        runs.append(np.concatenate(parts, axis=1))
        assert runs[-1][15] == pytest.approx(wanted, abs=1e-12)
    assert np.array_equal(runs[0], runs[1])
    assert np.array_equal(runs[0], runs[2])


@pytest.mark.parametrize("of", [ideal, model_of])
@pytest.mark.parametrize("target", [np.nextafter(70.0, 80.0), 70.02])
def test_a_speed_that_settles_does_so_in_the_same_block(of, target):
    # Blocks that began elsewhere would see it change in others; a motor's integral creeps on for long.
    model, runs = changed(of("ball"), backup_bearing={"clearance": 0.02}), []
    for size in (100_000, BLOCK - 1, 7):
        simulation, parts = Simulation(model, state=state(tilt_x=1e-3, house_x=1e-9, speed=70.0)), []
        simulation.set_speed(target, 10.0)
        while simulation.sample < 100_000:
            parts.append(signals_for(min(size, 100_000 - simulation.sample)))
            simulation.advance(parts[-1])
        runs.append(np.concatenate(parts, axis=1).tobytes())
    assert runs[0] == runs[1] == runs[2]


def test_a_block_at_a_speed_that_stays_is_that_of_single_ticks():
    # The second rig's speed creeps by 1e-12 rad/s a tick, so that it goes tick by tick.
    model = changed(ideal("ball"), backup_bearing={"clearance": 0.02})
    start = state(tilt_x=1e-3, tilt_rate_y=0.02, speed=70.0)
    stays, creeps = Simulation(model, state=start), Simulation(model, state=start)
    creeps.set_speed(80.0, 1e-12 * 25000.0)
    a, b = signals(stays, 1.0), signals(creeps, 1.0)
    assert a[10].min() == a[10].max()
    # That turns the tilt, 5e-3 rad, by 1.2e-8 rad in a second, and by less than rounding in a block.
    assert abs(a[:2] - b[:2]).max() < 1e-10
    assert abs(a[:2, :BLOCK] - b[:2, :BLOCK]).max() < 1e-16


def in_small_steps(model, start: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """Integrate by Runge-Kutta 4 at 10 us under set-points (n + 1,) in rad/s; return the states (12, n)."""
    model, now, path = checked(model), State(*start), []
    places = candidates(model, 2.1)
    for speed, following in pairwise(wanted):
        path.append(now)
        error, integral = speed - now.speed, now.speed_error_integral
        torque = motor_torque(model.drive, error, integral)
        held = Inputs(torque, (following - speed) * 25000.0, 0.0, 0.0)
        for _ in range(4):
            now = collide(model, places, held, held, held, 1e-5, now)
        now = now._replace(speed_error_integral=next_integral(model.drive, error, integral, 4e-5))
    return np.array(path).T


@pytest.mark.parametrize("fields", [{}, {"polar_inertia": 7.8e-3}, {"pivot_stiffness": 20.0}])
@pytest.mark.parametrize("of", [ideal, model_of])
def test_flight_is_that_of_small_steps(fields, of):
    # Through a ramp of 60 rad/s2 that ends half-way, so that an ideal drive accelerates and a motor lags.
    model = changed(of("ball"), rotor=fields, backup_bearing={"clearance": 0.02})
    start = state(tilt_x=1e-3, tilt_rate_y=0.02, house_x=1e-7, house_rate_y=1e-4, ring_speed=9.0, speed=70.0)
    simulation = Simulation(model, state=start)
    simulation.set_speed(73.0, 60.0)
    a = signals(simulation, 0.1)
    wanted = np.minimum(70.0 + 60.0 * np.arange(a.shape[1] + 1) * 4e-5, 73.0)
    b = in_small_steps(model, start, wanted)
    assert abs(a[15] - wanted[:-1]).max() < 1e-12
    # What is left out where the speed changes within a tick: 1e-9 of the unbalance's part.
    assert abs(a[:2] - b[:2]).max() < 2e-12
    assert abs(a[2:4] - b[2:4]).max() < 1e-9
    assert abs(a[9:11] - b[9:11]).max() < 1e-10
    # Runge-Kutta 4 at 10 us: a rate of 9900 rad/s is 1e-7 off in phase after 0.1 s; the ring's is slow.
    assert abs(a[4:8] - b[4:8]).max() < 1e-4 * abs(b[4:8]).max()
    assert abs(a[8] - b[8]).max() < 1e-9


def test_what_dies_away_ends_at_zero():
    # The slower house mode dies away at 67 1/s, the ring at 2.3 1/s.
    start = state(house_x=1e-190, house_y=1e-190, ring_speed=1e-199, speed=70.0)
    model = changed(ideal("ball"), backup_bearing={"clearance": 0.02})
    truth = signals(Simulation(model, state=start), 2.0)
    assert truth[4:9, 0].any()
    assert not truth[4:9, -1].any()


def test_flight_ends_where_the_shaft_may_touch():
    # Thrown at the wall from the middle: the very ticks that are near it are taken one by one.
    model, start = ideal("plain"), state(tilt_rate_x=0.8, speed=60.0)
    truth = signals(Simulation(model, state=start), 0.05)
    depth = np.hypot(0.211 * truth[0] - truth[4], 0.211 * truth[1] - truth[5]) - 1.5e-3
    assert np.array_equal(truth[13] > 0.0, depth > 0.0)
    assert (truth[13] > 0.0).any()


def test_a_speed_beyond_the_polynomials_is_taken_in_small_steps():
    model = changed(ideal("plain"), rotor={"unbalance": 0.0}, backup_bearing={"clearance": 0.02})
    truth = signals(Simulation(model, rate=500.0, state=hanging(model, 250.0)), 0.1)
    assert np.isfinite(truth).all()
    assert truth[9, -1] == pytest.approx(tau * 250.0 * 49 / 500)
