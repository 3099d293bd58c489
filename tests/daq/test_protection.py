"""Protection: limits on every sample, persistence, latch, first-out and reset."""

import tomllib
from dataclasses import replace
from math import cos, inf, nan, radians, sin, tau

import numpy as np
import pytest
import tomli_w
from hypothesis import given, settings
from hypothesis import strategies as st

from daq.guard import displacement_planes, guard_of, length, magnitude
from daq.protection import Trip, Warned, check, initial_state, latch, reset
from daq.rig import load_rig, rig_from_text, with_overrides
from daq.rig.channels import ChannelTable
from daq.rig.limits import NO_LIMIT
from daq.sensor_check import run_lengths
from simulator.rig import RigError


def plainly_limited():
    """The shipped rig with the limits that every rig has, so that constant samples are no fault."""
    tables = tomllib.loads(load_rig("thesis-ball").toml)
    tables["limits"].pop("speed_rate")
    for row in tables["channel"]:
        row.pop("stuck", None)
    return rig_from_text(tomli_w.dumps(tables))


RIG = plainly_limited()
GUARD = guard_of(RIG)
NAMES = RIG.channels.names
CONTACT = """
[[channel]]
name = "emergency_stop"
quantity = "contact"
unit = "1"
display_unit = "1"
terminal = "di0"
sensitivity = 5.0
offset = 0.0
range = [0.0, 6.0]
"""
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


def after(*reads, guard=GUARD):
    """Verdicts of successive reads from sample 0 on."""
    state, verdicts, sample = initial_state(guard), [], 0
    for values in reads:
        verdict = check(values, sample, state, guard)
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
    assert refused == "force 401 N is above the warning level of 150 N"
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


@given(st.lists(st.booleans(), min_size=1, max_size=60), st.integers(0, 30))
def test_runs_are_counted_as_a_person_would(flags, run):
    expected = []
    for flag in flags:
        run = run + 1 if flag else 0
        expected.append(run)
    before = expected[0] - 1 if flags[0] else 7
    assert run_lengths(np.array(flags, bool), before).tolist() == expected


@settings(max_examples=50)
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


def with_contact():
    rig = rig_from_text(CONTACT + RIG.toml)
    return rig, guard_of(rig)


def contact(*values):
    """Samples of the rig with an emergency-stop contact as its last channel."""
    rows = samples(len(values))
    return np.vstack([rows, np.array(values, np.float32)])


def test_an_open_safety_contact_trips_after_its_bouncing_and_is_first_out():
    rig, guard = with_contact()
    at = rig.channels.index("emergency_stop")
    order = [*range(at + 1, len(rig.channels)), at] if at == 0 else list(range(len(rig.channels)))
    rows = np.empty((len(rig.channels), 60), np.float32)
    rows[order] = contact(*[1.0] * 5, *[0.0] * 49, *[1.0] * 6)
    (bounced,) = after(rows, guard=guard)
    assert bounced.trip is None
    rows[at, 5:] = 0.0
    (opened,) = after(rows, guard=guard)
    assert opened.trip == Trip("emergency_stop", 54, "the safety contact emergency_stop is open")
    assert reset(opened.state, guard)[1] == "the safety contact emergency_stop is still open"
    rows[at] = 1.0
    closed = check(rows, 60, opened.state, guard)
    assert reset(closed.state, guard)[1] == ""


def test_a_stuck_sensor_trips_when_its_time_is_over():
    guard = guard_of(with_overrides(RIG, ["channel.force_top.stuck=0.004"]))
    noisy = np.resize([0.1, -0.1], N)
    frozen = samples(force_top=np.where(np.arange(N) < 10, noisy, 7.0))
    verdicts = after(frozen, samples(force_top=7.0), samples(force_top=7.0), guard=guard)
    assert [bool(verdict.trip) for verdict in verdicts] == [False, False, True]
    assert verdicts[2].trip == Trip(
        "sensor force_top",
        110,
        "the sensor of force_top is not OK: its value 7 has not changed for too long",
    )
    assert reset(verdicts[2].state, guard)[1] == "the sensor of force_top is still not OK"
    moving = check(samples(force_top=noisy), 150, verdicts[2].state, guard)
    assert reset(moving.state, guard)[1] == ""


def test_a_sensor_that_changes_in_time_is_not_stuck():
    guard = guard_of(with_overrides(RIG, ["channel.force_top.stuck=0.004"]))
    row = np.repeat([1.0, 2.0, 3.0, 4.0], 100)  # 100 samples: 99 without a change
    assert not any(verdict.trip for verdict in after(*[samples(400, force_top=row)] * 2, guard=guard))


RATE = with_overrides(
    RIG,
    ["limits.speed_rate.warn=70", "limits.speed_rate.trip=100", "limits.speed_rate.persistence=0.002",
     "limits.speed_rate.reason=the drive gives 50 Hz/s"],
)  # fmt: skip


def ramp(hz_per_s, first=0, n=N, until=10**9):
    """Speeds of a ramp that begins at sample 0 and ends at sample `until`."""
    return tau * hz_per_s * np.minimum(np.arange(first, first + n), until) / RIG.acquisition.rate


def test_a_speed_that_changes_too_fast_trips_over_the_window():
    guard = guard_of(RATE)
    assert guard.conditions[-1].window == 500
    for hz_per_s, trips in ((101.0, True), (-101.0, True), (99.0, False)):
        reads = [samples(motor_speed=ramp(hz_per_s, at, until=1000)) for at in range(0, 1500, N)]
        tripped = [verdict.trip for verdict in after(*reads, guard=guard) if verdict.trip]
        assert bool(tripped) == trips
        if trips:
            assert tripped[0].cause == "speed rate"
            # 500 samples fill the window, 50 are the persistence
            assert tripped[0].sample == 549
            assert tripped[0].text == "speed rate 101 Hz/s is above the trip level of 100 Hz/s"


def test_a_step_of_the_speed_is_a_rate_as_long_as_the_window_sees_it():
    guard = guard_of(RATE)
    step = np.where(np.arange(2000) < 1000, 0.0, tau * 2.5)  # 2.5 Hz in 20 ms: 125 Hz/s
    (verdict,) = after(samples(2000, motor_speed=step), guard=guard)
    assert verdict.trip.sample == 1000 + 50 - 1
    assert verdict.state.conditions[-1].maximum == pytest.approx(125.0 * tau)


def test_lost_samples_are_no_rate():
    guard = guard_of(RATE)
    (before,) = after(samples(1000, motor_speed=1.0), guard=guard)
    gap = check(samples(1000, motor_speed=100.0), 5000, before.state, guard)
    assert gap.trip is None
    joined = check(samples(1000, motor_speed=100.0), 1000, before.state, guard)
    assert joined.trip


def voting(votes, count=3):
    """A rig with that many tachometers, of which so many must agree."""
    channels = [
        *RIG.channels,
        *(RIG.channels["motor_speed"]._replace(name=f"t{n}") for n in range(count - 1)),
    ]
    speed = RIG.limits.speed._replace(votes=votes)
    rig = replace(RIG, channels=ChannelTable(tuple(channels)), limits=RIG.limits._replace(speed=speed))
    return guard_of(rig)


def tachometers(*speeds, n=1000):
    return np.vstack(
        [samples(n, motor_speed=speeds[0]), *(np.full((1, n), speed, np.float32) for speed in speeds[1:])]
    )


FAST, SLOW, BROKEN = 23.0 * tau, 10.0 * tau, 500.0


@pytest.mark.parametrize(
    ("speeds", "trips"),
    [((FAST, SLOW, SLOW), False), ((SLOW, FAST, FAST), True), ((FAST, FAST, FAST), True),
     ((nan, SLOW, SLOW), False), ((nan, FAST, SLOW), True)],
)  # fmt: skip
def test_two_of_three_must_agree(speeds, trips):
    (verdict,) = after(tachometers(*speeds), guard=voting(2))
    assert bool(verdict.trip) == trips


def test_a_voting_sensor_that_is_not_ok_warns_and_votes_for_the_trip():
    guard = voting(2)
    (one,) = after(tachometers(BROKEN, SLOW, SLOW), guard=guard)
    assert one.trip is None
    assert [warned.cause for warned in one.warnings] == ["sensor motor_speed"]
    assert reset(latch(one.state, Trip("manual", 0, "")), guard)[1] == ""
    (two,) = after(tachometers(BROKEN, SLOW, -BROKEN), guard=guard)
    assert two.trip == Trip("speed", 499, "speed cannot be told: too few of its sensors are OK")
    low = guard._replace(sensors=guard.sensors._replace(highest=np.full_like(guard.sensors.highest, 70.0)))
    (blind,) = after(tachometers(71.0, 1.0, 71.0), guard=low)
    assert blind.trip == Trip("speed", 748, "speed cannot be told: too few of its sensors are OK")
    assert reset(blind.state, low)[1] == "speed cannot be told: too few of its sensors are OK"


def test_more_votes_than_measurements_are_refused():
    with pytest.raises(RigError, match=r"\[limits.speed\] votes = 4, but there are only 3 independent"):
        voting(4)


def test_four_probes_in_a_plane_are_two_measurements():
    channels = [
        RIG.channels["proximity_x"]._replace(name=f"probe_{angle}", angle_deg=float(angle), station=0.2)
        for angle in (45, 225, 135, 315)
    ]
    planes = displacement_planes(channels, 0.2, apart=True)
    assert [plane.rows for plane in planes] == [[0, 2], [1, 3]]
    x, y = 0.4e-3, -0.9e-3
    seen = [x * cos(radians(c.angle_deg)) + y * sin(radians(c.angle_deg)) for c in channels]
    for plane in planes:
        assert length(np.array(seen, np.float32)[:, None], plane)[0] == pytest.approx(
            np.hypot(x, y), rel=1e-6
        )


PASSING = with_overrides(
    RIG,
    ["limits.force.multiplier=1.5", "limits.force.multiplier_hz=[8.0, 12.0]",
     "limits.force.multiplier_time=0.1"],
)  # fmt: skip


@pytest.mark.parametrize(
    ("hz", "force", "trips"),
    [(10.0, 599.0, False), (10.0, 601.0, True), (7.9, 401.0, True), (12.1, 401.0, True), (8.01, 401.0, False),
     (11.99, 401.0, False)],
)  # fmt: skip
def test_levels_are_raised_while_the_resonance_is_passed(hz, force, trips):
    (verdict,) = after(samples(motor_speed=tau * hz, force_top=force), guard=guard_of(PASSING))
    assert bool(verdict.trip) == trips
    if force == 601.0:
        assert verdict.trip.text == "force 601 N is above the trip level of 600 N"
        still = reset(verdict.state, guard_of(PASSING))[1]
        assert still == "force 601 N is above the warning level of 150 N"


def test_who_stays_in_the_resonance_gets_the_plain_levels_again():
    guard, reads = guard_of(PASSING), [samples(motor_speed=tau * 10.0, force_top=450.0)] * 60
    tripped = [verdict.trip for verdict in after(*reads, guard=guard) if verdict.trip]
    assert [trip.sample for trip in tripped] == [2500 + PERSISTENCE - 1]
    assert tripped[0].text == "force 450 N is above the trip level of 400 N"


def test_a_multiplier_without_its_band_is_refused():
    with pytest.raises(RigError, match="has only one of multiplier and multiplier_hz"):
        with_overrides(RIG, ["limits.force.multiplier=1.5"])
    no_speed = replace(
        PASSING,
        channels=ChannelTable(tuple(channel for channel in RIG.channels if channel.quantity != "speed")),
        limits=PASSING.limits._replace(speed=NO_LIMIT),
    )
    with pytest.raises(
        RigError, match=r"\[limits.force\] multiplier_hz needs a channel that measures the speed"
    ):
        guard_of(no_speed)


def test_before_the_first_sample_all_is_calm():
    state = initial_state(GUARD)
    for now in state.conditions:
        assert now[:-1] == (0, 0, GUARD.warning_hold, 0.0, True, 0)
        assert (now.past.dtype, now.past.size) == (np.float32, 0)
    assert (state.next_sample, state.first_out) == (0, None)
    assert reset(state, GUARD)[1] == ""


def test_the_earliest_of_two_trips_in_a_read_is_first_out_whatever_it_is_called():
    force, displaced = above(5, 45, 401.0), above(20, 30, -2.0e-3 * SCALE, base=-1.704e-3)
    (verdict,) = after(samples(force_top=force, proximity_y=displaced))
    assert verdict.trip.cause == "force"


def test_a_calm_read_is_remembered_with_its_largest_value():
    (verdict,) = after(samples(force_top=above(3, 1, 120.0)))
    assert verdict.state.conditions[1].maximum == pytest.approx(120.0)


def test_a_calm_read_begins_the_count_anew():
    _, short, enough = after(
        samples(), samples(force_top=above(0, PERSISTENCE - 1, 200.0)), samples(force_top=above(0, N, 200.0))
    )
    assert not short.warnings
    assert enough.warnings[0].sample == 2 * N + PERSISTENCE - 1


def test_spikes_shorter_than_the_persistence_are_quiet():
    loud, spike = samples(force_top=above(0, N, 200.0)), samples(force_top=above(0, 1, 200.0))
    verdicts = after(loud, *[spike] * 501, loud)  # the first spike prolongs what was loud
    assert [bool(verdict.warnings) for verdict in verdicts] == [True, *[False] * 501, True]


def test_a_second_to_the_sample_is_quiet():
    loud, almost = samples(force_top=above(0, N, 200.0)), samples(24_999)
    verdicts = after(loud, almost, loud, samples(25_000), loud)
    assert [bool(verdict.warnings) for verdict in verdicts] == [True, False, False, False, True]


def test_the_time_in_the_resonance_counts_also_while_all_is_calm():
    guard = guard_of(PASSING)
    calm, loud = samples(2500, motor_speed=tau * 10.0), samples(motor_speed=tau * 10.0, force_top=450.0)
    assert after(calm, loud, guard=guard)[-1].trip
    assert not after(samples(2500), loud, guard=guard)[-1].trip


def test_the_ends_of_the_band_and_its_first_sample_count():
    guard = guard_of(PASSING)
    (condition,) = [each for each in guard.conditions if each.name == "force"]
    multiplier = condition.multiplier._replace(low=50.0, high=75.0)
    guard = guard._replace(conditions=(condition._replace(persistence=1, multiplier=multiplier),))
    for speed, trips in ((50.0, False), (75.0, False), (49.5, True), (75.5, True)):
        (verdict,) = after(samples(motor_speed=speed, force_top=401.0), guard=guard)
        assert bool(verdict.trip) == trips
