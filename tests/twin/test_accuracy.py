"""What the observer promises, held on rigs that it does not know: see `tests.twin.cases`.

The bounds are those that docs/explanation/observer.md states, for every drawn run; seeds of these tests were
never used to choose a value of the tuning.
"""

from functools import cache

import numpy as np
import pytest

from tests.twin.accuracy import (
    Observation,
    calibration_of,
    errors_of,
    hindsight_of,
    observe,
    trace_of,
)
from tests.twin.cases import case_run

QUICK = tuple(range(7001, 7004))
MANY = tuple(range(7101, 7121))
RIGS = pytest.mark.parametrize("rig", ["thesis-ball", "thesis-pinned"])
SEEDS = pytest.mark.parametrize("seeds", [QUICK, pytest.param(MANY, marks=pytest.mark.slow)], ids=["3", "20"])
ONE_SIGMA, TWO_SIGMA = 0.683, 0.954  # shares of a normal distribution


@cache
def observed(rig: str, case: str, seeds: tuple[int, ...], without: str = "") -> list[Observation]:
    plain = case == "mm" and not without
    return [
        observe(case_run(rig, case, seed), without=[without] if without else [], smooth=plain)
        for seed in seeds
    ]


@SEEDS
@RIGS
def test_a_contact_that_is_described_wrongly_is_followed(rig, seeds):
    seen = observed(rig, "mm", seeds)
    errors = errors_of([each.run for each in seen], [trace_of(each) for each in seen])
    assert errors.impacts > 30 * len(seeds)
    assert errors.position < 0.2e-6
    assert errors.velocity < 0.08e-3
    assert errors.within(errors.peak_errors, 0.05) >= 0.98
    assert errors.within(errors.impulse_errors, 0.05) >= 0.98
    assert errors.missed == errors.false_alarms == 0
    assert errors.right_pin >= 0.99
    assert sum(each.lost for each in seen) == 0


@SEEDS
@RIGS
def test_its_doubts_are_fair(rig, seeds):
    fair = calibration_of(observed(rig, "mm", seeds))
    assert 0.4 < fair.error < 1.5
    assert (np.abs(fair.innovations - 1.0) < 0.1).all()
    assert fair.one_sigma == pytest.approx(ONE_SIGMA, abs=0.05)
    assert fair.two_sigma == pytest.approx(TWO_SIGMA, abs=0.05)
    # Of the force more are within: the sensors cannot tell a law that is exact from one that nearly is.
    assert ONE_SIGMA - 0.05 < fair.force_one_sigma < 0.93
    assert fair.force_two_sigma > TWO_SIGMA - 0.05


@SEEDS
@RIGS
def test_between_impacts_hindsight_helps_and_its_doubts_are_fair(rig, seeds):
    found = hindsight_of(observed(rig, "mm", seeds))
    assert found.share > 0.9
    assert found.velocity < 0.5 * found.filter_velocity
    assert found.position < found.filter_position
    assert found.two_sigma == pytest.approx(TWO_SIGMA, abs=0.05)


@SEEDS
@RIGS
def test_a_model_of_the_wrong_form_is_survived(rig, seeds):
    seen = observed(rig, "struct", seeds)
    errors = errors_of([each.run for each in seen], [trace_of(each) for each in seen])
    assert errors.velocity < 0.4e-3
    assert errors.within(errors.peak_errors, 0.05) >= 0.9
    assert errors.within(errors.impulse_errors, 0.05) >= 0.9
    assert errors.within(errors.peak_errors, 0.1) >= 0.97
    assert errors.right_pin >= 0.99
    assert sum(each.lost for each in seen) == 0
    fair = calibration_of(seen)
    assert fair.force_one_sigma > ONE_SIGMA - 0.1  # the transducers' gain, 2 % off, is in no band
    assert fair.force_two_sigma > TWO_SIGMA - 0.1


@SEEDS
@RIGS
def test_without_transducers_it_goes_on_and_says_that_it_knows_less(rig, seeds):
    seen = observed(rig, "mm", seeds, without="force")
    errors = errors_of([each.run for each in seen], [trace_of(each) for each in seen])
    assert errors.within(errors.impulse_errors, 0.05) >= 0.95
    assert errors.missed == errors.false_alarms == 0
    for alone, whole in zip(seen, observed(rig, "mm", seeds), strict=True):
        pressed = whole.run.truth["normal_force"][::5] > 5.0
        bands = [each.row("normal_force_sigma")[pressed].mean() for each in (whole, alone)]
        assert bands[1] > 1.1 * bands[0]
