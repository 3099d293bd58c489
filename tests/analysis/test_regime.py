"""The rules on windows whose regime is plain, and the measures on sets whose answer is known."""

import numpy as np
import pytest

from analysis.regime import LONGEST_PERIOD, SETTLED, WINDOW, Regime, likeliest, named, places, weigh
from analysis.turns import Turn

RNG = np.random.default_rng(5)


def turns(count=WINDOW, marks=(1.0 + 0j,), hits=(), **values):
    plain = {"speed": 90.0, "duty": 0.0, "sweep": 0.0, "span": 1.0, "flatness": 1.0}
    return [
        Turn(**plain | values, hits=np.array(hits, float), mark=marks[number % len(marks)])
        for number in range(count)
    ]


def classify(window, pins=False):
    return likeliest(weigh(window, pins))


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


@pytest.mark.parametrize("long", [4, 15, WINDOW - LONGEST_PERIOD])
def test_contact_that_has_only_begun_is_not_called_chaotic(long):
    scattered = turns(long, duty=0.1, hits=[-1.0], marks=RNG.normal(size=WINDOW))
    assert classify([*turns(WINDOW), *scattered][-WINDOW:]) == Regime.BOUNCING


def test_what_has_settled_after_a_scattered_beginning_has_its_places():
    scattered = turns(WINDOW - SETTLED, duty=0.1, hits=[-1.0], marks=RNG.normal(size=WINDOW))
    assert classify([*scattered, *turns(SETTLED, duty=0.1, hits=[2.0])]) == Regime.ONE_PLACE


def test_a_motion_of_two_periods_is_not_chaotic():
    number = np.arange(WINDOW)
    marks = 0.8 + 0.1 * np.exp(1j * number) + 0.03 * np.exp(-2j * number)
    found = weigh(turns(duty=0.1, hits=[-2.2, -0.8], marks=marks))
    assert likeliest(found) == Regime.TWO_PLACES
    assert found[Regime.CHAOTIC] < 0.2


def test_a_rub_that_lifts_off_and_does_not_repeat_is_chaotic_and_no_whirl():
    lifting = {"duty": 0.8, "sweep": 1.0, "hits": [0.0]}
    assert classify(turns(**lifting)) == Regime.FORWARD_WHIRL
    assert classify(turns(**lifting, marks=RNG.normal(size=WINDOW) * 0.3)) == Regime.CHAOTIC


@pytest.mark.parametrize("duty", [0.0, 0.001, 0.1, 0.5, 0.9, 1.0])
@pytest.mark.parametrize("sweep", [0.0, 0.4, 1.0, -5.0])
def test_weights_add_up_to_one(duty, sweep):
    found = weigh(turns(duty=duty, sweep=sweep, hits=[0.0, 2.0] if duty else []))
    assert sum(found.values()) == pytest.approx(1.0)
    assert min(found.values()) >= 0.0


@pytest.mark.parametrize(
    ("values", "pair"),
    [
        ({"duty": 0.00201, "hits": [0.0]}, (Regime.CONTACT_FREE, Regime.ONE_PLACE)),
        ({"duty": 0.95, "hits": [0.0]}, (Regime.PERMANENT, Regime.ONE_PLACE)),
        ({"duty": 1.0, "sweep": 0.5}, (Regime.PERMANENT, Regime.FORWARD_WHIRL)),
        ({"duty": 0.5, "sweep": -3.0, "hits": [0.0]}, (Regime.BACKWARD_WHIRL, Regime.ONE_PLACE)),
    ],
)
def test_both_regimes_are_as_likely_where_an_answer_turns(values, pair):
    found = weigh(turns(**values))
    assert found[pair[0]] == pytest.approx(0.5, abs=0.02)
    assert found[pair[1]] == pytest.approx(0.5, abs=0.02)


def test_places_are_groups_on_the_circle():
    def count(*directions):
        return places(np.array(directions))[0]

    assert count() == 0
    assert count(3.1, -3.1, 3.0) == 1  # across the cut of the angle
    assert count(0.0, 0.1, 1.5, 1.6, 3.0) == 3
    assert count(*np.zeros(20), 2.0) == 1  # a stray
    assert count(*np.linspace(-np.pi, np.pi, 40)) == 0  # all round


def test_places_are_sure_by_the_gap_nearest_to_the_bound():
    surely, hardly = places(np.array([0.0, 2.0])), places(np.array([0.0, np.radians(31.0)]))
    assert surely == (2, pytest.approx(1.0, abs=1e-4))
    assert hardly[0] == 2
    assert 0.5 < hardly[1] < 0.7


def test_a_confidence_of_zero_is_not_told():
    assert named("chaotic", 0.0) == "chaotic"
    assert named(Regime.TWO_PLACES, 0.9) == "bouncing on 2 places (90 %)"
