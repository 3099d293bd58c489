"""Page's sum on numbers whose change is known."""

import numpy as np

from analysis.cusum import Cusum


def alarms(values, usual=1.0, threshold=10.0, most=5.0):
    test = Cusum(usual, threshold, most)
    return [index for index, value in enumerate(values) if test.add(value, index)], test


def test_what_is_usual_is_no_change():
    found, test = alarms(np.random.default_rng(0).chisquare(6, 10_000) / 6, usual=3.0)
    assert found == []
    assert test.onset is None


def test_a_change_is_found_and_dated():
    found, test = alarms([0.5] * 50 + [4.0] * 10)
    assert found[0] == 53  # 3 above what is usual each: 12 after four
    assert test.onset == 50


def test_one_outlier_is_no_change_and_is_forgotten():
    found, test = alarms([0.5] * 5 + [1e9] + [0.5] * 20)
    assert found == []
    assert test.onset is None


def test_reset_begins_anew():
    _, test = alarms([4.0] * 10)
    test.reset()
    assert (test.sum, test.onset) == (0.0, None)
