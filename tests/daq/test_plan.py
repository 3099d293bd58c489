# ruff: noqa: E501  a table of cases reads best with one case a line
"""Plans: what is performed when, and what is refused in which words."""

import pytest

from daq.commanding.plan import PlanError, load_plan, plan_from_text, shipped_plans
from daq.commanding.plan_runner import PlanRunner
from daq.commanding.plan_steps import RecordStep, sentence
from daq.rig import load_rig, shipped_rigs

HEAD = '[plan]\nname = "short"\ndescription = "for a test"\n'
SHORT = (
    HEAD
    + """
[[step]]
do = "wait"
duration = 0.5
note = "stand still"
[[step]]
do = "hit"
solenoid = "horizontal"
force = 6.0
duration = 0.01
[[step]]
do = "mark"
text = "after the hit"
[[step]]
do = "speed"
speed_hz = 8.0
ramp_hz_per_s = 16.0
[[step]]
do = "speed"
speed_hz = 5.33
[[step]]
do = "wait"
duration = 1.0
"""
)


@pytest.fixture(scope="module")
def rig():
    return load_rig("thesis-ball")


NEEDS = {"drop-tests": "thesis-drop"}  # plans that only one rig has the means for


@pytest.mark.parametrize("plan", shipped_plans())
@pytest.mark.parametrize("rig_name", [name for name in shipped_rigs() if load_rig(name).plan])
def test_shipped_plan_suits_every_shipped_rig(plan, rig_name):
    rig = load_rig(rig_name)
    assert load_plan(rig.plan, rig)
    if NEEDS.get(plan, rig_name) == rig_name:
        assert load_plan(plan, rig).name == plan
    else:
        with pytest.raises(PlanError, match="no solenoid is named vertical"):
            load_plan(plan, rig)


@pytest.mark.parametrize(("plan", "levels"), [("stairs", 80), ("heavy-unbalance", 80), ("external-hit", 39)])
def test_thesis_plan_holds_each_speed_ten_seconds(plan, levels, rig):
    steps = load_plan(plan, rig).steps
    speeds = [step.speed_hz for step in steps if type(step).__name__ == "SpeedStep"]
    waits = [step.duration for step in steps if type(step).__name__ == "WaitStep"]
    assert len(speeds) in (levels, levels + 1)
    assert set(waits) <= {5.0, 10.0}


def test_expected_duration_counts_ramps_by_the_speed_last_commanded(rig):
    assert plan_from_text(SHORT, rig).expected_duration(rig) == pytest.approx(0.5 + 0.5 + 2.67 / 26.7 + 1.0)
    assert load_plan("resonance", rig).expected_duration(rig) == pytest.approx(50.0)


STAIR = (
    HEAD
    + """
[[step]]
do = "stair"
from_hz = 9.0
to_hz = 7.5
step_hz = 0.5
dwell = 2.0
"""
)


def test_stair_is_a_speed_and_a_wait_for_each_level(rig):
    steps = plan_from_text(STAIR, rig).steps
    assert [step.speed_hz for step in steps[::2]] == [9.0, 8.5, 8.0, 7.5]
    assert {step.duration for step in steps[1::2]} == {2.0}
    assert plan_from_text(STAIR, rig).expected_duration(rig) == pytest.approx(8.0 + 10.5 / 26.7)


def test_stair_hits_half_way_through_each_level(rig):
    hits = STAIR + 'solenoid = "horizontal"\nforce = 9.0\nhit_duration = 0.01\n'
    steps = plan_from_text(hits, rig).steps
    assert len(steps) == 16
    assert [step.duration for step in steps[1:4]] == [1.0, 0.01, 1.0]


def test_stair_of_one_level_stays_there(rig):
    steps = plan_from_text(STAIR.replace("7.5", "9.0"), rig).steps
    assert [type(step).__name__ for step in steps] == ["SpeedStep", "WaitStep"]


def performed(plan, rig, start, pitch):
    """Run a plan with `due` called each `pitch` samples; return actions and the sample of its end."""
    runner, sample, actions = PlanRunner(plan, rig), start, []
    while not runner.finished:
        actions += runner.due(sample)
        sample += pitch
    return actions, sample - pitch


@pytest.mark.parametrize("pitch", [1, 50, 250, 777])
def test_steps_are_due_by_the_plan_however_coarsely_it_is_asked(rig, pitch):
    actions, end = performed(plan_from_text(SHORT, rig), rig, 1000, pitch)
    assert [action.command for action in actions] == ["", "hit", "mark", "speed", "speed", ""]
    assert [action.sample - 1000 for action in actions] == [0, 12500, 12500, 12500, 25000, 27500]
    assert 0 <= end - 1000 - 52500 < pitch


def test_actions_carry_the_command_and_say_what_it_is(rig):
    actions, _ = performed(plan_from_text(SHORT, rig), rig, 0, 50)
    assert actions[0].text == "step 1 of 6: wait 0.5 s (stand still)"
    assert (actions[1].values, actions[1].texts) == (
        {"force": 6.0, "duration": 0.01},
        {"solenoid": "horizontal"},
    )
    assert actions[1].text == "step 2 of 6: solenoid horizontal hits with 6 N for 10 ms"
    assert actions[2].texts == {"text": "after the hit"}
    assert actions[3].values == {"speed_hz": 8.0, "ramp_hz_per_s": 16.0}
    assert actions[4].values == {"speed_hz": 5.33}


def test_aborted_plan_has_nothing_more_to_do(rig):
    runner = PlanRunner(plan_from_text(SHORT, rig), rig)
    runner.due(0)
    runner.abort("the rig tripped")
    runner.abort("a later reason")
    assert runner.finished
    assert runner.aborted == "the rig tripped"
    assert runner.due(10**9) == []


def test_a_plan_on_a_turning_rig_ramps_from_its_speed(rig):
    plan = plan_from_text(HEAD + '[[step]]\ndo = "speed"\nspeed_hz = 10.0\nramp_hz_per_s = 2.0\n', rig)
    runner = PlanRunner(plan, rig, speed_hz=9.0)
    runner.due(0)
    assert runner.next_sample == 12500


STEP_ERRORS = {
    'do = "record"': r"\[\[step\]\] 1 lacks switch",
    'do = "record"\nswitch = "of"': r'\[\[step\]\] 1 switch = "of" must be one of on, off',
    'do = "wiat"\nduration = 1.0': r"\[\[step\]\] 1 do = 'wiat' is not a step; did you mean wait\?",
    "duration = 1.0": r"\[\[step\]\] 1 lacks do: one of wait, speed, hit, mark, record, settle, stair, repeat",
    "do = 3": r"\[\[step\]\] 1 do = 3 is not a step",
    "do = []": r"\[\[step\]\] 1 do = \[\] is not a step",
    'do = "wait"\ndurations = 1.0': r"\[\[step\]\] 1 durations is not a key of this table; did you mean duration\?",
    'do = "wait"': r"\[\[step\]\] 1 lacks duration \(s\)",
    'do = "wait"\nduration = -1.0': r"duration = -1 is outside 0 to",
    'do = "wait"\nduration = "1 s"': r'duration = "1 s" must be a number in s',
    'do = "speed"\nspeed_hz = 26.0': r"speed_hz = 26 is above 25, thesis-ball \[command\] max_speed_hz",
    'do = "speed"\nspeed_hz = -1.0': r"speed_hz = -1 is outside",
    'do = "speed"\nspeed_hz = 1.0\nramp_hz_per_s = 51': r"ramp_hz_per_s = 51 is above 50, thesis-ball",
    'do = "speed"\nspeed_hz = 1.0\nramp_hz_per_s = 0': r"ramp_hz_per_s = 0 is outside",
    'do = "hit"\nsolenoid = "horizontl"\nforce = 1.0\nduration = 0.01': r'solenoid = "horizontl": .*did you mean horizontal\?',
    'do = "hit"\nsolenoid = "horizontal"\nforce = 61.0\nduration = 0.01': r"force = 61 is above 60, thesis-ball .*max_force",
    'do = "hit"\nsolenoid = "horizontal"\nforce = 1.0\nduration = 0.06': r"duration = 0\.06 is above 0\.05",
    'do = "stair"\nfrom_hz = 1.0\nto_hz = 2.0\nstep_hz = 0.3\ndwell = 1.0': r"\[\[step\]\] 1 step_hz = 0\.3 does not divide the way from 1 to 2 Hz",
    'do = "stair"\nfrom_hz = 1.0\nto_hz = 26.0\nstep_hz = 0.5\ndwell = 1.0': r"speed_hz = 25\.5 is above 25, thesis-ball \[command\] max_speed_hz",
    'do = "stair"\nfrom_hz = 1.0\nto_hz = 2.0\nstep_hz = 0.5\ndwell = 0.0': r"dwell = 0 is outside",
    'do = "stair"\nfrom_hz = 0.0\nto_hz = 20.0\nstep_hz = 0.001\ndwell = 1.0': r"step_hz = 0\.001 makes 20001 levels, above 10000",
    'do = "stair"\nfrom_hz = 1.0\nto_hz = 2.0\nstep_hz = 0.5\ndwell = 1.0\nforce = 9.0': r"a hit at each level needs all of solenoid, force and hit_duration",
    'do = "stair"\nfrom_hz = 1.0\nto_hz = 2.0\nstep_hz = 0.5\ndwell = 0.01\nsolenoid = "horizontal"\nforce = 9.0\nhit_duration = 0.05': r"\[\[step\]\] 1 hits 0\.0711798 s after",
    'do = "mark"\ntext = ""': r'text = "" must be a text of 1 to 500 characters',
}  # fmt: skip


@pytest.mark.parametrize("step", STEP_ERRORS)
def test_bad_step_is_refused_with_file_and_step(step, rig, tmp_path):
    path = tmp_path / "mine.toml"
    path.write_text(f"{HEAD}[[step]]\n{step}\n", encoding="utf-8")
    with pytest.raises(PlanError, match=STEP_ERRORS[step]) as caught:
        load_plan(path, rig)
    assert str(caught.value).startswith(f"{path}: ")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (HEAD, r"there is no \[\[step\]\]"),
        ('[[step]]\ndo = "wait"\nduration = 1.0\n', r"table \[plan\] is missing"),
        (SHORT.replace("[plan]", "[plna]"), r"\[plna\] is not a table of a plan; did you mean plan\?"),
        (SHORT.replace("description", "descripton"), r"\[plan\] descripton .* did you mean description\?"),
        (SHORT.replace("0.5", "0.5s", 1), r"plan: not TOML: .*line 7"),
    ],
)
def test_bad_plan_is_refused(text, message, rig):
    with pytest.raises(PlanError, match=message):
        plan_from_text(text, rig)


def test_hit_within_a_hit_is_refused(rig):
    hit = '[[step]]\ndo = "hit"\nsolenoid = "horizontal"\nforce = 6.0\nduration = 0.01\n'
    with pytest.raises(
        PlanError, match=r"\[\[step\]\] 2 hits 0 s after .* until 0\.01 s; put a wait between"
    ):
        plan_from_text(HEAD + hit + hit, rig)
    assert plan_from_text(HEAD + hit + '[[step]]\ndo = "wait"\nduration = 0.02\n' + hit, rig)


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("resonanc", r'no plan is named "resonanc"; did you mean resonance\?'),
        ("no/mine.toml", "does not exist"),
    ],
)
def test_plan_that_is_not_there(name, message, rig):
    with pytest.raises(PlanError, match=message):
        load_plan(name, rig)


def test_rows_are_repeated(rig):
    text = SHORT + '[[step]]\ndo = "repeat"\nlast = 2\ntimes = 3\n'
    plan = plan_from_text(text, rig)
    assert plan.steps[6:] == plan.steps[4:6] * 3
    once = plan_from_text(SHORT, rig)
    assert plan.expected_duration(rig) == pytest.approx(once.expected_duration(rig) + 3 * 1.0)


TIMES, WAIT = 'do = "repeat"\nlast = 1\ntimes = 10000', 'do = "wait"\nduration = 1.0'


@pytest.mark.parametrize(
    ("row", "said"),
    [
        ('do = "repeat"\nlast = 7\ntimes = 1', "last = 7, but there are only 6 rows before it"),
        ('do = "repeat"\nlast = 6\ntimes = 10000000', r"times = 1e\+07"),
        ('do = "repeat"\nlast = 1000\ntimes = 10', "only 6 rows"),
        (f"{TIMES}\n[[step]]\n{TIMES}", r"\[\[step\]\] 8 makes more than 100000 steps of the plan"),
        (
            "\n[[step]]\n".join([TIMES, WAIT] * 11),
            r"\[\[step\]\] 25 makes more than 100000 steps of the plan",
        ),
        ('do = "settle"\nquantity = "warmth"\nwithin = 1.0\nhold = 1.0\ntimeout = 1.0', "quantity"),
        (
            'do = "hit"\nsolenoid = "horizontal"\nforce = 1.0\nduration = 0.01\nangle_deg = 361.0',
            "angle_deg = 361",
        ),
    ],
)
def test_a_bad_row_is_refused(rig, row, said):
    with pytest.raises(PlanError, match=said):
        plan_from_text(f"{SHORT}[[step]]\n{row}\n", rig)


def test_what_is_left_of_a_plan_begins_at_the_speed_it_had(rig):
    plan = plan_from_text(SHORT, rig)
    assert plan.rest_from(1) == plan
    left = plan.rest_from(6)
    assert [type(step).__name__ for step in left.steps] == ["SpeedStep", "WaitStep"]
    assert left.steps[0].speed_hz == 5.33


def test_a_plan_that_was_cut_while_recording_was_off_goes_on_so(rig):
    off, on = ('[[step]]\ndo = "record"\nswitch = "off"\n', '[[step]]\ndo = "record"\nswitch = "on"\n')
    plan = plan_from_text(f"{SHORT}{off}{SHORT.removeprefix(HEAD)}{on}{SHORT.removeprefix(HEAD)}", rig)
    assert [type(step).__name__ for step in plan.rest_from(9).steps[:2]] == ["SpeedStep", "RecordStep"]
    assert not any(step == RecordStep("off") for step in plan.rest_from(16).steps)
    assert sentence(plan.steps[6]) == "recording off"
