"""Which solenoid a current is credited to."""

import numpy as np
import pytest

from daq.backend import HitOutput, make_backend
from daq.rig import load_rig
from twin.inputs import feeds_of, solenoid_currents

THREE = load_rig("thesis-ball-two-solenoids")


def test_each_solenoid_has_its_own_current_and_moment():
    assert {name: solenoid.name for name, solenoid in solenoid_currents(THREE).items()} == {
        f"solenoid_current_{name}": name for name in ("horizontal", "up", "down")
    }
    moment = 0.3035 * 20.0  # N m/A: station times force per ampere
    expected = [[-moment, 0.0], [0.0, moment], [0.0, -moment]]
    np.testing.assert_allclose(feeds_of(THREE).moments, expected, atol=1e-12)


def test_one_channel_is_the_first_solenoids():
    ball = load_rig("thesis-ball")
    assert [solenoid.name for solenoid in solenoid_currents(ball).values()] == ["horizontal"]
    assert feeds_of(ball).currents.tolist() == [ball.channels.index("solenoid_current")]


@pytest.mark.parametrize("hitting", ["horizontal", "up", "down"])
def test_the_emulated_current_flows_in_the_solenoid_that_hits(hitting):
    device = make_backend("emulator", paced=False)
    device.open(THREE)
    device.start()
    raw = np.empty((len(THREE.channels), 1000))
    device.write(HitOutput(hitting, 40.0, 0.02), 100)  # 40 N at 20 N/A: 2 A, which are 4 V
    device.read(raw)
    peaks = {
        name: raw[THREE.channels.index(f"solenoid_current_{name}")].max() for name in THREE.solenoid_names
    }
    for name, peak in peaks.items():
        assert peak == pytest.approx(4.0 if name == hitting else 0.0, abs=0.01)  # the converter's noise
    device.close()
