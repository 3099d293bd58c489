"""The rules on windows whose regime is plain, and the measures on sets whose answer is known."""

import numpy as np
import pytest

from analysis.regime import LOOKS, SETTLED, WINDOW, Regime, classify, dispersion, named, places
from analysis.turns import Turn

RNG = np.random.default_rng(5)


def turns(count=WINDOW, marks=(1.0 + 0j,), hits=(), **values):
    plain = {"speed": 90.0, "duty": 0.0, "sweep": 0.0, "span": 1.0, "flatness": 1.0}
    return [
        Turn(**plain | values, hits=np.array(hits, float), mark=marks[number % len(marks)])
        for number in range(count)
    ]


@pytest.mark.parametrize(
    ("regime", "window"),
    [
        (Regime.UNKNOWN, turns(0)),
        (Regime.AT_REST, turns(speed=0.0, span=0.0)),
        (Regime.FREE_DECAY, turns(speed=0.0, span=0.4)),
        (Regime.CONTACT_FREE, turns()),
        (Regime.BOUNCING, turns(5, duty=0.1, hits=[-1.5])),
        (Regime.ONE_PLACE, turns(duty=0.1, hits=[-1.5])),
        (Regime.ONE_PLACE, turns(duty=0.1, hits=[-1.5, -1.3], marks=(0, 1j, 2j))),
        (Regime.TWO_PLACES, turns(duty=0.1, hits=[-2.2, -0.8])),
        (Regime.THREE_PLACES, turns(duty=0.2, hits=[-2.8, -1.5, 0.0])),
        (Regime.MANY_PLACES, turns(duty=0.2, hits=[-2.8, -1.5, 0.0, 1.5])),
        (Regime.CHAOTIC, turns(duty=0.1, hits=[-1.5], marks=RNG.normal(size=WINDOW) * 0.3)),
        (Regime.PERMANENT, turns(duty=1.0)),
        (Regime.PERMANENT, turns(duty=1.0, speed=0.0, marks=(complex(np.nan, np.nan),))),
        (Regime.FORWARD_WHIRL, turns(duty=1.0, sweep=1.0)),
        (Regime.FORWARD_WHIRL, turns(duty=0.7, sweep=1.0, hits=[0.0])),
        (Regime.BACKWARD_WHIRL, turns(duty=1.0, sweep=-5.6)),
        (Regime.BACKWARD_WHIRL, turns(duty=0.8, sweep=-4.0, hits=RNG.uniform(-3, 3, 16))),
    ],
)
def test_each_regime_is_named(regime, window):
    assert classify(window) == regime


def test_a_line_onto_one_place_is_a_diagonal_between_pins_only():
    window = turns(duty=0.07, hits=[-2.3], flatness=0.2)
    assert classify(window, pins=True) == Regime.DIAGONAL
    assert classify(window) == Regime.ONE_PLACE
    assert classify(turns(duty=0.07, hits=[-2.3], flatness=0.9), pins=True) == Regime.ONE_PLACE


@pytest.mark.parametrize("long", [4, 15])
def test_contact_that_has_only_begun_is_not_called_chaotic(long):
    scattered = turns(long, duty=0.1, hits=[-1.0], marks=RNG.normal(size=WINDOW))
    assert classify([*turns(WINDOW), *scattered][-WINDOW:]) == Regime.BOUNCING


def test_what_has_settled_after_a_scattered_beginning_has_its_places():
    scattered = turns(SETTLED, duty=0.1, hits=[-1.0], marks=RNG.normal(size=WINDOW))
    assert classify([*scattered, *turns(SETTLED, duty=0.1, hits=[2.0])]) == Regime.ONE_PLACE


def test_moved_bounds_disagree_only_near_a_bound():
    def verdicts(duty):
        return {classify(turns(duty=duty, sweep=1.0, hits=[0.0]), bounds=bounds) for bounds in LOOKS}

    assert verdicts(0.1) == {Regime.ONE_PLACE}
    assert verdicts(0.5) == {Regime.ONE_PLACE, Regime.FORWARD_WHIRL}
    assert verdicts(0.9) == {Regime.FORWARD_WHIRL}


@pytest.mark.parametrize("period", [1, 2, 3, 4])
def test_what_repeats_has_no_dispersion(period):
    assert dispersion(np.resize(RNG.normal(size=period) + 1j, SETTLED)) == 0.0


def test_the_logistic_map_is_dispersed_in_its_chaos_and_not_in_its_period_four():
    def orbit(growth):
        values = [0.3]
        while len(values) < 500:
            values.append(growth * values[-1] * (1 - values[-1]))
        return np.array(values[-SETTLED:]) + 0j

    assert dispersion(orbit(3.5)) < 1e-6  # its period is 4
    assert dispersion(orbit(3.99)) > 0.1


def test_places_are_groups_on_the_circle():
    gap = np.radians(30.0)
    assert places(np.array([]), gap) == 0
    assert places(np.array([3.1, -3.1, 3.0]), gap) == 1  # across the cut of the angle
    assert places(np.array([0.0, 0.1, 1.5, 1.6, 3.0]), gap) == 3
    assert places(np.append(np.zeros(20), 2.0), gap) == 1  # a stray
    assert places(np.linspace(-np.pi, np.pi, 40), gap) == 0  # all round


def test_a_confidence_of_zero_is_not_told():
    assert named("chaotic", 0.0) == "chaotic"
    assert named(Regime.TWO_PLACES, 0.9) == "bouncing on 2 places (90 %)"
