"""What the twin has found travels with the recording, and becomes a rig file."""

import json
import re
from pathlib import Path

import pytest

from daq import keys
from daq.recording import Recording, RecordingError
from daq.rig import load_rig, rig_from_text
from recordings.reference import FOLDER
from replay.found import found_rig, last_summary
from replay.rerun import estimate
from rigtwin.cli import build_parser, main
from rigtwin.plan_command import rig_as_found
from tests.daq.recorded_run import record
from twin.estimation import Twin


@pytest.fixture(scope="module")
def twinned(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("found") / "out.mcap"
    estimate(FOLDER / "ball.mcap", path)
    return path


def test_an_estimate_made_anew_holds_what_the_twin_makes_of_each_block(twinned):
    with Recording(FOLDER / "ball.mcap") as recording:
        description = recording.description
        twin = Twin(rig_from_text(description.toml, "the recording"), description.run, description.t0_ns)
        made = [
            each
            for message in recording.messages(keys.block(description.rig))
            for each in twin.process(message.payload)
        ]
    made += twin.finish()
    with Recording(twinned) as recording:
        for key in {key for key, _ in made}:
            payloads = [message.payload for message in recording.messages(key)]
            assert payloads == [payload for name, payload in made if name == key], key


def test_the_last_summary_tells_what_was_found_and_the_rig_file_takes_it_over(twinned, tmp_path):
    with Recording(twinned) as recording:
        summary = last_summary(recording)
        text = found_rig(recording)
    (tmp_path / "found.toml").write_text(text, encoding="utf-8")
    found, described = load_rig(tmp_path / "found.toml"), load_rig("thesis-ball")
    assert found.name == "thesis-ball-found"
    told = {each.name: each for each in summary.parameters if each.told and each.key}
    assert {"unbalance", "unbalance_phase", "clearance", "contact_stiffness"} <= told.keys()
    assert found.model.rotor.unbalance == told["unbalance"].value
    assert found.model.backup_bearing.stiffness == told["contact_stiffness"].value
    assert found.model.housing == described.model.housing
    assert text.count("=") == len(told) + 3  # base, name and description


def test_info_shows_it_and_how_to_balance(twinned, capsys):
    assert main(["info", str(twinned)]) == 0
    shown = capsys.readouterr().out
    assert "the twin found" in shown
    assert "g mm" in shown
    assert "to balance: 2.27 g at 33 mm" in shown
    assert re.search(r"regime at the end: \w.* \(\d+ %\)", shown)
    assert main(["info", str(twinned), "--json"]) == 0
    facts = json.loads(capsys.readouterr().out)["twin"]
    assert 0.0 < facts["regime_confidence"] <= 1.0
    row = next(row for row in facts["parameters"] if row["name"] == "balance_mass")
    assert row["value"] == pytest.approx(75e-6 / 33e-3, rel=0.01)


def test_the_command_writes_the_rig_file_and_overwrites_none(tmp_path, capsys):
    source, target = str(FOLDER / "ball.mcap"), tmp_path / "found.toml"
    target.write_text("mine")
    command = ["twin", source, "-o", str(tmp_path / "out.mcap"), "--rig-out", str(target)]
    assert main(command) == 2
    assert "exists already" in capsys.readouterr().err
    assert target.read_text() == "mine"
    assert not (tmp_path / "out.mcap").exists()


def test_a_recording_without_findings_says_how_to_get_them(tmp_path):
    record(tmp_path / "run.mcap", blocks=2)
    with (
        Recording(tmp_path / "run.mcap") as recording,
        pytest.raises(RecordingError, match="rigtwin twin FILE -o OUT"),
    ):
        found_rig(recording)


WAIT = '[plan]\nname = "wait"\ndescription = "x"\n[[step]]\ndo = "wait"\nduration = 0.1\n'


@pytest.fixture
def check(tmp_path, monkeypatch, capsys):
    """Check a plan that only waits, with what was found in a file."""
    monkeypatch.chdir(tmp_path)
    Path("wait.toml").write_text(WAIT, encoding="utf-8")

    def call(*options):
        code = main(["plan", "check", "wait.toml", *map(str, options)])
        said = capsys.readouterr()
        return code, said.out + said.err

    return call


def test_a_plan_is_checked_with_what_was_found_in_a_recording_or_in_its_rig_file(twinned, check):
    with Recording(twinned) as recording:
        Path("found.toml").write_text(found_rig(recording), encoding="utf-8")
    hidden = ("--set", "emulator.actual.rotor.unbalance=9e-5")
    for source in (twinned, "found.toml"):
        code, said = check("--found", source, "--json", *hidden)
        facts = json.loads(said)
        assert code == 0
        assert facts["found"]["rotor.unbalance"] == pytest.approx(75e-6, rel=0.01)
        assert "backup_bearing.clearance" in facts["found"]
    assert "rotor.unbalance_angle" in check("--found", "found.toml")[1].splitlines()[1]


def test_a_setting_goes_on_top_of_what_was_found(check):
    Path("found.toml").write_text("[backup_bearing]\nclearance = 1e-3\n", encoding="utf-8")
    options = build_parser().parse_args(["plan", "check", "wait.toml", "--found", "found.toml"])
    rig, found = rig_as_found(options)
    assert rig.emulated_model.backup_bearing.clearance == 1e-3 == found["backup_bearing.clearance"]
    options = build_parser().parse_args(
        ["plan", "check", "x", "--found", "found.toml", "--set", "backup_bearing.clearance=2e-3"]
    )
    assert rig_as_found(options)[0].emulated_model.backup_bearing.clearance == 2e-3


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("[channel]\n", "found.toml has none of the parameters that the twin finds: rotor.unbalance,"),
        ("[backup_bearing]\nclearance = 1.0\n", "[backup_bearing] clearance = 1"),
        ("clearance", "found.toml: not TOML"),
    ],
)
def test_a_file_without_anything_found_is_refused(check, text, said):
    Path("found.toml").write_text(text, encoding="utf-8")
    code, told = check("--found", "found.toml")
    assert (code, said in told, len(told.splitlines())) == (2, True, 1)


def test_a_recording_without_anything_found_is_refused(check, tmp_path):
    record(tmp_path / "run.mcap")
    code, told = check("--found", "run.mcap")
    assert (code, "holds no parameters found by the twin" in told) == (2, True)
    assert check("--found", "absent.toml")[0] == 2
