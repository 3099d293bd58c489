import json
import os
import stat
import subprocess
import sys
from pathlib import Path

import pytest

from daq import runtime

ROOT = Path(__file__).parents[2]
RECORD = {"mode": "EMULATED", "host": "127.0.0.1", "daq": 7447, "control": 7448, "toml": "rig.toml"}
HOLD = """
import sys
from daq.runtime import claim
with claim(sys.argv[1], {"mode": "EMULATED"}):
    print("claimed", flush=True)
    sys.stdin.read()
"""


@pytest.fixture
def hold():
    """Start a process that claims a rig and holds it until its input ends."""
    processes = []

    def start(rig):
        command = [sys.executable, "-c", HOLD, rig]
        process = subprocess.Popen(
            command, cwd=ROOT, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )
        processes.append(process)
        assert process.stdout.readline() == "claimed\n"
        return process

    yield start
    for process in processes:
        process.kill()
        process.communicate()


def test_a_claimed_rig_is_found_with_its_record():
    with runtime.claim("thesis-ball", RECORD):
        expected = {**RECORD, "rig": "thesis-ball", "pid": os.getpid()}
        assert runtime.running() == expected
        assert runtime.running("thesis-ball") == expected
    assert runtime.all_running() == {}


def test_a_record_can_be_completed_later():
    with runtime.claim("a", RECORD) as claim:
        claim.update(display="http://127.0.0.1:9090")
        assert runtime.running("a")["display"] == "http://127.0.0.1:9090"
        assert runtime.running("a")["daq"] == 7447


def test_the_pid_of_a_record_is_kept():
    with runtime.claim("a", {"pid": 4711}):
        assert runtime.running("a")["pid"] == 4711


def test_a_second_claim_names_rig_process_and_remedy(hold):
    first = hold("thesis-ball")
    with pytest.raises(
        runtime.AlreadyRunning, match=rf"'thesis-ball' is already running in process {first.pid}: .*shutdown"
    ):
        runtime.claim("thesis-ball", RECORD)
    assert runtime.running()["pid"] == first.pid
    runtime.claim("another", RECORD).close()


def test_a_claim_ends_with_its_process(hold):
    process = hold("a")
    process.kill()
    process.wait()
    assert list(runtime.runtime_folder().glob("*.json"))
    assert runtime.all_running() == {}
    with pytest.raises(runtime.NotRunning):
        runtime.running("a")
    with runtime.claim("a", RECORD):
        assert runtime.running("a")["pid"] == os.getpid()


def test_a_closed_claim_can_be_taken_by_another(hold):
    claim = runtime.claim("a", RECORD)
    claim.close()
    claim.close()
    process = hold("a")
    assert runtime.running("a")["pid"] == process.pid
    process.communicate("")
    assert runtime.all_running() == {}


def test_a_closed_claim_leaves_the_next_ones_record_alone():
    first = runtime.claim("a", RECORD)
    first.close()
    with runtime.claim("a", {"mode": "REPLAY"}):
        first.close()
        assert runtime.running("a")["mode"] == "REPLAY"


def test_what_runs_is_listed_when_the_question_is_not_clear(hold):
    with pytest.raises(runtime.NotRunning, match=r"no rig is running: start one with 'rigtwin live'"):
        runtime.running()
    hold("b")
    hold("c")
    with pytest.raises(runtime.NotRunning, match=r"several rigs are running \(b, c\): name one"):
        runtime.running()
    with pytest.raises(runtime.NotRunning, match=r"'a' is not running \(running now: b, c\)"):
        runtime.running("a")


def test_looking_never_spoils_a_claim():
    """A reader tries the lock for an instant; a claim at that very instant must still succeed."""
    looking = [
        subprocess.Popen(
            [sys.executable, "-c", "from daq.runtime import all_running\nwhile True: all_running()"],
            cwd=ROOT,
        )
        for _ in range(2)
    ]
    try:
        for _ in range(200):
            with runtime.claim("a", RECORD):
                assert "a" in runtime.all_running()
    finally:
        for process in looking:
            process.kill()
            process.wait()


def test_a_damaged_record_is_no_record(runtime_folder):
    with runtime.claim("a", RECORD), runtime.claim("b", RECORD):
        (runtime_folder / "a.json").write_text('{"pid": 12')
        (runtime_folder / "b.json").write_text(json.dumps([1, 2]))
        assert runtime.all_running() == {}


def test_a_failed_write_frees_the_rig():
    with pytest.raises(TypeError):
        runtime.claim("a", {"mode": object()})
    runtime.claim("a", RECORD).close()


def test_the_folder_is_the_users_own(runtime_folder, monkeypatch, tmp_path):
    assert runtime.runtime_folder() == runtime_folder
    assert stat.S_IMODE(runtime_folder.stat().st_mode) == 0o700
    monkeypatch.delenv("RIGTWIN_RUNTIME_DIR")
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    assert runtime.runtime_folder() == tmp_path / "rigtwin"
    monkeypatch.delenv("XDG_RUNTIME_DIR")
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    assert runtime.runtime_folder() == tmp_path / f"rigtwin-{os.getuid()}"


def test_a_folder_that_cannot_be_used_is_named_with_the_remedy(monkeypatch, tmp_path):
    occupied = tmp_path / "file"
    occupied.write_text("")
    monkeypatch.setenv("RIGTWIN_RUNTIME_DIR", str(occupied))
    with pytest.raises(runtime.RuntimeRecordError, match=r"set RIGTWIN_RUNTIME_DIR to another folder"):
        runtime.claim("a", RECORD)


def test_a_folder_of_another_user_is_refused(monkeypatch):
    monkeypatch.setattr(os, "getuid", lambda: 4711)
    with pytest.raises(runtime.RuntimeRecordError, match="belongs to another user"):
        runtime.claim("a", RECORD)


def test_a_rig_whose_name_cannot_be_a_file_is_refused():
    for name in ("../a", "a/b", "", "*"):
        with pytest.raises(ValueError, match="cannot be"):
            runtime.claim(name, RECORD)
