"""The display may be stopped, killed and started again: whoever measures does not notice."""

import signal

import pytest

from daq.recording import Recording
from tests.end_to_end.rig_process import PATIENT, Running, gone, info, wait_until, with_pid
from tests.end_to_end.test_live import recorded


def test_killed_display_is_started_again_and_costs_no_sample(tmp_path):
    path = tmp_path / "run.mcap"
    options = ("--plan", "none", "--view", "web")
    with Running("live", *PATIENT, *options, "--record", path, cwd=tmp_path) as run:
        run.wait_for("watch it at http://127.0.0.1:")
        run.wait_until(lambda: recorded(path) > 25_000, "a second of recording")
        first = run.child("display")
        with_pid(first, signal.SIGKILL)
        wait_until(lambda: run.find_children()["display"] != first, "another display")
        before = recorded(path)
        run.wait_until(lambda: recorded(path) > before + 50_000, "two more seconds of recording")
        assert run.interrupt() == 0, run.said()
    found = info(path)
    assert found["gaps"] == []
    assert found["certificate"]["verdict"] == "valid"


@pytest.mark.parametrize("seconds", [2, pytest.param(60, marks=pytest.mark.slow)])
def test_stopped_display_costs_no_sample_and_slows_nobody(tmp_path, seconds):
    path = tmp_path / "run.mcap"
    options = ("--plan", "none", "--view", "web")
    with Running("live", *PATIENT, *options, "--record", path, cwd=tmp_path) as run:
        run.wait_for("watch it at http://127.0.0.1:")
        run.wait_until(lambda: recorded(path) > 25_000, "a second of recording")
        display, before = run.child("display"), recorded(path)
        with_pid(display, signal.SIGSTOP)
        run.wait_until(lambda: recorded(path) > before + seconds * 25_000, "the run to go on", seconds + 60.0)
        with_pid(display, signal.SIGCONT)
        assert not gone(display)
        assert run.interrupt() == 0, run.said()
    recording = Recording(path)
    assert not recording.series("block").gaps
    assert info(path)["certificate"]["verdict"] == "valid"
