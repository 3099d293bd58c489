"""The model and state of an estimate: the simulator goes on from them as the emulated rig does."""

from math import tau

import numpy as np
import pytest

from daq import keys
from daq.messages_pb2 import TwinSummary
from daq.recording import Recording
from daq.rig import load_rig, rig_from_text
from recordings.reference import REFERENCES
from simulator.equilibrium import static_state
from simulator.simulation import Simulation, signals_for
from simulator.state import STATE
from twin.ensemble import DOUBTS, drawn
from twin.present import of_recording
from twin.resume import resume

RIG = load_rig("thesis-ball", ['drive.mode="ideal"'])


def values_of(simulation):
    """Return the state as a perfect estimate would have it."""
    values = dict(zip(STATE[:11], simulation.state[:11].tolist(), strict=True))
    rotor = simulation.model.rotor
    return values | {
        "unbalance_x": rotor.unbalance * np.cos(rotor.unbalance_angle),
        "unbalance_y": rotor.unbalance * np.sin(rotor.unbalance_angle),
        "coupling_force_y": rotor.coupling_force,
        "contact_friction": simulation.model.backup_bearing.friction,
    }


@pytest.fixture(scope="module")
def running():
    """An emulated rig that is not as described, in impacts."""
    model = RIG.model
    true = model._replace(
        rotor=model.rotor._replace(unbalance=9e-5, unbalance_angle=2.0, coupling_force=-11.0),
        backup_bearing=model.backup_bearing._replace(friction=0.3),
    )
    simulation = Simulation(true)
    simulation.set_speed(11.0 * tau, 20.0 * tau)
    simulation.advance(signals_for(25000))
    return simulation


def test_the_simulator_goes_on_as_the_rig_does(running):
    model, state = resume(RIG.model, values_of(running))
    copy = Simulation(model, state=state)
    own, other = signals_for(2500), signals_for(2500)
    copy.advance(own)
    running.advance(other)
    assert other[13].any()
    # Unbalance and moment go through cosines and sums: the last bits differ, and impacts amplify that.
    assert own[:2] == pytest.approx(other[:2], rel=1e-6)


def test_what_is_not_estimated_stays_as_described(running):
    values = values_of(running)
    for row in ("unbalance_x", "unbalance_y", "coupling_force_y", "contact_friction"):
        del values[row]
    assert resume(RIG.model, values).model == RIG.model


def test_the_coupling_moves_the_rotor_at_rest(running):
    model, _ = resume(RIG.model, values_of(running))
    assert static_state(model) == pytest.approx(static_state(running.model), rel=1e-12)


def test_without_a_row_of_the_state_there_is_nothing_to_go_on_from(running):
    values = values_of(running)
    del values["ring_speed"]
    with pytest.raises(KeyError, match="ring_speed"):
        resume(RIG.model, values)


def test_the_model_is_that_of_the_parameters_found():
    """What stands in a recorded summary of the twin is what the model gets, with its doubt."""
    path = next(each.path for each in REFERENCES if each.name == "ball")
    with Recording(path) as recording:
        rig = rig_from_text(recording.rig_toml)
        summaries = [
            TwinSummary.FromString(message.payload)
            for message in recording.messages(keys.twin_summary(rig.name))
        ]
    newest = summaries[-2]
    present = of_recording(path, (newest.first_sample + newest.n_samples - 1) / rig.acquisition.rate)
    found = {each.name: each for each in newest.parameters}
    assert found["contact_stiffness"].value != rig.model.backup_bearing.stiffness
    bearing = resume(rig.model, present.values).model.backup_bearing
    assert bearing.stiffness == found["contact_stiffness"].value
    assert bearing.clearance == found["clearance"].value
    draws = [each.model.backup_bearing.stiffness for each in drawn(rig.model, present.values, 2000)]
    # A standard deviation of 2000 draws is within 5 % (three of its own deviations).
    assert np.std(draws) == pytest.approx(found["contact_stiffness"].sigma, rel=0.05)


def test_draws_have_the_estimates_spread_and_the_descriptions_doubt(running):
    station = RIG.model.rotor.bearing_station
    sigmas = {"displacement_x_sigma": 1e-5 * station, "contact_friction_sigma": 0.02}
    values = values_of(running) | sigmas | {"clearance": 1.4e-3}
    rigs = drawn(RIG.model, values, 2000, seed=5)
    assert rigs[0].state == pytest.approx(resume(RIG.model, values).state)
    tilts = np.array([each.state[0] for each in rigs])
    frictions = np.array([each.model.backup_bearing.friction for each in rigs])
    stiffnesses = np.array([each.model.backup_bearing.stiffness for each in rigs])
    # A standard deviation of 2000 draws is within 5 % (three of its own deviations).
    assert tilts.std() == pytest.approx(1e-5, rel=0.05)
    assert frictions.std() == pytest.approx(0.02, rel=0.05)
    assert stiffnesses.std() == pytest.approx(DOUBTS["contact_stiffness"] * 5e7, rel=0.05)
    assert {each.model.backup_bearing.clearance for each in rigs} == {1.4e-3}  # estimated without a doubt
    again = drawn(RIG.model, values, 2000, seed=5)
    assert [each.model for each in again] == [each.model for each in rigs]
