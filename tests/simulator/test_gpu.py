"""The GPU's loop: on the CPU, in numba's simulator of a GPU, and, where there is one, on a GPU."""

import json
import os
import subprocess
import sys
from math import tau

import numpy as np
import pytest

from simulator.candidates import for_kernels
from simulator.gpu import available, records, sweep_on_gpu
from simulator.march import IN_CONTACT, LARGEST_FORCE, LARGEST_RADIUS, OUTCOMES, march
from simulator.simulation import Simulation, SimulationError
from simulator.sweep import Leg, sweep
from tests.simulator.rigs import changed, ideal, signals

RAMP = tau * 26.7
STIFFNESSES = [2090.0, 0.0]  # N/m of the magnet: one rig hangs, the other lies on its bearing

IN_SIMULATOR = f"""
import json, sys
from simulator.gpu import sweep_on_gpu
from simulator.sweep import Leg
from tests.simulator.rigs import ideal

legs = [Leg(10.0, {RAMP}, 0.002), Leg([20.0, 30.0], {RAMP}, 0.002, watched=0.001)]
found = sweep_on_gpu(ideal("ball"), {{"magnetic_bearing.stiffness": {STIFFNESSES}}}, legs)
json.dump([outcome.tolist() for outcome in found[:4]], sys.stdout)
"""


@pytest.mark.parametrize("name", ["ball", "pinned"])
def test_the_loop_gives_the_outcomes_of_a_simulation(name):
    model = changed(ideal(name), rotor={"unbalance": 300e-6})
    rig, ramp = Simulation(model), np.array([0.0, tau * 12.0, RAMP, 0.0])
    model_record, tick_record = records([for_kernels(rig.model)]), records([rig.tick])
    values, places, found = rig.state.copy(), rig.candidates.copy(), np.zeros(OUTCOMES)
    for begin in range(0, 20_000, 2500):
        march(model_record[0], tick_record[0], ramp, 0, begin, 2500, 5000, values, places, found)
    one = Simulation(model)
    one.set_speed(tau * 12.0, RAMP)
    truth = signals(one, 0.8)[:, 5000:]
    assert truth[13].max() > 20.0
    # Flights at once and tick by tick round differently, by 1e-16 a tick; ten impacts make 1e-9 of it.
    assert values == pytest.approx(one.state, rel=1e-6, abs=1e-9)
    assert found[LARGEST_FORCE] == pytest.approx(truth[13].max(), rel=1e-6)
    assert found[LARGEST_RADIUS] == pytest.approx(0.211 * np.hypot(*truth[:2]).max(), rel=1e-9)
    assert abs(found[IN_CONTACT] - (truth[13] > 0.0).sum()) <= 2


def test_a_simulated_gpu_gives_the_outcomes_of_the_cpu():
    environment = {**os.environ, "NUMBA_ENABLE_CUDASIM": "1", "NUMBA_DISABLE_JIT": "1"}
    done = subprocess.run(
        [sys.executable, "-c", IN_SIMULATOR], env=environment, capture_output=True, text=True, check=True
    )
    legs = [Leg(10.0, RAMP, 0.002), Leg([20.0, 30.0], RAMP, 0.002, watched=0.001)]
    found = sweep(ideal("ball"), {"magnetic_bearing.stiffness": STIFFNESSES}, legs)
    assert found.contact_share[:, 1].min() > 0.9
    for ours, theirs in zip(json.loads(done.stdout), found[:4], strict=True):
        assert np.array(ours) == pytest.approx(theirs, rel=1e-6, abs=1e-12)


def test_without_a_gpu_the_remedy_is_named():
    if available():
        pytest.skip("there is a GPU")
    with pytest.raises(SimulationError, match=r"install rigtwin\[gpu\]"):
        sweep_on_gpu(ideal("ball"), {}, [Leg(10.0, RAMP, 0.1)])


@pytest.mark.filterwarnings("ignore:.*Grid size")  # few rigs leave most of it idle
def test_a_gpu_gives_the_outcomes_of_the_cpu():
    if not available():
        pytest.skip("there is no GPU here")  # also where nothing may be missing: few computers have one
    changes = {"rotor.unbalance": np.linspace(40e-6, 400e-6, 100)}
    legs = [Leg(tau * 11.0, RAMP, 0.3), Leg(tau * 12.0, RAMP, 0.3)]
    ours, theirs = sweep_on_gpu(ideal("ball"), changes, legs), sweep(ideal("ball"), changes, legs)
    assert theirs.largest_force.max() > 20.0
    # Rounding of 1e-16 grows tenfold in an impact; there are less than ten within 0.6 s.
    assert ours.largest_force == pytest.approx(theirs.largest_force, rel=1e-5, abs=1e-5)
    assert ours.largest_radius == pytest.approx(theirs.largest_radius, rel=1e-6)
