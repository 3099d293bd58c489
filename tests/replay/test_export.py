"""Exports, each read back by its format's own library and compared with the recording sample by sample."""

import csv
import json
import sys
from datetime import UTC, datetime
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

from daq.recording import Recording, RecordingError, RecordingWriter
from replay.export import export
from replay.formats import FORMATS
from replay.formats.matlab import variables
from replay.pieces import WINDOW, Stretch
from rigtwin.cli import main
from tests.daq.recorded_run import BLOCK, NAMES, RATE, T0_NS, UNITS, Maker, description, record, samples

BLOCKS = 1100  # two pieces and a little
GAP = (2 * BLOCK, 4 * BLOCK - 1)
LONG_GAP = (6 * BLOCK, 1098 * BLOCK - 1)  # longer than a piece
FIRST = 5 * BLOCK + 3  # of a part, in the middle of a block
EVERY = pytest.mark.parametrize("suffix", [row.suffix for row in FORMATS])


@pytest.fixture(scope="module")
def recorded(tmp_path_factory) -> Path:
    """A run of two pieces' length without loss."""
    path = tmp_path_factory.mktemp("recorded") / "run.mcap"
    record(path, BLOCKS)
    return path


@pytest.fixture(scope="module")
def with_gaps(tmp_path_factory) -> Path:
    """The same with two gaps, and a block that was recorded late."""
    path = tmp_path_factory.mktemp("gaps") / "run.mcap"
    make = Maker()
    with RecordingWriter(path, description()) as writer:
        for number in (0, 4, 1, 5, 1098, 1099):
            writer.add(*make.block(number))
        writer.add(*make.end(BLOCKS))
    return path


def expected(last: int = BLOCKS * BLOCK, gaps: tuple[tuple[int, int], ...] = ()) -> np.ndarray:
    values = samples(0, len(NAMES), last)
    for first, end in gaps:
        values[:, first : end + 1] = np.nan
    return values


# Readers: each returns the channels as rows and what the file says of them, read by the format's library.


def read_tdms(path):
    from nptdms import TdmsFile

    group = TdmsFile.read(path)["block"]
    channels = group.channels()
    properties = channels[2].properties
    assert properties["wf_increment"] == 1 / RATE
    return {
        "names": [channel.name for channel in channels],
        "samples": np.array([channel[:] for channel in channels]),
        "unit": properties["unit_string"],
        "station": properties["station_m"],
        "angle": properties["angle_deg"],
        "rate": 1 / properties["wf_increment"],
        "start_ns": int(properties["wf_start_time"].astype("datetime64[ns]").astype(int)),
        "gaps": json.loads(group.properties["gaps"]),
    }


def read_h5(path):
    import h5py

    with h5py.File(path) as file:
        group = file["block"]
        names = list(group)
        attributes = group["force_top"].attrs
        return {
            "names": names,
            "samples": np.array([group[name][:] for name in names]),
            "unit": attributes["unit"],
            "station": attributes["station_m"],
            "angle": attributes["angle_deg"],
            "rate": group.attrs["rate_hz"],
            "start_ns": ns(group.attrs["start"]),
            "gaps": file["gaps"][:].tolist(),
        }


def read_mf4(path):
    from asammdf import MDF

    with MDF(path) as file:
        signals = list(file.iter_channels())
        np.testing.assert_allclose(np.diff(signals[0].timestamps), 1 / RATE, rtol=1e-6)
        assert signals[0].timestamps[0] == 0.0
        said = json.loads(signals[2].comment)
        header = json.loads(ElementTree.fromstring(file.header.comment).findtext("TX"))
        return {
            "names": [signal.name for signal in signals],
            "samples": np.array([signal.samples for signal in signals]),
            "unit": signals[2].unit,
            "station": said["station_m"],
            "angle": said["angle_deg"],
            "rate": header["rate_hz"],
            "start_ns": file.header.abs_time,
            "gaps": header["gaps"],
        }


def read_mat(path):
    from scipy.io import loadmat

    found = loadmat(path, simplify_cells=True)
    about = found.pop("about")
    names = [name for name in found if not name.startswith("__")]
    return {
        "names": names,
        "samples": np.array([found[name] for name in names]),
        "unit": about["unit"]["force_top"],
        "station": about["station_m"]["force_top"],
        "angle": about["angle_deg"]["force_top"],
        "rate": about["rate_hz"],
        "start_ns": ns(about["start"]),
        "gaps": about["gaps"].reshape(-1, 2).tolist(),
    }


def read_uff(path):
    import pyuff

    sets = pyuff.UFF(str(path)).read_sets()
    force = sets[2]
    place = force["id1"].split()
    assert force["abscissa_axis_units_lab"] == "s"
    assert (force["func_type"], force["ordinate_spec_data_type"], force["rsp_dir"]) == (1, 13, 2)
    assert [each["rsp_node"] for each in sets] == list(range(1, len(sets) + 1))
    missing = force["id4"].removeprefix("missing samples: ").split()
    return {
        "names": [each["ordinate_axis_lab"] for each in sets],
        "samples": np.array([each["data"] for each in sets], np.float32),
        "unit": force["ordinate_axis_units_lab"],
        "station": float(place[2].rstrip(",")),
        "angle": float(place[4]),
        "rate": 1 / force["abscissa_inc"],
        "start_ns": ns(force["id3"]),
        "gaps": [list(map(int, gap.split("-"))) for gap in missing if gap != "none"],
    }


def read_parquet(path):
    from pyarrow import parquet

    table = parquet.read_table(path)
    field = table.schema.field("force_top").metadata
    metadata = parquet.read_metadata(path).metadata
    assert table.column_names[0] == "time"
    np.testing.assert_array_equal(table["time"], np.arange(len(table)) / RATE)
    return {
        "names": table.column_names[1:],
        "samples": np.array([column.to_numpy() for column in table.columns[1:]]),
        "unit": field[b"unit"].decode(),
        "station": float(field[b"station_m"]),
        "angle": float(field[b"angle_deg"]),
        "rate": float(metadata[b"rate_hz"]),
        "start_ns": ns(metadata[b"start"].decode()),
        "gaps": json.loads(metadata[b"gaps"]),
    }


def read_wav(path):
    from scipy.io import wavfile

    rate, frames = wavfile.read(path)
    said = path.read_bytes().rpartition(b"ICMT")[2][4:]
    comment = json.loads(said.rstrip(b"\0"))
    channels = comment["channels"]
    assert np.abs(frames[:, 2:]).max() <= 1.0  # the forces, which stay within their transducers' range
    values = frames.T * np.array([channel["scale"] for channel in channels], np.float32)[:, None]
    for first, last in comment["gaps"]:  # silence in the file
        assert not values[:, first : last + 1].any()
        values[:, first : last + 1] = np.nan
    return {
        "names": [channel["name"] for channel in channels],
        "samples": values,
        "unit": channels[2]["unit"],
        "station": channels[2]["station_m"],
        "angle": channels[2]["angle_deg"],
        "rate": rate,
        "start_ns": ns(comment["start"]),
        "gaps": comment["gaps"],
    }


def read_csv(path):
    lines = path.read_text().splitlines()
    said = dict(line[2:].split(": ", 1) for line in lines if line.startswith("#"))
    rows = list(csv.reader(line for line in lines if not line.startswith("#")))
    values = np.array([[float(field or "nan") for field in row] for row in rows[1:]])
    np.testing.assert_array_equal(values[:, 0], np.arange(len(values)) / RATE)
    force = json.loads(said["channel force_top"])
    assert rows[0][3] == "force_top [N]"
    return {
        "names": [label.partition(" ")[0] for label in rows[0][1:]],
        "samples": values[:, 1:].T.astype(np.float32),
        "unit": force["unit"],
        "station": force["station_m"],
        "angle": force["angle_deg"],
        "rate": float(said["rate_hz"]),
        "start_ns": ns(said["start"]),
        "gaps": empty_lines(values[:, 1:]),
    }


def empty_lines(rows: np.ndarray) -> list[list[int]]:
    """First and last of the lines that have no value."""
    edges = np.flatnonzero(np.diff(np.isnan(rows).all(axis=1).astype(int), prepend=0, append=0))
    return [[int(first), int(end) - 1] for first, end in edges.reshape(-1, 2)]


def ns(text: str) -> int:
    return int(np.datetime64(text.strip().removesuffix("Z"), "ns").astype(int))


READERS = {
    ".tdms": read_tdms,
    ".h5": read_h5,
    ".mf4": read_mf4,
    ".mat": read_mat,
    ".uff": read_uff,
    ".parquet": read_parquet,
    ".wav": read_wav,
    ".csv": read_csv,
}


@EVERY
def test_every_sample_comes_back_with_units_rate_start_and_places(suffix, tmp_path, recorded):
    written = export(recorded, tmp_path / f"run{suffix}")
    assert (written.samples, written.channels, written.gaps) == (BLOCKS * BLOCK, len(NAMES), [])
    found = READERS[suffix](written.path)
    order = [found["names"].index(name) for name in NAMES]  # HDF5 sorts them
    # Equal to the last bit: all formats hold single precision, text the digits that give it back.
    np.testing.assert_array_equal(found["samples"][order], expected())
    assert (found["unit"], found["station"], found["angle"]) == ("N", 0.211, 90.0)
    assert found["rate"] == pytest.approx(RATE, rel=1e-12)
    # TDMS counts in 2**-64 s, which npTDMS gives to the microsecond.
    assert abs(found["start_ns"] - T0_NS) < (1000 if suffix == ".tdms" else 1)
    assert found["gaps"] == []


@EVERY
def test_gaps_stay_gaps(suffix, tmp_path, with_gaps):
    written = export(with_gaps, tmp_path / f"run{suffix}")
    assert written.gaps == [GAP, LONG_GAP]
    found = READERS[suffix](written.path)
    order = [found["names"].index(name) for name in NAMES]
    np.testing.assert_array_equal(found["samples"][order], expected(gaps=(GAP, LONG_GAP)))
    assert found["gaps"] == [list(GAP), list(LONG_GAP)]


def test_a_long_recording_is_taken_in_pieces(recorded, with_gaps):
    """What is in memory at a time is bounded, however long the recording or a gap in it."""
    for path in (recorded, with_gaps):
        with Stretch(path) as stretch:
            pieces = list(stretch.pieces())
        assert len(pieces) > 2
        assert max(piece.samples.shape[1] for piece in pieces) <= WINDOW + BLOCK
        firsts = [piece.first_sample for piece in pieces]
        assert firsts == [0, *np.cumsum([piece.samples.shape[1] for piece in pieces])[:-1]]


def test_some_channels_of_a_part(tmp_path, recorded):
    names = ["force_left", "proximity_y"]
    written = export(recorded, tmp_path / "part.h5", names=names, first=FIRST, last=FIRST + 999)
    found = read_h5_part(written.path)
    assert (written.samples, sorted(found["names"])) == (1000, names)
    for name in names:
        row = expected()[NAMES.index(name), FIRST : FIRST + 1000]
        np.testing.assert_array_equal(found["samples"][found["names"].index(name)], row)
    assert found["start_ns"] == T0_NS + FIRST * 40_000  # ns a sample
    assert found["first_sample"] == FIRST


def read_h5_part(path):
    import h5py

    with h5py.File(path) as file:
        group = file["block"]
        return {
            "names": list(group),
            "samples": [group[name][:] for name in group],
            "start_ns": ns(group.attrs["start"]),
            "first_sample": group.attrs["first_sample"],
        }


def test_the_twin_s_estimates_have_their_own_rate(tmp_path, recorded):
    from pyarrow import parquet

    written = export(recorded, tmp_path / "twin.parquet", series="estimate", first=7)
    assert written.rate == RATE / 5
    table = parquet.read_table(written.path)
    with Recording(recorded) as recording:
        signals = recording.series("estimate", first=7)
    np.testing.assert_array_equal(table["time"], signals.time)
    np.testing.assert_array_equal(table["unbalance_x"], signals["unbalance_x"])


def test_continuations_are_taken_along(tmp_path):
    make = Maker()
    with RecordingWriter(tmp_path / "run.mcap", description()) as writer:
        for number in range(3):
            writer.add(*make.block(number))
    with RecordingWriter(tmp_path / "run.part2.mcap", description(first_sample=750), part=2) as writer:
        for number in range(3, 6):
            writer.add(*make.block(number))
        writer.add(*make.end(6))
    written = export(tmp_path / "run.mcap", tmp_path / "run.csv")
    np.testing.assert_array_equal(read_csv(written.path)["samples"], expected(6 * BLOCK))


def test_a_recording_that_was_cut_off_is_exported_as_far_as_it_goes(tmp_path, recorded, capsys):
    content = recorded.read_bytes()
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(content[: len(content) * 2 // 3])
    assert main(["export", str(cut), "-o", str(tmp_path / "cut.tdms")]) == 0
    assert "cut off" in capsys.readouterr().out
    found = read_tdms(tmp_path / "cut.tdms")
    size = found["samples"].shape[1]
    assert size > BLOCKS * BLOCK // 2
    np.testing.assert_array_equal(found["samples"], expected(size))


def test_the_command_tells_what_it_wrote_and_what_is_missing(tmp_path, with_gaps, capsys):
    options = ["--channels", "force_top,force_left", "--from", "0.02", "--to", "0.06"]
    assert main(["export", str(with_gaps), "-o", str(tmp_path / "run.wav"), *options]) == 0
    said = capsys.readouterr().out.splitlines()
    # Samples 500 to 999 are missing, so that the part begins behind them.
    assert said == [f"{tmp_path / 'run.wav'}: 2 channels of 0.020 s at 25000 Hz, 0.0 MB"]
    assert main(["export", str(with_gaps), "-o", str(tmp_path / "all.wav")]) == 0
    assert f"samples {GAP[0]} to {GAP[1]} are missing" in capsys.readouterr().out


@EVERY
def test_an_interrupted_export_leaves_nothing(suffix, tmp_path, recorded):
    def interrupt(sample):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        export(recorded, tmp_path / f"run{suffix}", progress=interrupt)
    assert list(tmp_path.iterdir()) == []


def test_nothing_is_overwritten(tmp_path, recorded):
    (tmp_path / "run.csv").write_text("mine")
    with pytest.raises(RecordingError, match=r"run\.csv exists already"):
        export(recorded, tmp_path / "run.csv")
    assert (tmp_path / "run.csv").read_text() == "mine"


@pytest.mark.parametrize(
    ("target", "options", "words"),
    [
        ("run.xlsx", {}, r"run\.xlsx: the suffix '\.xlsx' is no format to export to: choose of \.tdms, \.h5"),
        ("run.csv", {"names": ["force_tip"]}, "block has no channel 'force_tip': it has proximity_x, "),
        (
            "run.csv",
            {"series": "blocks"},
            "no series is named 'blocks': there are block, estimate, smoothed, truth",
        ),
        ("run.csv", {"first": 10**6}, "no samples of block from index 1000000 to"),
    ],
)
def test_what_cannot_be_exported_is_said_in_one_line(target, options, words, tmp_path, recorded):
    with pytest.raises(RecordingError, match=words):
        export(recorded, tmp_path / target, **options)
    assert list(tmp_path.iterdir()) == []


def test_a_missing_package_is_named_with_its_extra(tmp_path, recorded, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "h5py", None)
    assert main(["export", str(recorded), "-o", str(tmp_path / "run.h5")]) == 2
    assert capsys.readouterr().err == "rigtwin: HDF5 needs the package h5py: pip install 'rigtwin[export]'\n"
    assert list(tmp_path.iterdir()) == []


def test_matlab_gets_names_that_it_allows():
    from replay.formats.head import Column, Head

    columns = [Column(name, "V") for name in ("a.b", "a-b", "1st", "_x", "y")]
    head = Head("rig", "run", "LIVE", "block", 0, 1, 1.0, 0, tuple(columns))
    assert variables(head) == ["a_b", "a_b_1", "c_1st", "c__x", "y"]


def test_the_start_is_the_recording_s():
    assert datetime.fromtimestamp(T0_NS // 10**9, UTC).isoformat() == "2027-01-15T08:00:00+00:00"
    assert ns("2027-01-15T08:00:00.123456789Z") == T0_NS
    assert UNITS[2] == "N"
