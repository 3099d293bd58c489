"""Double-sided spectra against circles of known radius."""

import numpy as np
import pytest

from analysis.spectrum import cascade, full_spectrum

RATE = 500.0
TIME = np.arange(1000) / RATE


def circles(**radii):
    """Return an orbit made of circles: forward f10=1.0, backward b10=0.2."""
    signal = np.full(TIME.size, 0.3 - 1.2j)
    for name, radius in radii.items():
        hz = float(name[1:]) * (1.0 if name[0] == "f" else -1.0)
        signal = signal + radius * np.exp(2j * np.pi * hz * TIME)
    return np.stack([signal.real, signal.imag])


def test_forward_and_backward_circles_show_their_radii():
    found = full_spectrum(circles(f10=1.0, b10=0.2, f25=0.05), RATE)
    assert found.near(10.0) == pytest.approx(1.0, rel=1e-9)
    assert found.near(-10.0) == pytest.approx(0.2, rel=1e-9)
    assert found.near(25.0) == pytest.approx(0.05, rel=1e-9)
    assert found.near(-25.0) < 1e-12
    assert found.near(0.0) < 1e-12
    assert np.all(np.diff(found.frequency) > 0.0)


def test_a_line_is_half_forward_and_half_backward():
    orbit = np.stack([np.zeros(TIME.size), np.cos(2.0 * np.pi * 12.0 * TIME)])
    found = full_spectrum(orbit, RATE)
    assert found.near(12.0) == pytest.approx(0.5)
    assert found.near(-12.0) == pytest.approx(0.5)


def test_cascade_stacks_what_lies_within_the_limit():
    frequency, amplitude = cascade([circles(f10=1.0), circles(b20=2.0)], RATE, 30.0)
    assert amplitude.shape == (2, frequency.size)
    assert np.abs(frequency).max() == 30.0
    assert frequency[amplitude.argmax(axis=1)] == pytest.approx([10.0, -20.0])


def test_too_short_or_unequal_orbits_are_refused():
    with pytest.raises(ValueError, match="at least 16 samples, not 15"):
        full_spectrum(np.zeros((2, 15)), RATE)
    with pytest.raises(ValueError, match="orbits of one length"):
        cascade([np.zeros((2, 20)), np.zeros((2, 21))], RATE, 10.0)
