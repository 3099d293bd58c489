"""What the twin has found travels with the recording, and becomes a rig file."""

import json
import re
from pathlib import Path

import pytest

from daq.recording import Recording, RecordingError
from daq.rig import load_rig
from recordings.reference import FOLDER
from replay.found import found_rig, last_summary
from replay.rerun import estimate
from rigtwin.cli import main
from tests.daq.recorded_run import record


@pytest.fixture(scope="module")
def twinned(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("found") / "out.mcap"
    estimate(FOLDER / "ball.mcap", path)
    return path


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
