"""The acquisition, unpaced: blocks, events, protection acting, commands, gaps, determinism."""

import hashlib
from itertools import pairwise
from math import tau

import numpy as np
import pytest

from daq import keys
from daq.acquisition import Acquisition
from daq.answers import KEPT, Answers
from daq.backend import RestOutput, make_backend
from daq.backends.emulator import Emulator
from daq.commanding.plan import load_plan, plan_from_text
from daq.messages import BlockStatus, decode_series
from daq.messages_pb2 import ALARM, Answer, ChannelSummary, Command, Event, Summary
from daq.offline import perform
from daq.rig import load_rig, rig_from_text
from simulator.state import TRUTH

RIG = load_rig("thesis-ball")
T0 = 1_800_000_000_000_000_000
BLOCK = 250


class Sink:
    """Keeps what is published."""

    def __init__(self):
        self.messages = []

    def __call__(self, key, payload):
        self.messages.append((key, payload))

    def of(self, key):
        return [payload for published, payload in self.messages if published == key]

    @property
    def blocks(self):
        return [decode_series(payload) for payload in self.of(keys.block(RIG.name))]

    @property
    def events(self):
        return [Event.FromString(payload) for payload in self.of(keys.event(RIG.name, "daq"))]

    def kinds(self):
        return [event.kind for event in self.events]

    def event(self, kind):
        (found,) = [event for event in self.events if event.kind == kind]
        return found


class Bench:
    """An acquisition of an unpaced emulated rig and what it published."""

    def __init__(self, rig=RIG, backend=None):
        self.sink = Sink()
        self.backend = backend or make_backend("emulator", paced=False)
        self.backend.open(rig)
        self.acquisition = Acquisition(rig, self.backend, self.sink, run="run-1", t0_ns=T0)
        self.lease = ""

    def begin(self):
        self.acquisition.begin()
        return self

    def go(self, seconds):
        until = self.acquisition.sample + round(seconds * RIG.acquisition.rate)
        while self.acquisition.sample < until:
            self.acquisition.step()

    def ask(self, name, lease=None, **given):
        texts = {key: value for key, value in given.items() if isinstance(value, str)}
        values = {key: value for key, value in given.items() if key not in texts}
        lease = self.lease if lease is None else lease
        command = Command(name=name, who="anna", lease=lease, values=values, texts=texts)
        answer = self.acquisition.serve(command)
        self.lease = answer.lease or self.lease
        return answer


@pytest.fixture
def bench():
    return Bench().begin()


def test_blocks_are_full_consecutive_and_dated_by_index(bench):
    bench.go(0.1)
    blocks = bench.sink.blocks
    assert [block.first_sample for block in blocks] == list(range(0, 2500, BLOCK))
    for block in blocks:
        assert block.samples.shape == (len(RIG.channels), BLOCK)
        assert block.timestamp == pytest.approx(T0 * 1e-9 + block.first_sample / 25000)
        assert block.run == "run-1"
        assert block.rate == RIG.acquisition.rate
        assert block.names == RIG.channels.names
        assert block.units == RIG.channels.units
        assert block.status == BlockStatus.EMULATED


def test_samples_are_calibrated(bench):
    bench.go(0.01)
    block = bench.sink.blocks[0]
    probe = block.samples[block.names.index("proximity_y")]
    assert probe.mean() == pytest.approx(-1.704e-3, rel=0.01)
    raw = np.empty((len(RIG.channels), BLOCK))
    emulator = make_backend("emulator", paced=False)
    emulator.open(RIG)
    emulator.start()
    emulator.read(raw)
    np.testing.assert_array_equal(block.samples, RIG.channels.calibrate(raw, raw).astype(np.float32))


def test_truth_is_published_every_fifth_sample(bench):
    bench.go(0.02)
    truth = [decode_series(payload) for payload in bench.sink.of(keys.truth(RIG.name))]
    assert [series.first_sample for series in truth] == [0, BLOCK]
    assert truth[0].samples.shape == (len(TRUTH), BLOCK // 5)
    assert truth[0].stride == 5
    assert truth[0].names == TRUTH


def test_summaries_say_what_the_blocks_hold(bench):
    bench.ask("arm")
    bench.ask("hit", force=20.0, duration=0.01)
    bench.go(0.2)
    blocks = bench.sink.blocks
    summaries = [Summary.FromString(payload) for payload in bench.sink.of(keys.summary(RIG.name))]
    assert [summary.first_sample for summary in summaries] == [block.first_sample for block in blocks]
    scale = 0.211 / 0.3035
    for block, summary in zip(blocks, summaries, strict=True):
        radius = scale * np.hypot(block.samples[0], block.samples[1]).max()
        assert summary.radius_maximum == pytest.approx(radius, rel=1e-5)
    of_probe = bench.sink.of(keys.channel_summary(RIG.name, "proximity_x"))
    first = ChannelSummary.FromString(of_probe[0])
    samples = np.concatenate([block.samples[0] for block in blocks[:10]]).astype(float)
    assert len(of_probe) == 2
    assert (first.first_sample, first.n_samples, first.name, first.unit) == (0, 2500, "proximity_x", "m")
    expected = (samples.mean(), samples.min(), samples.max(), np.sqrt((samples**2).mean()))
    assert (first.mean, first.minimum, first.maximum, first.rms) == pytest.approx(expected, rel=1e-6)


def test_the_end_publishes_the_last_partial_block_and_the_count(bench):
    bench.go(0.013)
    bench.acquisition.rest()
    bench.acquisition.end()
    blocks, end = bench.sink.blocks, bench.sink.event("end")
    assert blocks[-1].samples.shape[1] < BLOCK
    total = blocks[-1].first_sample + blocks[-1].samples.shape[1]
    assert end.details["samples"] == str(total) == str(bench.acquisition.sample)
    assert end.sample == total
    assert bench.acquisition.state == "ended"
    assert bench.ask("arm").text == "the run has ended"
    assert bench.sink.kinds()[-1] == "end"


def test_nothing_is_answered_before_the_start():
    bench = Bench()
    assert bench.acquisition.state == "waiting"
    answer = bench.ask("arm")
    assert not answer.accepted
    assert answer.text == "the run has not started yet"


def test_events_are_numbered_and_dated(bench):
    bench.go(0.01)
    bench.ask("mark", text="first")
    bench.go(0.01)
    bench.ask("mark", text="second")
    events = bench.sink.events
    assert [event.sequence for event in events] == [0, 1, 2]
    assert [event.sample for event in events] == [0, BLOCK, 2 * BLOCK]
    assert events[1].text == "anna: first"
    assert events[1].details["who"] == "anna"
    assert events[1].timestamp == pytest.approx(T0 * 1e-9 + 0.01)


def test_an_armed_rig_runs_up_and_stops_on_command(bench):
    assert bench.acquisition.state == "idle"
    assert bench.ask("arm").accepted
    assert bench.acquisition.state == "armed"
    answer = bench.ask("speed", speed_hz=5.0, ramp_hz_per_s=25.0)
    assert answer.accepted
    assert answer.sample == bench.acquisition.sample + 25
    bench.go(1.0)
    assert not bench.acquisition.at_rest
    speed = bench.sink.blocks[-1].samples[RIG.channels.index("motor_speed")].mean()
    assert speed == pytest.approx(5.0 * tau, rel=0.02)
    assert bench.ask("stop").accepted
    assert bench.acquisition.state == "idle"
    bench.go(2.0)
    assert bench.acquisition.at_rest
    assert bench.sink.kinds() == ["start", "arm", "speed", "stop"]
    details = bench.sink.event("speed").details
    assert (details["speed_hz"], details["who"]) == ("5.0", "anna")
    assert details["effect_sample"] == str(answer.sample)


def test_a_refused_command_is_an_event_too_and_moves_nothing(bench):
    answer = bench.ask("speed", speed_hz=5.0)
    assert not answer.accepted
    refused = bench.sink.event("refused")
    assert refused.text == "speed refused to anna: the rig is not armed: arm it first"
    assert refused.details["command"] == "speed"
    bench.go(0.5)
    assert bench.acquisition.at_rest


def test_the_answer_comes_before_the_event(bench):
    order = []
    acquisition = Acquisition(RIG, bench.backend, lambda key, payload: order.append(key), run="r", t0_ns=T0)
    acquisition.begin()
    order.clear()
    acquisition.serve(Command(name="mark", who="anna", texts={"text": "x"}), order.append)
    assert order[0].accepted
    assert order[1:] == [keys.event(RIG.name, "daq")]


def test_overspeed_trips_in_the_read_that_shows_it(bench):
    bench.ask("arm")
    bench.ask("speed", speed_hz=24.0, ramp_hz_per_s=50.0)
    bench.go(1.5)
    trip = bench.sink.event("trip")
    assert trip.severity == ALARM
    assert trip.details["cause"] == "speed"
    assert bench.acquisition.state == "tripped"
    assert bench.acquisition.first_out == "speed"
    assert not bench.acquisition.commands.armed
    row = RIG.channels.index("motor_speed")
    speeds = np.concatenate([block.samples[row] for block in bench.sink.blocks])
    over = speeds > 22.0 * tau
    run = np.convolve(over, np.ones(500), "valid") == 500
    assert trip.sample == int(np.argmax(run)) + 499
    effect = int(trip.details["effect_sample"])
    assert trip.sample < effect <= trip.sample + RIG.acquisition.read + 25
    commands = np.concatenate(
        [block.samples[RIG.channels.index("motor_speed_command")] for block in bench.sink.blocks]
    )
    assert commands[effect + 50] < commands[effect]
    assert "22 Hz" in trip.text


def test_a_hit_that_is_too_hard_trips_and_the_rig_comes_to_rest(bench):
    bench.ask("arm")
    bench.ask("speed", speed_hz=12.0, ramp_hz_per_s=50.0)
    bench.go(1.0)
    bench.ask("hit", force=60.0, duration=0.02)
    bench.go(3.0)
    trip = bench.sink.event("trip")
    assert trip.details["first_out"] in ("displacement", "force")
    assert trip.details["who"] == "anna"
    assert bench.acquisition.at_rest
    assert bench.ask("speed", speed_hz=1.0).text.startswith("the rig is tripped")


def test_a_trip_is_reset_only_when_its_cause_is_gone(bench):
    bench.ask("arm")
    bench.ask("speed", speed_hz=24.0, ramp_hz_per_s=50.0)
    while not bench.acquisition.first_out:
        bench.go(0.01)
    refused = bench.ask("reset")
    assert not refused.accepted
    assert refused.text.startswith("the cause lives: speed 2")
    bench.go(2.0)
    assert bench.ask("reset").accepted
    assert bench.acquisition.state == "idle"
    assert bench.ask("arm").accepted


def test_a_manual_trip_latches(bench):
    bench.ask("arm")
    assert bench.ask("trip", text="smoke").accepted
    assert bench.acquisition.first_out == "manual"
    trip = bench.sink.event("trip")
    assert trip.severity == ALARM
    assert trip.text == "anna: manual trip: smoke"
    bench.go(0.01)
    assert bench.ask("reset").accepted


def test_a_lost_lease_brings_the_rig_to_rest(bench):
    bench.ask("arm")
    bench.ask("speed", speed_hz=5.0, ramp_hz_per_s=50.0)
    bench.go(0.5)
    for _ in range(60):
        bench.acquisition.elapse(0.002)
    lost = bench.sink.event("lease_lost")
    assert lost.details["first_out"] == "lease lost"
    assert lost.details["who"] == "anna"
    assert bench.acquisition.state == "tripped"
    bench.go(2.0)
    assert bench.acquisition.at_rest


def test_a_renewed_lease_is_kept(bench):
    bench.ask("arm")
    for _ in range(500):
        bench.acquisition.elapse(0.002)
        bench.acquisition.renew(bench.lease)
    assert bench.acquisition.state == "armed"


def test_a_schedule_that_is_too_early_is_refused_in_words(bench):
    bench.ask("arm")
    answer = bench.ask("speed", speed_hz=5.0, at_sample=float(bench.acquisition.sample + 3))
    assert not answer.accepted
    assert "needs 25 more" in answer.text


def test_a_hit_by_shaft_angle_begins_there(bench):
    bench.ask("arm")
    bench.ask("speed", speed_hz=5.0, ramp_hz_per_s=50.0)
    bench.go(1.0)
    answer = bench.ask("hit", force=5.0, duration=0.002, angle=1.0)
    assert answer.accepted
    bench.go(0.3)
    row = RIG.channels.index("encoder_angle")
    angle = np.concatenate([block.samples[row] for block in bench.sink.blocks])[answer.sample]
    # Two counts of 4096 a turn in the speed over 0.1 s, for a turn at most, and one sample.
    assert angle == pytest.approx(1.0, abs=2 * tau * tau / 4096 / (0.1 * 5.0 * tau) + 0.002)


def test_the_end_leaves_no_way_to_move(bench):
    bench.ask("arm")
    bench.acquisition.rest()
    assert bench.ask("arm").text == "the run is ending: nothing moves any more"


class Clock:
    def __init__(self):
        self.seconds = 0.0

    def __call__(self):
        return self.seconds


def test_a_gap_is_an_event_and_cuts_the_blocks_honestly():
    clock = Clock()
    bench = Bench(backend=Emulator(clock=clock)).begin()

    def read_all():
        while bench.acquisition.due() == 0.0:
            bench.acquisition.step()

    clock.seconds = 0.0151
    read_all()
    clock.seconds += 5.0
    taken = bench.backend.clock()
    read_all()
    bench.acquisition.end()
    gap = bench.sink.event("gap")
    first, last = int(gap.details["first"]), int(gap.details["last"])
    held = round(RIG.emulator.buffer * RIG.acquisition.rate)
    assert (first, last) == (350, taken - held - 1)
    assert gap.details["cause"] == "the device's buffer overflowed"
    assert gap.severity == ALARM
    blocks = bench.sink.blocks
    spans = [(block.first_sample, block.first_sample + block.samples.shape[1]) for block in blocks]
    assert spans[0] == (0, BLOCK)
    assert spans[1] == (BLOCK, first)
    assert spans[2] == (last + 1, (last // BLOCK + 1) * BLOCK)
    assert all(before[1] == after[0] for before, after in pairwise(spans[2:]))
    flagged = [bool(block.status & BlockStatus.GAP_BEFORE) for block in blocks]
    assert flagged == [False, False, True] + [False] * (len(blocks) - 3)
    assert blocks[2].status & BlockStatus.OVERRUN
    assert bench.acquisition.lost == last - first + 1
    end = bench.sink.event("end")
    assert int(end.details["lost"]) == last - first + 1


def test_a_read_that_comes_late_is_flagged_and_loses_nothing():
    clock = Clock()
    bench = Bench(backend=Emulator(clock=clock)).begin()
    for _ in range(20):
        clock.seconds += 0.0020001
        bench.acquisition.step()
    clock.seconds += 0.02
    while bench.acquisition.due() == 0.0:
        bench.acquisition.step()
    blocks = bench.sink.blocks
    assert not any(block.status & BlockStatus.LATE for block in blocks[:4])
    assert blocks[4].status & BlockStatus.LATE
    assert bench.acquisition.lost == 0


def test_due_tells_when_a_whole_read_is_there():
    clock = Clock()
    bench = Bench(backend=Emulator(clock=clock)).begin()
    assert bench.acquisition.due() == pytest.approx(0.002)
    clock.seconds = 0.00101
    assert bench.acquisition.due() == pytest.approx(0.001, abs=5e-5)
    clock.seconds = 0.0021
    assert bench.acquisition.due() == 0.0


def test_a_broken_sensor_is_flagged_and_trips():
    rig = load_rig("thesis-ball", ["channel.force_top.offset=9.95", "emulator.force_noise=0.0"])
    bench = Bench(rig).begin()
    bench.go(0.02)
    assert bench.sink.blocks[0].status & BlockStatus.SENSOR_NOT_OK
    assert bench.sink.event("trip").details["cause"] == "sensor force_top"


def digest_of(rig, plan):
    digest, sink = hashlib.sha256(), Sink()

    def publish(key, payload):
        digest.update(key.encode() + payload)
        sink(key, payload)

    outcome = perform(rig, plan, publish, run="run-1", t0_ns=T0)
    return digest.hexdigest(), outcome, sink


SHORT = """
[plan]
name = "short"
description = "a little of everything"
[[step]]
do = "speed"
speed_hz = 8.0
ramp_hz_per_s = 40.0
[[step]]
do = "hit"
solenoid = "horizontal"
force = 10.0
duration = 0.01
[[step]]
do = "mark"
text = "hit done"
[[step]]
do = "wait"
duration = 0.3
"""


def test_equal_inputs_give_equal_bytes():
    plan = plan_from_text(SHORT, RIG)
    first, outcome, sink = digest_of(RIG, plan)
    again, _, _ = digest_of(RIG, plan)
    other, _, _ = digest_of(load_rig("thesis-ball", ["emulator.seed=2"]), plan)
    assert first == again
    assert first != other
    assert outcome.aborted == ""
    assert sink.kinds() == ["start", "arm", "speed", "hit", "mark", "stop", "region", "end"]
    assert sink.event("end").details["samples"] == str(outcome.samples)
    steps = [Event.FromString(payload).kind for payload in sink.of(keys.event(RIG.name, "operator"))]
    assert steps == ["plan_start", "step", "step", "step", "step", "plan_end"]


def test_a_plan_is_cut_short_by_a_trip():
    plan = plan_from_text(SHORT.replace("speed_hz = 8.0", "speed_hz = 24.0"), RIG)
    _, outcome, sink = digest_of(RIG, plan)
    assert "speed 2" in outcome.aborted
    assert sink.kinds()[:5] == ["start", "arm", "speed", "warning", "trip"]
    assert sink.kinds()[-1] == "end"


def test_the_shipped_plan_runs_without_a_trip():
    _, outcome, sink = digest_of(RIG, load_plan("impacts", RIG))
    assert outcome.aborted == ""
    assert "trip" not in sink.kinds()


def test_rest_is_what_a_lost_run_ends_with(bench):
    written = []
    write = bench.backend.write
    bench.backend.write = lambda output, at_sample=None: written.append(output) or write(output, at_sample)
    bench.acquisition.rest()
    assert written == [RestOutput(RIG.safe_state.ramp)]


def test_a_request_that_comes_again_is_answered_again_and_performed_once(bench):
    bench.ask("arm")
    hit = Command(
        name="hit", who="anna", lease=bench.lease, values={"force": 5.0, "duration": 0.01}, id="one"
    )
    first = bench.acquisition.serve(hit)
    bench.go(0.05)
    replies = []
    assert bench.acquisition.serve(hit, replies.append) == first
    assert replies == [first]
    assert bench.sink.kinds().count("hit") == 1
    hit.id = "two"
    assert bench.acquisition.serve(hit).sample > first.sample
    assert bench.sink.kinds().count("hit") == 2


def test_answers_are_forgotten_when_many_newer_ones_were_given():
    answers = Answers()
    for number in range(KEPT + 1):
        answers.keep(str(number), Answer(text=str(number)))
    answers.keep("", Answer(text="without an id"))
    assert answers.get("0") is None
    assert answers.get("") is None
    assert [answers.get(str(number)).text for number in (1, KEPT)] == ["1", str(KEPT)]


def with_due(day, *settings):
    text = load_rig("thesis-ball", settings).toml.replace('"proximity_x"', f'"proximity_x"\ndue = {day}', 1)
    return rig_from_text(text)


@pytest.mark.parametrize(("day", "overdue"), [("2027-01-15", False), ("2027-01-14", True)])
def test_an_overdue_calibration_warns_and_blocks_arming(day, overdue):
    site = Bench(with_due(day)).begin()  # sample 0 is on 2027-01-15
    answer = site.ask("arm")
    assert answer.accepted != overdue
    assert (answer.text == "armed") != overdue
    if overdue:
        assert answer.text.startswith("the calibration of proximity_x is overdue: have it renewed, or set")
        assert site.sink.event("warning").text == f"channel proximity_x: its calibration was due on {day}"


def test_an_overdue_calibration_is_overridden_by_a_setting_that_the_recording_tells():
    rig = with_due("2020-01-01", "command.allow_overdue=true")
    site = Bench(rig).begin()
    assert site.ask("arm").accepted
    assert "allow_overdue = true" in rig.toml
    assert site.sink.kinds() == ["start", "warning", "arm"]


EMERGENCY_STOP = """
[[channel]]
name = "emergency_stop"
quantity = "contact"
unit = "1"
display_unit = "1"
terminal = "di0"
sensitivity = 5.0
offset = 0.0
range = [0.0, 6.0]
[[emulator.fault]]
kind = "open"
at = 0.6
channel = "emergency_stop"
"""


def test_an_emergency_stop_is_first_out_and_its_contact_keeps_the_rig_tripped():
    bench = Bench(rig_from_text(load_rig("thesis-ball").toml + EMERGENCY_STOP)).begin()
    bench.ask("arm")
    assert bench.ask("speed", speed_hz=5.0).accepted
    bench.go(1.5)
    trip = bench.sink.event("trip")
    assert (trip.details["cause"], trip.sample) == ("emergency_stop", 15_000 + 49)
    assert bench.acquisition.first_out == "emergency_stop"
    assert bench.acquisition.at_rest
    assert bench.ask("reset").text == "the cause lives: the safety contact emergency_stop is still open"
