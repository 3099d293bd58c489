"""Other programs' files become recordings that are replayed and twinned as live ones."""

from math import tau
from pathlib import Path

import numpy as np
import pytest

from daq.recording import Recording, RecordingError, RecordingWriter
from daq.rig import RigError, load_rig
from recordings.reference import REFERENCES
from replay.channel_map import load_map
from replay.export import export
from replay.importing import import_file
from replay.rerun import estimate
from rigtwin.cli import main
from tests.daq.recorded_run import NAMES, RATE, T0_NS, Maker, description
from tests.end_to_end.rig_process import rigtwin

RIG = load_rig("thesis-ball")
BALL = REFERENCES[0].path
SAME = load_map(None, RIG.channels)
CONSTANT = [name for name in RIG.channels.names if name not in ("proximity_x", "encoder_angle")]


def write_map(folder: Path, text: str, constant: list[str] = CONSTANT) -> Path:
    """A map of `text` and of constant values for the other channels."""
    rows = [f'[[channel]]\nname = "{name}"\nvalue = 0.0\n' for name in constant]
    (folder / "map.toml").write_text("\n".join([text, *rows]), encoding="utf-8")
    return folder / "map.toml"


LAB = """
rate = 25000.0
start = 2026-05-01T14:00:00+02:00
delimiter = ";"
decimal = ","
[[channel]]
name = "proximity_x"
source = "Probe X"
unit = "µm"
offset = 100.0
[[channel]]
name = "encoder_angle"
source = "Angle"
unit = "deg"
"""


def lab_file(folder: Path, rows: list[list[str]], header: str = "Probe X;Angle") -> Path:
    (folder / "lab.csv").write_text("\n".join([header, *(";".join(row) for row in rows)]) + "\n")
    return folder / "lab.csv"


@pytest.mark.parametrize("suffix", [".tdms", ".h5", ".csv"])
def test_what_was_exported_comes_back_to_the_last_bit_and_is_twinned(suffix, tmp_path):
    lab = export(BALL, tmp_path / f"lab{suffix}").path
    account = import_file(lab, tmp_path / "back.mcap", RIG, SAME)
    assert (account.lost, account.clean) == (0, True)
    with Recording(BALL) as before, Recording(tmp_path / "back.mcap") as back:
        assert back.check().verdict == "valid"
        assert back.description.mode == "IMPORTED"
        # The start in TDMS comes back to the microsecond.
        assert abs(back.description.t0_ns - before.description.t0_ns) < 1000
        np.testing.assert_array_equal(back.series().samples, before.series().samples)
        summaries = [topic for topic in before.topics() if "/daq/summary" in topic]
        for topic in summaries:
            assert len(list(back.messages(topic))) == len(list(before.messages(topic)))
    if suffix == ".tdms":
        estimate(tmp_path / "back.mcap", tmp_path / "twinned.mcap")
        with Recording(tmp_path / "twinned.mcap") as twinned, Recording(BALL) as before:
            found, live = twinned.series("estimate"), before.series("estimate")
        np.testing.assert_allclose(found["normal_force"], live["normal_force"], atol=1e-3)
        assert found["normal_force"].max() > 10.0


def test_gaps_come_back_as_gaps(tmp_path):
    make = Maker()
    with RecordingWriter(tmp_path / "gap.mcap", description()) as writer:
        for number in (0, 1, 4, 5):
            writer.add(*make.block(number))
        writer.add(*make.end(6))
    names = [name for name in RIG.channels.names if name not in NAMES]
    rows = [f'[[channel]]\nname = "{name}"\nsource = "{name}"\n' for name in NAMES]
    channel_map = load_map(write_map(tmp_path, "\n".join(rows), names), RIG.channels)
    lab = export(tmp_path / "gap.mcap", tmp_path / "lab.h5").path
    account = import_file(lab, tmp_path / "back.mcap", RIG, channel_map)
    assert account.gaps == ((500, 999),)
    with Recording(tmp_path / "gap.mcap") as before, Recording(tmp_path / "back.mcap") as back:
        np.testing.assert_array_equal(
            back.series("block", NAMES).samples, before.series("block", NAMES).samples
        )
        assert back.check().verdict == "incomplete"
        assert [event.kind for event in back.events()] == ["start", "gap", "end"]
        assert (back.description.t0_ns, back.description.rate) == (T0_NS, RATE)


def test_a_map_converts_units_and_says_when(tmp_path):
    rows = [["100,5", "359"], ["99,5", "361"], ["", "0"], ["101", "-1"]]
    channel_map = load_map(write_map(tmp_path, LAB), RIG.channels)
    account = import_file(lab_file(tmp_path, rows), tmp_path / "lab.mcap", RIG, channel_map)
    assert account.gaps == ((2, 2),)
    with Recording(tmp_path / "lab.mcap") as recording:
        signals = recording.series("block", ["proximity_x", "encoder_angle", "force_top"])
        assert recording.description.t0_ns == 1_777_636_800 * 10**9  # 12:00 UTC
        assert recording.description.t0_source == "channel map"
        assert recording.notes["imported"]["source"] == "lab.csv"
        assert 'source = "Probe X"' in recording.notes["imported"]["map"]
    np.testing.assert_allclose(signals["proximity_x"], [0.5e-6, -0.5e-6, np.nan, 1e-6], rtol=1e-6)
    turn = tau / 360
    np.testing.assert_allclose(signals["encoder_angle"], [359 * turn, turn, np.nan, 359 * turn], rtol=1e-6)
    assert not signals["force_top"][:2].any()


def test_the_replay_runs_on_an_imported_file(tmp_path):
    lab = export(BALL, tmp_path / "lab.tdms").path
    done = rigtwin("import", lab, "--rig", "thesis-ball", "-o", "run.mcap", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "34600 samples, 0 lost, certificate valid" in done.stdout
    played = rigtwin("replay", "run.mcap", "--rate", "0.5", "--view", "none", cwd=tmp_path)
    assert played.returncode == 0, played.stdout + played.stderr
    assert "regime: bouncing" in played.stdout


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (LAB.replace("proximity_x", "proximity_z"), "proximity_z is not a channel of the rig; did you mean"),
        (
            LAB.replace("µm", "inch"),
            'unit = "inch" is no unit of displacement: write one of m, mm',
        ),
        (LAB.replace('unit = "deg"', "scale = 0.0"), "encoder_angle scale = 0 must not be 0"),
        (LAB.replace('unit = "deg"', 'unit = "deg"\nscale = 1.0'), "has both unit and scale"),
        (LAB.replace('source = "Angle"', ""), "encoder_angle needs either a source"),
        (LAB.replace("rate =", "rat ="), "rat is not a key of this table; did you mean rate"),
        (LAB.replace("+02:00", ""), "start = 2026-05-01 14:00:00 must be a date and time with its zone"),
        (LAB.replace('";"', '"ab"'), 'delimiter = "ab" must be one character'),
        (LAB + '[[channel]]\nname = "proximity_x"\nvalue = 1.0', "proximity_x stands there twice"),
        ("rate = 1.0\n", r"\[\[channel\]\] proximity_x of the rig is missing: give it a source"),
    ],
)
def test_a_wrong_map_is_said_with_its_row(text, words, tmp_path):
    with pytest.raises(RigError, match=rf"map\.toml: .*{words}"):
        load_map(write_map(tmp_path, text), RIG.channels)


@pytest.mark.parametrize(
    ("changes", "rows", "words"),
    [
        ({}, [["1", "text"]], r"lab\.csv: .*invalid value 'text'"),
        ({}, [["1"]], r"lab\.csv: .*Expected 2 columns"),
        ({}, [], "there are no samples"),
        ({"Probe X": "Probe"}, [["1", "2"]], r"no column 'Probe'; did you mean Probe X"),
        ({"rate = 25000.0": "rate = 51200.0"}, [["1", "2"]], "has 51200 samples a second, thesis-ball 25000"),
        ({"rate = 25000.0": ""}, [["1", "2"]], "does not say its sample rate: write rate or time"),
        (
            {"rate = 25000.0": 'time = "Angle"'},
            [["0", "0"], ["0", "0,00004"], ["0", "0,00012"]],
            r"sample 2 stands at 0\.00012 s, which does not fit 25000 samples a second",
        ),
    ],
)
def test_a_file_that_does_not_fit_is_said_and_leaves_nothing(changes, rows, words, tmp_path):
    text = LAB
    for old, new in changes.items():
        text = text.replace(old, new)
    channel_map = load_map(write_map(tmp_path, text), RIG.channels)
    lab_file(tmp_path, rows)
    before = sorted(tmp_path.iterdir())
    with pytest.raises(RecordingError, match=words):
        import_file(tmp_path / "lab.csv", tmp_path / "out.mcap", RIG, channel_map)
    assert sorted(tmp_path.iterdir()) == before


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("none.csv", "no such file"),
        ("lab.xlsx", "the suffix '.xlsx' cannot be imported: choose of .tdms, .h5"),
        ("text.tdms", "is not readable as TDMS"),
        ("text.h5", "is not readable as HDF5"),
        ("empty.csv", "there is no line of names"),
    ],
)
def test_what_is_no_such_file_is_one_line(name, words, tmp_path, capsys):
    for each in ("text.tdms", "text.h5"):
        (tmp_path / each).write_text("text, for too long to be a head of anything")
    (tmp_path / "empty.csv").write_text("")
    arguments = ["import", str(tmp_path / name), "--rig", "thesis-ball", "-o", str(tmp_path / "out.mcap")]
    assert main(arguments) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert words in said


def test_columns_of_one_name_must_be_told_apart(tmp_path):
    import h5py

    with h5py.File(tmp_path / "lab.h5", "w") as file:
        for group in ("a", "b"):
            for name in RIG.channels.names:
                file[f"{group}/{name}"] = np.zeros(10)
        file["a"].attrs["rate_hz"] = 25000.0
    with pytest.raises(RecordingError, match="'proximity_x' can be a/proximity_x or b/proximity_x"):
        import_file(tmp_path / "lab.h5", tmp_path / "out.mcap", RIG, SAME)
