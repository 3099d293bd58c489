"""Recording switched off and on by a plan: what is left out is told, and nothing that protection needs is."""

import json

import pytest

from daq import keys
from daq.acquisition import Acquisition
from daq.backends.emulator import Emulator
from daq.events import LEFT_OUT
from daq.messages import BlockStatus, decode_series, read_status
from daq.messages_pb2 import Command, Event
from daq.recording import Recording, RecordingWriter, recover
from daq.recording.certificate import Certificate
from daq.recording.recorded_run import RecordedRun
from daq.recording.withheld import Withheld
from daq.rig import load_rig
from replay.rerun import estimate
from replay.resimulation import resimulate
from replay.verify import IDENTICAL, verify
from rigtwin.cli import main
from tests.daq.recorded_run import BLOCK, RATE, Maker, description

OFF = BlockStatus.RECORDING_OFF
RIG = load_rig("thesis-ball", ["twin.model=none"])


class Run:
    """An armed emulated rig; keeps what it publishes."""

    def __init__(self):
        self.published = []
        self._device = Emulator(paced=False)
        self._device.open(RIG)
        self.daq = Acquisition(RIG, self._device, self._take, run="run", t0_ns=0)
        self.daq.begin()
        self.lease = self.ask("arm").lease

    def _take(self, key, payload):
        self.published.append((key, payload))

    def ask(self, name, lease="", **texts):
        return self.daq.serve(Command(name=name, who="anna", lease=lease, texts=texts))

    def switch(self, to):
        answer = self.ask("record", self.lease, switch=to)
        assert answer.accepted, answer.text

    def go(self, seconds):
        for _ in range(round(seconds * 500)):
            self.daq.step()

    def of(self, key):
        return [payload for name, payload in self.published if name == key]

    def flagged(self, key):
        """First samples of the series that are not to be recorded."""
        return [decode_series(each).first_sample for each in self.of(key) if read_status(each) & OFF]

    def events(self, kind):
        found = map(Event.FromString, self.of(keys.event(RIG.name, "daq")))
        return [event for event in found if event.kind == kind]

    def write(self, path):
        """Record what was published."""
        with RecordingWriter(path, description(run="run", toml=RIG.toml)) as writer:
            add(writer, self.published)
        return path


def add(writer, messages):
    """Record what a recorder would that hears these."""
    withheld = Withheld(RIG.toml, RATE)
    for message in messages:
        for wanted in withheld.release(*message):
            writer.add(*wanted)


@pytest.fixture(scope="module")
def switched():
    """0.1 s recorded, 0.1 s not, 0.1 s recorded; switched within a block."""
    run = Run()
    run.go(0.104)
    run.switch("off")
    run.go(0.1)
    run.switch("on")
    run.go(0.1)
    run.daq.end()
    return run


def test_whole_blocks_are_left_out_and_none_from_before_the_order(switched):
    off, on = (event.sample for event in switched.events("record"))
    assert (off, on) == (2600, 5100)
    for key in (keys.block(RIG.name), keys.truth(RIG.name)):
        assert switched.flagged(key) == list(range(2750, 5000, BLOCK))
    (told,) = switched.events(LEFT_OUT)
    assert (told.details["first"], told.details["last"]) == ("2750", "4999")
    assert told.text == "0.09 s were left out of the recording, as commanded"


def test_what_was_left_out_is_no_loss_and_the_rest_is_all_there(switched, tmp_path):
    with Recording(switched.write(tmp_path / "run.mcap")) as recording:
        check = recording.check()
        summaries = len(list(recording.messages(keys.summary(RIG.name))))
    account = check.certificate
    assert check.verdict == "valid"
    assert account.left_out == ((2750, 4999),)
    assert (account.gaps, account.lost) == ((), 0)
    assert account.received == account.expected - 2250 == 7600 - 2250
    assert summaries == 31  # also while it was off
    assert Certificate.from_metadata(account.to_metadata()) == account


def test_a_loss_beside_it_is_still_a_loss(switched, tmp_path):
    block = keys.block(RIG.name)
    lost = switched.of(block)[24]  # 6000 to 6249
    switched_less = [message for message in switched.published if message[1] != lost]
    with RecordingWriter(tmp_path / "run.mcap", description(run="run", toml=RIG.toml)) as writer:
        add(writer, switched_less)
        assert writer.lost == BLOCK
        account = writer.close()
    assert account.gaps == ((6000, 6249),)
    assert account.left_out == ((2750, 4999),)


def test_a_part_that_begins_meanwhile_does_not_miss_what_was_left_out(switched, tmp_path):
    """The recorder died after the event and before the first block that followed."""
    events = [each for name, each in switched.published if name == keys.event(RIG.name, "daq")]
    blocks = switched.of(keys.block(RIG.name))
    with RecordingWriter(tmp_path / "run.mcap", description(run="run", toml=RIG.toml)) as first:
        add(first, [message for message in switched.published if message[1] not in blocks[20:]])
        first.close(expected=2750, clean=False, continued=True)
    following = description(run="run", toml=RIG.toml, first_sample=2750)
    with RecordingWriter(tmp_path / "run.part2.mcap", following, part=2) as second:
        second.ledger.leave_out({keys.block(RIG.name): 2750}, events)
        add(second, [(keys.block(RIG.name), block) for block in blocks[20:]])
        account = second.close(expected=7600)
    assert (account.gaps, account.left_out) == ((), ((2750, 4999),))
    with RecordedRun(tmp_path / "run.mcap") as run:
        assert run.check().certificate.gaps == ()


def tripped() -> Run:
    """Recording is off from 0.1 s on, for 1.3 s, until a trip."""
    run = Run()
    run.go(0.1)
    run.switch("off")
    run.go(1.3)
    run.ask("trip")
    run.go(0.1)
    run.daq.end()
    return run


def test_a_trip_switches_it_on_and_has_what_came_before_it(tmp_path):
    run = tripped()
    (trip,) = run.events("trip")
    (told,) = run.events(LEFT_OUT)
    last = trip.sample // BLOCK * BLOCK - 1  # the trip's own block is recorded
    assert (int(told.details["first"]), int(told.details["last"])) == (2500, last)
    account = recorded_account(run.write(tmp_path / "run.mcap"))
    ((first, end),) = account.left_out
    assert first == 2500
    assert trip.sample - RATE - 2 * BLOCK <= end < trip.sample - RATE  # [capture] before is 1 s
    assert account.gaps == ()
    recover(tmp_path / "run.mcap", tmp_path / "again.mcap")
    assert recorded_account(tmp_path / "again.mcap").left_out == account.left_out


def test_what_came_before_a_trip_is_recorded_whatever_comes_first(tmp_path):
    """Blocks and events are fetched apart: here all events come before all blocks."""
    run = tripped()
    wanted = recorded_account(run.write(tmp_path / "run.mcap"))
    run.published.sort(key=lambda message: message[0] != keys.event(RIG.name, "daq"))
    found = recorded_account(run.write(tmp_path / "late.mcap"))
    assert (found.left_out, found.received) == (wanted.left_out, wanted.received)


def test_the_next_part_has_what_came_before_a_trip(tmp_path):
    """The part changes between the event that tells what was left out and the trip."""
    run = tripped()
    wanted = recorded_account(run.write(tmp_path / "whole.mcap"))
    withheld = Withheld(RIG.toml, RATE)
    first = RecordingWriter(tmp_path / "run.mcap", description(run="run", toml=RIG.toml))
    with (
        first,
        RecordingWriter(
            tmp_path / "run.part2.mcap", description(run="run", toml=RIG.toml, first_sample=2500), part=2
        ) as second,
    ):
        writer = first
        for key, payload in run.published:
            for message in withheld.release(key, payload):
                writer.add(*message)
            if key == keys.event(RIG.name, "daq") and Event.FromString(payload).kind == LEFT_OUT:
                assert first.ledger.end_of("Block") == 2500
                second.ledger.leave_out(*first.ledger.held())
                writer = second
        first.close(expected=2500, clean=False, continued=True)
        account = second.close(clean=True)
    assert (account.left_out, account.gaps) == (wanted.left_out, ())
    assert account.received + 2500 == wanted.received


def test_a_device_that_fails_meanwhile_loses_nothing_of_what_led_to_it(tmp_path):
    run = Run()
    run.go(0.2)
    run.switch("off")
    run.go(0.006)
    run.daq.fail("the cable was pulled")
    run.daq.end()
    account = recorded_account(run.write(tmp_path / "run.mcap"))
    assert (account.left_out, account.gaps, account.received) == ((), (), 5150)


def recorded_account(path):
    with Recording(path) as recording:
        check = recording.check()
    assert check.verdict == "valid"
    return check.certificate


@pytest.mark.parametrize("order", ["stop", "silence"])
def test_it_is_off_for_no_longer_than_whoever_switched_it_holds_the_rig(order):
    run = Run()
    run.switch("off")
    run.go(0.1)
    if order == "stop":
        run.ask("stop")
    else:
        for _ in range(5):
            run.daq.elapse(1.0)
    run.go(0.1)
    flagged = run.flagged(keys.block(RIG.name))
    assert flagged == list(range(0, 2500, BLOCK))
    assert len(run.events(LEFT_OUT)) == 1


def test_switched_within_a_block_nothing_is_left_out():
    run = Run()
    run.go(0.012)
    run.switch("off")
    run.switch("on")
    run.go(0.1)
    run.daq.end()
    assert run.flagged(keys.block(RIG.name)) == []
    assert run.events(LEFT_OUT) == []


def test_a_run_that_ends_meanwhile_tells_what_was_left_out(tmp_path):
    run = Run()
    run.go(0.1)
    run.switch("off")
    run.go(0.1)
    run.daq.end()
    account = recorded_account(run.write(tmp_path / "run.mcap"))
    assert (account.left_out, account.gaps) == (((2500, 4999),), ())


def test_only_the_holder_switches_it_and_only_on_or_off():
    run = Run()
    assert "only the holder" in run.ask("record", "guessed", switch="off").text
    assert run.ask("record", run.lease, switch="of").text == "record takes switch, on or off, not of"
    assert run.ask("record", run.lease).text == "record takes switch, on or off, not nothing"


def test_a_certificate_from_before_is_read():
    texts = {name: text for name, text in old().to_metadata().items() if name != "left_out"}
    assert Certificate.from_metadata(texts) == old()


def old():
    from daq.recording.certificate import Ledger

    ledger = Ledger()
    ledger.admit(*Maker().block(0))
    return ledger.certificate(part=1, expected=None, clean=True)


PLAN = """
[plan]
name = "pause"
description = "for a test"
[[step]]
do = "wait"
duration = 0.1
[[step]]
do = "record"
switch = "off"
[[step]]
do = "wait"
duration = 0.2
[[step]]
do = "record"
switch = "on"
[[step]]
do = "wait"
duration = 0.3
"""


@pytest.fixture(scope="module")
def paused(tmp_path_factory):
    """The folder of a recording `run.mcap` that a plan paused."""
    folder = tmp_path_factory.mktemp("paused")
    (folder / "pause.toml").write_text(PLAN)
    assert main(["simulate", str(folder / "pause.toml"), "-o", str(folder / "run.mcap")]) == 0
    return folder


def test_a_plan_pauses_recording_and_the_twin_repeats_what_it_made_of_it(paused, monkeypatch, capsys):
    monkeypatch.chdir(paused)
    assert main(["info", "run.mcap", "--json"]) == 0
    facts = json.loads(capsys.readouterr().out)
    ((first, last),) = facts["left_out"]
    assert last - first + 1 == pytest.approx(0.2 * RATE, abs=BLOCK)
    assert (facts["lost"], facts["gaps"], facts["certificate"]["verdict"]) == (0, [], "valid")
    (gap,) = [event for event in facts["events"] if event["kind"] == "gap"]
    assert (gap["source"], gap["severity"]) == ("twin", "INFO")
    assert gap["details"] == {"first": str(first), "last": str(last), "cause": "not recorded, as commanded"}
    assert main(["info", "run.mcap"]) == 0
    assert f"left out     samples {first} to {last}\n" in capsys.readouterr().out
    verdict = verify("run.mcap")
    assert (verdict.verdict, verdict.notes) == (IDENTICAL, ())


def test_what_was_left_out_is_left_out_again(paused, tmp_path):
    with Recording(paused / "run.mcap") as recording:
        wanted = recording.certificate
    found = resimulate(paused / "run.mcap", tmp_path / "again.mcap")
    assert wanted.left_out
    assert (found.left_out, found.received, found.gaps) == (wanted.left_out, wanted.received, ())
    assert found.signal_digests == wanted.signal_digests
    assert recorded_account(tmp_path / "again.mcap").left_out == wanted.left_out


def test_a_fresh_twin_says_that_it_was_left_out(paused, tmp_path):
    estimate(paused / "run.mcap", tmp_path / "anew.mcap")
    gaps = []
    for path in (paused / "run.mcap", tmp_path / "anew.mcap"):
        with Recording(path) as recording:
            gaps += [
                (each.sample, each.severity, each.text) for each in recording.events() if each.kind == "gap"
            ]
    live, anew = gaps
    assert live == anew


def test_what_a_trip_called_for_is_there_again(tmp_path):
    run = tripped()
    wanted = recorded_account(run.write(tmp_path / "run.mcap"))
    found = resimulate(tmp_path / "run.mcap", tmp_path / "again.mcap")
    assert (found.left_out, found.received) == (wanted.left_out, wanted.received)
