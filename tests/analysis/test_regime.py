"""The rules on windows whose regime is plain."""

import numpy as np
import pytest

from analysis.regime import Regime, classify, features

GAP = 1.5e-3
TIME = np.arange(12500) / 25000.0


def seen(speed_hz, centre, force):
    speed = 2 * np.pi * speed_hz
    return classify(features(speed * TIME, speed, centre, force, GAP))


def hanging(amplitude=0.0, hz=10.0):
    return -1.18e-3j + amplitude * np.exp(2j * np.pi * hz * TIME)


def test_a_hanging_shaft_is_at_rest():
    assert seen(0.0, hanging(), 0 * TIME) == Regime.AT_REST


def test_a_swinging_one_decays_freely():
    assert seen(0.0, hanging(2e-4), 0 * TIME) == Regime.FREE_DECAY


def test_a_small_orbit_without_force_is_contact_free():
    assert seen(20.0, hanging(8e-5, 20.0), 0 * TIME) == Regime.CONTACT_FREE


def test_a_hit_each_revolution_is_bouncing():
    force = np.maximum(np.sin(2 * np.pi * 14 * TIME) - 0.9, 0.0)
    assert seen(14.0, hanging(1e-3, 14.0), force) == Regime.BOUNCING


def test_one_touch_in_half_a_second_is_bouncing_already():
    force = np.where(np.abs(TIME - 0.2) < 1e-3, 5.0, 0.0)
    assert seen(9.5, hanging(3e-4, 9.5), force) == Regime.BOUNCING


def test_lying_on_the_bearing_is_permanent_contact():
    assert seen(10.0, -1.51e-3j + 0 * TIME, 8.0 + 0 * TIME) == Regime.PERMANENT
    assert seen(0.0, -1.51e-3j + 0 * TIME, 8.0 + 0 * TIME) == Regime.PERMANENT


@pytest.mark.parametrize("speed_hz", [20.0, -20.0])
@pytest.mark.parametrize("whirl", [1.0, -4.3])
def test_running_round_the_bearing_is_whirl_with_its_direction(speed_hz, whirl):
    centre = 1.51e-3 * np.exp(2j * np.pi * speed_hz * whirl * TIME)
    expected = Regime.FORWARD_WHIRL if whirl > 0 else Regime.BACKWARD_WHIRL
    assert seen(speed_hz, centre, 25.0 + 0 * TIME) == expected


def test_an_empty_window_says_at_rest_without_failing():
    nothing = np.empty(0)
    assert classify(features(nothing, 0.0, nothing + 0j, nothing, GAP)) == Regime.AT_REST
