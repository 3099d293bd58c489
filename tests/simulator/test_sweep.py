"""Many rigs at once against one rig at a time."""

from math import pi, tau

import numpy as np
import pytest

from simulator.rig import RigError
from simulator.simulation import Simulation
from simulator.sweep import Leg, sweep
from tests.simulator.rigs import changed, ideal, signals

RAMP = tau * 26.7
UNBALANCES = np.linspace(40e-6, 160e-6, 7)


def test_each_rig_s_outcomes_are_those_of_its_own_run():
    legs = [Leg(tau * 12.0, RAMP, 0.9), Leg(np.linspace(60.0, 80.0, 7), RAMP, 0.6, watched=0.2)]
    found = sweep(ideal("ball"), {"rotor.unbalance": UNBALANCES}, legs, points=3, workers=2)
    assert found.largest_force.shape == (2, 7)
    assert not found.failures
    for number, unbalance in enumerate(UNBALANCES):
        one = Simulation(changed(ideal("ball"), rotor={"unbalance": unbalance}))
        one.set_speed(tau * 12.0, RAMP)
        first = signals(one, 0.9)
        one.set_speed(float(np.linspace(60.0, 80.0, 7)[number]), RAMP)
        second = signals(one, 0.6)[:, 10_000:]
        for leg, truth in enumerate((first, second)):
            assert found.largest_force[leg, number] == truth[13].max()
            assert found.contact_share[leg, number] == np.mean(truth[13] > 0.0)
            assert found.largest_radius[leg, number] == pytest.approx(0.211 * np.hypot(*truth[:2]).max())
        closed = np.flatnonzero(first[13])
        assert found.last_contact[0, number] == pytest.approx(
            (closed[-1] + 1) / 25000 if len(closed) else 0.0
        )
        begins = np.arange(np.ceil(second[9, 0] / tau), second[9, -1] / tau)[-3:] * tau
        expected = [0.211 * np.interp(begins, second[9], second[row]) for row in (0, 1)]
        assert pytest.approx(np.array(expected), abs=1e-7) == found.section[1, number, : len(begins)].T
    assert found.largest_force[0].max() > 10.0


def test_threads_and_their_number_change_nothing():
    changes = {"rotor.unbalance": UNBALANCES, "rotor.unbalance_angle": 0.5 * pi}
    legs = [Leg(tau * 11.0, RAMP, 0.7)]
    one, two, five = (sweep(ideal("plain"), changes, legs, points=2, workers=n) for n in (1, 2, 5))
    for a, b, c in zip(one[:-1], two[:-1], five[:-1], strict=True):
        assert np.array_equal(a, b, equal_nan=True)
        assert np.array_equal(a, c, equal_nan=True)


def test_a_diverging_rig_is_told_and_leaves_the_others_alone():
    soft = changed(ideal("ball"), magnetic_bearing={"stiffness": 300.0})
    changes = {"backup_bearing.stiffness": [5e7, 4e4], "rotor.unbalance": [75e-6, 1.0]}
    found = sweep(soft, changes, [Leg(tau * 20.0, RAMP, 1.0)])
    assert list(found.failures) == [1]
    assert "diverged" in found.failures[1]
    assert np.isnan(found.largest_force[0, 1])
    assert found.largest_force[0, 0] > 0.0


def test_wrong_sweeps_are_refused():
    legs = [Leg(60.0, RAMP, 0.1)]
    with pytest.raises(RigError, match=r"rotor\.unbalanc is no number of the model"):
        sweep(ideal("ball"), {"rotor.unbalanc": [1.0]}, legs)
    with pytest.raises(ValueError, match=r"\[2, 3, 1\] values"):
        sweep(ideal("ball"), {"rotor.unbalance": [0.0, 1e-6], "rotor.mass": [1.0, 2.0, 3.0]}, legs)
    with pytest.raises(RigError, match=r"rig 1: \[backup_bearing\] ring_inertia = 0"):
        sweep(ideal("ball"), {"backup_bearing.ring_inertia": [3e-5, 0.0]}, legs)
    with pytest.raises(ValueError, match="duration = 0"):
        sweep(ideal("ball"), {}, [Leg(60.0, RAMP, 0.0)])
