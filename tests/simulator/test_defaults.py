"""The shipped rigs give the bits that recordings were made with."""

from hashlib import sha256
from math import tau

import numpy as np
import pytest

from daq.rig import load_rig
from simulator.sensors import read_sensors, sensor_table
from simulator.simulation import Simulation, signals_for

# Digests of truth and raw readings of each rig; a change breaks the comparison with earlier recordings,
# so it belongs into the change log.
DIGESTS = {
    "ball": ("dc056fee0e7976b6", "71009bb967d22cba"),
    "pinned": ("b564fd9836b5a434", "4a8899e05af02916"),
    "plain": ("99f81e48c6618960", "b5409ccc3dff3400"),
}


@pytest.mark.parametrize("name", DIGESTS)
def test_run_up_and_hit_have_not_changed_by_a_bit(name):
    rig = load_rig(f"thesis-{name}")
    assert rig.model is not None
    simulation = Simulation(rig.model)
    simulation.set_speed(tau * 12, tau * 26.7)
    before, after = signals_for(50_000), signals_for(25_000)
    simulation.advance(before)
    simulation.hit(rig.solenoids[0], 40.0, 0.01)
    simulation.advance(after)
    assert after[13].max() > 100.0
    table = sensor_table(rig.channels, rig.model, rig.encoder, 20.0, rig.emulator)
    raw = np.empty((len(rig.channels), after.shape[1]))
    read_sensors(table, after, 50_000, 1, raw)
    found = sha256(before.tobytes() + after.tobytes()).hexdigest(), sha256(raw.tobytes()).hexdigest()
    assert tuple(digest[:16] for digest in found) == DIGESTS[name]
