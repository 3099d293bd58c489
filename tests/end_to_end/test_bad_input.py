"""Bad input at the command line: one clear line with the remedy, exit code 2, nothing lost, no traceback."""

import socket

import pytest

from tests.end_to_end.rig_process import obeying_permissions, rigtwin

MISSPELT = '[rig]\nbase = "thesis-ball"\n[rotor]\nmas = 1.3\n'
TEXT_FOR_NUMBER = '[rig]\nbase = "thesis-ball"\n[rotor]\nmass = "heavy"\n'
MILLIMETRES = '[rig]\nbase = "thesis-ball"\n[backup_bearing]\nclearance = 1.5\n'
NEGATIVE = '[rig]\nbase = "thesis-ball"\n[rotor]\nmass = -1.3\n'


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["live", "--rig", "thesis-bal"], ["thesis-bal", "thesis-ball"]),
        (["live", "--rig", "misspelt.toml"], ["misspelt.toml", "[rotor]", "mas", "mass"]),
        (["live", "--rig", "text.toml"], ["text.toml", "[rotor] mass", "heavy", "number"]),
        (["live", "--rig", "millimetres.toml"], ["[backup_bearing] clearance", "1.5", "m"]),
        (["live", "--rig", "negative.toml"], ["[rotor] mass", "-1.3"]),
        (["live", "--plan", "resonanse"], ["resonanse", "resonance"]),
        (["live", "--set", "rotor.mas=2"], ["mas", "mass"]),
        (["live", "--set", "acquisition.backend=emulater"], ["emulater", "did you mean emulator"]),
        (["live", "--view", "none", "--record", "taken.mcap"], ["taken.mcap", "exists"]),
        (["live", "--view", "none", "--record", "file.txt/run.mcap"], ["file.txt"]),
        (["simulate", "impacts", "-o", "taken.mcap"], ["taken.mcap", "exists"]),
        (["simulate", "impacts", "-o", "new.mcap", "--set", "command.max_speed_hz=5"], ["speed_hz", "5"]),
        (["info", "file.txt"], ["file.txt", "MCAP"]),
        (["info", "absent.mcap"], ["absent.mcap", "no such file"]),
        (["replay", "file.txt", "--view", "none"], ["file.txt", "MCAP"]),
        (["recover", "file.txt", "-o", "out.mcap"], ["file.txt", "MCAP"]),
        (["command", "arm"], ["no rig is running", "rigtwin live"]),
        (["shutdown"], ["no rig is running"]),
        (["view", "file.txt"], ["file.txt"]),
    ],
)
def test_one_line_names_what_is_wrong(tmp_path, arguments, words):
    for name, text in {
        "misspelt": MISSPELT,
        "text": TEXT_FOR_NUMBER,
        "millimetres": MILLIMETRES,
        "negative": NEGATIVE,
    }.items():
        (tmp_path / f"{name}.toml").write_text(text)
    (tmp_path / "file.txt").write_text("not a recording")
    (tmp_path / "taken.mcap").write_text("do not overwrite me")
    result = rigtwin(*arguments, cwd=tmp_path)
    assert result.returncode == 2, result.stdout + result.stderr
    said = result.stderr.strip().splitlines()
    assert len(said) == 1, result.stderr
    assert said[0].startswith("rigtwin: ")
    for word in words:
        assert word in said[0]
    assert (tmp_path / "taken.mcap").read_text() == "do not overwrite me"


def test_a_port_in_use_is_named(tmp_path):
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
        options = ("--view", "none", "--no-record", "--plan", "none", "--set", f"link.daq={port}")
        result = rigtwin("live", *options, cwd=tmp_path)
    assert result.returncode == 2
    assert f"link.daq = {port}: the port is in use" in result.stderr
    assert len(result.stderr.strip().splitlines()) == 1


def test_a_folder_that_cannot_be_written_is_named(tmp_path):
    result = rigtwin("live", "--record", "/proc/run.mcap", cwd=tmp_path)  # where not even root may write
    assert result.returncode == 2
    assert "/proc: no file can be made there" in result.stderr
    assert len(result.stderr.strip().splitlines()) == 1


def test_a_folder_without_permission_is_named(tmp_path):
    folder = tmp_path / "closed"
    folder.mkdir(mode=0o500)
    path = folder / "run.mcap"
    result = rigtwin("live", "--record", path, cwd=tmp_path, through=obeying_permissions())
    assert result.returncode == 2
    assert f"{folder}: no permission to write there: change it or record elsewhere" in result.stderr
    assert len(result.stderr.strip().splitlines()) == 1
    assert not list(folder.iterdir())
