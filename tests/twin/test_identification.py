"""What the observer finds out about a rig that it is not told, and what it says it cannot find."""

from math import degrees

import numpy as np
import pytest

from tests.twin.accuracy import observe
from tests.twin.cases import case_run, hidden_rig
from tests.twin.emulated import emulate, run_up
from twin.layout import Tuning
from twin.observer import Observer

SEED = 7301
KNOWN = Tuning(magnet_stiffness_doubt=0.0, magnet_damping_doubt=0.0)


def found_by(observer: Observer) -> dict:
    return {each.name: each for each in observer.identified()[0]}


def turned(one: float, other: float) -> float:
    """Return the angle between two directions, deg."""
    return degrees(abs(np.angle(np.exp(1j * (one - other)))))


@pytest.mark.parametrize("rig", ["thesis-ball", "thesis-pinned"])
def test_a_run_up_with_impacts_tells_all_parameters(rig):
    run = case_run(rig, "mm", SEED)
    actual = run.rig.emulated_model
    seen = observe(run)
    found, not_told = found_by(seen.observer), seen.observer.identified()[1]
    assert not [each for each in not_told if not each.startswith(("moment_x", "contact_damping"))]
    assert found["unbalance"].value == pytest.approx(actual.rotor.unbalance, rel=0.005)
    assert turned(found["unbalance_phase"].value, actual.rotor.unbalance_angle) < 0.5
    assert found["magnet_stiffness"].value == pytest.approx(actual.magnetic_bearing.stiffness, rel=1e-3)
    assert found["magnet_damping"].value == pytest.approx(actual.magnetic_bearing.damping, rel=0.02)
    assert found["coupling_force"].value == pytest.approx(actual.rotor.coupling_force, rel=0.01)
    bearing = actual.backup_bearing
    assert found["clearance"].value == pytest.approx(bearing.clearance, abs=1e-6)
    for name, true in (("stiffness", bearing.stiffness), ("friction", bearing.friction)):
        each = found[f"contact_{name}"]
        assert each.value == pytest.approx(true, abs=4.0 * each.sigma)
        assert each.sigma < 0.1 * true
    mass, angle = found["balance_mass"], found["balance_angle"]
    left = mass.value * 33e-3 * np.exp(1j * angle.value)
    left += actual.rotor.unbalance * np.exp(1j * actual.rotor.unbalance_angle)
    assert abs(left) < 0.02 * actual.rotor.unbalance


def test_with_the_magnet_known_the_unbalance_is_found_in_the_midst_of_bouncing():
    run = case_run("thesis-ball", "mm", SEED)
    actual, observer = run.rig.emulated_model.rotor, Observer(run.rig, KNOWN)
    assert run.truth["normal_force"][100_000:105_000].max() > 5.0
    for block in run.blocks[400:420]:
        observer.update(block)
    found = found_by(observer)
    assert found["unbalance"].value == pytest.approx(actual.unbalance, rel=0.01)
    assert turned(found["unbalance_phase"].value, actual.unbalance_angle) < 1.0
    for block in run.blocks[420:]:
        observer.update(block)
    found = found_by(observer)
    assert found["unbalance"].value == pytest.approx(actual.unbalance, rel=1e-3)
    assert turned(found["unbalance_phase"].value, actual.unbalance_angle) < 0.1
    assert found["magnet_stiffness"].sigma == 0.0


def test_one_steady_free_orbit_does_not_tell_the_magnet_s_stiffness():
    rig = hidden_rig("thesis-ball", "exact", SEED)
    run = emulate(rig, run_up(7.0, 7.01, 0.1, dwell=9.0))
    observer = Observer(rig)
    for block in run.blocks[-200:]:
        observer.update(block)
    found, not_told = found_by(observer), " ".join(observer.identified()[1])
    assert not found["magnet_stiffness"].told
    assert not found["contact_stiffness"].told
    assert "magnet_stiffness is not told" in not_told
    assert "contact_friction is not told" in not_told


def test_before_any_data_nothing_is_told():
    observer = Observer(hidden_rig("thesis-pinned", "exact", SEED))
    assert not any(each.told for each in observer.identified()[0])
    described = observer.described
    assert found_by(observer)["magnet_stiffness"].value == described.magnetic_bearing.stiffness
    assert found_by(observer)["coupling_force"].value == pytest.approx(described.rotor.coupling_force)
