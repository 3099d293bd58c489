"""Published = recorded = replayed, byte by byte, while the other processes are stopped and killed."""

import random
import signal
import sys
from pathlib import Path
from typing import NamedTuple

import pytest

from daq.recording.recorded_run import RecordedRun
from daq.rig import Rig
from tests.daq.broadcast import rig_with_ports
from tests.end_to_end.rig_process import PATIENCE, PATIENT, Running, wait_until, with_pid
from tests.end_to_end.witness import Digests, Witness, digests_of, topics_of_daq
from tests.started import started

SEED = 20261122
PLAN = """
[plan]
name = "to-and-fro"
description = "through the resonance and back, with impacts, again and again"
"""
LEG = """
[[step]]
do = "speed"
speed_hz = {speed_hz}
ramp_hz_per_s = 2.0
[[step]]
do = "wait"
duration = 5.0
"""
MISHAPS = {  # how often in 10 min each is killed and stopped, and for how long at most (s)
    "recorder": (4, 3, 10.0),
    "twin": (4, 3, 10.0),
    "display": (2, 3, 30.0),
    "operator": (0, 4, 5.0),  # its lease is 10 s here: the plan goes on
}


class Mishap(NamedTuple):
    """What happens to a process at some time of the run."""

    at: float  # s
    victim: str
    signal: signal.Signals


def mishaps(seconds: float) -> list[Mishap]:
    """Return what is to happen, at random times that are the same each time; the operator dies at last."""
    chance = random.Random(SEED)
    found = [Mishap(0.97 * seconds, "operator", signal.SIGKILL)]
    for victim, (kills, stops, longest) in MISHAPS.items():
        for number in range(kills + stops):
            at = chance.uniform(0.02, 0.9) * seconds
            if number < kills:
                found.append(Mishap(at, victim, signal.SIGKILL))
            else:
                until = at + chance.uniform(0.1, 1.0) * longest * seconds / 600.0
                found += [Mishap(at, victim, signal.SIGSTOP), Mishap(until, victim, signal.SIGCONT)]
    return sorted(found)


def let_happen(each: Mishap, run: Running) -> None:
    """Send the signal; wait until a killed process has its successor."""
    pid = run.child(each.victim)
    with_pid(pid, each.signal)
    if each.signal == signal.SIGKILL:
        run.wait_until(lambda: run.find_children()[each.victim] != pid, f"another {each.victim}")


def replayed(path: Path, rig: Rig, description: Path, folder: Path) -> Digests:
    """Return the digests of what a player publishes as fast as it is taken."""
    words = (sys.executable, "-P", "-m", "replay", "play", path, "--rig", description, "--rate", "max")
    with started(folder, "player") as start, Witness(rig, "twin") as heard:
        player = start([*words, "--wait-for", "twin"])
        wait_until(lambda: heard.has_all() or player.poll() is not None, "the replay's end", 6 * PATIENCE)
        assert heard.has_all(), player.log.read_text()
    return heard.digests


@pytest.mark.slow
@pytest.mark.parametrize("seconds", [600])
def test_what_is_published_is_recorded_and_replayed_byte_by_byte(tmp_path, seconds):
    rig, description = rig_with_ports(tmp_path)
    path, plan = tmp_path / "run.mcap", tmp_path / "plan.toml"
    plan.write_text(PLAN + "".join(LEG.format(speed_hz=speed) for speed in (14.5, 8.0)) * (seconds // 10))
    options = ("--rig", description, "--plan", plan, "--duration", seconds, "--view", "web", *PATIENT)
    with (
        Witness(rig) as published,
        Running("live", *options, "--record", path, cwd=tmp_path) as run,
    ):
        for each in mishaps(seconds):
            due = int(each.at * rig.acquisition.rate)
            run.wait_until(lambda due=due: published.newest >= due, f"{each.at:.0f} s", seconds + PATIENCE)
            let_happen(each, run)
        assert run.process.wait(seconds + PATIENCE) == 0, run.said()
        wait_until(published.has_all, "the last messages")
    assert published.newest > seconds * rig.acquisition.rate - rig.acquisition.block
    with RecordedRun(path) as recording:
        assert len(recording.files) == 1 + MISHAPS["recorder"][0]
        messages = recording.messages(*topics_of_daq(rig.name))
        recorded = digests_of((each.key, each.payload) for each in messages)
    assert set(recorded) == set(topics_of_daq(rig.name))
    assert recorded == published.digests
    assert replayed(path, rig, description, tmp_path) == published.digests
