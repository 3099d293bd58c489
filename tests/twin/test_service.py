"""From blocks to messages, and the process on a real link."""

import os
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from daq import keys
from daq.link import Inbox, Link, Request, free_ports
from daq.messages import SeriesEncoder, decode_series
from daq.messages_pb2 import Description, Event, Status, TwinSummary
from daq.rig import Rig, RigError, load_rig, with_ports
from tests.twin.emulated import EmulatedRun, emulate, run_up
from twin.estimation import Twin
from twin.observer import EstimateStatus

T0_NS = 1_700_000_000_000_000_000
RUN = "run-1"


@pytest.fixture(scope="module")
def run() -> EmulatedRun:
    """Two seconds with impacts."""
    rig = load_rig("thesis-ball", ["emulator.actual.rotor.unbalance_angle=0.7"])
    return emulate(rig, run_up(10.0, 12.0, 2.0), seconds=2.0)


def encoded(run: EmulatedRun) -> list[bytes]:
    """Return the run's blocks as the daq publishes them."""
    encoder = SeriesEncoder(RUN, run.rig.acquisition.rate, run.rig.channels.names, run.rig.channels.units)
    return [encoder.encode(each.timestamp, each.first_sample, 16, each.samples) for each in run.blocks]


def processed(twin: Twin, blocks: list[bytes]) -> list[tuple[str, bytes]]:
    return [message for block in blocks for message in twin.process(block)]


def of(messages: list[tuple[str, bytes]], key: str) -> list[bytes]:
    return [payload for found, payload in messages if found == key]


def test_each_block_gives_an_estimate_of_the_same_samples(run):
    messages = processed(Twin(run.rig, RUN, T0_NS), encoded(run))
    estimates = [decode_series(each) for each in of(messages, keys.estimate("thesis-ball"))]
    assert [each.first_sample for each in estimates] == [each.first_sample for each in run.blocks]
    assert all(each.samples.shape[1] * each.stride == 250 for each in estimates)
    assert estimates[3].timestamp == pytest.approx(T0_NS * 1e-9 + 0.03)
    assert estimates[3].run == RUN
    assert estimates[0].status == 16 | EstimateStatus.RESTARTED | EstimateStatus.SETTLING
    assert estimates[-1].status == 16
    assert all(np.isfinite(each.samples).all() for each in estimates)


def test_equal_blocks_give_equal_bytes(run):
    blocks = encoded(run)
    assert processed(Twin(run.rig, RUN, T0_NS), blocks) == processed(Twin(run.rig, RUN, T0_NS), blocks)


def test_summaries_come_each_tenth_of_a_second_and_name_the_regime(run):
    messages = processed(Twin(run.rig, RUN, T0_NS), encoded(run))
    summaries = [TwinSummary.FromString(each) for each in of(messages, keys.twin_summary("thesis-ball"))]
    assert [each.first_sample for each in summaries] == [2500 * i for i in range(len(summaries))]
    assert len(summaries) == 20
    assert summaries[-1].regime == "bouncing"
    assert summaries[-1].valid
    assert not summaries[0].valid
    truth = run.truth["normal_force"][-2500:]
    assert summaries[-1].contact_force_maximum == pytest.approx(truth.max(), rel=0.05)
    assert summaries[-1].residual_rms == pytest.approx(1e-6, rel=0.1)
    assert 2 * np.pi * summaries[-1].speed_hz == pytest.approx(run.truth["speed"][-2500:].mean(), rel=1e-3)
    events = [Event.FromString(each) for each in of(messages, keys.event("thesis-ball", "twin"))]
    assert [each.sequence for each in events] == list(range(len(events)))
    assert events[0].kind == "start"
    change = [each for each in events if each.kind == "regime"][-1]
    assert change.details["now"] == "bouncing"
    assert 0.0 < float(change.details["confidence"]) <= 1.0
    assert 0.0 < summaries[-1].regime_confidence <= 1.0


def test_a_gap_is_an_event_and_the_estimate_recovers(run):
    blocks = encoded(run)
    twin = Twin(run.rig, RUN, T0_NS)
    processed(twin, blocks[:150])
    messages = twin.process(blocks[160], "shed")
    event = Event.FromString(of(messages, keys.event("thesis-ball", "twin"))[0])
    assert event.kind == "gap"
    assert dict(event.details) == {"first": "37500", "last": "39999", "cause": "shed"}
    assert event.sample == 40000
    assert twin.lost == 2500
    messages = processed(twin, blocks[161:])
    estimate = decode_series(of(messages, keys.estimate("thesis-ball"))[-1])
    force = estimate.samples[estimate.names.index("normal_force")]
    place = estimate.samples[estimate.names.index("displacement_y")]
    index = estimate.first_sample + 5 * np.arange(force.size)
    station = run.rig.model.rotor.bearing_station
    assert place == pytest.approx(station * run.truth["tilt_y"][index], abs=1e-6)
    assert force == pytest.approx(run.truth["normal_force"][index], abs=2.0)


def test_a_late_start_is_an_event(run):
    messages = Twin(run.rig, RUN, T0_NS).process(encoded(run)[100])
    event = Event.FromString(of(messages, keys.event("thesis-ball", "twin"))[0])
    assert event.kind == "start"
    assert event.text == "the estimate begins late, 1.00 s after the run"


def test_a_rig_without_a_model_is_refused():
    rig = load_rig("thesis-ball", ['twin.model="none"'])
    with pytest.raises(RigError, match="no model to run alongside"):
        Twin(rig, RUN, T0_NS)


class FakeRun:
    """The daq's side of the link: publishes given blocks and describes the run."""

    def __init__(self, link: Link, rig: Rig, mode: str = "EMULATED") -> None:
        self.link, self.rig = link, rig
        self.blocks = link.publish(keys.block(rig.name), cache=3000)
        self.events = link.publish(keys.event(rig.name, "daq"), cache=100)
        answer = Description(run=RUN, rig=rig.name, toml=rig.toml, t0_ns=time.time_ns(), mode=mode)
        self.answer = answer.SerializeToString()
        self.describes = True
        self.asked = 0
        link.serve(keys.description(rig.name), self.describe)
        link.announce(keys.alive(rig.name, "daq"))

    def describe(self, request: Request) -> None:
        self.asked += 1
        if self.describes:
            request.reply(self.answer)

    def await_questions(self, count: int) -> None:
        """Wait for so many more questions for the description.

        Each follows the end of the one before, which went to the twin behind all that was sent until then.
        """
        enough, deadline = self.asked + count, time.monotonic() + 60.0
        while self.asked < enough:
            assert time.monotonic() < deadline, "the twin does not ask what the run is"
            time.sleep(0.01)

    def end(self, sample: int) -> None:
        self.events.put(Event(run=RUN, sample=sample, source="daq", kind="end").SerializeToString())


class Observing:
    """A twin process on a rig with ports of its own, and what it publishes."""

    def __init__(self, rig: Rig, folder: Path) -> None:
        self.rig = rig
        path = folder / "rig.toml"
        path.write_text(rig.toml)
        self.inbox = Inbox(100_000, "drop_oldest")
        self.log = (folder / "twin.log").open("wb")
        self.process = subprocess.Popen(
            [sys.executable, "-P", "-m", "twin", "observe", "--rig", str(path)],
            stdin=subprocess.PIPE,
            stdout=self.log,
            stderr=subprocess.STDOUT,
            env={**os.environ, "PYTHONPATH": str(Path(__file__).parents[2])},
        )
        self.link = Link(connect=[rig.link.endpoint("twin")])
        for key in (keys.estimate(rig.name), keys.event(rig.name, "twin"), keys.status(rig.name, "twin")):
            self.link.subscribe(key, self.inbox, recover=not key.endswith("status"))

    def until(self, key: str, wanted, seconds: float = 60.0) -> list[tuple[str, bytes]]:
        """Return what came up to the first message of `key` for which `wanted` is true."""
        deadline, seen = time.monotonic() + seconds, []
        while time.monotonic() < deadline:
            item = self.inbox.get(0.1)
            if item is not None:
                seen.append(item)
                if item[0] == key and wanted(item[1]):
                    return seen
        raise AssertionError(f"no such message on {key} within {seconds} s; the twin said: {self.said()}")

    def said(self) -> str:
        return Path(self.log.name).read_text()

    def close(self) -> None:
        self.link.close()
        self.process.stdin.close()
        self.process.kill()
        self.process.wait()
        self.log.close()


@pytest.fixture
def stage(run, tmp_path):
    """Return a function that makes rig, daq side and twin process, all on free ports."""
    made = []

    def make(mode: str = "EMULATED") -> tuple[FakeRun, Observing]:
        rig = with_ports(run.rig, free_ports(4))
        link = Link(listen=[rig.link.endpoint("daq")])
        twin = Observing(rig, tmp_path)
        made.extend([twin, link])
        return FakeRun(link, rig, mode), twin

    yield make
    for each in made:
        each.close()


def await_twin(daq: FakeRun, twin: Observing) -> None:
    """Wait until the twin has compiled its kernels and the daq's side and this one hear it."""
    deadline = time.monotonic() + 120
    token = keys.alive(daq.rig.name, "twin")
    for link in (daq.link, twin.link):
        while token not in link.alive(token):
            assert twin.process.poll() is None, f"the twin ended: {twin.said()}"
            assert time.monotonic() < deadline, f"the twin did not come: {twin.said()}"
            time.sleep(0.02)


def test_the_process_estimates_a_run_to_its_last_sample_and_ends(run, stage):
    daq, twin = stage("REPLAY")
    await_twin(daq, twin)
    blocks = encoded(run)
    daq.end(run.blocks[-1].first_sample + 250)  # the end may overtake the blocks
    for block in blocks:
        daq.blocks.put(block)
    key = keys.estimate("thesis-ball")
    last = run.blocks[-1].first_sample
    messages = twin.until(key, lambda payload: decode_series(payload).first_sample == last)
    expected = of(processed(Twin(run.rig, RUN, 0), blocks), key)
    assert [decode_series(each).samples.tobytes() for each in of(messages, key)] == [
        decode_series(each).samples.tobytes() for each in expected
    ]
    assert twin.process.wait(30) == 0


def test_a_replay_that_goes_back_is_estimated_anew(run, stage):
    daq, twin = stage("REPLAY")
    await_twin(daq, twin)
    blocks = encoded(run)[:40]
    for block in [*blocks, *blocks[20:]]:
        daq.blocks.put(block)
    key, last = keys.estimate("thesis-ball"), run.blocks[39].first_sample
    messages = []
    for _ in range(2):
        messages += twin.until(key, lambda payload: decode_series(payload).first_sample == last)
    expected = of(processed(Twin(run.rig, RUN, 0), blocks), key)
    expected += of(processed(Twin(run.rig, RUN, 0), blocks[20:]), key)
    assert [decode_series(each).samples.tobytes() for each in of(messages, key)] == [
        decode_series(each).samples.tobytes() for each in expected
    ]
    daq.end(last + 250)
    assert twin.process.wait(30) == 0


def test_a_backlog_is_shed_live_and_the_newest_is_estimated(run, stage):
    daq, twin = stage()
    await_twin(daq, twin)
    daq.describes = False  # so that two seconds of blocks wait when the twin begins
    *backlog, newest = encoded(run)
    for block in backlog:
        daq.blocks.put(block)
    daq.await_questions(3)  # of so many blocks at once the link may drop some; now it has room again
    daq.blocks.put(newest)
    daq.await_questions(3)
    daq.describes = True
    status = keys.status("thesis-ball", "twin")
    last = run.blocks[-1].first_sample + 250
    messages = twin.until(status, lambda payload: Status.FromString(payload).sample == last)
    first = decode_series(of(messages, keys.estimate("thesis-ball"))[0])
    assert first.first_sample > 10000
    assert first.status & EstimateStatus.RESTARTED
    daq.end(last)
    assert twin.process.wait(30) == 0


def test_a_twin_that_nobody_waits_for_ends_when_the_daq_is_gone(stage):
    daq, twin = stage()
    await_twin(daq, twin)
    daq.link.close()
    twin.process.stdin.close()
    assert twin.process.wait(30) == 0


def test_a_rig_without_a_model_needs_no_process(tmp_path):
    path = tmp_path / "rig.toml"
    path.write_text(load_rig("thesis-ball", ['twin.model="none"']).toml)
    done = subprocess.run(
        [sys.executable, "-m", "twin", "observe", "--rig", str(path)],
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert done.returncode == 2
    assert 'twin: thesis-ball has [twin] model = "none"' in done.stderr


@pytest.mark.parametrize("arguments", [[], ["dance"]])
def test_an_unknown_process_is_named_with_the_known_ones(arguments, capsys):
    from twin.__main__ import main

    assert main(arguments) == 2
    said = capsys.readouterr().err
    assert "is no process of the twin" in said
    assert "observe" in said
