"""Forks of simulated recordings against what was true, and what makes them differ."""

import json
from math import atan2, hypot

import numpy as np
import pytest

from daq.commanding.plan import plan_from_text
from daq.recording import Recording
from daq.rig import load_rig, rig_from_text
from recordings.reference import REFERENCES
from replay.fork import ForkError, fork
from rigtwin.cli import main
from rigtwin.simulate_command import simulate

PLAN = """
[plan]
name = "free"
description = "below the resonance, without contact"
[[step]]
do = "speed"
speed_hz = 8.0
ramp_hz_per_s = 20.0
[[step]]
do = "wait"
duration = 0.4
[[step]]
do = "speed"
speed_hz = 6.0
ramp_hz_per_s = 5.0
[[step]]
do = "hit"
solenoid = "horizontal"
force = 5.0
duration = 0.01
[[step]]
do = "wait"
duration = 0.5
"""
LOUD = 0.5  # N from which on there is contact
TRUE = (9e-5, 1.2)  # kg m and rad: the unbalance that the rig has and its description does not tell
NEAR = (
    4e-5  # rad of tilt, 12 µm at the probes: the error of an estimate 0.3 s old, which the free shaft keeps
)


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """A run without contact, with an unbalance that the description does not tell."""
    changes = [
        f"emulator.actual.rotor.unbalance={TRUE[0]}",
        f"emulator.actual.rotor.unbalance_angle={TRUE[1]}",
    ]
    rig = load_rig("thesis-ball", changes)
    path = tmp_path_factory.mktemp("fork") / "run.mcap"
    simulate(rig, plan_from_text(PLAN, rig), path)
    return path


def truth(path, first: int, last: int | None = None) -> dict[str, np.ndarray]:
    with Recording(path) as recording:
        found = recording.series("truth", first=first, last=last)
    return {name: found[name].astype(float) for name in found.names}


@pytest.mark.parametrize("at", [0.3, 0.6, 0.95])
def test_without_a_change_it_follows_the_truth(recorded, tmp_path, at):
    """From a ramp, from a steady speed and from a ramp down with a hit to come, for half a second."""
    account = fork(recorded, tmp_path / "fork.mcap", at, seconds=0.5)
    first = account.first_sample
    assert first == round(at * 25_000) // 250 * 250
    would, was = truth(tmp_path / "fork.mcap", first), truth(recorded, first, first + account.received - 1)
    length = min(len(would["tilt_x"]), len(was["tilt_x"]))
    assert length > 2000
    moved = np.ptp(was["tilt_x"])
    for name in ("tilt_x", "tilt_y"):
        off = np.abs(would[name][:length] - was[name][:length]).max()
        assert off < NEAR < 0.05 * moved
    assert np.abs(would["angle"][:length] - was["angle"][:length]).max() < 0.03  # rad
    assert np.abs(would["speed"][:length] - was["speed"][:length]).max() < 0.2  # rad/s


IN_CONTACT = [
    ("ball", 0.65),
    ("ball", 0.80),
    ("pinned", 0.37),
    ("pinned", 0.43),
    ("plain", 0.50),
    ("plain", 0.66),
]
TOUCHING = {  # the twin's error in the middle of an impact
    "tilt_x": 5e-6,  # rad, 1.5 µm at the probes
    "tilt_y": 5e-6,
    "tilt_rate_x": 5e-3,  # rad/s, 1 % of what an impact turns round
    "tilt_rate_y": 5e-3,
    "house_x": 1e-8,  # m
    "house_y": 1e-8,
    "ring_speed": 1.0,  # rad/s, of 60
    "angle": 1e-3,  # rad
    "speed": 0.2,  # rad/s
}


@pytest.mark.parametrize(("name", "at"), IN_CONTACT)
def test_from_within_an_impact_it_follows_the_truth_to_the_third_next_one(tmp_path, name, at):
    (source,) = [each.path for each in REFERENCES if each.name == name]
    assert_follows(source, at, tmp_path)


@pytest.fixture(scope="module")
def latched(tmp_path_factory):
    """A run whose contact remembers the speed at which it closed."""
    rig = load_rig("thesis-ball", ['backup_bearing.damping_mode="latched"'])
    path = tmp_path_factory.mktemp("latched") / "run.mcap"
    simulate(rig, plan_from_text(REFERENCES[0].plan.read_text(), rig), path)
    return path


@pytest.mark.parametrize("at", [0.73, 1.05])
def test_the_contact_s_memory_of_its_closing_goes_with_it(latched, tmp_path, at):
    assert_follows(latched, at, tmp_path)


def assert_follows(source, at, tmp_path):
    """Compare up to the third next impact; each multiplies what two ways differ by, and the bounds widen."""
    first = fork(source, tmp_path / "fork.mcap", at, seconds=0.3).first_sample
    would, was = truth(tmp_path / "fork.mcap", first), truth(source, first)
    assert was["normal_force"][0] > LOUD, "the rotor does not touch there"
    for row, bound in TOUCHING.items():
        assert abs(would[row][0] - was[row][0]) < bound, row
    followed = zip(impacts(would["normal_force"]), impacts(was["normal_force"]), strict=False)
    pairs = list(followed)[:4]
    assert len(pairs) == 4
    for number, ((begin, peak), (true_begin, true_peak)) in enumerate(pairs):
        assert abs(begin - true_begin) <= number  # columns of 0.2 ms
        assert peak == pytest.approx(true_peak, rel=0.05 if number < 3 else 0.15)


def impacts(force: np.ndarray) -> list[tuple[int, float]]:
    """Column at which each contact begins, and its largest force; one that is under way begins at 0."""
    steps = np.diff(np.concatenate(([0], force > LOUD, [0])).astype(int))
    spans = zip(np.flatnonzero(steps > 0), np.flatnonzero(steps < 0), strict=True)
    return [(int(begin), float(force[begin:end].max())) for begin, end in spans]


def test_it_is_a_recording_like_any_other_and_says_where_it_comes_from(recorded, tmp_path):
    path = tmp_path / "fork.mcap"
    fork(recorded, path, 0.6, ["backup_bearing.clearance=0.0014"], seconds=0.2)
    with Recording(path) as made, Recording(recorded) as source:
        assert made.check()[:2] == ("valid", "")
        assert made.notes["fork"] == {
            "source": "run.mcap",
            "sample": "15000",
            "changes": "backup_bearing.clearance=0.0014",
        }
        assert made.description.run != source.description.run
        assert made.clock.ns(15_000) == source.clock.ns(15_000)
        assert made.series().first_sample == 15_000
        model = rig_from_text(made.rig_toml).model
        rotor = model.rotor
        assert model.backup_bearing.clearance == 0.0014
        assert rotor.unbalance == pytest.approx(TRUE[0], rel=0.05)
        assert rotor.unbalance_angle == pytest.approx(TRUE[1], abs=0.05)
        estimate = made.series("estimate", ["unbalance_x", "unbalance_y"])
        assert hypot(*estimate.samples[:, -1]) == pytest.approx(TRUE[0], rel=0.1)
        assert atan2(*estimate.samples[::-1, -1]) == pytest.approx(TRUE[1], abs=0.1)


@pytest.mark.parametrize(
    ("change", "name", "least"),
    [
        ("command.hit=20", "normal_force", 10.0),
        ("rotor.unbalance=3e-4", "tilt_x", 2e-4),
        ("command.speed=3", "speed", 5.0),
    ],
)
def test_what_is_changed_makes_a_difference(recorded, tmp_path, change, name, least):
    account = fork(recorded, tmp_path / "fork.mcap", 0.6, [change], seconds=0.3)
    first = account.first_sample
    would, was = truth(tmp_path / "fork.mcap", first), truth(recorded, first, first + account.received - 1)
    length = min(len(would[name]), len(was[name]))
    assert np.abs(would[name][:length] - was[name][:length]).max() > least
    assert np.abs(would["tilt_x"][0] - was["tilt_x"][0]) < NEAR


@pytest.mark.parametrize(
    ("at", "changes", "words"),
    [
        (0.01, [], "the estimate at 0.010 s is not valid"),
        (99.0, [], "holds no estimate at 99.000 s"),
        (-1.0, [], "--at -1: name a time of the recording"),
        (float("nan"), [], "--at nan"),
        (0.6, ["command.hit=1e9"], "horizontal hits with up to"),
        (0.6, ["command.hit=hard"], "'hard' is no number"),
        (0.6, ["command.speed=400"], "the rig's speed is 0 to 25 Hz"),
    ],
)
def test_what_cannot_be_forked_is_refused(recorded, tmp_path, at, changes, words):
    with pytest.raises(ForkError, match=words):
        fork(recorded, tmp_path / "fork.mcap", at, changes)
    assert not (tmp_path / "fork.mcap").exists()


def test_the_command_says_what_it_made(recorded, tmp_path, capsys):
    out = tmp_path / "fork.mcap"
    assert (
        main(
            ["fork", str(recorded), "--at", "0.6", "--for", "0.1", "--set", "command.hit=20", "-o", str(out)]
        )
        == 0
    )
    assert "certificate valid" in capsys.readouterr().out
    assert main(["info", str(out), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["first_sample"] == 15_000
    assert (
        main(["fork", str(recorded), "--at", "0.6", "--set", "rotor.masss=1", "-o", str(tmp_path / "x.mcap")])
        == 2
    )
    assert "masss" in capsys.readouterr().err
