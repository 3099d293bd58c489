"""`rigtwin live` with real processes, a real link and a real file."""

import signal

import numpy as np
import pytest

from analysis.impacts import compare_impacts, find_impacts
from daq.recording import Recording, RecordingError, part_path, parts
from daq.recording.recorded_run import RecordedRun
from replay.resimulation import resimulate
from replay.verify import IDENTICAL, verify
from tests.daq.disk import small_disk
from tests.end_to_end.rig_process import (
    PATIENT,
    Running,
    gone,
    info,
    obeying_permissions,
    rigtwin,
    wait_until,
    with_pid,
)

LOUD = 5.0  # N: impacts above this must be found


def test_every_sample_of_a_live_run_is_recorded(live_run):
    path, said = live_run
    found = info(path)
    assert found["certificate"]["verdict"] == "valid"
    assert found["gaps"] == []
    assert found["samples"] == found["certificate"]["expected"] > 100_000
    assert "valid" in said


def test_twin_sees_the_contact_force_that_no_sensor_sees(live_run):
    recording = Recording(live_run[0])
    truth, twin = recording.series("truth", ["normal_force"]), recording.series("estimate", ["normal_force"])
    first = max(truth.first_sample, twin.first_sample)
    true = truth.samples[0, (first - truth.first_sample) // truth.stride :]
    seen = twin.samples[0, (first - twin.first_sample) // twin.stride :]
    length = min(true.size, seen.size)
    true, seen = true[:length].astype(float), seen[:length].astype(float)
    assert np.corrcoef(true, seen)[0, 1] >= 0.9
    rate = truth.rate / truth.stride
    compared = compare_impacts(find_impacts(true, rate), find_impacts(seen, rate), tolerance=5, least=LOUD)
    assert len(compared.pairs) > 20
    assert len(compared.missed) == 0
    assert np.median(np.abs(compared.peak_error)) <= 0.20


def test_a_live_run_simulated_again_with_its_commands_at_their_samples_gives_the_same_bits(
    live_run, tmp_path
):
    again = resimulate(live_run[0], tmp_path / "again.mcap")
    with Recording(live_run[0]) as recording:
        live = recording.certificate
    assert again.received == live.received
    for series in ("block", "truth"):
        assert again.signal_digests[series] == live.signal_digests[series]


def test_interrupt_ends_in_order_and_keeps_the_recording(tmp_path):
    path = tmp_path / "run.mcap"
    with Running("live", *PATIENT, "--view", "none", "--record", path, cwd=tmp_path) as run:
        run.wait_for("stand still")
        assert run.interrupt() == 0, run.said()
    assert info(path)["certificate"]["verdict"] == "valid"


def test_interrupt_before_the_first_sample_ends_in_order(tmp_path):
    with Running("live", "--view", "none", "--record", tmp_path / "run.mcap", cwd=tmp_path) as run:
        run.wait_for("starting")
        assert run.interrupt() == 0, run.said()


def test_killed_supervisor_leaves_a_safe_rig_and_a_closed_recording(tmp_path):
    path = tmp_path / "run.mcap"
    with Running(
        "live", *PATIENT, "--plan", "impacts", "--view", "none", "--record", path, cwd=tmp_path
    ) as run:
        run.wait_for("Hz")
        children = [run.child(name) for name in ("daq", "recorder", "twin", "operator")]
        run.wait_until(lambda: recorded(path) > 25_000, "a second of recording")
        with_pid(run.process.pid, signal.SIGKILL)
        run.process.wait()
        for pid in children:
            wait_until(lambda pid=pid: gone(pid), "the children to end")
    assert info(path)["certificate"]["verdict"] == "valid"
    assert (
        abs(Recording(path).series("block", ["motor_speed"]).samples[0, -50:].mean()) < 2.0
    )  # rad/s: at rest


@pytest.mark.parametrize("victim", ["twin", "operator"])
def test_killed_process_costs_no_sample(tmp_path, victim):
    path = tmp_path / "run.mcap"
    options = ("--plan", "none", "--duration", "6", "--view", "none")
    with Running("live", *options, "--record", path, cwd=tmp_path) as run:
        run.wait_until(lambda: recorded(path) > 25_000, "a second of recording")
        with_pid(run.child(victim), signal.SIGKILL)
        assert run.wait() == 0, run.said()
        assert f"{victim} was ended by SIGKILL" in run.said()
    found = info(path)
    assert found["gaps"] == []
    assert found["certificate"]["verdict"] == "valid"
    assert verify(path).verdict == IDENTICAL


def test_killed_recorder_goes_on_in_a_second_part_without_a_gap(tmp_path):
    path = tmp_path / "run.mcap"
    part2 = tmp_path / "run.part2.mcap"
    options = ("--plan", "none", "--view", "none")
    with Running("live", *options, "--record", path, cwd=tmp_path) as run:
        run.wait_until(lambda: recorded(path) > 50_000, "two seconds of recording")
        with_pid(run.child("recorder"), signal.SIGKILL)
        run.wait_until(lambda: recorded(part2) > 25_000, "a second of the second part")
        assert run.interrupt() == 0, run.said()
    first, second = Recording(path).series("block"), Recording(part2).series("block")
    assert second.first_sample == first.first_sample + first.samples.shape[1]
    assert not first.gaps
    assert not second.gaps
    assert info(part2)["certificate"]["verdict"] == "valid"
    assert (
        verify(path).verdict == IDENTICAL
    )  # part 1 has no certificate, but tells its fingerprint at its start


def test_a_file_that_is_removed_is_said_and_written_anew_while_the_rig_runs(tmp_path):
    path = tmp_path / "run.mcap"
    options = ("--plan", "none", "--view", "none")
    with Running("live", *options, "--record", path, cwd=tmp_path) as run:
        run.wait_until(lambda: recorded(path) > 25_000, "a second of recording")
        path.unlink()
        run.wait_for("the file was removed while it was being written; starting it again")
        run.wait_until(lambda: recorded(path) > 25_000, "a second of the new recording")
        assert run.interrupt() == 0, run.said()
    found = info(path)  # all of it, as what the removed file held is in the caches still
    assert (found["lost"], found["certificate"]["verdict"]) == (0, "valid")


def test_a_disk_that_fills_up_ends_the_recording_but_not_the_run(tmp_path):
    options = ("--plan", "none", "--duration", "14", "--view", "none")
    with small_disk(tmp_path / "disk", 7) as disk:
        path = disk / "run.mcap"
        with Running("live", *options, "--record", path, cwd=tmp_path) as run:
            assert run.wait() == 1, run.said()
            assert "warning: recorder: the disk is nearly full" in run.said()
            assert "the run did not go as planned: recorder: " in run.said()
            assert samples_shown(run) > 9.9 * 25_000
        found = info(path)
        assert found["certificate"]["closed"]
        assert found["gaps"] == []
        assert found["samples"] > 25_000


def test_a_folder_that_becomes_unwritable_is_said_and_costs_no_sample(tmp_path):
    """The open part goes on where no next one can be made; so it is at last after a killed recorder."""
    folder = tmp_path / "folder"
    folder.mkdir()
    path = folder / "run.mcap"
    denied = f"{folder}: no permission to write there: change it or record elsewhere"
    options = ("--plan", "none", "--view", "none", "--rotate", "2s", *PATIENT)
    with Running("live", *options, "--record", path, cwd=tmp_path, through=obeying_permissions()) as run:
        run.wait_until(lambda: recorded(path) > 0, "the first samples")
        folder.chmod(0o500)
        run.wait_for(f"warning: recorder: no next part: {denied}; going on in {parts(path)[-1].name}")
        made = parts(path)
        run.wait_until(lambda: recorded(made[-1]) > 75_000, "more than the part was to hold")
        with_pid(run.child("recorder"), signal.SIGKILL)
        run.wait_for(f"recorder: {denied}; starting it again")
        folder.chmod(0o700)
        run.wait_until(lambda: recorded(part_path(path, len(made) + 1)) > 0, "the next part")
        assert run.interrupt() == 0, run.said()
    assert recorded(made[-1]) > 75_000
    with RecordedRun(path) as recording:
        account = recording.check().certificate
    assert (account.first_sample, account.lost, account.clean) == (0, 0, True)


@pytest.mark.parametrize("seconds", [4, pytest.param(13, marks=pytest.mark.slow)])
def test_stopped_recorder_loses_nothing(tmp_path, seconds):
    """After ten seconds the link gives a process up that gives no sign of life, and it has to come back."""
    path = tmp_path / "run.mcap"
    options = ("--plan", "none", "--view", "none")
    with Running("live", *options, "--record", path, cwd=tmp_path) as run:
        run.wait_until(lambda: recorded(path) > 25_000, "a second of recording")
        pid, before = run.child("recorder"), run.child("daq")
        with_pid(pid, signal.SIGSTOP)
        run.wait_until(lambda: samples_shown(run) > (0.9 + seconds) * 25_000, f"{seconds} s more of the run")
        with_pid(pid, signal.SIGCONT)
        assert not gone(before)
        assert run.interrupt() == 0, run.said()
    found = info(path)
    assert found["gaps"] == []
    assert found["certificate"]["verdict"] == "valid"


def test_second_daq_for_the_same_rig_is_refused(tmp_path):
    options = ("--plan", "none", "--view", "none", "--no-record")
    with Running("live", *options, cwd=tmp_path) as run:
        run.wait_for("rest")
        second = rigtwin("live", *options, cwd=tmp_path)
        assert second.returncode == 2
        assert "thesis-ball" in second.stderr
        assert "shutdown" in second.stderr
        assert rigtwin("command", "mark", "hello", cwd=tmp_path).returncode == 0
        assert rigtwin("command", "speed", "500", cwd=tmp_path).returncode == 1
        assert rigtwin("shutdown", cwd=tmp_path).returncode == 0
        assert run.wait() == 0, run.said()


def recorded(path):
    """Samples that can be read from a recording by now."""
    try:
        return Recording(path).series("block", ["motor_speed"]).samples.shape[1]
    except RecordingError:
        return 0


def samples_shown(run):
    """Samples of the run by the time in its newest status line."""
    times = [line.split(" s |")[0] for line in run.said().splitlines() if " s |" in line]
    return float(times[-1]) * 25_000 if times else 0.0
