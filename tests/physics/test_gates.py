"""The integrator's accuracy gates: isotropy, order of convergence, drops, chaos and backward whirl."""

from itertools import pairwise
from math import cos, pi, sin, tau

import numpy as np
import pytest

from simulator.dynamics import collide, contact_substeps, derivatives
from simulator.simulation import Simulation, checked
from simulator.state import Inputs, State
from simulator.stepping import pack, unpacked
from tests.physics.reference import integrate
from tests.simulator.rigs import candidates, changed, ideal, signals, state

GAP, STATION = 1.5e-3, 0.211  # m


def weightless(name: str, **tables):
    """Return a rig without weight and coupling force, its house so heavy that it stays."""
    return changed(
        ideal(name),
        **{
            "rotor": {"gravity": 0.0, "coupling_force": 0.0},
            "housing": {"inner_mass": 1e15, "outer_mass": 1e15, "transducer_stiffness": 1e12},
        }
        | tables,
    )


@pytest.mark.parametrize(("name", "turn"), [("ball", 0.7), ("plain", 2.2), ("pinned", 0.5 * pi)])
def test_a_turned_start_turns_the_answer(name, turn):
    # Weight and coupling point along -y in the model, so a turned rig is one without them.
    model = weightless(name)
    runs = []
    for angle in (0.0, turn):
        z = np.exp(1j * angle) * np.array([1e-3, 0.9j])
        start = state(
            tilt_x=z[0].real, tilt_y=z[0].imag, tilt_rate_x=z[1].real, tilt_rate_y=z[1].imag, speed=60.0
        )
        turned = changed(model, rotor={"unbalance_angle": angle})
        truth = signals(Simulation(turned, state=start), 0.15)
        runs.append((truth[0] + 1j * truth[1]) * np.exp(-1j * angle))
        assert truth[13].max() > 20.0
    # Rounding, which impacts amplify, against tilts of 7e-3.
    assert abs(runs[0] - runs[1]).max() < 1e-12


def test_weight_s_direction_is_no_other_s():
    # With the loads as a moment by hand: gravity, coupling force, unbalance phase and start turned together.
    model, turn = weightless("ball"), 1.1
    moment = -1.28 * 9.81 * 0.1959 + 0.0608 * 12.0
    runs = []
    for angle in (0.0, turn):
        values = state(tilt_y=-5.6e-3, tilt_rate_x=0.9, speed=60.0)
        w, v = (complex(*values[i : i + 2]) * np.exp(1j * angle) for i in (0, 2))
        now = State(w.real, w.imag, v.real, v.imag, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 60.0, 0.0)
        turned = checked(changed(model, rotor={"unbalance_angle": angle}))
        held = Inputs(0.0, 0.0, -moment * sin(angle), moment * cos(angle))
        places, path = candidates(turned, 2.1), []
        for _ in range(6000):
            now = collide(turned, places, held, held, held, 2e-5, now)
            path.append(complex(now.tilt_x, now.tilt_y) * np.exp(-1j * angle))
        runs.append(np.array(path))
    assert abs(runs[0]).max() * STATION > GAP  # it has hit the wall
    assert abs(runs[0] - runs[1]).max() < 1e-12


def test_order_of_convergence_is_four_within_a_contact():
    model = checked(ideal("plain"))
    places, held = candidates(model, 2.1), Inputs(0.0, 0.0, 0.0, 0.0)
    start = np.array(state(tilt_x=1.6e-3 / STATION, tilt_rate_x=0.3, tilt_rate_y=0.4, speed=60.0))
    ends = []
    for count in (100, 200, 400, 3200):
        now, duration = unpacked(start), 1e-3 / count
        for _ in range(count):
            now = collide(model, places, held, held, held, duration, now)
        values = np.empty(12)
        pack(now, values)
        ends.append(values[:4])
    errors = [abs((end - ends[-1]) / abs(ends[-1])).max() for end in ends[:-1]]
    orders = [np.log2(a / b) for a, b in pairwise(errors)]
    assert errors[-1] < 1e-7
    assert all(3.5 < order < 4.7 for order in orders), orders


@pytest.mark.parametrize("name", ["ball", "plain"])
def test_first_five_impacts_of_a_drop(name):
    model, speed = ideal(name), tau * 10.0
    model = changed(model, magnetic_bearing={"stiffness": 0.0, "damping": 0.0}, rotor={"coupling_force": 0.0})
    start, seconds = state(speed=speed), 0.3
    rate = 100e3  # Hz: contacts are seen at 10 us
    truth = signals(Simulation(model, rate, state=start), seconds)
    _, times = integrate(model, start, speed, seconds)
    closed = np.flatnonzero((truth[13, :-1] == 0.0) & (truth[13, 1:] > 0.0))
    assert len(times) >= 5
    now, then = 0.0, start
    for time, sample in list(zip(times, closed, strict=False))[:5]:
        assert 0.0 <= time - sample / rate <= 20e-6
        before = time - 1e-7  # the reference's speed at its own moment of closing
        then, now = integrate(model, then, speed, before - now)[0], before
        wanted = radial(then[:2], then[2:4])
        assert radial(truth[:2, sample], truth[2:4, sample]) == pytest.approx(wanted, rel=0.02, abs=1e-3)


def radial(tilt: np.ndarray, rate: np.ndarray) -> float:
    """Return the speed towards the wall, m/s, of a shaft in a house at rest."""
    return float(STATION * np.dot(tilt, rate) / np.hypot(*tilt))


def test_chaotic_impacts_of_240_n_stay_within_1e_5_of_the_gap():
    model, speed = ideal("ball"), tau * 12.0
    start = state(tilt_rate_x=0.9, tilt_rate_y=0.3, speed=speed)
    simulation = Simulation(model, state=start)
    truth = signals(simulation, 0.3)
    assert 150.0 < truth[13].max() < 350.0
    end, times = integrate(model, start, speed, 0.3)
    assert len(times) >= 5
    assert np.hypot(*(end[:2] - simulation.state[:2])) * STATION < 1e-5 * GAP


def test_backward_whirl_of_2_kn_is_stable():
    # Rolling backwards around a plain wall; the same at twice the rate is the same whirl.
    model = changed(ideal("plain"), backup_bearing={"friction": 0.4}, rotor={"unbalance": 300e-6})
    means = []
    for rate in (25e3, 50e3):
        whirl = tau * 110.0
        radius = 1.9e-3 / STATION
        start = state(tilt_x=radius, tilt_rate_y=-radius * whirl, speed=tau * 20.0)
        truth = signals(Simulation(model, rate, state=start), 1.0)
        assert np.isfinite(truth).all()
        assert truth[13].max() > 2000.0
        turn = np.unwrap(np.arctan2(truth[1], truth[0]))
        assert turn[-1] < turn[len(turn) // 2] < 0.0  # still backwards
        means.append(truth[13, len(turn) // 2 :].mean())
    assert means[0] == pytest.approx(means[1], rel=1e-3)


def test_substeps_follow_the_force():
    from simulator.tick import tick_of

    model = checked(ideal("ball"))
    tick, places = tick_of(model, 4e-5), candidates(model, 2.1)

    def substeps(depth: float, ring: float, rate: float = 0.0) -> int:
        now = state(tilt_x=(GAP + depth) / STATION, tilt_rate_x=rate / STATION, speed=60.0, ring_speed=ring)
        return contact_substeps(model, tick, places, State(*now))

    rolling = 60.0 * 12.5 / 14.0  # rad/s: the ring runs with the shaft, so that friction sticks
    sticking = [substeps(depth, rolling) for depth in (1e-6, 1e-4, 3e-4, 1e-3)]
    assert sticking == sorted(sticking)
    assert sticking[0] == 1
    assert sticking[-1] > 10
    assert substeps(3e-4, 0.0) < substeps(3e-4, rolling)  # sliding
    assert substeps(1e-6, 0.0, 0.2) == 4  # a contact that has just closed
    assert derivatives(model, places, Inputs(0.0, 0.0, 0.0, 0.0), State(*state())).tilt_x == 0.0
