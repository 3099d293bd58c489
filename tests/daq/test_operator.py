"""The operator as a real process beside a real daq process, over the real link."""

import os
import signal
import subprocess
import sys
import time

import pytest

from daq import keys
from daq.link import Inbox, Link, free_ports
from daq.messages_pb2 import Answer, Command, Event, Status, Summary
from daq.rig import load_rig, with_ports

PATIENCE = 60.0  # s; bound on every wait
PLAN = """
[plan]
name = "nudge"
description = "for a test"
[[step]]
do = "speed"
speed_hz = 2.0
[[step]]
do = "hit"
solenoid = "horizontal"
force = 5.0
duration = 0.01
[[step]]
do = "wait"
duration = 0.2
"""


LEASE = 1.0  # s: a busy machine may hold an operator up for longer than the shipped 0.1 s


class Site:
    """A running rig: daq and operator as processes, and an ear on their events."""

    def __init__(self, folder):
        self.folder = folder
        self.rig = with_ports(load_rig("thesis-ball", [f"command.lease={LEASE}"]), free_ports(4))
        self.toml = folder / "rig.toml"
        self.toml.write_text(self.rig.toml, encoding="utf-8")
        self.processes = []
        self.inbox = Inbox(20_000, "drop_oldest")
        self.events: list[Event] = []
        ends = [self.rig.link.endpoint("daq"), self.rig.link.endpoint("operator")]
        self.link = Link(connect=ends)
        self.link.subscribe(keys.event(self.rig.name, "*"), self.inbox, recover=True)

    def start(self, *words):
        process = subprocess.Popen(
            [sys.executable, "-m", "daq", words[0], "--rig", str(self.toml), *words[1:]],
            stdin=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        self.processes.append(process)
        return process

    def wait_for(self, source, kind):
        """Wait for the next event of that source and kind."""
        deadline = time.monotonic() + PATIENCE
        while time.monotonic() < deadline:
            message = self.inbox.get(1.0)
            if message:
                self.events.append(Event.FromString(message[1]))
                if (self.events[-1].source, self.events[-1].kind) == (source, kind):
                    return self.events[-1]
        pytest.fail(f"no event {kind} of {source}; there were {[event.text for event in self.events]}")

    def run_on(self, seconds):
        """Wait until so many seconds of samples have been summarised."""
        summaries = Inbox(1000, "drop_oldest")
        subscription = self.link.subscribe(keys.summary(self.rig.name), summaries)
        samples, enough = 0, None
        while enough is None or samples < enough:
            _, payload = summaries.get(PATIENCE)
            samples = Summary.FromString(payload).first_sample
            enough = enough or samples + seconds * self.rig.acquisition.rate
        subscription.close()

    def ask(self, name, **values):
        """Send a command to the operator, as `rigtwin command` does."""
        key = keys.operator_command(self.rig.name, name)
        command = Command(who="alice", values=values)
        return Answer.FromString(self.link.ask(key, command.SerializeToString(), 5.0))

    def order_end(self, process):
        process.stdin.close()
        return process.wait(PATIENCE)

    def close(self):
        self.link.close()
        for process in self.processes:
            if process.poll() is None:
                process.kill()
            process.wait()
            process.stdin.close()
            process.stderr.close()


@pytest.fixture
def site(tmp_path):
    made = Site(tmp_path)
    yield made
    made.close()


@pytest.fixture
def staffed(site):
    """A site whose operator waits for commands."""
    operator = site.start("operate")
    site.start("acquire", "--wait-for", "operator")
    site.wait_for("daq", "start")
    return site, operator


def test_operator_performs_a_plan_and_ends_when_told(site):
    plan = site.folder / "nudge.toml"
    plan.write_text(PLAN, encoding="utf-8")
    operator = site.start("operate", "--plan", str(plan))
    daq = site.start("acquire", "--wait-for", "operator")
    end = site.wait_for("operator", "plan_end")
    assert end.text == "plan nudge is completed"
    assert site.order_end(operator) == 0
    assert site.order_end(daq) == 0
    site.wait_for("daq", "end")
    steps = [event.text for event in site.events if event.kind == "step"]
    assert [step.partition(":")[0] for step in steps] == ["step 1 of 3", "step 2 of 3", "step 3 of 3"]
    moved = [event.kind for event in site.events if event.source == "daq"]
    assert moved == ["start", "arm", "speed", "hit", "stop", "end"]


def test_person_moves_the_rig_through_the_operator(staffed):
    site, operator = staffed
    assert site.ask("speed", speed_hz=2.0).text == "the rig is not armed: arm it first"
    assert site.ask("arm").accepted
    assert site.ask("speed", speed_hz=2.0).accepted
    site.run_on(1.5 * LEASE)
    assert site.ask("hit", force=5.0, duration=0.01).accepted
    assert site.ask("stop").accepted
    assert not site.ask("hit", force=5.0, duration=0.01).accepted
    assert "lease_lost" not in [event.kind for event in site.events]
    assert site.order_end(operator) == 0


def test_operator_that_ends_stops_what_was_armed(staffed):
    site, operator = staffed
    assert site.ask("arm").accepted
    operator.stdin.write("stop\n")
    operator.stdin.flush()
    assert operator.wait(PATIENCE) == 0
    assert site.wait_for("daq", "stop").details["who"] == "operator"


@pytest.mark.parametrize("blow", [signal.SIGKILL, signal.SIGSTOP])
def test_operator_that_dies_or_hangs_loses_the_lease(staffed, blow):
    site, operator = staffed
    assert site.ask("arm").accepted
    assert site.ask("speed", speed_hz=2.0).accepted
    os.kill(operator.pid, blow)
    assert site.wait_for("daq", "lease_lost").details["first_out"] == "lease lost"
    if blow == signal.SIGSTOP:
        os.kill(operator.pid, signal.SIGCONT)
        answer = site.ask("speed", speed_hz=2.0)
        assert not answer.accepted
        assert "tripped (lease lost)" in answer.text
        assert site.ask("reset").accepted
        assert site.ask("arm").accepted


def test_status_and_presence_are_published(staffed):
    site, _ = staffed
    inbox = Inbox(100, "drop_oldest")
    site.link.subscribe(keys.status(site.rig.name, "operator"), inbox)
    message = inbox.get(PATIENCE)
    assert message
    status = Status.FromString(message[1])
    assert status.process == "operator"
    assert status.state in ("waiting", "idle")
    assert keys.alive(site.rig.name, "operator") in site.link.alive(keys.alive(site.rig.name, "*"), 5.0)


def test_bytes_that_are_no_command_are_refused(staffed):
    site, _ = staffed
    answer = Answer.FromString(site.link.ask(keys.operator_command(site.rig.name, "arm"), b"\xff\xff", 5.0))
    assert not answer.accepted
    assert "these bytes are none" in answer.text


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--plan", "resonanc"], 'no plan is named "resonanc"; did you mean resonance?'),
        (["--rig", "thesis-ball"], "rig 'thesis-ball' is not running"),
        (["--rig", "thesis-bal"], 'no rig is named "thesis-bal"; did you mean thesis-ball?'),
    ],
)
def test_wrong_use_is_said_in_one_line(site, words, said):
    process = site.start("operate", *words)
    assert process.wait(PATIENCE) == 2
    lines = process.stderr.read().splitlines()
    assert len(lines) == 1
    assert lines[0].startswith(f"daq: {said}")


def test_port_in_use_is_said_in_one_line(site):
    with Link(listen=[site.rig.link.endpoint("operator")]):
        process = site.start("operate")
        assert process.wait(PATIENCE) == 2
    lines = process.stderr.read().splitlines()
    assert len(lines) == 1
    assert "is in use by another process" in lines[0]
