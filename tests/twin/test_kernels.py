"""The observer's kernels against closed forms and other ways to compute the same."""

import numpy as np
import pytest
from scipy.linalg import expm

from daq.rig import load_rig
from simulator.candidates import candidates_of
from simulator.contact import contact_force
from simulator.dynamics import derivatives
from simulator.state import Inputs, State
from tests.simulator.rigs import candidates
from twin.correction import correct
from twin.layout import (
    CLEARANCE,
    DAMPING,
    DYNAMIC,
    FREE_INPUTS,
    INPUTS,
    MAGNET_DAMPING,
    MAGNET_STIFFNESS,
    SIZE,
    STIFFNESS,
    new_memory,
)
from twin.linear import carry, discretise, multiply
from twin.observer import bare
from twin.parameters import adjusted, bound
from twin.slopes import (
    add_contact,
    add_parameters,
    contact_slopes,
    free_rates,
    input_rates,
    parameter_slopes,
)
from twin.tracking import lock, track

STEP = 4e-5


@pytest.fixture(scope="module")
def model():
    return bare(load_rig("thesis-ball").model)


def pressed(depth: float) -> State:
    """Return a state with the shaft `depth` m in the wall, below and a little to the right, sliding."""
    tilt = (1.5e-3 + depth) / 0.211
    return State(
        0.2 * tilt, -np.sqrt(1 - 0.04) * tilt, 0.1, -0.3, 1e-7, -2e-7, 1e-3, -2e-3, 40.0, 0.3, 80.0, 0.0
    )


def test_products_skip_nothing_that_matters():
    draw = np.random.default_rng(1)
    left, right = draw.normal(size=(5, 7)), draw.normal(size=(7, 4))
    left[np.abs(left) < 0.5] = 0.0
    out = np.empty((5, 4))
    multiply(left, right, out)
    assert out == pytest.approx(left @ right)


def test_a_covariance_stays_symmetric():
    draw = np.random.default_rng(2)
    top, root = draw.normal(size=(DYNAMIC, SIZE)), draw.normal(size=(SIZE, SIZE))
    top[np.abs(top) < 0.5] = 0.0
    covariance = root @ root.T
    whole = np.vstack((top, np.eye(SIZE)[DYNAMIC:]))
    expected = whole @ covariance @ whole.T
    scratch = np.empty((DYNAMIC, SIZE)), np.empty((SIZE, DYNAMIC)), np.empty((DYNAMIC, DYNAMIC))
    carry(top, covariance, *scratch)
    assert covariance == pytest.approx(expected)
    assert (covariance == covariance.T).all()


@pytest.mark.parametrize(("depth", "doublings"), [(-1e-3, 1), (5e-5, 3), (4e-4, 6)])
def test_a_tick_is_the_matrix_exponential(model, depth, doublings):
    rates, inputs = np.empty((DYNAMIC, DYNAMIC)), np.empty((DYNAMIC, INPUTS))
    places, slopes = candidates(model, 2.1), np.empty((5, 9))
    free_rates(model, 80.0, rates)
    input_rates(model, inputs)
    here = contact_slopes(model, places, pressed(depth), slopes)
    parameter_slopes(model, places, pressed(depth), here, slopes, np.empty((8, 6)))
    add_contact(model, slopes, rates)
    add_parameters(model, slopes, inputs)
    flow = np.empty((DYNAMIC, DYNAMIC + INPUTS))
    discretise(rates, inputs, STEP, doublings, flow, np.empty((2, DYNAMIC, DYNAMIC + INPUTS)))
    whole = np.zeros((DYNAMIC + INPUTS, DYNAMIC + INPUTS))
    whole[:DYNAMIC, :DYNAMIC], whole[:DYNAMIC, DYNAMIC:] = rates, inputs
    scale = np.array([1.0] * 2 + [1e2] * 2 + [1e-3] * 2 + [1.0] * 2 + [1e3] + [1.0] * (INPUTS - 1) + [1e-6])
    expected = expm(whole * STEP)[:DYNAMIC]
    assert flow / scale[:DYNAMIC, None] * scale == pytest.approx(
        expected / scale[:DYNAMIC, None] * scale, rel=5e-3, abs=1e-5
    )


def test_the_rates_are_those_of_the_simulator(model):
    """Compare each column of the matrix with differences of the simulator's derivatives, in contact."""
    here, inputs, places = pressed(8e-5), Inputs(0.0, 0.0, 0.0, 0.0), candidates(model, 2.1)
    rates, slopes = np.empty((DYNAMIC, DYNAMIC)), np.empty((5, 9))
    free_rates(model, here.speed, rates)
    assert contact_slopes(model, places, here, slopes) == contact_force(model, places, here)
    add_contact(model, slopes, rates)
    steps = [1e-7, 1e-7, 1e-5, 1e-5, 1e-8, 1e-8, 1e-6, 1e-6, 1e-3]
    for column, step in enumerate(steps):
        there = here._replace(**{State._fields[column]: here[column] + step})
        change = np.subtract(
            derivatives(model, places, inputs, there), derivatives(model, places, inputs, here)
        )
        expected = change[:DYNAMIC] / step
        scale = np.abs(rates[:, column]).max()
        assert rates[:, column] == pytest.approx(expected, rel=0.02, abs=1e-3 * scale)


def test_the_parameters_act_as_in_the_simulator(model):
    """Compare each parameter's column with differences of the simulator's derivatives, in contact."""
    here, inputs, places = pressed(8e-5), Inputs(0.0, 0.0, 0.0, 0.0), candidates(model, 2.1)
    columns, slopes = np.zeros((DYNAMIC, INPUTS)), np.empty((5, 9))
    force = contact_slopes(model, places, here, slopes)
    parameter_slopes(model, places, here, force, slopes, np.empty((8, 6)))
    add_parameters(model, slopes, columns)
    for index, step in ((0, 1e-4), (1, 1e-4), (2, 1e-4), (3, 1e-8)):
        memory = new_memory()
        memory.described[:] = places
        memory.state[STIFFNESS + index] = step
        changed = adjusted(model, memory)
        change = np.subtract(
            derivatives(changed, memory.candidates, inputs, here),
            derivatives(model, places, inputs, here),
        )
        expected = change[:DYNAMIC] / step
        scale = np.abs(expected).max()
        assert columns[:, FREE_INPUTS + index] == pytest.approx(expected, rel=0.01, abs=1e-4 * scale)


@pytest.mark.parametrize("rig", ["thesis-ball", "thesis-plain", "thesis-pinned"])
def test_a_model_without_changes_is_the_described_one(rig):
    described, memory = bare(load_rig(rig).model), new_memory()
    memory.described[:] = candidates_of(described)
    assert adjusted(described, memory) == described
    assert memory.candidates.tobytes() == memory.described.tobytes()
    changes = {CLEARANCE: 1e-5, STIFFNESS: np.log(1.1), MAGNET_STIFFNESS: 0.02, MAGNET_DAMPING: -0.2}
    for index, value in changes.items():
        memory.state[index] = value
    changed = adjusted(described, memory)
    bearing = described.backup_bearing
    stiffer = bearing._replace(clearance=bearing.clearance + 1e-5, stiffness=1.1 * bearing.stiffness)
    expected = candidates_of(described._replace(backup_bearing=stiffer))
    assert memory.candidates == pytest.approx(expected)
    assert changed.backup_bearing.clearance == stiffer.clearance
    assert changed.magnetic_bearing == pytest.approx((1.02 * 2090.0, 0.8 * 1.5))


def test_parameters_beyond_belief_are_held_at_its_bounds(model):
    state = np.zeros(SIZE)
    state[STIFFNESS], state[DAMPING], state[CLEARANCE], state[MAGNET_STIFFNESS] = 5.0, -5.0, 1.0, -5.0
    bound(model, state)
    assert state[STIFFNESS:] == pytest.approx([1.2, -1.2, 0.0, 0.75e-3, -1.0, 0.0])


def test_a_scalar_correction_is_kalmans():
    draw = np.random.default_rng(3)
    root = draw.normal(size=(4, 4))
    covariance, state = root @ root.T, draw.normal(size=4)
    row = np.array([0.3, 0.0, -1.2, 0.0])
    spread = row @ covariance @ row + 0.5
    gain = covariance @ row / spread
    expected = state + 0.7 * gain, covariance - np.outer(gain, row @ covariance)
    ratio = correct(state, covariance, np.array([0.3, -1.2]), np.array([0, 2]), 0.7, 0.5, np.empty(4))
    assert state == pytest.approx(expected[0])
    assert covariance == pytest.approx(expected[1])
    assert ratio == pytest.approx(0.49 / spread)


def counts(angle: np.ndarray) -> np.ndarray:
    """Return what an encoder of 4096 counts reads, within one turn."""
    turn = 2 * np.pi
    return np.round(angle / turn * 4096) % 4096 * turn / 4096


def test_the_tracking_loop_follows_a_ramp_without_lag():
    time = np.arange(25000) * STEP
    angle, speed = 3.0 + 60.0 * time + 50.0 * time**2, 60.0 + 100.0 * time
    shaft = np.zeros(3)
    lock(shaft, counts(angle[:250]), 1.0, STEP)
    errors = []
    for reading, true_angle, true_speed in zip(counts(angle), angle, speed, strict=True):
        track(shaft, reading, STEP)
        errors.append((shaft[0] - true_angle, shaft[1] - true_speed, shaft[2] - 100.0))
    settled = np.array(errors)[12500:]
    assert np.abs(settled.mean(axis=0)) == pytest.approx([0.0, 0.0, 0.0], abs=0.5)
    assert np.std(settled[:, 0]) < 3e-4
    assert np.std(settled[:, 1]) < 0.15


def test_the_tracking_loop_stands_still_with_the_shaft():
    shaft = np.zeros(3)
    readings = np.full(5000, counts(np.array([1.0]))[0])
    lock(shaft, readings[:250], 1.0, STEP)
    for reading in readings:
        track(shaft, reading, STEP)
    assert shaft == pytest.approx([readings[0], 0.0, 0.0])


def test_an_encoder_that_counts_down_is_locked_backwards():
    shaft = np.zeros(3)
    lock(shaft, counts(-60.0 * np.arange(250) * STEP), -1.0, STEP)
    assert shaft[1] == pytest.approx(60.0, abs=0.2)
