import numpy as np
import pytest
from limit_study import highest_clear_speed, largest_radius

HANGING = 1.704e-3  # m: how far the shaft hangs below the probes' zero


def test_a_rig_at_rest_hangs_still(emulated_rig):
    rig = emulated_rig()
    rig.run(0.2)
    assert largest_radius(rig.signals("proximity_x", "proximity_y")) == pytest.approx(HANGING, rel=0.01)


def test_the_speed_is_found_and_twice_the_same(emulated_rig):
    found = [highest_clear_speed(emulated_rig(), (2.0, 4.0, 6.0, 8.0), 1.9e-3) for _ in range(2)]
    assert found[0] == found[1]
    assert 0.0 < found[0] < 8.0


def test_a_trip_ends_the_study(emulated_rig):
    rig = emulated_rig(settings=["limits.speed.warn=3.0", "limits.speed.trip=5.0"])
    assert highest_clear_speed(rig, (2.0, 4.0, 6.0, 8.0), 1.9e-3) <= 4.0
    assert rig.expect("trip").details["cause"] == "speed"


def test_lost_samples_are_told(emulated_rig):
    rig = emulated_rig(faults=[{"kind": "dropped", "at": 0.1, "size": 100}])
    gap = rig.expect("gap", within=1.0)
    assert (gap.details["first"], gap.details["last"]) == ("2500", "2599")
    rig.run(0.1)
    assert np.isnan(rig.signals("proximity_x").samples[0, 2500:2600]).all()


def test_a_broken_cable_ends_the_study(emulated_rig):
    rig = emulated_rig()
    rig.inject("open", channel="proximity_x", after=1.5)  # s: at the second speed
    assert highest_clear_speed(rig, (2.0, 4.0, 6.0), 1.9e-3) == 2.0
    assert rig.expect("trip").details["cause"] == "displacement"


@pytest.mark.parametrize("number", [1, 2])  # at the same time, with pytest-xdist
def test_a_rig_in_real_time_loses_samples_and_its_lease(emulated_rig, number):
    rig = emulated_rig(real_time=True, settings=["command.lease=1.0"])
    rig.arm()
    assert rig.command("speed", speed_hz=3.0).accepted
    rig.run(0.5)
    rig.inject("dropped", size=100)
    rig.expect("gap")
    rig.fall_silent()
    assert "lease lost" in rig.expect("lease_lost").text


def test_what_does_not_happen_is_an_error_that_tells_what_did(emulated_rig):
    with pytest.raises(AssertionError, match=r"no event trip within 0\.1 s, but: start"):
        emulated_rig().expect("trip", within=0.1)
