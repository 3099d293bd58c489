"""One revolution in numbers, on orbits whose numbers are known in closed form."""

import numpy as np
import pytest

from analysis.turns import flatness, hit_directions, turn_of

RATE = 5000.0
GAP = 1.5e-3
ANGLE = np.linspace(-0.001, 2 * np.pi + 0.001, 501)  # from just before one zero to just behind the next
NONE = 0.0 * ANGLE


def test_a_circle_has_its_speed_sweep_span_and_mark():
    turn = turn_of(ANGLE, 0.5 * GAP * np.exp(1j * (ANGLE + 0.3)), NONE + 0j, NONE, GAP, RATE)
    assert turn.speed == pytest.approx((ANGLE[-1] - ANGLE[0]) / 0.1)
    assert turn.sweep == pytest.approx(1.0, abs=1e-3)
    assert turn.span == pytest.approx(1.0, abs=1e-3)
    assert turn.flatness == pytest.approx(1.0, abs=0.01)
    assert turn.mark == pytest.approx(0.5 * np.exp(0.3j), abs=1e-4)
    assert turn.duty == 0.0
    assert turn.hits.size == 0


@pytest.mark.parametrize(("shaft", "orbit"), [(1, 1), (1, -1), (-1, 1), (-1, -1)])
def test_the_sweep_is_counted_with_the_shaft_s_rotation(shaft, orbit):
    turn = turn_of(shaft * ANGLE, GAP * np.exp(1j * orbit * ANGLE), NONE + 0j, NONE, GAP, RATE)
    assert turn.sweep == pytest.approx(shaft * orbit, abs=1e-3)


def test_an_ellipse_has_the_ratio_of_its_axes():
    assert flatness(np.cos(ANGLE) + 0.25j * np.sin(ANGLE) + 3.0) == pytest.approx(0.25, rel=0.02)
    assert flatness((1 + 1j) * np.cos(ANGLE)) == pytest.approx(0.0, abs=1e-6)
    assert flatness(NONE + 0j) == 1.0


def test_each_hit_has_the_direction_of_its_impulse_on_the_bearing():
    normal = np.zeros(100)
    normal[10:14], normal[50:60], normal[70:72] = 20.0, 5.0, 0.1  # the last is no hit
    direction = np.where(np.arange(100) < 30, -2.0, 1.0)
    np.testing.assert_allclose(hit_directions(-normal * np.exp(1j * direction), normal), [-2.0, 1.0])


def test_a_shaft_that_ends_its_stretch_elsewhere_has_no_mark():
    part = slice(100, 200)
    turn = turn_of(ANGLE[part], NONE[part] + 0j, NONE[part] + 0j, NONE[part], GAP, RATE)
    assert np.isnan(turn.mark)


def test_one_sample_is_no_revolution():
    with pytest.raises(ValueError, match="at least two samples, not 1"):
        turn_of(ANGLE[:1], NONE[:1] + 0j, NONE[:1] + 0j, NONE[:1], GAP, RATE)
