import json
from pathlib import Path

import numpy as np
import pytest

from daq.recording import Recording, RecordingError, RecordingWriter
from replay.info import brief, info, text
from replay.recover import recover, report
from rigtwin.cli import main
from tests.daq.recorded_run import BLOCK, NAMES, RUN, Maker, description, record, samples


@pytest.fixture
def whole(tmp_path) -> Path:
    record(tmp_path / "run.mcap", blocks=20)
    return tmp_path / "run.mcap"


@pytest.fixture
def cut(tmp_path, whole) -> Path:
    content = whole.read_bytes()
    (tmp_path / "cut.mcap").write_bytes(content[: len(content) * 2 // 3])
    return tmp_path / "cut.mcap"


@pytest.fixture
def altered(tmp_path, whole) -> Path:
    content = bytearray(whole.read_bytes())
    content[len(content) // 2] ^= 1
    (tmp_path / "altered.mcap").write_bytes(content)
    return tmp_path / "altered.mcap"


@pytest.fixture
def with_gap(tmp_path) -> Path:
    make = Maker()
    with RecordingWriter(tmp_path / "gap.mcap", description()) as writer:
        for number in (0, 1, 4, 5):
            writer.add(*make.block(number))
        writer.add(*make.end(6))
    return tmp_path / "gap.mcap"


def test_info_tells_what_is_there(whole):
    found = info(whole)
    assert (found["rig"], found["mode"], found["run"], found["part"]) == ("thesis-ball", "EMULATED", RUN, 1)
    assert (found["samples"], found["lost"], found["gaps"]) == (20 * BLOCK, 0, [])
    assert found["duration"] == pytest.approx(0.2)
    assert found["start"] == "2027-01-15T08:00:00.123456+00:00"
    assert [event["kind"] for event in found["events"]] == ["start", "mark", "end"]
    assert found["events"][1]["time"] == pytest.approx((3 * BLOCK + 7) / 25_000)
    assert found["certificate"]["verdict"] == "valid"
    assert found["digests"]["file"] == Recording(whole).certificate.file_digest
    values = samples(0, len(NAMES), 20 * BLOCK)
    row = found["channels"][2]
    assert (row["name"], row["unit"], row["display_unit"]) == ("force_top", "N", "N")
    np.testing.assert_array_equal([row["minimum"], row["maximum"]], [values[2].min(), values[2].max()])
    assert json.loads(json.dumps(found)) == found


def test_text_shows_the_units_that_people_use(whole):
    lines = text(info(whole)).splitlines()
    assert any(line.startswith("proximity_x") and line.endswith("µm") for line in lines)
    assert "certificate  valid" in lines
    assert brief(whole).endswith("0.2 s of thesis-ball, 5000 samples, 0 lost, certificate valid")


def test_a_description_that_is_not_understood_shows_si_units(tmp_path):
    with RecordingWriter(tmp_path / "run.mcap", description(toml="[rig]\nname = 'other'\n")) as writer:
        writer.add(*Maker().block(0))
    assert "proximity_x" in text(info(tmp_path / "run.mcap"))
    assert info(tmp_path / "run.mcap")["channels"][0]["display_unit"] == "m"


def test_verdicts_and_exit_codes(whole, cut, altered, with_gap, capsys):
    for path, code, verdict in (
        (whole, 0, "valid"),
        (cut, 1, "incomplete"),
        (altered, 1, "altered"),
        (with_gap, 1, "incomplete"),
    ):
        assert main(["info", str(path), "--json"]) == code
        found = json.loads(capsys.readouterr().out)
        assert found["certificate"]["verdict"] == verdict
    assert found["gaps"] == [[500, 999]]
    assert main(["info", str(with_gap)]) == 1
    assert "samples 500 to 999" in capsys.readouterr().out


def test_recover_saves_what_is_intact_and_says_what_is_lost(tmp_path, altered, cut, capsys):
    assert main(["recover", str(altered), "-o", str(tmp_path / "mended.mcap")]) == 1
    said = capsys.readouterr().out
    assert "is damaged: its checksum is wrong" in said or "is damaged" in said
    assert "are lost" in said
    assert Recording(tmp_path / "mended.mcap").check().verdict == "incomplete"
    assert main(["recover", str(cut), "-o", str(tmp_path / "closed.mcap")]) == 0
    assert "saved" in capsys.readouterr().out
    assert Recording(tmp_path / "closed.mcap").complete


def test_long_reports_are_cut_short(tmp_path, whole):
    make = Maker()
    with RecordingWriter(tmp_path / "gaps.mcap", description()) as writer:
        for number in range(0, 60, 2):
            writer.add(*make.block(number))
    saved = recover(tmp_path / "gaps.mcap", tmp_path / "mended.mcap")
    assert "and 19 more gaps" in report(tmp_path / "gaps.mcap", saved)
    assert "and 19 more gaps" in text(info(tmp_path / "gaps.mcap"))


def test_bad_files_are_one_line(tmp_path, whole, capsys):
    (tmp_path / "text.mcap").write_text("no")
    for arguments in (
        ["info", str(tmp_path / "none.mcap")],
        ["info", str(tmp_path / "text.mcap")],
        ["info", str(tmp_path)],
        ["recover", str(whole), "-o", str(whole)],
        ["recover", str(tmp_path / "none.mcap"), "-o", str(tmp_path / "out.mcap")],
    ):
        assert main(arguments) == 2
        said = capsys.readouterr().err
        assert said.startswith("rigtwin: ")
        assert said.count("\n") == 1
    with pytest.raises(RecordingError):
        info(tmp_path / "none.mcap")
