"""The free decay against closed forms."""

import numpy as np
import pytest

from analysis.decay import fit_decay

RATE = 25000.0


def decay(frequency, damping, amplitude, offset, seconds, seed=None, noise=0.0):
    time = np.arange(int(seconds * RATE)) / RATE
    natural = 2 * np.pi * frequency
    damped = natural * np.sqrt(1 - damping**2)
    position = offset + amplitude * np.exp(-damping * natural * time) * np.cos(damped * time + 0.3)
    if seed is None:
        return position
    draws = np.random.default_rng(seed).normal(size=(2, time.size))
    return position + noise * (draws[0] + 1j * draws[1])


@pytest.mark.parametrize("amplitude", [1e-4, 1e-4j, (3 - 4j) * 1e-5])
def test_frequency_and_damping_are_found_whatever_the_direction(amplitude):
    found = fit_decay(decay(10.06, 0.02268, amplitude, 1e-5 - 1.7e-3j, 1.0), RATE)
    assert found.frequency == pytest.approx(10.06, rel=1e-6)
    assert found.damping == pytest.approx(0.02268, rel=1e-5)
    assert found.offset == pytest.approx(1e-5 - 1.7e-3j, rel=1e-6)
    assert found.residual < 1e-9


def test_probe_noise_leaves_a_tenth_of_a_per_cent():
    found = fit_decay(decay(10.06, 0.02268, 5e-4, -1.7e-3j, 2.0, seed=4, noise=1e-6), RATE)
    assert found.frequency == pytest.approx(10.06, rel=1e-4)
    assert found.damping == pytest.approx(0.02268, rel=2e-3)
    assert found.residual == pytest.approx(np.sqrt(2) * 1e-6, rel=0.05)


def test_what_is_no_decay_is_refused():
    with pytest.raises(ValueError, match="does not move"):
        fit_decay(np.full(1000, 1j), RATE)
    with pytest.raises(ValueError, match="finite"):
        fit_decay(np.full(1000, np.nan + 0j), RATE)
    with pytest.raises(ValueError, match="16"):
        fit_decay(np.zeros(3, complex), RATE)
    with pytest.raises(ValueError, match="one damped oscillation"):
        fit_decay(np.random.default_rng(1).normal(size=5000) + 0j, RATE)
