"""Orbits against closed forms."""

import numpy as np
import pytest

from analysis.orbit import crossings, largest_radius, once_a_turn

RATE = 1000.0
TIME = np.arange(2000) / RATE


def circle(radius, hz, centre=(0.0, 0.0), phase=0.0):
    """Return an orbit (2, n) that runs round `centre`."""
    turned = 2.0 * np.pi * hz * TIME + phase
    return np.stack([centre[0] + radius * np.cos(turned), centre[1] + radius * np.sin(turned)])


def test_largest_radius_of_a_circle_off_the_middle():
    assert largest_radius(circle(2.0, 10.0, (3.0, 4.0))) == pytest.approx(7.0, rel=1e-3)
    assert largest_radius(np.empty((2, 0))) == 0.0


@pytest.mark.parametrize("direction", [1.0, -1.0])
@pytest.mark.parametrize("at", [0.0, 1.0])
def test_a_synchronous_orbit_has_one_poincare_point(direction, at):
    angle = direction * 2.0 * np.pi * 7.3 * TIME + 0.1
    points = once_a_turn(angle, np.stack([np.cos(angle), np.sin(angle)]), at)
    assert points.shape[1] in (14, 15)
    assert points == pytest.approx(np.repeat([[np.cos(at)], [np.sin(at)]], points.shape[1], 1), abs=3e-4)


def test_a_motion_of_half_the_speed_has_two_poincare_points():
    angle = 2.0 * np.pi * 8.0 * TIME + 0.1
    points = once_a_turn(angle, np.sin(0.5 * angle)[None])
    assert points[0, ::2] == pytest.approx(-points[0, 1::2][: points[0, ::2].size], abs=1e-3)


def test_poincare_section_of_a_shaft_at_rest_is_empty():
    assert once_a_turn(np.ones(10), np.ones((2, 10))).shape == (2, 0)
    assert once_a_turn(np.empty(0), np.empty((2, 0))).shape == (2, 0)


def test_crossings_of_a_circle_are_its_top_and_bottom():
    found = crossings(circle(1.5, 10.0, phase=0.3), RATE)
    assert found.shape[1] == 40
    assert np.sort(found[0]) == pytest.approx(np.repeat([-1.5, 1.5], 20), abs=2e-3)
    assert found[1] == pytest.approx(-2.0 * np.pi * 10.0 * found[0], rel=2e-3)
    assert np.abs(found[2]).max() < 0.04 * np.abs(found[1]).max()


def test_an_orbit_beside_the_line_does_not_cross_it():
    assert crossings(circle(1.0, 10.0, (2.0, 0.0)), RATE).shape == (3, 0)
