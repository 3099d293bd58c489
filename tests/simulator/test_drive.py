from math import exp, tau

import numpy as np
import pytest

from simulator.simulation import Simulation, signals_for
from tests.simulator.rigs import changed, ideal, model_of, signals, state

SPEED, COMMAND = 10, 15


def test_set_point_goes_from_where_it_is_at_the_given_ramp():
    simulation = Simulation(ideal("ball"))
    simulation.set_speed(10.0, 100.0)
    truth = signals(simulation, 0.05)
    # Rounding of sample / rate, at most 1e-15 relative of numbers up to 10.
    assert truth[COMMAND] == pytest.approx(100.0 * np.arange(1250) / 25000.0, abs=1e-13)
    simulation.set_speed(-2.0, 50.0)
    truth = signals(simulation, 0.2)
    assert truth[COMMAND, 0] == pytest.approx(5.0, abs=1e-13)
    assert truth[COMMAND, 2500] == pytest.approx(0.0, abs=1e-13)
    assert truth[COMMAND, -1] == -2.0


def test_prescribed_speed_is_the_set_point_and_its_integral_the_angle():
    simulation = Simulation(ideal("ball"))
    simulation.set_speed(20.0, 100.0)
    truth = signals(simulation, 0.4)
    assert np.array_equal(truth[SPEED], truth[COMMAND])
    # 0.2 s of ramp and 0.2 s at speed, 2 + 4 rad, reached one tick after the last sample; 1e4 roundings.
    assert simulation.state[9] == pytest.approx(6.0, abs=1e-11)


def test_motor_settles_as_its_controller_s_equation_says():
    # J w' = k_p e + k_i int e from a step of the set-point: e'' + (k_p/J) e' + (k_i/J) e = 0, overdamped.
    # The controller holds its torque for 40 us of its 22 ms time constant: half a tick's delay is 1e-3 of
    # the step.
    model = model_of("ball")
    drive, inertia = model.drive, model.drive.inertia + model.rotor.polar_inertia
    simulation = Simulation(model)
    simulation.set_speed(1.0, 1e9)
    signals(simulation, 1 / 25000)
    truth = signals(simulation, 1.0)
    p, q = drive.proportional_gain / inertia, drive.integral_gain / inertia
    fast, slow = (-p - (p * p - 4 * q) ** 0.5) / 2, (-p + (p * p - 4 * q) ** 0.5) / 2
    a = (-p - slow) / (fast - slow)  # e(0) = 1, e'(0) = -p
    for at in (0.01, 0.03, 0.1, 0.5, 0.9):
        error = a * exp(fast * at) + (1 - a) * exp(slow * at)
        assert 1.0 - truth[SPEED, round(at * 25000)] == pytest.approx(error, abs=1e-3)


def test_motor_follows_the_fastest_commanded_ramp_within_its_torque():
    simulation = Simulation(model_of("ball"))
    simulation.set_speed(tau * 8.0, tau * 40.0)
    truth = signals(simulation, 1.5)
    lag = truth[COMMAND] - truth[SPEED]
    # Without integral the lag would settle at J a / k_p = 0.0133 x 251 / 0.6 = 5.6 rad/s.
    assert 0.0 < lag.max() < 5.6
    assert truth[SPEED, -1] == pytest.approx(tau * 8.0, rel=1e-4)


def test_integral_waits_while_the_torque_is_at_its_limit():
    model = changed(model_of("ball"), drive={"max_torque": 0.5})
    simulation = Simulation(model)
    simulation.set_speed(60.0, 1e9)
    signals(simulation, 1 / 25000)
    before = simulation.state[11]
    truth = signals(simulation, 1.0)
    assert simulation.state[11] == before  # frozen all the while
    inertia = model.drive.inertia + model.rotor.polar_inertia
    # Constant torque, so the speed is exact but for the rounding of 25 000 sums.
    assert truth[SPEED, -1] == pytest.approx(0.5 / inertia * (1.0 - 1 / 25000), rel=1e-10)
    truth = signals(simulation, 2.0)
    assert (
        truth[SPEED].max() < 60.0 * 1.15
    )  # unfrozen from zero it overshoots as a small step's response does


def test_contact_brakes_the_shaft_and_the_motor_makes_up_for_it():
    simulation = Simulation(model_of("plain"), state=state(speed=tau * 10.0))
    truth = signals(simulation, 3.0)
    assert truth[13].max() > 0.0
    lost = truth[SPEED].min()
    assert lost < tau * 10.0 - 0.01
    assert truth[SPEED, -1] == pytest.approx(tau * 10.0, rel=1e-3)


def test_angular_momentum_of_the_shaft_is_torque_times_time():
    # Without controller the shaft slows only by the friction's torque: J dw = sum of f_t r_s dt.
    model = changed(model_of("plain"), drive={"proportional_gain": 0.0, "integral_gain": 0.0})
    simulation = Simulation(model, rate=200e3, state=state(speed=tau * 10.0))
    truth = signals_for(40_000)
    simulation.advance(truth)
    inertia = model.drive.inertia + model.rotor.polar_inertia
    tangential = (truth[11] ** 2 + truth[12] ** 2 - truth[13] ** 2).clip(0.0) ** 0.5
    lost = -inertia * (truth[SPEED, -1] - truth[SPEED, 0])
    # The trapezoid rule at 5 us through contacts of 4 ms: 1e-4 is its error and that of the clipped root.
    assert lost == pytest.approx(np.trapezoid(tangential) * 12.5e-3 / 200e3, rel=1e-3)
