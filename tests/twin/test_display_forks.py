"""A fork in the picture of the recording that it comes from."""

from pathlib import Path

import numpy as np
import pytest

from daq.describe import run_of_fork
from daq.recording import RecordingError, RecordingWriter
from daq.rig import load_rig
from tests.twin.display_process import (
    complaints,
    headless_viewer,
    newest_time,
    pixels_of,
    view_names,
    wait_until,
)
from tests.twin.drawn_run import description, messages, motion
from tests.twin.test_display import VIEWS
from twin.display_data import BIN
from twin.display_look import FORKS, MEASURED
from twin.display_recording import pictures, save_recording

RIG = load_rig("thesis-ball")
LEAVES = 2.0  # s at which the fork leaves the run
END = 3.0
AHEAD = 0.7  # s: the fork's orbit is larger
RATE = RIG.acquisition.rate


@pytest.fixture(scope="module")
def source(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("forks") / "run.mcap"
    with RecordingWriter(path, description(RIG, "run", "EMULATED")) as writer:
        for message in messages(RIG, "run", END):
            writer.add(*message)
    return path


@pytest.fixture(scope="module")
def fork(source) -> Path:
    first = int(LEAVES * RATE)
    told = description(RIG, run_of_fork("run", first), "EMULATED")
    told.first_sample = first
    path = source.with_name("hit.mcap")
    with RecordingWriter(path, told) as writer:
        writer.note("fork", {"source": source.name, "sample": str(first), "changes": "command.hit=20"})
        for message in messages(RIG, told.run, END, LEAVES, AHEAD):
            writer.add(*message)
    return path


def test_rerun_s_own_reader_finds_both_in_one_recording_on_one_time_axis(source, fork, tmp_path):
    drawn = tmp_path / "both.rrd"
    save_recording([fork, source], drawn)
    chunk = pytest.importorskip("rerun.chunk")
    reader = chunk.RrdReader(drawn)
    assert len(reader.recordings()) == 1
    for place, label, begin, ahead in (("", "", 0.0, 0.0), ("fork1/", "hit: ", LEAVES, AHEAD)):
        path = f"/plots/displacement/{place}measured"
        pieces = [piece for piece in reader.stream().to_chunks() if piece.entity_path == path]
        times, values = scalars([piece for piece in pieces if not piece.is_static])
        assert times[0] == pytest.approx(begin)
        assert times[-1] == pytest.approx(END - BIN)
        # The mean over a bin of 2 ms is the value in its middle, but for 0.3 % at 10 Hz.
        middle = motion(times + BIN / 2 + ahead)
        assert values[:, 0] == pytest.approx(1e6 * middle.x, abs=5.0)
        assert values[:, 1] == pytest.approx(1e6 * middle.y, abs=5.0)
        (style,) = [piece.to_record_batch() for piece in pieces if piece.is_static]
        names = [name for rows in column(style, "names") for name in rows]
        assert [name.replace(" measured", "") for name in names] == [f"{label}x", f"{label}y"]
    paths = {piece.entity_path for piece in reader.stream().to_chunks()}
    for drawn_there in (
        "/orbit/fork1/measured",
        "/plots/force/fork1/twin",
        "/plots/speed/fork1",
        "/regime/fork1",
    ):
        assert drawn_there in paths


def scalars(pieces) -> tuple[np.ndarray, np.ndarray]:
    """Times (n,) in s and values (n, lines) of one entity, in order."""
    times: list[float] = []
    values: list[list[float]] = []
    for piece in pieces:
        batch = piece.to_record_batch()
        times += [each.total_seconds() for each in batch.column("time").to_pylist()]
        values += column(batch, "scalars")
    order = np.argsort(times)
    return np.array(times)[order], np.array(values)[order]


def column(batch, component: str) -> list:
    """The values of the one column of a component."""
    (name,) = [name for name in batch.schema.names if name.endswith(f":{component}")]
    return batch.column(name).to_pylist()


@pytest.mark.needs_viewer
def test_the_viewer_shows_both_in_colours_of_their_own_and_complains_of_nothing(source, fork, tmp_path):
    drawn = tmp_path / "both.rrd"
    save_recording([source, fork], drawn)
    with headless_viewer(str(drawn)) as (client, _):
        wait_until(lambda: newest_time(client) > END - 0.1, "both")
        client.set_time(timeline="time", duration=END - 0.1, play_state="paused")
        wait_until(lambda: view_names(client) == VIEWS | {"hit"}, "the views")
        wait_until(lambda: pixels_of(client.take_screenshot(), FORKS[0][0]) > 500, "the fork")
        picture = client.take_screenshot()
        assert len(client.get_state().recordings) == 1
        assert complaints(client) == []
    assert pixels_of(picture, MEASURED) > 500


def test_only_forks_share_a_picture(source, fork, tmp_path):
    assert pictures([fork, source, source]) == [[source, fork], [source]]
    assert pictures([fork, fork]) == [[fork, fork]]
    with pytest.raises(RecordingError, match=r"run\.mcap is no fork of .*run\.mcap: save each alone"):
        save_recording([source, source], tmp_path / "none.rrd")
    assert not (tmp_path / "none.rrd").exists()
