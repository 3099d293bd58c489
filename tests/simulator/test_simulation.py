from math import pi, tau

import numpy as np
import pytest

from simulator.rig import RigError, Solenoid
from simulator.simulation import SIGNALS, STATE, TRUTH, Simulation, SimulationError, signals_for
from tests.simulator.rigs import changed, hanging, ideal, model_of, signals, state

SOLENOID = Solenoid("horizontal", 0.3035, 180.0, 60.0, 0.05, 20.0)


def performed(chunks: list[int], mode: int = 1) -> tuple[np.ndarray, np.ndarray]:
    """Run up through impacts with a hit and a change of mind, in chunks; return signals and last state."""
    model = changed(model_of("ball"), drive={"mode": mode})
    simulation = Simulation(model, state=hanging(model, 9.0))
    truth, sizes = [], chunks * (40_000 // sum(chunks))
    orders = {
        0: lambda: simulation.set_speed(tau * 12.0, tau * 4.0),
        20_000: lambda: simulation.hit(SOLENOID, 40.0, 0.01),
        20_100: lambda: simulation.hit(SOLENOID, -10.0, 0.003),
        30_000: lambda: simulation.set_speed(tau * 8.0, tau * 40.0),
    }
    for size in sizes:
        if simulation.sample in orders:
            orders[simulation.sample]()
        truth.append(signals_for(size))
        simulation.advance(truth[-1])
    return np.concatenate(truth, axis=1), simulation.state


@pytest.mark.parametrize("mode", [0, 1])
def test_chunks_do_not_change_a_byte(mode):
    whole, end = performed([100], mode)
    assert whole[13].max() > 0.0
    for chunks in ([50], [1, 99], [7, 93], [20, 80]):
        other, last = performed(chunks, mode)
        different = np.argwhere(whole != other)
        assert not len(different), f"first difference at sample {different[:, 1].min()}"
        assert np.array_equal(end, last)


def test_a_run_can_go_on_from_its_state():
    simulation = Simulation(ideal("ball"), state=hanging(ideal("ball"), 11.0))
    signals(simulation, 2.0)
    other = Simulation(ideal("ball"), state=simulation.moment().state)
    assert np.array_equal(signals(simulation, 0.5), signals(other, 0.5))


def test_rows_are_what_their_names_say():
    simulation = Simulation(ideal("ball"), state=hanging(ideal("ball"), 11.0))
    before = simulation.state.copy()
    truth = signals(simulation, 1.0)
    rows = dict(zip(SIGNALS, truth, strict=True))
    assert SIGNALS[: len(TRUTH)] == TRUTH
    assert [rows[name][0] for name in STATE[:11]] == before[:11].tolist()
    closed = rows["normal_force"] > 0.0
    assert 0 < closed.sum() < len(closed)
    assert (rows["penetration"][closed] > 0.0).all()
    resultant = np.hypot(rows["contact_force_x"], rows["contact_force_y"])
    # Friction adds at most its coefficient, 0.4, at a right angle to the normal force.
    assert (resultant >= rows["normal_force"] * (1.0 - 1e-12)).all()
    assert (resultant <= rows["normal_force"] * (1.0 + 0.4**2) ** 0.5 * (1.0 + 1e-12)).all()
    assert simulation.sample == 25_000


def test_a_pulse_is_a_half_sine_that_begins_now_and_gives_its_impulse():
    model = changed(ideal("ball"), magnetic_bearing={"stiffness": 0.0, "damping": 0.0})
    model = changed(model, rotor={"gravity": 0.0, "coupling_force": 0.0})
    simulation = Simulation(model, state=state())
    signals(simulation, 100 / 25000)
    simulation.hit(SOLENOID, 1.0, 0.010)
    truth = signals(simulation, 0.012)
    time = np.arange(300) / 25000.0
    expected = np.where(time < 0.010, np.sin(pi * time / 0.010), 0.0)
    assert truth[16] == pytest.approx(expected, abs=1e-13)  # rounding of the elapsed time
    # Step of the tilt's rate l J / I with J = 2 F T / pi; Simpson's rule on substeps of 10 us gives 1e-9.
    step = 0.3035 * 2.0 * 1.0 * 0.010 / pi / 0.07714
    assert truth[2, -1] == pytest.approx(-step, rel=1e-8)
    assert abs(truth[3, -1]) < 1e-12 * step + 1e-17  # 180 degrees exactly along -x


def test_pulses_add_up_and_a_release_ends_them():
    simulation = Simulation(model_of("ball"))
    simulation.hit(SOLENOID, 4.0, 0.010)
    signals(simulation, 0.002)
    simulation.hit(SOLENOID, 3.0, 0.010)
    truth = signals(simulation, 0.003)
    elapsed = 0.002 + np.arange(75) / 25000.0
    expected = 4.0 * np.sin(pi * elapsed / 0.01) + 3.0 * np.sin(pi * (elapsed - 0.002) / 0.01)
    assert truth[16] == pytest.approx(expected, abs=1e-12)
    simulation.release()
    assert not signals(simulation, 0.003)[16].any()


def test_a_diverging_run_says_when_and_why():
    # Nothing carries the rotor: it falls through a bearing that is a million times too soft.
    model = changed(ideal("ball"), magnetic_bearing={"stiffness": 0.0}, backup_bearing={"stiffness": 1.0})
    simulation = Simulation(model, state=state())
    with pytest.raises(SimulationError, match=r"diverged at 0\.\d+ s \(sample \d+\): tilt_x .* Likely cause"):
        signals(simulation, 1.0)
    assert 0.2 < simulation.sample / simulation.rate < 0.5


def test_a_state_that_is_no_number_is_told():
    simulation = Simulation(model_of("ball"))
    simulation.state[8] = np.nan
    with pytest.raises(SimulationError, match=r"at 0\.000000 s \(sample 0\).*ring_speed nan"):
        signals(simulation, 0.01)


def test_permanent_contact_of_a_kilonewton_is_survived():
    # Backward whirl in a plain ring: rolling at up to 1 mm penetration, the specification's hard case.
    model = ideal("plain")
    simulation = Simulation(model, state=hanging(model, 12.0))
    simulation.hit(SOLENOID, 60.0, 0.02)
    simulation.set_speed(tau * 20.0, tau * 40.0)
    truth = signals(simulation, 6.0)
    assert np.isfinite(truth).all()
    assert truth[13].max() > 500.0


def test_wrong_use_is_refused_in_plain_words():
    model = model_of("ball")
    with pytest.raises(RigError, match="ring_inertia = 0 kg m2 must be above 0"):
        Simulation(changed(model, backup_bearing={"ring_inertia": 0.0}))
    weak = changed(model, magnetic_bearing={"stiffness": 0.0}, backup_bearing={"stiffness": 1.0})
    with pytest.raises(RigError, match="carries the weight"):
        Simulation(weak)
    stiff = changed(model, backup_bearing={"law": 2, "stiffness": 1e13})
    with pytest.raises(RigError, match=r"stiffness = 1e\+13 makes the contact swing at \d+ kHz"):
        Simulation(stiff)
    with pytest.raises(RigError, match=r"slip_speed = 1e-05 m/s makes friction stop the slip within"):
        Simulation(changed(model, backup_bearing={"slip_speed": 1e-5}))
    with pytest.raises(ValueError, match="rate = 0"):
        Simulation(model, rate=0.0)
    with pytest.raises(ValueError, match="state must hold 12 finite numbers: tilt_x"):
        Simulation(model, state=np.zeros(11))
    simulation = Simulation(model)
    with pytest.raises(ValueError, match=r"shape \(3, 10\), not \(17, n\)"):
        simulation.advance(np.empty((3, 10)))
    with pytest.raises(ValueError, match="C-contiguous array of float64"):
        simulation.advance(np.empty((17, 10), dtype=np.float32))
    with pytest.raises(ValueError, match=r"ramp = 0\.0 must be a number above 0, in rad/s2"):
        simulation.set_speed(1.0, 0.0)
    with pytest.raises(ValueError, match="duration = nan"):
        simulation.hit(SOLENOID, 1.0, float("nan"))
