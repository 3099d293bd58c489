"""The shaft's motion by the encoder against a shaft that is known."""

from math import tau

import numpy as np
import pytest

from daq.rig import load_rig
from daq.shaft import Motion, Shaft

RIG = load_rig("thesis-ball")
ROW = RIG.channels.index("encoder_angle")
READ = 50
RATE = RIG.acquisition.rate


def turning(rig, hz, reads=100, skip=()):
    """Return what is known of a shaft that turned at `hz` through some reads, by its encoder's counts."""
    shaft = Shaft(rig)
    for number in range(reads):
        sample = number * READ + np.arange(READ)
        values = np.zeros((len(rig.channels), READ), dtype=np.float32)
        counts = np.round(hz * sample / RATE * 4096)
        values[ROW] = counts * tau / 4096 % tau
        if number not in skip:
            shaft.add(values, number * READ)
    return shaft.motion()


@pytest.mark.parametrize("hz", [15.0, -3.0])
def test_angle_and_speed_follow_the_encoder_either_way(hz):
    motion = turning(RIG, hz)
    assert motion.sample == 4999
    assert motion.speed * RATE == pytest.approx(tau * hz, abs=tau / 4096 / 0.09)
    assert (motion.angle - tau * hz * 4999 / RATE + 1.0) % tau == pytest.approx(1.0, abs=tau / 4096)


def test_an_encoder_that_counts_the_other_way_is_turned_round():
    reversed_rig = load_rig("thesis-ball", ["encoder.direction=-1"])
    assert turning(reversed_rig, 15.0).speed * RATE == pytest.approx(-tau * 15.0, rel=1e-3)


def test_missing_reads_do_not_spoil_the_speed():
    assert turning(RIG, 15.0, skip=range(20, 90)).speed * RATE == pytest.approx(tau * 15.0, rel=5e-3)


def test_a_shaft_at_rest_or_unseen_has_no_motion():
    assert turning(RIG, 0.0) is None
    assert turning(RIG, 15.0, reads=1) is None
    foreign = load_rig("thesis-ball", ['twin.model="none"'])
    assert Shaft(foreign).motion() is None


@pytest.mark.parametrize("speed", [tau / 1000, -tau / 1000])
def test_the_next_passage_is_the_first_sample_at_the_angle(speed):
    motion = Motion(sample=100, angle=2.0, speed=speed)
    for earliest in (100, 777, 5000):
        sample = motion.passage(1.0, earliest)
        past = (np.sign(speed) * (2.0 + speed * (sample - 100) - 1.0)) % tau
        assert earliest <= sample < earliest + 1000
        assert min(past, tau - past) < abs(speed) * 1.01
    assert motion.passage(2.0, 100) == 100
