"""`rigtwin rig` and `rigtwin plan`, called as the command line calls them."""

import argparse
import json
import tomllib
from pathlib import Path

import pytest

from daq.rig import RigError, load_rig, shipped_rigs
from daq.rig.toml_source import shipped
from rigtwin import plan_command, rig_command
from rigtwin.cli import main


@pytest.fixture
def call(capsys):
    """Return a function that performs a command line and returns its exit code and output."""

    def perform(*words):
        parser = argparse.ArgumentParser()
        commands = parser.add_subparsers(required=True)
        rig_command.add_parser(commands)
        plan_command.add_parser(commands)
        options = parser.parse_args([str(word) for word in words])
        code = options.run(options)
        return code, capsys.readouterr().out

    return perform


def test_shipped_rigs_are_listed(call):
    code, said = call("rig", "list")
    assert code == 0
    assert [line.split()[0] for line in said.splitlines()] == shipped_rigs()
    assert [rig["name"] for rig in json.loads(call("rig", "list", "--json")[1])] == shipped_rigs()


def test_show_prints_the_resolved_description(call, tmp_path):
    _, said = call("rig", "show", "thesis-pinned", "--set", "emulator.seed=7")
    path = tmp_path / "shown.toml"
    path.write_text(said, encoding="utf-8")
    assert load_rig(path) == load_rig("thesis-pinned", ["emulator.seed=7"])
    shown = json.loads(call("rig", "show", "thesis-pinned", "--json")[1])
    assert shown["backup_bearing"]["kind"] == "pinned"


@pytest.mark.parametrize("name", shipped_rigs())
def test_check_accepts_the_shipped_rigs_without_a_doubt(call, name):
    code, said = call("rig", "check", name)
    assert code == 0
    rig = load_rig(name)
    assert said.startswith(
        f"{name} is valid: {len(rig.channels)} channels at {rig.acquisition.rate:g} Hz, "
        f"backend {rig.acquisition.backend}"
    )
    assert len(said.splitlines()) == 1
    assert json.loads(call("rig", "check", name, "--json")[1]) == {"valid": True, "rig": name, "warnings": []}


def test_check_answers_no_to_a_wrong_description(call):
    code, said = call("rig", "check", "thesis-ball", "--set", "rotor.mass=-1")
    assert code == 1
    assert "[rotor] mass = -1 is outside" in said
    code, said = call("rig", "check", "thesis-ball", "--set", "rig.plan=resonanc", "--json")
    assert code == 1
    assert "did you mean resonance" in json.loads(said)["error"]


@pytest.mark.parametrize(
    ("setting", "doubt"),
    [
        ("channel.force_top.due=2020-01-31", "channel force_top: calibration was due on 2020-01-31"),
        (
            "limits.displacement.trip=3e-3",
            "limit displacement: trips at 3000 µm, but its sensors read no more than 2780",
        ),
        ("acquisition.backend=nidaq", "channel proximity_x: no anti-alias filter; vibration above 12500 Hz"),
    ],
)
def test_check_warns_of_what_is_doubtful(call, setting, doubt):
    code, said = call("rig", "check", "thesis-ball", "--set", setting)
    assert code == 0
    assert said.startswith(f"warning: {doubt}")


def test_rig_that_is_not_there_is_wrong_use(call):
    with pytest.raises(RigError, match="did you mean thesis-ball"):
        call("rig", "check", "thesis-bal")


@pytest.mark.parametrize("source", shipped_rigs())
def test_init_copies_a_shipped_rig_with_its_comments(call, tmp_path, source):
    path = tmp_path / "my-rig.toml"
    code, said = call("rig", "init", path, "--from", source)
    assert code == 0
    assert f"rigtwin rig check {path}" in said
    assert path.read_text(encoding="utf-8").count("#") == shipped("rig")[source].read_text(
        encoding="utf-8"
    ).count("#")
    original, copy = (tomllib.loads(load_rig(each).toml) for each in (source, path))
    assert copy["rig"].pop("name") == "my-rig"
    original["rig"].pop("name")
    assert copy == original


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("there.toml", r"there\.toml exists already; rigtwin overwrites nothing"),
        ("my-rig", r"my-rig must end in \.toml, as .*my-rig\.toml"),
        ("1st.toml", r'name = "1st" must be a name'),
        ("no/folder.toml", r"folder\.toml cannot be written: No such file or directory"),
    ],
)
def test_init_refuses_what_it_cannot_write(call, tmp_path, name, message):
    (tmp_path / "there.toml").write_text("mine", encoding="utf-8")
    with pytest.raises(RigError, match=message):
        call("rig", "init", tmp_path / name)
    assert (tmp_path / "there.toml").read_text(encoding="utf-8") == "mine"


def test_plans_are_listed_with_their_durations(call):
    code, said = call("plan", "list")
    assert code == 0
    assert any(line.split()[:3] == ["resonance", "50", "s"] for line in said.splitlines())
    names = {plan["name"] for plan in json.loads(call("plan", "list", "--json")[1])}
    assert {"impacts", "resonance", "stairs"} <= names
    assert "drop-tests" not in names  # it needs a solenoid that the rig has not


def test_plans_are_listed_for_the_rig_that_is_asked_for(call):
    assert "drop-tests" in call("plan", "list", "--rig", "thesis-drop")[1]


def test_show_tells_when_each_step_begins(call):
    _, said = call("plan", "show", "impacts")
    assert "   2     0.50 s  10.5 Hz by 12 Hz/s (into the resonance)" in said.splitlines()
    steps = json.loads(call("plan", "show", "impacts", "--json")[1])["steps"]
    assert steps[1] == {"begins": 0.5, "does": "10.5 Hz by 12 Hz/s (into the resonance)"}


@pytest.mark.parametrize("rig", [name for name in shipped_rigs() if load_rig(name).plan])
def test_each_shipped_rig_completes_its_own_plan_on_its_model(call, rig):
    code, said = call("plan", "check", load_rig(rig).plan, "--rig", rig, "--json")
    found = json.loads(said)
    assert code == 0
    assert found["model"]["aborted"] == ""
    assert found["model"]["samples"] >= found["expected_duration"] * 25_000
    assert load_rig(rig).model.backup_bearing.clearance < found["model"]["radius"] < 2.6e-3
    assert 20.0 < found["model"]["force"] < 400.0  # N: it hits the bearing


def test_check_answers_no_to_a_plan_that_trips(call):
    code, said = call(
        "plan", "check", "impacts", "--set", "limits.force.warn=20", "--set", "limits.force.trip=30"
    )
    assert code == 1
    assert "it does not complete: force" in said


def test_check_answers_no_to_a_plan_beyond_the_rig(call, tmp_path):
    path = Path(tmp_path / "fast.toml")
    path.write_text('[plan]\nname = "fast"\ndescription = "x"\n[[step]]\ndo = "speed"\nspeed_hz = 30.0\n')
    code, said = call("plan", "check", path)
    assert code == 1
    assert "[[step]] 1 speed_hz = 30 is above 25" in said
    assert json.loads(call("plan", "check", path, "--json")[1])["valid"] is False


def test_check_answers_no_to_hits_that_the_device_does_not_end(call):
    device = ("--set", "acquisition.backend=opendaq", "--set", "device.address=daqref://device0")
    code, said = call("plan", "check", "resonance", *device)
    assert code == 1
    assert said == (
        "resonance hits, but on the backend opendaq the device does not end a hit by its own timing: "
        "hits are refused\n"
    )


def test_setup_writes_a_dated_description_and_overwrites_nothing(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(["rig", "setup", "thesis-ball"]) == 0
    (path,) = tmp_path.glob("thesis-ball-2*.toml")
    said = capsys.readouterr().out
    assert "clearance: 15" in said
    assert "solenoid horizontal: moved the shaft by" in said
    rig = load_rig(path)
    assert rig.name == path.stem
    assert "set up on" in rig.description
    assert not [name for name in rig.solenoid_names if name.startswith("hand")]
    assert main(["rig", "setup", "thesis-ball"]) == 2
    assert "exists already" in capsys.readouterr().err
