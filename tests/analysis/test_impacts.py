"""Finding and matching impacts."""

import numpy as np
import pytest

from analysis.impacts import compare_impacts, correlation, find_impacts

RATE = 25000.0


def trace(*pulses, n=2000):
    """Half sines of (start, length, peak)."""
    force = np.zeros(n)
    for start, length, peak in pulses:
        force[start : start + length] += peak * np.sin(np.pi * (np.arange(length) + 0.5) / length)
    return force


def test_start_end_peak_and_impulse_of_half_sines():
    found = find_impacts(trace((100, 100, 50.0), (700, 50, 8.0)), RATE)
    assert found.start.tolist() == [100, 700]
    assert found.end.tolist() == [200, 750]
    assert found.peak == pytest.approx([50.0, 8.0], rel=1e-3)
    assert found.impulse == pytest.approx([2 / np.pi * 50 * 100 / RATE, 2 / np.pi * 8 * 50 / RATE], rel=1e-3)


def test_impacts_at_the_very_ends_count():
    force = np.array([3.0, 1.0, 0.0, 2.0])
    found = find_impacts(force, 1.0)
    assert found.start.tolist() == [0, 3]
    assert found.end.tolist() == [2, 4]
    assert found.impulse.tolist() == [4.0, 2.0]


def test_a_quiet_trace_has_none():
    assert find_impacts(np.zeros(10), RATE).peak.size == 0
    assert find_impacts(np.empty(0), RATE).peak.size == 0


def test_comparison_names_pairs_misses_and_false_alarms():
    truth = find_impacts(trace((100, 100, 50.0), (500, 50, 20.0), (900, 50, 3.0)), RATE)
    seen = find_impacts(trace((105, 100, 55.0), (900, 50, 6.0), (1500, 60, 9.0)), RATE)
    found = compare_impacts(truth, seen, tolerance=5)
    assert found.pairs.tolist() == [[0, 0]]
    assert found.peak_error == pytest.approx([0.1], rel=1e-6)
    assert found.impulse_error == pytest.approx([0.1], rel=1e-6)
    assert found.missed.tolist() == [1]
    assert found.false_alarms.tolist() == [2]


def test_an_impact_split_in_two_is_matched_by_its_larger_part():
    truth = find_impacts(trace((100, 100, 50.0)), RATE)
    seen = find_impacts(trace((95, 20, 9.0), (125, 70, 51.0)), RATE)
    found = compare_impacts(truth, seen, tolerance=0)
    assert found.pairs.tolist() == [[0, 1]]
    assert found.false_alarms.size == 0


def test_comparison_of_nothing_with_nothing():
    none = find_impacts(np.zeros(5), RATE)
    found = compare_impacts(none, none, tolerance=5)
    assert found.pairs.shape == (0, 2)
    assert found.missed.size == found.false_alarms.size == 0


def test_selection_keeps_the_fields_together():
    found = find_impacts(trace((100, 100, 50.0), (700, 50, 8.0)), RATE)
    assert found.select(found.peak < 10).start.tolist() == [700]


def test_correlation():
    draws = np.random.default_rng(2).normal(size=(2, 20000))
    assert correlation(draws[0], 3 * draws[0] + 1) == pytest.approx(1.0)
    assert correlation(draws[0], -draws[0]) == pytest.approx(-1.0)
    assert abs(correlation(*draws)) < 0.05
    assert correlation(draws[0], np.ones(20000)) == 0.0
