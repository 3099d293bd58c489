"""Flight at constant speed, many samples at once, against closed forms and single ticks."""

from math import tau

import numpy as np
import pytest

from simulator.flight import BLOCK
from simulator.rig import Solenoid
from simulator.simulation import Simulation, signals_for
from tests.simulator.rigs import changed, hanging, ideal, signals, state

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


@pytest.mark.parametrize(("name", "hz"), [("ball", 8.0), ("ball", 12.0), ("pinned", 11.0)])
def test_calls_of_any_size_give_the_same_bytes(name, hz):
    start = hanging(ideal(name), hz)
    whole = in_chunks(ideal(name), start, [10**6], 0.4)
    for sizes in ([1], [3, 50, 7], [BLOCK - 1], [BLOCK, 2 * BLOCK + 1]):
        assert np.array_equal(whole, in_chunks(ideal(name), start, sizes, 0.4))


def test_a_snapshot_between_blocks_goes_on_to_the_same_bytes():
    simulation = Simulation(ideal("ball"), state=hanging(ideal("ball"), 8.0))
    signals(simulation, 7 * BLOCK / 25000)
    other = Simulation(ideal("ball"), state=simulation.state)
    assert np.array_equal(signals(simulation, 0.1), signals(other, 0.1))


@pytest.mark.parametrize("fields", [{}, {"polar_inertia": 7.8e-3}, {"pivot_stiffness": 20.0}])
@pytest.mark.parametrize("magnet", [{}, {"stiffness": 0.0, "damping": 0.0}])
def test_flight_is_that_of_single_ticks(fields, magnet):
    # A ramp that never ends within the run keeps the simulator at single ticks, at a speed that is as good
    # as constant: it changes by 1e-14 rad/s.
    model = changed(ideal("ball"), rotor=fields, magnetic_bearing=magnet, backup_bearing={"clearance": 0.02})
    start = state(tilt_x=1e-3, tilt_rate_y=0.02, house_x=1e-7, house_rate_y=1e-4, ring_speed=9.0, speed=70.0)
    at_once, tick_by_tick = Simulation(model, state=start), Simulation(model, state=start)
    tick_by_tick.set_speed(71.0, 1e-14)
    a, b = signals(at_once, 0.1), signals(tick_by_tick, 0.1)
    # Runge-Kutta 4 at 40 us: 1e-15 a step of 2500, and rounding of the house's maps.
    assert abs(a[:2] - b[:2]).max() < 1e-13
    assert abs(a[2:4] - b[2:4]).max() < 1e-11
    for row in range(4, 10):
        assert abs(a[row] - b[row]).max() < 1e-10 * abs(b[row]).max()


def test_flight_ends_where_the_shaft_may_touch():
    # Thrown at the wall from the middle: the very ticks that are near it are taken one by one.
    model, start = ideal("plain"), state(tilt_rate_x=0.8, speed=60.0)
    truth = signals(Simulation(model, state=start), 0.05)
    depth = np.hypot(0.211 * truth[0] - truth[4], 0.211 * truth[1] - truth[5]) - 1.5e-3
    assert np.array_equal(truth[13] > 0.0, depth > 0.0)
    assert (truth[13] > 0.0).any()


def test_a_speed_beyond_the_tables_is_taken_tick_by_tick():
    model = changed(ideal("plain"), rotor={"unbalance": 0.0}, backup_bearing={"clearance": 0.02})
    truth = signals(Simulation(model, rate=500.0, state=hanging(model, 250.0)), 0.1)
    assert np.isfinite(truth).all()
    assert truth[9, -1] == pytest.approx(tau * 250.0 * 49 / 500)
