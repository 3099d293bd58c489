"""Recurrence of Poincaré marks, on maps whose motion is known."""

import numpy as np
import pytest

from analysis.recurrence import dispersion, divergence

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
    assert np.isnan(divergence(marks, 1, 1e-3))
    assert np.isnan(divergence(np.ones(3, complex), 1, 1e-3))  # one pair of marks has no neighbour


def test_the_logistic_map_s_neighbours_part_by_its_lyapunov_exponent():
    """At a growth of 4 the exponent is ln 2 a step, and each pair of marks parts as the later one does."""
    marks = logistic(4.0, 400)
    assert divergence(marks, 1, 1e-9) == pytest.approx(2.0, rel=0.25)  # 400 marks are a sample
    assert divergence(marks, 2, 1e-9) == pytest.approx(4.0, rel=0.25)


@pytest.mark.parametrize("turns", [1, 5, 10])
def test_neighbours_on_a_torus_stay_as_far_apart_as_they_are(turns):
    number = np.arange(48)
    torus = 2.0 + np.exp(1.3j * number) + 0.4 * np.exp(-2.1j * number)
    assert divergence(np.exp(1.3j * number), turns, 0.0) == pytest.approx(1.0)
    assert divergence(torus, turns, 0.0) == pytest.approx(1.0, abs=0.2)


def test_what_is_finer_than_the_resolution_does_not_part():
    noise = 1e-6 * RNG.normal(size=48) + 0j
    assert divergence(noise, 5, 1e-3) == pytest.approx(1.0, abs=0.01)
    assert divergence(np.ones(48, complex), 5, 1e-3) == 1.0
