"""The catalogue of recordings: what it lists, chooses and compares, and how little it reads for that."""

import json
from datetime import date
from pathlib import Path

import pytest

from daq.recording import Recording, RecordingError, RecordingWriter, recover
from daq.recording.notes import add_note
from daq.recording.overview import RECORD, Overview
from recordings.reference import REFERENCES
from replay.catalogue import catalogue, entry
from replay.catalogue_text import comparison, listing
from replay.selection import Selection
from rigtwin.cli import main
from tests.daq.recorded_run import BLOCK, RATE, Maker, description, record

DAY = date(2027, 1, 15)  # of the runs made by hand


def with_trip(path: Path) -> Path:
    """A run that trips, with what people told of it."""
    make = Maker()
    with RecordingWriter(path, description(meta={"operator": "anna"})) as writer:
        for number in range(4):
            writer.add(*make.block(number))
            writer.add(*make.summary(number))
        writer.add(*make.event(300, 0, "trip", cause="displacement"))
        writer.add(*make.end(6))
    return path


@pytest.fixture
def folder(tmp_path) -> Path:
    """One whole run, one with a trip, one that was cut off, and a file that is no recording."""
    record(tmp_path / "whole.mcap", blocks=20)
    with_trip(tmp_path / "tripped.mcap")
    content = (tmp_path / "whole.mcap").read_bytes()
    (tmp_path / "cut.mcap").write_bytes(content[: len(content) * 2 // 3])
    (tmp_path / "text.mcap").write_text("no")
    return tmp_path


def names(folder: Path, **wanted) -> list[str]:
    entries, _refused = catalogue([folder])
    return [each.path.stem for each in entries if Selection(**wanted).judge(each)]


def test_an_entry_tells_what_the_recording_holds(folder):
    found = entry(folder / "tripped.mcap")
    assert (found.rig, found.bearing, found.mode, found.day) == ("thesis-ball", "ball", "EMULATED", DAY)
    assert (found.duration, found.lost, found.parts) == (6 * BLOCK / RATE, 2 * BLOCK, 1)
    assert found.overview == Overview(5.0, events={"trip": 1, "end": 1}, trips=["displacement"])
    assert found.meta == {"operator": "anna"}
    assert json.loads(json.dumps(found.to_json()))["trips"] == ["displacement"]


def test_later_notes_count_too(folder):
    add_note(folder / "tripped.mcap", "bob", "looked at again", {"operator": "bob", "pins": "worn"})
    assert entry(folder / "tripped.mcap").meta == {"operator": "bob", "pins": "worn"}
    (folder / "tripped.notes.toml").write_text("no TOML")
    _entries, refused = catalogue([folder])
    assert any("tripped.notes.toml: not TOML" in reason for reason in refused)


def test_the_overview_is_that_of_the_messages(tmp_path):
    """Of a recording that has none, because it was cut off, reading it whole gives what its messages say."""
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(REFERENCES[0].path.read_bytes()[:-200_000])
    with Recording(cut) as recording:
        assert RECORD not in recording.notes
    assert entry(cut).overview is None
    read = entry(cut, whole=True).overview
    assert read is not None
    with Recording(cut) as recording:
        fastest = abs(recording.series("block", ["motor_speed"]).samples).max() / 6.283185307179586
        kinds = [event.kind for event in recording.events()]
    assert read.max_speed_hz == pytest.approx(fastest, rel=0.01)  # a block's mean, not a sample
    assert sum(read.events.values()) == len(kinds)
    assert read.events["hit"] == kinds.count("hit")


def test_a_mended_recording_tells_again(folder):
    assert entry(folder / "cut.mcap").overview is None
    recover(folder / "cut.mcap", folder / "mended.mcap")
    mended, read = entry(folder / "mended.mcap"), entry(folder / "cut.mcap", whole=True)
    assert mended.overview is not None
    assert mended.overview == read.overview
    assert mended.overview.max_speed_hz == 5.0
    assert (mended.duration, mended.lost) == (read.duration, read.lost)


def test_continuations_are_one_recording(tmp_path):
    make = Maker()
    with RecordingWriter(tmp_path / "run.mcap", description()) as writer:
        writer.add(*make.block(0))
        writer.add(*make.event(3, 0, "mark"))
    with RecordingWriter(tmp_path / "run.part2.mcap", description(first_sample=BLOCK), part=2) as writer:
        writer.add(*make.block(1))
        writer.add(*make.event(BLOCK + 3, 1, "mark"))
        writer.add(*make.end(3, 2))
    (found,), refused = catalogue([tmp_path])
    assert refused == []
    assert (found.parts, found.duration, found.lost) == (2, 3 * BLOCK / RATE, BLOCK)
    assert found.overview.events == {"mark": 2, "end": 1}


@pytest.mark.parametrize(
    ("wanted", "found"),
    [
        ({}, ["cut", "tripped", "whole"]),
        ({"rig": "thesis-pinned"}, []),
        ({"bearing": "ball"}, ["cut", "tripped", "whole"]),
        ({"since": DAY, "until": DAY}, ["cut", "tripped", "whole"]),
        ({"until": date(2027, 1, 14)}, []),
        ({"since": date(2027, 1, 16)}, []),
        ({"event": "mark"}, ["whole"]),
        ({"min_speed_hz": 5.0}, ["tripped", "whole"]),
        ({"max_speed_hz": 4.9}, []),
        ({"tripped": True}, ["tripped"]),
        ({"tripped": False}, ["whole"]),
        ({"meta": {"operator": "anna"}}, ["tripped"]),
        ({"meta": {"operator": "bob"}}, []),
    ],
)
def test_recordings_are_chosen_by_what_they_tell(folder, wanted, found):
    assert names(folder, **wanted) == found


def test_the_list_and_what_is_said_beside_it(folder, capsys):
    assert main(["recordings", str(folder), "--tripped"]) == 0
    said = capsys.readouterr()
    head, row = said.out.splitlines()
    assert head.split()[:4] == ["start", "(UTC)", "s", "rig"]
    assert row.split()[:8] == ["2027-01-15", "08:00:00", "0.1", "thesis-ball", "ball", "5.00", "1", "500"]
    assert "text.mcap is not an MCAP file" in said.err
    assert "1 more may fit, but were not closed or are older: --read reads them whole" in said.err
    assert main(["recordings", str(folder), "--event", "mark", "--read", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert [Path(each["file"]).stem for each in found] == ["cut", "whole"]
    assert main(["recordings", str(folder), "--rig", "other"]) == 1
    assert capsys.readouterr().out == "no recording fits\n"
    assert main(["recordings", str(folder / "none")]) == 2


def test_the_oldest_is_listed_first(folder):
    make = Maker("earlier")
    with RecordingWriter(folder / "zzz.mcap", description(run="earlier", t0_ns=10**18)) as writer:
        writer.add(*make.block(0))
    entries, _refused = catalogue([folder])
    assert listing(entries).splitlines()[1].endswith("zzz.mcap")


def test_recordings_stand_side_by_side_with_the_differences_of_their_rigs(folder):
    entries = [entry(reference.path) for reference in REFERENCES[:2]]
    rows = {line[:30].strip(): line for line in comparison(entries).splitlines()}
    assert rows["backup_bearing.kind"].split() == ["backup_bearing.kind", "ball", "pinned"]
    assert "backup_bearing.clearance" not in rows  # the same in both
    shown = comparison([entry(folder / "whole.mcap"), entry(folder / "tripped.mcap")])
    counts = next(line for line in shown.splitlines() if line.startswith("events trip"))
    assert counts.split() == ["events", "trip", "-", "1"]
    assert not any(line.startswith("rig.") for line in shown.splitlines())


def test_a_closed_file_is_read_at_its_ends_only(tmp_path, monkeypatch):
    record(tmp_path / "run.mcap", blocks=200)

    def unpacked(*_):
        raise AssertionError("a chunk was unpacked")

    monkeypatch.setattr("daq.recording.reader.unpack_chunk", unpacked)
    assert entry(tmp_path / "run.mcap").duration == 200 * BLOCK / RATE


def test_a_place_that_is_not_there_is_said():
    with pytest.raises(RecordingError, match="nowhere: no such file or folder"):
        catalogue([Path("nowhere")])
