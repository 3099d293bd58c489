"""Forecasts against what the emulated rig then does."""

from copy import deepcopy
from math import tau

import numpy as np
import pytest

from daq.backend import SpeedOutput
from daq.rig import RigError, load_rig
from tests.twin.bouncing import drawn_rig
from twin.forecast import course_of, forecast


@pytest.fixture(scope="module")
def bouncing():
    """A rig in impacts of which the twin does not know the contact well."""
    return drawn_rig("thesis-ball", 3)


def test_what_is_foretold_of_holding_and_changing_the_speed_comes_true(bouncing):
    rig, station = bouncing.rig, bouncing.rig.model.rotor.bearing_station
    held, raised = forecast(rig, bouncing.values), forecast(rig, bouncing.values, course_of(rig, 20.0))
    for told, hz in ((held, None), (raised, 20.0)):
        future = deepcopy(bouncing)
        if hz:
            future.device.write(SpeedOutput(hz * tau, rig.command.default_ramp_hz_per_s * tau))
        truth = future.go(3.2)
        radius = station * np.hypot(truth["tilt_x"], truth["tilt_y"]).max()
        # Contact parameters 20 % off move the peaks by a tenth: Hertz's law has force as stiffness^0.4.
        assert told.contact_force.middle == pytest.approx(truth["normal_force"].max(), rel=0.15)
        assert told.radius.middle == pytest.approx(radius, rel=0.02)
        assert told.free == (1.0 if hz else 0.0)
        assert truth["normal_force"][-12500:].any() == (hz is None)
        assert told.trips == 0.0
    assert held.seconds == 3.0
    assert raised.seconds == pytest.approx(3.2, abs=0.1)


def test_equal_estimates_give_equal_forecasts(bouncing):
    assert forecast(bouncing.rig, bouncing.values) == forecast(bouncing.rig, bouncing.values)


def test_a_limit_that_would_trip_is_foretold(bouncing):
    strict = load_rig("thesis-ball", ["limits.force.trip=20.0", "limits.force.warn=10.0"])
    assert forecast(strict, bouncing.values).trips == 1.0


def test_a_course_that_may_not_be_commanded_is_refused(bouncing):
    with pytest.raises(RigError, match="speed = 30 Hz is not within thesis-ball's 0 to 25 Hz"):
        course_of(bouncing.rig, 30.0)
    with pytest.raises(RigError, match="ramp = 0 Hz/s is not within"):
        course_of(bouncing.rig, 10.0, 0.0)
