"""Protection: limits on every sample, persistence, latch, first-out and reset."""

from dataclasses import replace
from math import cos, inf, nan, radians, sin, tau

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from daq.channels import ChannelTable
from daq.guard import displacement_planes, guard_of, length, magnitude
from daq.protection import Trip, Warned, check, consecutive, initial_state, latch, reset
from daq.rig import load_rig
from simulator.rig import RigError

RIG = load_rig("thesis-ball")
GUARD = guard_of(RIG)
NAMES = RIG.channels.names
SCALE = 0.3035 / 0.211
PERSISTENCE = 10
N = 50


def samples(n=N, **rows):
    """Samples of a rig at rest with some channels replaced."""
    values = np.zeros((len(NAMES), n), np.float32)
    values[NAMES.index("proximity_y")] = -1.704e-3
    for name, row in rows.items():
        values[NAMES.index(name)] = row
    return values


def above(first, count, level, n=N, base=0.0):
    """A row that is `level` on `count` samples from `first` on, else `base`."""
    row = np.full(n, base)
    row[first : first + count] = level
    return row


def after(*reads):
    """Verdicts of successive reads from sample 0 on."""
    state, verdicts, sample = initial_state(GUARD), [], 0
    for values in reads:
        verdict = check(values, sample, state, GUARD)
        verdicts.append(verdict)
        state, sample = verdict.state, sample + values.shape[1]
    return verdicts


def test_a_rig_at_rest_is_left_alone():
    (verdict,) = after(samples())
    assert verdict.trip is None
    assert not verdict.warnings
    assert verdict.sensors_ok
    assert verdict.state.first_out is None


def test_trips_on_the_sample_on_which_the_persistence_is_over():
    (verdict,) = after(samples(force_top=above(7, PERSISTENCE, 401.0)))
    assert verdict.trip == Trip("force", 7 + PERSISTENCE - 1, "force 401 N is above the trip level of 400 N")
    assert verdict.state.first_out == verdict.trip


def test_one_sample_less_than_the_persistence_does_not_trip():
    (verdict,) = after(samples(force_top=above(7, PERSISTENCE - 1, 401.0)))
    assert verdict.trip is None


def test_the_level_itself_is_allowed():
    (verdict,) = after(samples(force_top=above(0, N, 400.0)))
    assert verdict.trip is None


def test_persistence_counts_across_reads():
    first, second = after(samples(force_top=above(N - 4, 4, 401.0)), samples(force_top=above(0, 6, 401.0)))
    assert first.trip is None
    assert second.trip is not None
    assert second.trip.sample == N + 5


def test_a_pause_begins_the_count_anew():
    row = above(0, N, 401.0)
    row[PERSISTENCE - 1 :: PERSISTENCE] = 0.0
    (verdict,) = after(samples(force_top=row))
    assert verdict.trip is None


def test_opposite_transducers_add_up():
    (verdict,) = after(samples(force_top=above(0, N, 210.0), force_bottom=above(0, N, -210.0)))
    assert verdict.trip is not None
    assert verdict.trip.cause == "force"


def test_what_presses_both_transducers_alike_is_no_resultant():
    (verdict,) = after(samples(force_top=above(0, N, 300.0), force_bottom=above(0, N, 300.0)))
    assert verdict.trip is None


def test_the_resultant_counts_not_its_components():
    pushed = above(0, N, 290.0)
    (verdict,) = after(samples(force_top=pushed, force_right=pushed))
    assert verdict.trip is not None
    assert "410.1 N" in verdict.trip.text


def test_displacement_is_taken_at_the_bearing():
    (inside,) = after(samples(proximity_y=above(0, N, -1.89e-3 * SCALE)))
    (outside,) = after(samples(proximity_y=above(0, N, -1.91e-3 * SCALE)))
    assert inside.trip is None
    assert outside.trip is not None
    assert outside.trip.cause == "displacement"
    assert outside.trip.text == "displacement 1910 µm is above the trip level of 1900 µm"


def test_overspeed_trips_either_way_round():
    for speed in (22.1 * tau, -22.1 * tau):
        verdicts = after(*[samples(motor_speed=above(0, N, speed))] * 10)
        assert [bool(verdict.trip) for verdict in verdicts] == [False] * 9 + [True]
        assert verdicts[-1].trip.cause == "speed"
        assert verdicts[-1].trip.sample == 499


def test_a_commanded_speed_is_no_measured_one():
    verdicts = after(*[samples(motor_speed_command=above(0, N, 30.0 * tau))] * 20)
    assert not any(verdict.trip for verdict in verdicts)


def test_the_first_out_is_the_earliest_and_stays():
    force = above(20, 30, 401.0)
    displaced = above(5, 45, -2.0e-3 * SCALE, base=-1.704e-3)
    first, second = after(
        samples(force_top=force, proximity_y=displaced), samples(force_top=above(0, N, 500.0))
    )
    assert first.trip.cause == "displacement"
    assert second.trip is None
    assert second.state.first_out == first.trip


def test_a_number_that_is_none_exceeds_every_level():
    (verdict,) = after(samples(force_top=nan))
    assert verdict.trip is not None
    assert verdict.trip.cause == "force"
    assert not verdict.sensors_ok


def test_a_bad_number_on_another_channel_does_not_touch_the_limits():
    verdicts = after(*[samples(solenoid_current=nan)] * 10)
    assert not any(verdict.trip for verdict in verdicts)
    warned = [warning.cause for verdict in verdicts for warning in verdict.warnings]
    assert warned == ["sensor solenoid_current"]


def test_a_protecting_sensor_that_is_not_ok_trips_after_ten_milliseconds():
    broken = samples(force_left=-500.0, force_right=-500.0)
    verdicts = after(*[broken] * 6)
    assert not verdicts[0].sensors_ok
    assert [bool(verdict.trip) for verdict in verdicts] == [False] * 4 + [True, False]
    assert verdicts[4].trip == Trip(
        "sensor force_left", 249, "the sensor of force_left is not OK: its value -500 is outside the OK range"
    )


def test_a_sensor_that_recovers_in_time_does_not_trip():
    broken = samples(force_left=-500.0, force_right=-500.0)
    verdicts = after(*[broken, broken, broken, broken, samples()] * 3)
    assert not any(verdict.trip for verdict in verdicts)


def test_warns_once_until_it_was_quiet_for_a_second():
    loud, calm = samples(force_top=above(0, N, 200.0)), samples()
    reads = [loud, loud, calm, loud] + [calm] * 499 + [loud] + [calm] * 500 + [loud]
    verdicts = after(*reads)
    warned = [(at, warning) for at, verdict in enumerate(verdicts) for warning in verdict.warnings]
    assert [at for at, _ in warned] == [0, len(reads) - 1]
    assert warned[0][1] == Warned("force", 9, "force 200 N is above the warning level of 150 N")


def test_reset_is_refused_while_the_cause_lives():
    (verdict,) = after(samples(force_top=above(0, N, 401.0)))
    state, refused = reset(verdict.state, GUARD)
    assert refused == "force is still 401 N, above the warning level"
    assert state.first_out is not None


def test_reset_is_refused_between_warning_and_trip():
    tripped, lower = after(samples(force_top=above(0, N, 401.0)), samples(force_top=above(0, N, 151.0)))
    assert tripped.trip
    assert reset(lower.state, GUARD)[1]


def test_reset_is_refused_while_a_sensor_is_not_ok():
    verdicts = after(*[samples(force_left=-500.0, force_right=-500.0)] * 6)
    assert reset(verdicts[-1].state, GUARD)[1] == "the sensor of force_left is still not OK"


def test_reset_clears_the_latch_once_the_cause_is_gone():
    _, quiet = after(samples(force_top=above(0, N, 401.0)), samples())
    state, refused = reset(quiet.state, GUARD)
    assert refused == ""
    assert state.first_out is None
    again = check(samples(force_top=above(0, N, 401.0)), 100, state, GUARD)
    assert again.trip is not None


def test_latching_by_hand_keeps_an_earlier_first_out():
    manual, later = Trip("manual", 1, "by hand"), Trip("lease lost", 2, "silent")
    state = latch(initial_state(GUARD), manual)
    assert latch(state, later).first_out == manual


def test_four_probes_at_45_degrees_give_the_same_radius():
    x, y = 0.4e-3, -0.9e-3
    channels = [
        RIG.channels["proximity_x"]._replace(name=f"probe_{angle}", angle_deg=float(angle), station=0.2)
        for angle in (45, 135, 225, 315)
    ]
    seen = [x * cos(radians(c.angle_deg)) + y * sin(radians(c.angle_deg)) for c in channels]
    values = np.array(seen, np.float32)[:, None]
    planes = displacement_planes(channels, 0.2)
    assert len(planes) == 1
    assert length(values, planes[0])[0] == pytest.approx(np.hypot(x, y), rel=1e-6)


def test_without_a_model_each_plane_stands_for_itself():
    probe = RIG.channels["proximity_x"]
    channels = [
        probe._replace(name=f"p{at}", station=station, angle_deg=angle)
        for at, (station, angle) in enumerate([(0.1, 0.0), (0.1, 90.0), (0.4, 0.0), (0.4, 90.0)])
    ]
    planes = displacement_planes(channels, None)
    values = np.array([[1e-3], [0.0], [0.0], [3e-3]], np.float32)
    assert len(planes) == 2
    assert magnitude(values, planes)[0] == pytest.approx(3e-3)


def test_a_single_probe_protects_along_its_direction():
    (plane,) = displacement_planes([RIG.channels["proximity_x"]], None)
    assert length(np.array([[-2e-3]], np.float32), plane)[0] == pytest.approx(2e-3)


def test_a_limit_without_a_channel_that_can_tell_is_refused():
    told = tuple(channel for channel in RIG.channels if channel.name != "motor_speed")
    with pytest.raises(RigError, match=r"\[limits.speed\] protects nothing"):
        guard_of(replace(RIG, channels=ChannelTable(told)))


@given(st.lists(st.booleans(), max_size=60), st.integers(0, 30), st.integers(1, 30))
def test_consecutive_counts_like_a_person_would(flags, run, needed):
    reached, expected_run = None, run
    for column, flag in enumerate(flags):
        expected_run = expected_run + 1 if flag else 0
        if reached is None and expected_run >= needed:
            reached = column
    assert consecutive(np.array(flags, bool), run, needed) == (reached, expected_run)


@settings(max_examples=50, deadline=None)
@given(st.lists(st.floats(0.0, 600.0) | st.just(nan) | st.just(inf), min_size=1, max_size=40), st.data())
def test_the_verdict_does_not_depend_on_how_the_samples_are_read(forces, data):
    row = np.repeat(np.array(forces, np.float32), 7)
    whole = samples(len(row), force_top=row)
    cuts = sorted(data.draw(st.lists(st.integers(1, len(row) - 1), max_size=6, unique=True)))
    with np.errstate(invalid="ignore"):
        (at_once,) = after(whole)
        parts = [part for part in np.split(whole, cuts, axis=1) if part.shape[1]]
        in_parts = after(*parts)
    trips = [verdict.trip for verdict in in_parts if verdict.trip]
    assert trips == ([at_once.trip] if at_once.trip else [])
