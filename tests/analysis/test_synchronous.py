"""The 1X vector against closed forms."""

import numpy as np
import pytest

from analysis.synchronous import last_whole_revolutions, synchronous, whirl_vectors

RATE = 25000.0


def test_amplitude_phase_and_offset_of_a_steady_orbit():
    angle = 0.4 + 2 * np.pi * 20.0 * np.arange(4000) / RATE
    x = 1e-3 + 8.4e-5 * np.cos(angle + 0.7)
    y = -2e-3 + 8.4e-5 * np.sin(angle + 0.7)
    found = synchronous(angle, np.stack([x, y]))
    assert found.revolutions == 3
    assert found.amplitude == pytest.approx([8.4e-5, 8.4e-5], rel=1e-9)
    assert found.phase == pytest.approx([0.7, 0.7 - np.pi / 2])
    assert found.offset == pytest.approx([1e-3, -2e-3])
    assert np.all(found.residual < 1e-12)


def test_other_orders_do_not_leak_into_whole_revolutions():
    angle = 2 * np.pi * 10.0 * np.arange(5000) / RATE  # two whole revolutions exactly
    found = synchronous(angle, np.cos(angle) + 0.3 * np.cos(2 * angle) + 0.2 * np.sin(3 * angle))
    assert found.vector[0] == pytest.approx(1.0, abs=1e-3)
    assert found.residual[0] == pytest.approx(np.sqrt((0.3**2 + 0.2**2) / 2), rel=1e-3)


def test_the_vector_holds_while_the_speed_changes():
    time = np.arange(12500) / RATE
    angle = 2 * np.pi * (8.0 * time + 13.0 * time**2)
    assert synchronous(angle, 3.0 + np.cos(angle - 1.0)).vector[0] == pytest.approx(np.exp(-1j), abs=1e-9)


def test_rotation_the_other_way_counts_its_revolutions_too():
    angle = -2 * np.pi * 10.0 * np.arange(5200) / RATE
    found = synchronous(angle, np.cos(angle + 0.2), most=1)
    assert found.revolutions == 1
    assert found.phase[0] == pytest.approx(0.2)


def test_less_than_one_revolution_is_refused():
    with pytest.raises(ValueError, match="at least one whole revolution"):
        synchronous(np.linspace(0.0, 6.0, 100), np.zeros(100))
    with pytest.raises(ValueError, match="at least one whole revolution"):
        synchronous(np.empty(0), np.empty((1, 0)))


def test_the_start_of_the_last_whole_revolutions():
    angle = 2 * np.pi * np.arange(26) / 10.0
    assert last_whole_revolutions(angle) == (6, 2)
    assert last_whole_revolutions(angle, most=1) == (16, 1)


def test_forward_and_backward_parts_rebuild_the_orbit():
    angle = 2 * np.pi * np.arange(1000) / 250.0
    orbit = (2.0 + 1.0j) * np.exp(1j * angle) + (0.3 - 0.4j) * np.exp(-1j * angle)
    vectors = synchronous(
        np.append(angle, 8 * np.pi),
        np.stack([np.append(orbit.real, orbit.real[0]), np.append(orbit.imag, orbit.imag[0])]),
    ).vector
    forward, backward = whirl_vectors(*vectors)
    assert forward == pytest.approx(2.0 + 1.0j)
    assert backward == pytest.approx(0.3 - 0.4j)
