"""The rules for commands: lease, ranges, refusals in plain words."""

from dataclasses import replace
from math import inf, nan, tau

import pytest

from daq.backend import Capabilities, HitOutput, RestOutput, SpeedOutput
from daq.commanding.commands import COUNTED_PAUSE, CommandError, Commands, Situation
from daq.messages_pb2 import Command
from daq.rig import load_rig
from daq.shaft import Motion

RIG = load_rig("thesis-ball")
ALL_OUTPUTS = (SpeedOutput, HitOutput, RestOutput)
DEVICE = Capabilities((1.0, 1e6), ALL_OUTPUTS, True, None, True, True, longest_pulse_s=1.0)
NOW = Situation(sample=1000, first_out="", ending=False)
TRIPPED = NOW._replace(first_out="force")


@pytest.fixture
def commands():
    return Commands(RIG, DEVICE)


@pytest.fixture
def lease(commands):
    """An armed rig's lease, held by anna."""
    return decide(commands, "arm").lease


def decide(commands, name, lease="", who="anna", now=NOW, **given):
    texts = {key: value for key, value in given.items() if isinstance(value, str)}
    values = {key: value for key, value in given.items() if key not in texts}
    return commands.decide(Command(name=name, who=who, lease=lease, values=values, texts=texts), now)


def refusal(commands, name, lease="", who="anna", now=NOW, **given):
    with pytest.raises(CommandError) as caught:
        decide(commands, name, lease, who, now, **given)
    return str(caught.value)


def test_arm_gives_a_lease_and_names_the_holder(commands):
    assert not commands.armed
    assert decide(commands, "arm").lease
    assert commands.armed
    assert commands.holder == "anna"


def test_two_leases_differ(commands):
    first = decide(commands, "arm").lease
    commands.disarm()
    assert decide(commands, "arm").lease != first


def test_a_second_operator_is_refused_with_the_holders_name(commands, lease):
    assert refusal(commands, "arm", who="bert") == (
        "anna holds the rig: one operator at a time, wait or stop it first"
    )
    assert refusal(commands, "speed", lease="guessed", who="bert", speed_hz=1.0) == (
        "anna holds the rig: only the holder of the lease may move it"
    )


def test_the_holder_may_arm_again_with_the_lease(commands, lease):
    assert decide(commands, "arm", lease=lease).lease == lease


def test_a_tripped_rig_cannot_be_armed_or_moved(commands, lease):
    for name in ("arm", "speed", "hit"):
        said = refusal(commands, name, lease=lease, now=TRIPPED)
        assert said == "the rig is tripped (force): find the cause, then reset"


def test_speed_becomes_an_output_in_si(commands, lease):
    decision = decide(commands, "speed", lease, speed_hz=10.0, ramp_hz_per_s=5.0)
    assert decision.output == SpeedOutput(10.0 * tau, 5.0 * tau)
    assert decision.text == "speed to 10 Hz with 5 Hz/s"
    assert decision.at_sample is None


def test_speed_uses_the_default_ramp(commands, lease):
    decision = decide(commands, "speed", lease, speed_hz=10.0)
    assert decision.output == SpeedOutput(10.0 * tau, 26.7 * tau)


def test_speed_needs_arming(commands):
    assert refusal(commands, "speed", speed_hz=1.0) == "the rig is not armed: arm it first"


@pytest.mark.parametrize("speed", [-0.1, 25.1, nan, inf])
def test_a_speed_out_of_range_is_refused_with_the_range(commands, lease, speed):
    assert refusal(commands, "speed", lease, speed_hz=speed) == (
        f"speed_hz must be 0 to 25 Hz, not {speed:g}"
    )


@pytest.mark.parametrize("ramp", [-1.0, 0.0, 50.1, nan])
def test_a_ramp_out_of_range_is_refused_with_the_range(commands, lease, ramp):
    assert refusal(commands, "speed", lease, speed_hz=5.0, ramp_hz_per_s=ramp) == (
        f"ramp_hz_per_s must be 0.01 to 50 Hz/s, not {ramp:g}"
    )


def test_the_ends_of_the_range_are_allowed(commands, lease):
    decide(commands, "speed", lease, speed_hz=25.0, ramp_hz_per_s=50.0)
    decide(commands, "speed", lease, speed_hz=0.0, ramp_hz_per_s=0.01)


def test_a_missing_value_is_asked_for(commands, lease):
    assert refusal(commands, "speed", lease) == "speed needs speed_hz, 0 to 25 Hz"
    assert refusal(commands, "hit", lease) == "hit needs force, 0 to 60 N"


def test_a_misspelt_value_is_refused_not_ignored(commands, lease):
    assert refusal(commands, "speed", lease, speed_hz=5.0, ramp_hz=1.0).startswith(
        "speed does not take ramp_hz; did you mean ramp_hz_per_s?"
    )
    assert refusal(commands, "stop", hard=1.0) == "stop does not take hard; it takes no values"


def test_an_unknown_command_is_refused_with_the_nearest(commands):
    assert refusal(commands, "sped") == "no command is called sped; did you mean speed?"


def test_an_anonymous_command_is_refused(commands):
    assert refusal(commands, "stop", who="").startswith("say who you are")


def test_a_hit_becomes_an_output(commands, lease):
    decision = decide(commands, "hit", lease, force=40.0, duration=0.01)
    assert decision.output == HitOutput("horizontal", 40.0, 0.01)
    assert decision.text == "hit by horizontal with 40 N for 0.01 s"


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"force": 61.0, "duration": 0.01}, "force must be 0 to 60 N, not 61"),
        ({"force": -1.0, "duration": 0.01}, "force must be 0 to 60 N, not -1"),
        ({"force": 1.0, "duration": 0.06}, "duration must be 0.0001 to 0.05 s, not 0.06"),
        ({"force": 1.0, "duration": 0.0}, "duration must be 0.0001 to 0.05 s, not 0"),
        (
            {"force": 1.0, "duration": 0.01, "solenoid": "horizontl"},
            "no solenoid is called horizontl; did you mean horizontal?",
        ),
    ],
)
def test_a_hit_out_of_range_is_refused(commands, lease, given, said):
    assert refusal(commands, "hit", lease, **given) == said


def test_one_hit_at_a_time(commands, lease):
    decision = decide(commands, "hit", lease, force=40.0, duration=0.02)
    commands.performed(decision.output, 1025)
    assert refusal(commands, "hit", lease, force=40.0, duration=0.02).startswith(
        "another hit is still to end, in 0.021 s"
    )
    later = NOW._replace(sample=1525)
    assert decide(commands, "hit", lease, now=later, force=40.0, duration=0.02).output


def test_rest_ends_the_wait_for_a_hit(commands, lease):
    commands.performed(HitOutput("horizontal", 40.0, 0.02), 1025)
    commands.performed(RestOutput(250.0), 1030)
    assert decide(commands, "hit", lease, force=40.0, duration=0.02).output


def test_an_output_may_be_scheduled_within_ten_seconds(commands, lease):
    assert decide(commands, "speed", lease, speed_hz=5.0, at_sample=251000.0).at_sample == 251000
    for sample in (1000.0, 251001.0, nan):
        said = refusal(commands, "hit", lease, force=1.0, duration=0.01, at_sample=sample)
        assert said == f"at_sample must be 1001 to 251000, not {sample:.0f}: now to 10 s ahead"


def test_a_hit_may_wait_for_a_shaft_angle(commands, lease):
    turning = NOW._replace(motion=Motion(sample=900, angle=1.0, speed=tau / 1000))
    hit = decide(commands, "hit", lease, now=turning, force=1.0, duration=0.01, angle=0.5 * tau)
    # 20 ms after the command it is sample 1500, and the angle is that of sample 900 + 340.8.
    assert hit.at_sample == 900 + 341 + 1000
    assert hit.text.endswith("when the shaft is at 180 deg")
    said = refusal(commands, "hit", lease, force=1.0, duration=0.01, angle=1.0)
    assert said == "the shaft hardly turns, or no encoder tells: leave angle out to hit at once"
    both = {"angle": 1.0, "at_sample": 2000.0}
    said = refusal(commands, "hit", lease, now=turning, force=1.0, duration=0.01, **both)
    assert said == "a hit takes angle or at_sample, not both"
    said = refusal(commands, "hit", lease, now=turning, force=1.0, duration=0.01, angle=7.0)
    assert said == "angle must be 0 to 6.28319 rad, not 7"


def test_anyone_may_stop_and_trip_at_any_time(commands, lease):
    for now in (NOW, TRIPPED):
        for name in ("stop", "trip"):
            assert decide(commands, name, who="bert", now=now).output == RestOutput(RIG.safe_state.ramp)


def test_a_trip_carries_its_reason(commands):
    assert decide(commands, "trip", text="smoke").text == "manual trip: smoke"
    assert decide(commands, "trip").text == "manual trip"


def test_reset_needs_a_trip(commands):
    assert refusal(commands, "reset") == "nothing is tripped: there is nothing to reset"
    assert decide(commands, "reset", now=TRIPPED).output is None


def test_a_mark_is_a_text(commands):
    assert decide(commands, "mark", text=" bearing changed ").text == "bearing changed"
    for text in ("", "   ", "x" * 501):
        assert refusal(commands, "mark", text=text) == "mark takes a text of 1 to 500 characters"


def test_nothing_moves_at_the_end_of_a_run(commands, lease):
    ending = NOW._replace(ending=True)
    for name in ("arm", "speed", "hit", "reset"):
        assert refusal(commands, name, lease, now=ending) == "the run is ending: nothing moves any more"
    assert decide(commands, "stop", now=ending).output
    assert decide(commands, "mark", now=ending, text="last words").text == "last words"


def test_what_the_device_cannot_do_is_refused(lease):
    mute = Commands(RIG, DEVICE._replace(outputs=(RestOutput,)))
    lease = decide(mute, "arm").lease
    assert refusal(mute, "speed", lease, speed_hz=1.0) == "the backend emulator has no speed output"
    assert refusal(mute, "hit", lease) == "the backend emulator has no solenoid output"
    bare = Commands(replace(RIG, solenoids=()), DEVICE)
    lease = decide(bare, "arm").lease
    assert refusal(bare, "hit", lease, force=1.0, duration=0.01) == "this rig has no solenoid"


@pytest.mark.parametrize(
    ("longest", "said"),
    [
        (None, "the device does not end a hit by its own timing: hits are refused"),
        (0.005, "the device ends a hit of at most 0.005 s by its own timing, not one of 0.01 s"),
    ],
)
def test_a_hit_that_the_device_would_not_end_is_refused_and_so_is_a_plan_with_one(longest, said):
    commands = Commands(RIG, DEVICE._replace(longest_pulse_s=longest))
    assert refusal(commands, "arm", plan="impacts", longest_hit=0.01) == said
    assert not commands.armed
    lease = decide(commands, "arm", plan="spin", longest_hit=0.0).lease
    assert refusal(commands, "hit", lease, force=1.0, duration=0.01) == said


def test_a_hit_that_the_device_just_times_is_accepted():
    commands = Commands(RIG, DEVICE._replace(longest_pulse_s=0.01))
    lease = decide(commands, "arm", longest_hit=0.01).lease
    assert decide(commands, "hit", lease, force=1.0, duration=0.01).output


def test_hardware_arms_once_a_plan_is_named():
    commands = Commands(RIG, DEVICE._replace(emulated=False))
    assert refusal(commands, "arm") == (
        "this rig is hardware, which arms for a named plan: `rigtwin plan run PLAN`, or start the run with "
        "`rigtwin live --plan PLAN`"
    )
    assert refusal(commands, "arm", plan="", now=TRIPPED).startswith("the rig is tripped")
    assert not commands.armed
    assert decide(commands, "arm", plan="spin").text == "armed for spin"
    commands.disarm()
    assert decide(commands, "arm").text == "armed"  # the run has its plan


def test_a_plan_that_was_refused_does_not_count():
    commands = Commands(RIG, DEVICE._replace(emulated=False, longest_pulse_s=None))
    assert refusal(commands, "arm", plan="impacts", longest_hit=0.01).startswith("the device does not end")
    assert refusal(commands, "arm").startswith("this rig is hardware")


def silent_for(commands, seconds, step=0.002):
    """Let time pass in steps; return the time at which the lease was lost."""
    passed = 0.0
    while passed < seconds:
        passed += step
        if commands.elapse(step):
            return passed
    return None


def test_a_silent_holder_loses_the_lease(commands, lease):
    assert silent_for(commands, 1.0) == pytest.approx(
        0.1, abs=0.003
    )  # the shipped rig's; counted in steps of 2 ms


def test_renewals_keep_the_lease(commands, lease):
    for _ in range(100):
        assert silent_for(commands, 0.098) is None
        commands.renew(lease)


def test_only_the_lease_itself_renews(commands, lease):
    assert silent_for(commands, 0.09) is None
    for other in ("", "another", lease.upper() + "x"):
        commands.renew(other)
    assert silent_for(commands, 0.09) is not None


def test_without_a_holder_nobody_is_silent(commands):
    assert silent_for(commands, 1.0) is None
    commands.renew("")
    assert not commands.armed


def test_a_pause_of_the_daq_itself_is_not_the_holders_silence(commands, lease):
    assert not commands.elapse(3.0)
    commands.renew(lease)
    assert not commands.elapse(COUNTED_PAUSE)


def test_disarming_tells_who_held_the_rig(commands, lease):
    assert commands.disarm() == "anna"
    assert not commands.armed
    assert refusal(commands, "speed", lease, speed_hz=1.0) == "the rig is not armed: arm it first"
