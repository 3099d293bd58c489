"""`rigtwin view`, run as a user does."""

import signal
import subprocess
import sys
import urllib.request
from pathlib import Path

import pytest

from daq.recording import RecordingWriter
from daq.rig import load_rig
from daq.runtime import claim
from tests.twin.display_process import Display, family, listening, rig_on_free_ports, wait_until
from tests.twin.drawn_run import description, messages

COMMAND = [sys.executable, "-P", "-m", "rigtwin", "view"]
LOOPBACK = {"0100007F"}


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    rig = load_rig("thesis-ball")
    path = tmp_path / "run.mcap"
    with RecordingWriter(path, description(rig, "run", "EMULATED")) as writer:
        for key, payload in messages(rig, "run", 1.0):
            writer.add(key, payload)
    return path


def view(*arguments: object) -> subprocess.CompletedProcess[str]:
    return subprocess.run([*COMMAND, *map(str, arguments)], capture_output=True, text=True, timeout=60)


def test_saves_a_file_that_the_viewer_finds_sound(recording, tmp_path):
    target = tmp_path / "run.rrd"
    result = view(recording, "--save", target)
    assert (result.returncode, result.stdout) == (0, f"saved {target}\n"), result.stderr
    from twin.viewer import program

    verified = subprocess.run([program(), "rrd", "verify", str(target)], capture_output=True, text=True)
    assert verified.returncode == 0, verified.stderr


def test_serves_recordings_on_loopback_until_ctrl_c(recording, tmp_path, monkeypatch):
    monkeypatch.setenv("TMPDIR", str(tmp_path / "temporary"))
    (tmp_path / "temporary").mkdir()
    with subprocess.Popen(
        [*COMMAND, str(recording), str(recording)], stdout=subprocess.PIPE, text=True
    ) as process:
        try:
            assert process.stdout is not None
            address = process.stdout.readline().removeprefix("open ").strip()
            with urllib.request.urlopen(address.partition("?")[0], timeout=20) as page:
                assert b"Rerun" in page.read()
            _, child = family(process.pid)
            wait_until(lambda: len(listening([child])) == 1, "the page")
            assert listening([child]) == LOOPBACK
            process.send_signal(signal.SIGINT)
            assert process.wait(60) == 0
        finally:
            process.kill()
    assert not Path(f"/proc/{child}").exists()
    assert list((tmp_path / "temporary").iterdir()) == []


def test_finds_the_page_of_the_running_rig(tmp_path):
    rig = rig_on_free_ports()
    with claim(rig.name, {"toml": rig.toml}), Display(rig, tmp_path) as display:
        address = display.address()
        result = view()
        assert (result.returncode, result.stdout) == (0, f"open {address}\n"), result.stderr


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ([], "no rig is running"),
        (["none.mcap"], "none.mcap: no such file"),
        (["--save", "out.rrd"], "--save writes what a recording shows, and none was named"),
    ],
)
def test_says_in_one_line_what_is_wrong(arguments, words):
    result = view(*arguments)
    assert result.returncode == 2
    assert words in result.stderr
    assert result.stderr.count("\n") == 1


def test_says_that_the_running_rig_has_no_display():
    rig = load_rig("thesis-ball")
    with claim(rig.name, {"toml": rig.toml}):
        result = view()
    assert result.returncode == 2
    assert "runs without a display" in result.stderr
