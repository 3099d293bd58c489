"""What people tell of a run: into the recording, beside it, and out again; read by a stock reader too."""

import json

import pytest
from mcap.reader import make_reader

from daq.recording import Recording, recover
from daq.recording.metadata import metadata_of
from daq.recording.notes import notes_of
from daq.rig import RigError
from rigtwin.cli import main

PLAN = '[plan]\nname = "short"\ndescription = "short"\n[[step]]\ndo = "wait"\nduration = 0.05\n'


@pytest.fixture
def recorded(tmp_path):
    plan, path = tmp_path / "short.toml", tmp_path / "run.mcap"
    plan.write_text(PLAN, encoding="utf-8")
    told = ["--meta", "operator=Anna Ünal", "--meta", "specimen = bearing 7=B"]
    assert main(["simulate", str(plan), "-o", str(path), "--no-twin", *told]) == 0
    return path


def test_metadata_travels_with_the_recording(recorded, tmp_path, capsys):
    told = {"operator": "Anna Ünal", "specimen": "bearing 7=B"}
    with recorded.open("rb") as file:
        record = next(each for each in make_reader(file).iter_metadata() if each.name == "meta")
    assert {key: record.metadata[key] for key in told} == told
    recover(recorded, tmp_path / "mended.mcap")
    with Recording(tmp_path / "mended.mcap") as mended:
        assert dict(mended.description.meta) == told
    capsys.readouterr()
    assert main(["info", str(recorded), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["meta"] == told


def test_later_notes_stand_beside_it(recorded, capsys):
    before = recorded.read_bytes()
    assert main(["note", str(recorded), "crack found at pin 3", "--meta", "specimen=scrapped"]) == 0
    assert main(["note", str(recorded), "seen again"]) == 0
    assert recorded.read_bytes() == before
    first, second = notes_of(recorded)
    assert (first.text, first.meta) == ("crack found at pin 3", {"specimen": "scrapped"})
    assert second.text == "seen again"
    capsys.readouterr()
    main(["info", str(recorded)])
    said = capsys.readouterr().out
    assert "specimen     bearing 7=B" in said
    assert "crack found at pin 3 specimen=scrapped" in said


@pytest.mark.parametrize("setting", ["operator", "Operator=anna", "=x", "a b=c", "crc32=1"])
def test_what_is_no_key_and_value_is_refused(setting):
    with pytest.raises(RigError, match="write it as key=value"):
        metadata_of([setting])


def test_keys_come_once_and_with_a_value():
    with pytest.raises(RigError, match="operator is given twice"):
        metadata_of(["operator=anna", "operator=bob"])
    with pytest.raises(RigError, match="1 to 1000 characters"):
        metadata_of(["operator="])


def test_a_note_on_nothing_is_refused(tmp_path, capsys):
    assert main(["note", str(tmp_path / "none.mcap"), "hello"]) == 2
    assert "does not exist: name the recording" in capsys.readouterr().err
