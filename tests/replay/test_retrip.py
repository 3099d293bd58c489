"""What other limits would have done: against the same question answered by hand on the recorded arrays."""

import json

import numpy as np
import pytest

from daq.recording import Recording
from daq.rig import RigError
from recordings.reference import REFERENCES
from replay.retrip import retrip
from rigtwin.cli import main

BALL = REFERENCES[0].path
LEVEL, PERSISTENCE = 25.0, 10


@pytest.fixture(scope="module")
def force():
    """Resultant of the four transducers, N."""
    with Recording(BALL) as recording:
        top, bottom, left, right = recording.series(
            "block", ("force_top", "force_bottom", "force_left", "force_right")
        ).samples
    return np.hypot(right - left, top - bottom)


def first_trip(force, level):
    """Sample on which a level has been exceeded for the persistence."""
    run = 0
    for sample, value in enumerate(force):
        run = run + 1 if value > level else 0
        if run == PERSISTENCE:
            return sample
    return None


def test_a_lower_limit_trips_where_the_samples_say(force):
    answer = retrip(BALL, settings=[f"limits.force.trip={LEVEL}", f"limits.force.warn={LEVEL}"])
    assert answer.recorded.trips == []
    assert answer.other.trips[0].sample == first_trip(force, LEVEL)
    assert answer.other.trips[0].cause == "force"
    assert answer.other.peaks["force"] == pytest.approx(force.max(), rel=1e-5)


def test_a_level_just_above_the_largest_value_does_not_trip(force):
    limit = float(force.max()) * 1.0001
    answer = retrip(BALL, settings=[f"limits.force.trip={limit}", f"limits.force.warn={limit}"])
    assert (answer.other.trips, answer.other.warnings) == ([], [])


def test_limits_come_from_a_file(tmp_path, capsys, force):
    path = tmp_path / "strict.toml"
    path.write_text(f"[limits.force]\nwarn = 10.0\ntrip = {LEVEL}\n", encoding="utf-8")
    assert main(["retrip", str(BALL), "--limits", str(path), "--json"]) == 1
    said = json.loads(capsys.readouterr().out)
    assert said["other"]["trips"][0]["sample"] == first_trip(force, LEVEL)
    assert said["recorded"]["trips"] == []


def test_what_the_recording_was_made_with_trips_nothing(capsys):
    assert main(["retrip", str(BALL)]) == 0
    assert capsys.readouterr().out.startswith("the recorded limits do not trip; 0 warnings\n")


def test_limits_that_cannot_be_are_refused(tmp_path):
    path = tmp_path / "other.toml"
    path.write_text("[rotor]\nmass = 1.0\n", encoding="utf-8")
    with pytest.raises(RigError, match=r"has no table \[limits.displacement\]"):
        retrip(BALL, path)
    path.write_text("[limits.force]\nwarn = 500.0\n", encoding="utf-8")
    with pytest.raises(RigError, match="warn = 500 is above trip = 400"):
        retrip(BALL, path)
