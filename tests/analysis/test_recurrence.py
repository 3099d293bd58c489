"""Recurrence of Poincaré marks, on maps whose motion is known."""

import numpy as np
import pytest

from analysis.recurrence import broadband, dispersion

RNG = np.random.default_rng(6)


def logistic(growth, count=48):
    """Return the marks of the logistic map once it has settled."""
    values = [0.3]
    while len(values) < 500:
        values.append(growth * values[-1] * (1 - values[-1]))
    return np.array(values[-count:]) + 0j


@pytest.mark.parametrize("period", [1, 2, 3, 4])
def test_what_repeats_has_no_dispersion(period):
    assert dispersion(np.resize(RNG.normal(size=period) + 1j, 12), 6) == 0.0


def test_the_logistic_map_is_dispersed_in_its_chaos_and_not_in_its_period_four():
    assert dispersion(logistic(3.5), 6) < 1e-6  # its period is 4
    assert dispersion(logistic(3.99), 6) > 0.1


def test_a_rotation_comes_back_as_closely_as_its_continued_fraction_says():
    golden = np.exp(2j * np.pi * (np.sqrt(5.0) - 1.0) / 2.0 * np.arange(48))
    nearest = [2.0 * np.sin(np.pi * abs(p * (np.sqrt(5.0) - 1.0) / 2.0 - q)) for p, q in ((5, 3), (13, 8))]
    assert dispersion(golden, 6) == pytest.approx(nearest[0])
    assert dispersion(golden, 18) == pytest.approx(nearest[1])


def test_unknown_marks_have_neither_measure():
    marks = np.array([1.0, complex(np.nan, np.nan), 1.0])
    assert np.isnan(dispersion(marks, 2))
    assert np.isnan(broadband(marks, 1))


def test_lines_hold_the_power_of_two_periods_and_not_that_of_noise():
    number = np.arange(48)
    torus = 2.0 + np.exp(1.3j * number) + 0.4 * np.exp(-2.1j * number)
    assert broadband(torus, 2) < 0.005
    assert broadband(torus, 1) == pytest.approx(0.4**2 / (1.0 + 0.4**2), rel=0.05)
    white = [broadband(RNG.normal(size=48) + 1j * RNG.normal(size=48), 3) for _ in range(50)]
    assert np.mean(white) > 0.3
    assert broadband(logistic(3.99), 3) > 0.1


def test_what_stands_still_is_not_broadband():
    assert broadband(np.full(48, 1.0 + 1.0j), 3) == 0.0
