"""Recordings scaled anew: against the arithmetic on their arrays, and what must stay as it was."""

import json

import numpy as np
import pytest

from daq import keys
from daq.messages_pb2 import ChannelSummary
from daq.recording import Recording
from daq.rig import RigError, load_rig, rig_from_text
from recordings.reference import REFERENCES
from replay.recalibrate import recalibrate
from rigtwin.cli import main

BALL = REFERENCES[0].path
NEW = [
    "channel.proximity_x.sensitivity=-2600",
    "channel.force_top.offset=0.4",
    "channel.force_top.due=2031-05-01",
]


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    path = tmp_path_factory.mktemp("recalibrated") / "new.mcap"
    recalibrate(BALL, load_rig("thesis-ball", NEW), path)
    return path


def test_values_follow_from_the_raw_readings(made):
    with Recording(BALL) as before, Recording(made) as after:
        old, new = before.series(), after.series()
    assert new.samples.shape == old.samples.shape
    raw = 2500.0 * old.samples[0].astype(float)
    np.testing.assert_allclose(new.samples[0], raw / -2600.0, rtol=1e-6)
    raw = 0.02 * old.samples[2].astype(float)
    np.testing.assert_allclose(new.samples[2], (raw - 0.4) / 0.02, rtol=1e-5, atol=1e-5)
    for row in (1, 3, 4, 5, 6, 7, 8, 9, 10):
        np.testing.assert_array_equal(new.samples[row], old.samples[row])


def test_what_was_made_of_them_is_made_anew_and_the_rest_stays(made):
    with Recording(BALL) as before, Recording(made) as after:
        events = keys.event("thesis-ball", "daq")
        assert [m.payload for m in after.messages(events)] == [m.payload for m in before.messages(events)]
        assert not any("/twin/" in topic for topic in after.topics())
        key = keys.channel_summary("thesis-ball", "force_top")
        first = ChannelSummary.FromString(next(after.messages(key)).payload)
        held = after.series("block", ["force_top"]).samples[0][first.first_sample :][: first.n_samples]
        assert first.mean == pytest.approx(held.mean(dtype=float))
        rig = rig_from_text(after.rig_toml)
        assert rig.channels["proximity_x"].sensitivity == -2600.0
        assert rig.channels["force_top"].due.year == 2031
        assert rig.limits == rig_from_text(before.rig_toml).limits
        told = json.loads(after.notes["recalibrated"]["channels"])
        assert told["proximity_x"] == {"sensitivity": [2500.0, -2600.0]}
        assert told["force_top"] == {"offset": [0.0, 0.4], "due": [None, "2031-05-01"]}
        assert after.check().verdict == "valid"


def test_there_and_back_gives_the_same_values(made, tmp_path):
    recalibrate(made, load_rig("thesis-ball"), tmp_path / "back.mcap")
    with Recording(BALL) as before, Recording(tmp_path / "back.mcap") as after:
        np.testing.assert_allclose(after.series().samples, before.series().samples, rtol=1e-6, atol=1e-5)


def test_descriptions_that_do_not_fit_are_refused(tmp_path):
    with pytest.raises(RigError, match="nothing to do"):
        recalibrate(BALL, load_rig("thesis-ball"), tmp_path / "same.mcap")
    text = (
        load_rig("thesis-ball")
        .toml.replace('"solenoid_current"', '"coil_current"')
        .replace('backend = "emulator"', 'backend = "card"')
    )
    other = rig_from_text(text)
    with pytest.raises(RigError, match="has no channel solenoid_current, which the recording has"):
        recalibrate(BALL, other, tmp_path / "other.mcap")
    assert not list(tmp_path.iterdir())


def test_the_command_writes_it_and_leaves_the_original(tmp_path, capsys):
    rig, out = tmp_path / "new.toml", tmp_path / "out.mcap"
    rig.write_text(
        '[rig]\nbase = "thesis-ball"\nname = "new"\n[[channel]]\nname = "force_left"\noffset = 0.1\n'
    )
    before = BALL.read_bytes()
    assert main(["rig", "recalibrate", str(BALL), "--rig", str(rig), "-o", str(out)]) == 0
    assert "out.mcap" in capsys.readouterr().out
    assert BALL.read_bytes() == before
    assert main(["rig", "recalibrate", str(BALL), "--rig", str(rig), "-o", str(out)]) == 2
