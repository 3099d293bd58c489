"""The wire between the rig and those who follow it is cut: real processes in two networks."""

import sys
import time
from pathlib import Path

import pytest

from daq.recording import Recording
from daq.rig import load_rig, with_ports
from tests.end_to_end.networks import PORTS, two_networks
from tests.end_to_end.rig_process import PATIENCE, wait_until
from tests.started import started

LEASE = 1.0  # s: a busy machine may hold an operator up for longer than the shipped 0.1 s
SPEED = 3.0  # Hz
AT_REST = 0.2  # Hz
HELD_BACK = 0.5  # s for which a busy computer may hold a renewal back that came before the cut
PYTHON = (sys.executable, "-P", "-m")


class Site:
    """A rig in one network, its control room in another, and an ear beside the rig."""

    def __init__(self, folder, networks, start):
        self.folder, self.networks, self._start = folder, networks, start
        self.rig = with_ports(load_rig("thesis-ball", [f"command.lease={LEASE}"]), PORTS)
        self.toml = folder / "rig.toml"
        self.toml.write_text(self.rig.toml, encoding="utf-8")

    def start_near(self, module, *words):
        return self._start([*self.networks.near, *PYTHON, module, *words])

    def start_far(self, module, *words):
        return self._start([*self.networks.far, *PYTHON, module, *words])

    def start_rig(self, wait_for):
        self.daq = self.start_near("daq", "acquire", "--rig", self.toml, "--wait-for", wait_for)
        self.ear = self.start_near("tests.end_to_end.listener", self.toml)

    def command(self, *words):
        """Do what a person in the control room does: (exit code, what was said)."""
        asked = self.start_far("rigtwin", "command", *words)
        return asked.wait(PATIENCE), asked.log.read_text()

    def heard(self, kind):
        """What the ear heard of a kind, each as its words."""
        lines = self.ear.log.read_text().split("\n")[:-1]
        return [words[1:] for line in lines if (words := line.split())[0] == kind]

    def events(self):
        """What the ear heard of events: (kind, s since 1970, sample at which it takes effect or "None")."""
        return [(kind, float(when), effect) for kind, when, effect in self.heard("event")]

    def event(self, wanted):
        """Wait for an event of a kind; return it as `events` does."""
        wait_until(lambda: any(kind == wanted for kind, *_ in self.events()), f"the event {wanted}")
        return next(event for event in self.events() if event[0] == wanted)

    def newest(self):
        """What the ear heard last of the shaft: (sample, speed in Hz)."""
        sample, speed = [("0", "0"), *self.heard("speed")][-1]
        return int(sample), float(speed)

    def run_on(self, seconds):
        """Wait until so many seconds more of samples are there."""
        enough = self.newest()[0] + seconds * self.rig.acquisition.rate
        wait_until(lambda: self.newest()[0] > enough, f"{seconds:g} s of samples")

    def sample_now(self):
        """The device's present sample, by the computer's clock."""
        return (time.time() - self.event("start")[1]) * self.rig.acquisition.rate


@pytest.fixture
def site(tmp_path, monkeypatch):
    monkeypatch.setenv("PYTHONPATH", str(Path(__file__).parents[2]))
    with two_networks() as networks, started(tmp_path, "process") as start:
        yield Site(tmp_path, networks, start)


def test_a_rig_that_is_cut_off_comes_to_rest_and_says_so_once_it_is_reached_again(site):
    site.start_far("daq", "operate", "--rig", site.toml)
    site.start_rig("operator")
    site.event("start")
    assert site.command("arm") == (0, "armed\n")
    assert site.command("speed", SPEED, "--ramp", "20")[0] == 0
    wait_until(lambda: site.newest()[1] > 0.9 * SPEED, "the rotor to turn")

    site.networks.cut()
    cut = site.sample_now()
    code, said = site.command("speed", "1")
    assert code != 0
    assert "answer" in said  # none comes
    assert said.count("\n") == 1
    effect = int(site.event("lease_lost")[2])
    wait_until(lambda: site.newest()[1] < AT_REST, "the rotor to stand still")

    rate, block = site.rig.acquisition.rate, site.rig.acquisition.block
    spans = [(int(first), int(end)) for first, end in site.heard("late")]
    late = sum(end - first for first, end in spans if cut - block < first < effect)
    assert effect <= cut + (LEASE + HELD_BACK) * rate + block + late
    site.networks.mend()
    tripped = "refused: the rig is tripped (lease lost): find the cause, then reset\n"
    wait_until(lambda: site.command("speed", "1") == (1, tripped), "the daq's answer")
    assert [kind for kind, *_ in site.events()].count("lease_lost") == 1


def test_a_recorder_that_is_cut_off_misses_nothing(site):
    path = site.folder / "run.mcap"
    recorder = site.start_far("twin", "record", "--rig", site.toml, "--file", path)
    site.start_rig("recorder")
    site.event("start")
    site.networks.cut()
    site.run_on(2.0)  # of which the daq's end of the wire can hold back a third
    site.networks.mend()
    site.run_on(0.5)
    site.daq.stdin.close()
    assert recorder.wait(PATIENCE) == 0, recorder.log.read_text()
    assert site.daq.wait(PATIENCE) == 0
    with Recording(path) as recording:
        check, spans = recording.check(), recording.series().gaps
    assert (check.verdict, check.certificate.gaps, spans) == ("valid", (), ())
    assert check.certificate.received == check.certificate.expected
