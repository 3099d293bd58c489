"""A rig that is not the thesis': no model, no force, no speed channel, another rate, a card of its own."""

import os
import shutil
from pathlib import Path

import numpy as np
import pytest

from daq.recording import Recording
from daq.rig import load_rig
from tests.end_to_end.rig_process import PATIENT, Running, info, rigtwin
from twin.display_geometry import project, sensors_of

HERE = Path(__file__).parent / "foreign"
RATE = 51_200
NAMES = ("drive_left", "drive_right", "free_left", "free_right", "keyphasor")
ORBIT = 40e-6  # m, of the drive's plane; the free end's is half of it


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """The rig's description, and its backend as an installed package."""
    packages = tmp_path / "packages"
    installed = packages / "magnet_card-1.0.dist-info"
    installed.mkdir(parents=True)
    shutil.copy(HERE / "magnet_card.py", packages)
    shutil.copy(HERE / "foreign.toml", tmp_path)
    (installed / "METADATA").write_text("Metadata-Version: 2.1\nName: magnet-card\nVersion: 1.0\n")
    (installed / "entry_points.txt").write_text("[rigtwin.backends]\nmagnet-card = magnet_card:MagnetCard\n")
    paths = [str(packages), *filter(None, [os.environ.get("PYTHONPATH")])]
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(paths))
    return tmp_path


def test_a_foreign_rig_is_acquired_shown_recorded_and_replayed(folder):
    checked = rigtwin("rig", "check", "foreign.toml", cwd=folder)
    assert (checked.returncode, "foreign is valid: 9 channels at 51200 Hz" in checked.stdout) == (0, True)

    path = folder / "run.mcap"
    live = ("--rig", "foreign.toml", "--duration", "3", "--view", "web", "--record", path)
    with Running("live", *PATIENT, *live, cwd=folder) as run:
        run.wait_for("LIVE foreign")
        run.wait_for("watch it at http://127.0.0.1:")
        assert run.wait() == 0, run.said()
    assert_nothing_died(run.said())
    assert "contact" not in run.said()  # it measures none
    assert info(path)["certificate"]["verdict"] == "valid"
    assert_as_measured(path)

    with Running("view", path, cwd=folder) as run:
        run.wait_for("http://127.0.0.1:")
        assert run.interrupt() == 0, run.said()

    with Running("replay", path, "--view", "none", "--rate", "max", cwd=folder) as run:
        assert run.wait() == 0, run.said()
    assert_nothing_died(run.said())


def assert_nothing_died(said):
    assert "started again" not in said
    assert "did not go as planned" not in said


def assert_as_measured(path):
    """The recorded samples, which are the card's: orbits, keyphasor and currents."""
    with Recording(path) as recording:
        assert recording.description.mode == "LIVE"
        signals = recording.series()
    assert signals.gaps == ()
    assert signals.rate == RATE
    assert signals.samples.shape[1] > 2 * RATE
    rig = load_rig(path.parent / "foreign.toml")
    plane = sensors_of(rig).displacement
    centre = project(signals.samples, plane)  # of the first plane, in x and y by its probes at +-45 degrees
    turns = 50.0 * signals.time
    circle = ORBIT * np.array([np.cos(2 * np.pi * turns), np.sin(2 * np.pi * turns)])
    np.testing.assert_allclose(centre, circle, atol=1e-10)  # float32 of 40 µm
    notches = np.flatnonzero(np.diff((signals["keyphasor"] < -4.0).astype(int)) == 1)
    assert set(np.diff(notches)) == {1024}
    assert signals["current_drive_left"].mean() == pytest.approx(2.0, abs=1e-3)


STILL = """
[plan]
name = "still"
description = "nothing moves"
[[step]]
do = "mark"
text = "begun"
[[step]]
do = "wait"
duration = 0.1
"""


def test_hardware_arms_for_a_named_plan_alone(folder):
    (folder / "still.toml").write_text(STILL)
    live = ("--rig", "foreign.toml", "--plan", "none", "--view", "none", "--no-record")
    with Running("live", *PATIENT, *live, cwd=folder) as run:
        run.wait_for("no plan: nothing moves until `rigtwin plan run PLAN`")
        run.wait_for("| idle")
        armed = rigtwin("command", "arm", cwd=folder)
        assert (armed.returncode, armed.stdout) == (
            1,
            "refused: this rig is hardware, which arms for a named plan: `rigtwin plan run PLAN`, or start "
            "the run with `rigtwin live --plan PLAN`\n",
        )
        planned = rigtwin("plan", "run", "still.toml", cwd=folder)
        assert (planned.returncode, planned.stdout) == (0, "plan still: 2 steps, about 0 s\n")
        run.wait_for("plan still is completed")
        assert rigtwin("command", "arm", cwd=folder).stdout == "armed\n"
        assert run.interrupt() == 0, run.said()
