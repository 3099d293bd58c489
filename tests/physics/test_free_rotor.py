"""The rotor without contact against closed forms (numbers: the thesis' parameters)."""

from itertools import pairwise
from math import pi, sqrt, tau

import numpy as np
import pytest

from simulator.rig import Model
from simulator.simulation import Simulation
from tests.simulator.rigs import changed, hanging, ideal, model_of, signals, state

STATION, DISK = 0.211, 0.3035  # m
STIFFNESS, DAMPING = 2090.0 * 0.384**2, 1.5 * 0.384**2  # N m/rad, N m s/rad
INERTIA, POLAR = 0.07714, 7.8e-4  # kg m2


def without_bearing(model: Model) -> Model:
    """Return the model with a clearance that the shaft does not cross."""
    return changed(model, backup_bearing={"clearance": 0.02})


def synchronous(hz: float) -> complex:
    """Return the tilt's complex amplitude W (rad) at a constant speed, relative to the unbalance."""
    speed = tau * hz
    forced = DISK * 75e-6 * speed**2
    return forced / (STIFFNESS - (INERTIA - POLAR) * speed**2 + 1j * DAMPING * speed)


def test_static_equilibrium():
    simulation = Simulation(model_of("ball"))
    moment = -1.28 * 9.81 * 0.1959 + 0.0608 * 12.0
    assert simulation.state[1] == pytest.approx(moment / STIFFNESS, rel=1e-12)  # rounding
    # The specification's digits.
    assert simulation.state[1] * STATION == pytest.approx(-1.18465e-3, abs=5e-9)
    assert simulation.state[1] * DISK == pytest.approx(-1.70398e-3, abs=5e-9)
    assert 1.5e-3 + simulation.state[1] * STATION == pytest.approx(0.3154e-3, abs=5e-8)
    truth = signals(simulation, 1.0)
    assert abs(truth[1] - moment / STIFFNESS).max() < 1e-15  # it stays: rounding only


@pytest.mark.parametrize("name", ["ball", "pinned"])
def test_a_rotor_too_heavy_for_its_magnet_rests_on_the_bearing(name):
    model = changed(model_of(name), magnetic_bearing={"stiffness": 500.0})
    simulation = Simulation(model)
    truth = signals(simulation, 0.5)
    assert truth[13, 0] > 1.0
    # Bisection to the last bit; what is left is the rounding of forces of some N, over a kilonewton per mm.
    assert abs(truth[1] - truth[1, 0]).max() < 1e-12
    assert 2.0 * 8.3e7 * truth[5, 0] == pytest.approx(-truth[12, 0], rel=1e-9)  # the house carries it


def test_free_decay_gives_frequency_and_damping():
    simulation = Simulation(ideal("ball"))
    start = simulation.state.copy()
    start[0] = 0.5e-3 / STATION
    truth = signals(Simulation(ideal("ball"), state=start), 4.0)
    assert not truth[13].any()
    x = truth[0]
    rising = np.flatnonzero((x[:-1] < 0.0) & (x[1:] >= 0.0))
    crossings = rising - x[rising] / (x[rising + 1] - x[rising])
    frequency = (len(crossings) - 1) / (crossings[-1] - crossings[0]) * 25000.0
    peaks = [x[a:b].max() for a, b in pairwise(rising)]
    decrement = np.log(peaks[0] / peaks[-1]) / (len(peaks) - 1)
    zeta = decrement / sqrt(decrement**2 + tau**2)
    natural = sqrt(STIFFNESS / INERTIA) / tau
    assert natural == pytest.approx(10.0597, abs=5e-5)  # the specification's digits
    # Interpolated crossings and sampled peaks at 2500 samples a period: 1e-6.
    assert frequency == pytest.approx(natural * sqrt(1.0 - zeta**2), rel=2e-6)
    assert zeta == pytest.approx(DAMPING / (2.0 * sqrt(STIFFNESS * INERTIA)), rel=2e-4)
    assert zeta == pytest.approx(0.02268, abs=5e-6)  # the specification's digits


@pytest.mark.parametrize("sign", [1, -1])
def test_whirl_frequencies_split_with_speed(sign):
    # Forward and backward whirl are eigenvectors: started in one, the rotor stays in it. 200 rad/s and ten
    # times the polar inertia make the split plain.
    model = changed(ideal("ball"), rotor={"polar_inertia": 7.8e-3, "unbalance": 0.0, "gravity": 0.0})
    model = without_bearing(changed(model, rotor={"coupling_force": 0.0}))
    roots = np.roots([INERTIA, DAMPING - 1j * 7.8e-3 * 200.0, STIFFNESS])
    root = max(roots, key=lambda s: sign * s.imag)
    start = state(tilt_x=1e-3, tilt_rate_x=1e-3 * root.real, tilt_rate_y=1e-3 * root.imag, speed=200.0)
    truth = signals(Simulation(model, state=start), 1.0)
    w = truth[0] + 1j * truth[1]
    expected = 1e-3 * np.exp(root * np.arange(25000) / 25000.0)
    assert abs(w - expected).max() < 1e-3 * 1e-9  # 25 000 steps of 1e-15, and the gyroscopic part's share


@pytest.mark.parametrize(
    ("hz", "millimetres"), [(8.5, 0.1503), (9.0, 0.2355), (9.5, 0.4450), (10.0, 1.2281), (20.0, 0.08445)]
)
@pytest.mark.parametrize("mode", [0, 1])
def test_synchronous_response(hz, millimetres, mode):
    model = without_bearing(changed(model_of("ball"), drive={"mode": mode}))
    amplitude = synchronous(hz)
    rest = Simulation(model).state[1]
    u, v = amplitude + 1j * rest, 1j * tau * hz * amplitude
    start = state(tilt_x=u.real, tilt_y=u.imag, tilt_rate_x=v.real, tilt_rate_y=v.imag, speed=tau * hz)
    truth = signals(Simulation(model, state=start), 2.0)
    w = truth[0] + 1j * (truth[1] - rest)
    error = abs(w - amplitude * np.exp(1j * truth[9])).max()
    assert error < 1e-9 * abs(amplitude)  # Runge-Kutta 4 at 40 us: 1e-15 a step, 50 000 steps
    assert abs(amplitude) * STATION * 1e3 == pytest.approx(
        millimetres, rel=4e-4
    )  # the specification's digits


def test_20_hz_is_free_of_contact_after_a_fast_run_up_has_died_away():
    model = ideal("ball")
    simulation = Simulation(model, state=hanging(model, 20.0))
    signals(simulation, 6.0)  # the transient decays with 0.7 s
    truth = signals(simulation, 1.0)
    assert not truth[13].any()
    w = truth[0] + 1j * truth[1]
    once = (w * np.exp(-1j * truth[9])).mean()
    # exp(-6 / 0.7) of a transient of 1.2 mm: 0.3 %.
    assert abs(once) == pytest.approx(abs(synchronous(20.0)), rel=5e-3)


def test_a_speed_ramp_keeps_the_phase_and_the_tangential_force():
    # Against scipy with Omega' in the unbalance's force: 8 to 12 Hz in 0.15 s.
    from scipy.integrate import solve_ivp

    model = without_bearing(ideal("ball"))
    slope, begin = tau * 26.7, tau * 8.0
    simulation = Simulation(model, state=state(speed=begin))
    simulation.set_speed(1e3, slope)
    signals(simulation, 0.15)

    def rates(time, y):
        angle, speed = begin * time + 0.5 * slope * time**2, begin + slope * time
        u, v = complex(y[0], y[1]), complex(y[2], y[3])
        moment = DISK * 75e-6 * (speed**2 - 1j * slope) * np.exp(1j * angle)
        moment += 1j * (-1.28 * 9.81 * 0.1959 + 0.0608 * 12.0) - STIFFNESS * u - DAMPING * v
        a = (moment + 1j * POLAR * speed * v) / INERTIA
        return [v.real, v.imag, a.real, a.imag]

    found = solve_ivp(rates, (0.0, 0.15), np.zeros(4), method="DOP853", rtol=1e-12, atol=1e-14)
    assert simulation.state[:2] == pytest.approx(found.y[:2, -1], abs=2e-12)  # 2e-10 of the tilt


def test_house_modes_ring_at_their_frequencies():
    model = changed(ideal("ball"), rotor={"unbalance": 0.0})
    for row, mass, damping, hertz, ratio in (
        (4, 1.70 + 8.87, 704.0, 630.7, 0.0168),
        (5, 1.70, 228.0, 1572.8, 0.0136),
    ):
        start = Simulation(model).state
        start[row] = 1e-6
        truth = signals(Simulation(model, state=start), 0.02)
        natural, decay = sqrt(2.0 * 8.3e7 / mass), 2.0 * damping / (2.0 * mass)
        damped = sqrt(natural**2 - decay**2)
        time = np.arange(500) / 25000.0
        expected = (
            1e-6 * np.exp(-decay * time) * (np.cos(damped * time) + decay / damped * np.sin(damped * time))
        )
        assert abs(truth[row] - expected).max() < 1e-6 * 1e-11  # exact maps: rounding of 500 products
        assert natural / tau == pytest.approx(hertz, abs=0.1)  # the specification's digits
        assert decay / natural == pytest.approx(ratio, abs=5e-5)


def test_ring_spins_down_from_10_hz_to_1_hz_in_a_second():
    start = Simulation(ideal("ball")).state
    start[8] = tau * 10.0
    truth = signals(Simulation(ideal("ball"), state=start), 1.00004)
    # c = I ln 10 / 1 s, given as 6.908e-5 to four digits.
    assert truth[8, -1] == pytest.approx(tau * 1.0, rel=2e-4)
    assert truth[8, -1] == pytest.approx(tau * 10.0 * np.exp(-6.908e-5 / 3e-5), rel=1e-11)
    assert pi < truth[8, -1]
