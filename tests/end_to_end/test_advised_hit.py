"""Foretelling and freeing a running rig, with real processes and a real link."""

import json

import pytest

from daq.recording import Recording
from tests.end_to_end.rig_process import PATIENT, Running, info, rigtwin, wait_until

RIG = "thesis-ball-two-solenoids"
PLAN = """
[plan]
name = "into-impacts"
description = "run up slowly and stay"

[[step]]
do = "speed"
speed_hz = 8.0
ramp_hz_per_s = 20.0

[[step]]
do = "speed"
speed_hz = 14.5
ramp_hz_per_s = 1.5

[[step]]
do = "wait"
duration = 1.0
"""


def command(*words, cwd):
    return rigtwin("command", *words, cwd=cwd)


def foretold(cwd):
    """Return what holding the speed will come to."""
    result = rigtwin("predict", "--json", cwd=cwd)
    assert result.returncode == 0, result.stderr
    return json.loads(result.stdout)["hold"]


@pytest.mark.slow
def test_the_advised_hit_frees_a_running_rig(tmp_path):
    path = tmp_path / "run.mcap"
    options = ("--rig", RIG, "--plan", "none", *PATIENT, "--view", "none", "--record", path)
    with Running("live", *options, cwd=tmp_path) as run:
        wait_until(lambda: command("arm", cwd=tmp_path).returncode == 0, "the rig to be armed")
        assert command("speed", 8, "--ramp", 20, cwd=tmp_path).returncode == 0
        wait_until(lambda: speed_hz(tmp_path) > 7.99, "8 Hz")
        assert command("speed", 14.5, "--ramp", 1.5, cwd=tmp_path).returncode == 0
        wait_until(lambda: speed_hz(tmp_path) > 14.49, "14.5 Hz")
        assert foretold(tmp_path)["free"] == 0.0
        hit = command("hit", "--advised", cwd=tmp_path)
        assert hit.returncode == 0, hit.stdout + hit.stderr
        assert "advised: " in hit.stdout
        wait_until(lambda: foretold(tmp_path)["free"] == 1.0, "the rotor to be free")
        again = command("hit", "--advised", cwd=tmp_path)
        assert again.returncode == 1
        assert "no hit: none is needed" in again.stdout
        assert run.interrupt() == 0, run.said()
    assert info(path)["certificate"]["verdict"] == "valid"


def speed_hz(cwd):
    """Return the running rotor's speed, by the twin."""
    return foretold(cwd)["speed"] / 6.283185


@pytest.mark.slow
def test_a_recording_is_foretold_from_any_moment(tmp_path):
    plan, path = tmp_path / "plan.toml", tmp_path / "run.mcap"
    plan.write_text(PLAN)
    assert rigtwin("simulate", plan, "-o", path, cwd=tmp_path).returncode == 0
    told = rigtwin("predict", path, "--at", 4.5, "--speed", 14.5, "--ramp", 1.5, "--json", cwd=tmp_path)
    assert told.returncode == 0, told.stderr
    change = json.loads(told.stdout)["change"]
    with Recording(path) as recording:
        truth = recording.series("truth", ["normal_force"], first=round(4.5 * 25000)).samples
    assert change["contact_force"]["low"] <= truth.max() <= 1.1 * change["contact_force"]["high"]
