"""The acquisition process, for real: a child, the link, its commands, its end."""

import signal
import socket
import time
from itertools import pairwise
from math import tau

import pytest

from daq import keys
from daq.link import Link, NoAnswer, Refused, free_ports
from daq.messages import BlockStatus, decode_series
from daq.messages_pb2 import Answer, Description
from daq.rig import load_rig, rig_from_text, with_ports
from daq.runtime import NotRunning, running
from tests.daq.daq_process import Client, DaqProcess, until

SECOND = 25_000


@pytest.fixture
def start(tmp_path):
    """Start acquisition processes; they are gone after the test."""
    started = []

    def run(*arguments, **options):
        started.append(DaqProcess(tmp_path, *arguments, **options))
        return started[-1]

    yield run
    for daq in started:
        daq.close()


@pytest.fixture
def daq(start):
    return start().wait_until_ready()


@pytest.fixture
def client(daq):
    client = Client(daq.rig)
    until(lambda: client.blocks and client.statuses)
    yield client
    client.close()


def assert_gapless(spans, until_sample=None):
    assert spans[0][0] == 0
    assert all(before[1] == after[0] for before, after in pairwise(spans))
    assert until_sample is None or spans[-1][1] == until_sample


def test_a_run_from_ready_to_the_end_of_standard_input(daq, client):
    until(lambda: len(client.blocks) > 50)
    assert client.state() == "idle"
    description = Description.FromString(client.data.ask(keys.description(daq.rig.name), b""))
    assert rig_from_text(description.toml) == daq.rig
    assert description.mode == "EMULATED"
    assert abs(description.t0_ns - time.time_ns()) < 300e9
    assert description.t0_uncertainty_ns > 0
    assert "numpy" in description.versions
    record = running(daq.rig.name)
    assert (record["pid"], record["mode"]) == (daq.process.pid, "EMULATED")
    assert (record["daq"], record["control"]) == (daq.rig.link.daq, daq.rig.link.control)
    assert rig_from_text(record["toml"]) == daq.rig

    daq.process.stdin.close()
    samples = client.hear_the_end()
    assert_gapless(client.spans(), samples)
    assert daq.finish() == (0, "")
    assert client.event("end").details["lost"] == "0"
    assert client.kinds() == ["start", "end"]
    assert {block.run for block in map(decode_series, client.blocks)} == {description.run}
    with pytest.raises(NotRunning):
        running(daq.rig.name)


def test_armed_it_moves_and_the_end_brings_the_rotor_to_rest(daq, client):
    client.arm()
    assert client.ask("speed", speed_hz=5.0, ramp_hz_per_s=50.0).accepted
    until(lambda: client.channel("motor_speed") > 4.5 * tau)
    until(lambda: client.state() == "armed")
    daq.process.stdin.write("stop\n")
    daq.process.stdin.flush()
    client.hear_the_end()
    assert abs(client.channel("motor_speed")) < 0.2 * tau
    assert daq.finish() == (0, "")


def test_a_second_operator_is_refused_and_may_still_stop(daq, client):
    client.arm()
    refused = client.ask("arm", who="bert", lease="")
    assert not refused.accepted
    assert "anna holds the rig" in refused.text
    assert not client.ask("speed", who="bert", lease="", speed_hz=1.0).accepted
    assert client.ask("stop", who="bert", lease="").accepted
    until(lambda: client.state() == "idle")


def test_out_of_range_is_refused_in_words_and_recorded_as_an_event(daq, client):
    client.arm()
    answer = client.ask("speed", speed_hz=26.0)
    assert (answer.accepted, answer.text) == (False, "speed_hz must be 0 to 25 Hz, not 26")
    assert client.event("refused").details["who"] == "anna"


def test_a_silent_operator_loses_the_lease_and_the_rig_comes_to_rest(daq, client):
    client.arm()
    client.ask("speed", speed_hz=5.0, ramp_hz_per_s=50.0)
    until(lambda: client.channel("motor_speed") > 2.0 * tau)
    client.fall_silent()
    lost = client.event("lease_lost")
    assert lost.details["first_out"] == "lease lost"
    until(lambda: abs(client.channel("motor_speed")) < 0.2 * tau)
    until(lambda: client.state() == "tripped")
    assert client.statuses[-1].first_out == "lease lost"
    assert client.ask("arm").text.startswith("the rig is tripped (lease lost)")
    assert client.ask("reset").accepted
    client.arm()


def test_overspeed_trips_and_latches(daq, client):
    client.arm()
    client.ask("speed", speed_hz=24.0, ramp_hz_per_s=50.0)
    trip = client.event("trip")
    assert trip.details["cause"] == "speed"
    until(lambda: client.state() == "tripped")
    assert client.ask("speed", speed_hz=1.0).text.startswith("the rig is tripped (speed)")
    until(lambda: client.ask("reset").accepted)
    client.arm()


def test_a_daq_that_was_stopped_for_a_second_loses_nothing(daq, client):
    until(lambda: len(client.blocks) > 20)
    daq.process.send_signal(signal.SIGSTOP)
    time.sleep(1.0)
    daq.process.send_signal(signal.SIGCONT)
    reached = client.spans()[-1][1]
    until(lambda: client.spans()[-1][1] > reached + 2 * SECOND)
    assert_gapless(client.spans())
    assert any(decode_series(payload).status & BlockStatus.LATE for payload in client.blocks)
    assert "gap" not in client.kinds()


def test_a_daq_that_was_stopped_for_longer_than_the_buffer_says_what_is_lost(start):
    daq = start(overrides=["emulator.buffer=0.5"]).wait_until_ready()
    client = Client(daq.rig)
    try:
        until(lambda: len(client.blocks) > 20)
        daq.process.send_signal(signal.SIGSTOP)
        time.sleep(1.5)
        daq.process.send_signal(signal.SIGCONT)
        gap = client.event("gap")
        first, last = int(gap.details["first"]), int(gap.details["last"])
        until(lambda: client.spans()[-1][1] > last + SECOND)
        daq.process.stdin.close()
        client.hear_the_end()
        spans = client.spans()
        jumps = [(before[1], after[0] - 1) for before, after in pairwise(spans) if before[1] != after[0]]
        gaps = [event for event in client.events if event.kind == "gap"]
        told = [(int(event.details["first"]), int(event.details["last"])) for event in gaps]
        assert jumps == told
        assert (first, last) == told[0]
        assert last - first + 1 > 0.5 * SECOND
        lost = sum(end - begin + 1 for begin, end in told)
        assert daq.finish() == (0, "")
        assert client.event("end").details["lost"] == str(lost)
    finally:
        client.close()


def test_it_ends_by_itself_after_a_duration(start):
    daq = start("--duration", "0.5", "--run", "my-run", "--wait-for", "recorder")
    client = Client(daq.rig)
    try:
        assert client.hear_the_end() >= 12_500
        assert client.event("end").run == "my-run"
        assert daq.process.wait(30) == 0
    finally:
        client.close()


def test_sigterm_ends_it_in_order_and_ctrl_c_is_not_its_business(daq, client):
    daq.process.send_signal(signal.SIGINT)
    reached = until(lambda: len(client.blocks))
    until(lambda: len(client.blocks) > reached + 20)
    daq.process.send_signal(signal.SIGTERM)
    client.hear_the_end()
    assert daq.process.wait(30) == 0


def test_it_waits_for_the_processes_that_it_is_told_to_wait_for(start):
    daq = start("--wait-for", "recorder,twin")
    name = daq.rig.name
    with Link(connect=[daq.rig.link.endpoint("daq")]) as link:
        until(lambda: link.alive(keys.alive(name, "daq")))
        link.announce(keys.alive(name, "recorder"))
        with pytest.raises(NoAnswer):
            link.ask(keys.description(name), b"")
        with Link(connect=[daq.rig.link.endpoint("control")]) as control:
            answer = Answer.FromString(control.ask(keys.command(name, "arm"), b"", 10.0))
            assert answer.text == "the run has not started yet"
        twin = link.announce(keys.alive(name, "twin"))
        daq.wait_until_ready()
        twin.close()
        client = Client(daq.rig)
        try:
            until(lambda: len(client.blocks) > 2)
            assert client.spans()[0][0] == 0
        finally:
            client.close()


def test_it_can_be_ended_while_it_waits(start):
    daq = start("--wait-for", "recorder")
    with Link(connect=[daq.rig.link.endpoint("daq")]) as link:
        until(lambda: link.alive(keys.alive(daq.rig.name, "daq")))
    assert daq.finish() == (0, "")


def test_bytes_that_are_no_command_are_refused(daq, client):
    key = keys.command(daq.rig.name, "arm")
    answer = Answer.FromString(client.control.ask(key, b"\xff\xff\xff", 10.0))
    assert not answer.accepted
    assert "these bytes are none" in answer.text
    with pytest.raises((Refused, NoAnswer)):
        client.control.ask(keys.command(daq.rig.name, "*"), b"", 5.0)


def test_a_second_daq_for_the_same_rig_is_refused(daq, start):
    code, said = start().finish()
    assert code == 2
    assert said.count("\n") == 1
    assert f"already running in process {daq.process.pid}" in said


def test_a_port_in_use_is_one_clear_line(start):
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        rig = with_ports(load_rig("thesis-ball"), [port, *free_ports(3)])
        code, said = start(rig=rig).finish()
    assert code == 2
    assert said == (
        f"daq: tcp/127.0.0.1:{port} is in use by another process: stop that one or take another port\n"
    )


FLAKY = """
from daq.backend import BackendError
from daq.backends.emulator import Emulator

class Flaky(Emulator):
    def read(self, out):
        reading = super().read(out)
        if reading.first_sample > 10_000:
            raise BackendError("the cable was pulled: plug it in and start anew")
        return reading
"""


def test_a_device_that_fails_ends_the_run_and_is_said(start, tmp_path):
    (tmp_path / "flaky.py").write_text(FLAKY)
    installed = tmp_path / "flaky-1.0.dist-info"
    installed.mkdir()
    (installed / "METADATA").write_text("Metadata-Version: 2.1\nName: flaky\nVersion: 1.0\n")
    (installed / "entry_points.txt").write_text("[rigtwin.backends]\nflaky = flaky:Flaky\n")
    daq = start("--wait-for", "recorder", overrides=["acquisition.backend=flaky"], packages=tmp_path)
    client = Client(daq.rig)
    try:
        daq.wait_until_ready()
        assert client.event("failure").text == "the cable was pulled: plug it in and start anew"
        samples = client.hear_the_end()
        assert_gapless(client.spans(), samples)
        code, said = daq.finish()
        assert (code, said) == (2, "daq: the cable was pulled: plug it in and start anew\n")
    finally:
        client.close()


def test_a_backend_that_is_not_installed_is_one_clear_line(start):
    code, said = start(overrides=["acquisition.backend=emulatr"]).finish()
    assert code == 2
    assert said == "daq: no backend is called emulatr; did you mean emulator?\n"
