"""The operator's rules, against a real acquisition of the emulator, without links or clocks."""

from collections import deque
from functools import partial

import pytest

from daq import keys
from daq.acquisition import Acquisition
from daq.backends.emulator import Emulator
from daq.commanding.operation import Operation
from daq.commanding.plan import plan_from_text
from daq.link import LinkError, NoAnswer
from daq.messages_pb2 import Answer, Command, Event, Summary
from daq.rig import load_rig

RIG = load_rig("thesis-ball")
SPIN = """
[plan]
name = "spin"
description = "for a test"
[[step]]
do = "speed"
speed_hz = 4.0
ramp_hz_per_s = 20.0
[[step]]
do = "mark"
text = "at speed"
[[step]]
do = "wait"
duration = 0.3
[[step]]
do = "hit"
solenoid = "horizontal"
force = 5.0
duration = 0.01
[[step]]
do = "wait"
duration = 0.2
"""


VIRTUAL = partial(Emulator, paced=False)


class Bench:
    """A daq and an operator joined by function calls; a line that is cut gives no answers."""

    def __init__(self, plan=None, rig=RIG, run="run-1", device=VIRTUAL):
        self.rig = rig
        self.device = device
        self.events: list[Event] = []  # the operator's
        self.daq_events: list[Event] = []
        self.cut: Exception | None = None
        self.operation = Operation(
            rig, plan, self.ask, lambda payload: self.events.append(Event.FromString(payload))
        )
        self.backend = None
        self.start(run)

    def start(self, run):
        """Start the daq, or start it anew."""
        self.close()
        self._news = deque()
        self.backend = self.device()
        self.backend.open(self.rig)
        self.daq = Acquisition(
            self.rig, self.backend, lambda *message: self._news.append(message), run=run, t0_ns=0
        )
        self.daq.begin()

    def close(self):
        if self.backend:
            self.backend.close()

    def ask(self, command: Command) -> Answer:
        if self.cut:
            raise self.cut
        return self.daq.serve(Command.FromString(command.SerializeToString()))

    def run(self, seconds):
        """Let the daq acquire and the operator follow, renewing its lease."""
        for _ in range(round(seconds * 500)):
            self.daq.step()
            self.daq.renew(self.operation.lease)
            self.deliver()

    def deliver(self):
        while self._news:
            key, payload = self._news.popleft()
            if key == keys.summary(self.rig.name):
                self.operation.advance(Summary.FromString(payload))
            elif key == keys.event(self.rig.name, "daq"):
                self.daq_events.append(Event.FromString(payload))
                self.operation.heed(self.daq_events[-1])

    def command(self, name, values=None, texts=None, who="alice"):
        return self.operation.serve(Command(name=name, who=who, values=values or {}, texts=texts or {}))

    def kinds(self):
        return [event.kind for event in self.events]

    @property
    def last(self):
        return self.events[-1]


@pytest.fixture
def bench():
    made = []

    def make(*arguments, **options):
        made.append(Bench(*arguments, **options))
        return made[-1]

    yield make
    for each in made:
        each.close()


@pytest.fixture(scope="module")
def spin():
    return plan_from_text(SPIN, RIG)


def test_plan_is_performed_from_arm_to_stop(bench, spin):
    rig = bench(spin)
    rig.run(1.0)
    assert rig.kinds() == ["plan_start", *["step"] * 5, "plan_end"]
    assert [event.kind for event in rig.daq_events] == ["start", "arm", "speed", "mark", "hit", "stop"]
    assert rig.last.details["completed"] == "yes"
    assert rig.last.text == "plan spin is completed"
    assert rig.operation.lease == ""
    assert rig.daq.state == "idle"


def test_events_tell_run_sample_and_step(bench, spin):
    rig = bench(spin)
    rig.run(1.0)
    step = rig.events[1]
    assert (step.run, step.source, step.kind) == ("run-1", "operator", "step")
    assert step.text == "step 1 of 5: 4 Hz by 20 Hz/s"
    assert step.details["speed_hz"] == "4.0"
    assert [event.sequence for event in rig.events] == list(range(7))
    assert step.timestamp == pytest.approx(step.sample / RIG.acquisition.rate)
    due = [int(event.details["due"]) for event in rig.events if event.kind == "step"]
    assert [sample - due[0] for sample in due] == [0, 5000, 5000, 12500, 12500]
    assert all(0 <= event.sample - sample <= 250 for event, sample in zip(rig.events[1:6], due, strict=True))


def test_the_stream_says_what_the_operator_is_doing(bench, spin):
    rig = bench(spin)
    assert rig.operation.status().state == "waiting"
    rig.run(0.1)
    assert rig.operation.status().state == "plan"
    rig.run(1.0)
    assert rig.operation.status().state == "idle"
    assert rig.command("arm").accepted
    status = rig.operation.status()
    assert (status.process, status.run, status.state) == ("operator", "run-1", "armed")


@pytest.mark.parametrize("name", ["arm", "speed", "hit", "reset"])
def test_motion_is_refused_while_a_plan_runs(bench, spin, name):
    rig = bench(spin)
    rig.run(0.1)
    answer = rig.command(name, {"speed_hz": 20.0} if name == "speed" else {})
    assert not answer.accepted
    assert answer.text == "plan spin is running: only stop, trip and mark until it is over"
    assert rig.last.kind == "refused"
    assert rig.last.text.startswith(f"{name} refused to alice")
    rig.run(1.0)
    assert rig.last.details["completed"] == "yes"


def test_mark_is_passed_on_while_a_plan_runs(bench, spin):
    rig = bench(spin)
    rig.run(0.1)
    assert rig.command("mark", texts={"text": "noise heard"}).accepted
    rig.run(1.0)
    marks = [event.details["who"] for event in rig.daq_events if event.kind == "mark"]
    assert marks == ["alice", "plan spin"]
    assert rig.last.details["completed"] == "yes"


@pytest.mark.parametrize("name", ["stop", "trip"])
def test_stop_and_trip_cut_a_plan_short(bench, spin, name):
    rig = bench(spin)
    rig.run(0.3)
    assert rig.command(name).accepted
    assert rig.last.kind == "plan_end"
    assert rig.last.details["completed"] == "no"
    assert rig.last.text == f"plan spin was cut short: {name} by alice"
    assert rig.operation.lease == ""
    rig.run(1.0)
    assert rig.daq.at_rest
    assert rig.kinds().count("plan_end") == 1


def test_stop_sent_to_the_daq_by_someone_else_cuts_a_plan_short(bench, spin):
    rig = bench(spin)
    rig.run(0.3)
    rig.daq.serve(Command(name="stop", who="bob"))
    rig.run(0.1)
    assert rig.last.kind == "plan_end"
    assert rig.last.details["reason"].startswith("bob")


def test_trip_of_the_limits_cuts_a_plan_short(bench, spin):
    rig = bench(spin, load_rig("thesis-ball", ["limits.speed.warn=2", "limits.speed.trip=3"]))
    rig.run(1.0)
    assert rig.last.kind == "plan_end"
    assert "speed" in rig.last.details["reason"]
    assert rig.daq.state == "tripped"
    assert rig.operation.lease == ""


def test_refused_step_cuts_a_plan_short_and_stops(bench, spin):
    rig = bench(spin)
    rig.rig = load_rig("thesis-ball", ["command.max_speed_hz=3"])
    rig.start("run-1")
    rig.run(0.2)
    assert rig.last.kind == "plan_end"
    assert rig.last.details["reason"] == "step 1 of 5: 4 Hz by 20 Hz/s: speed_hz must be 0 to 3 Hz, not 4"
    assert [event.kind for event in rig.daq_events][-1] in ("refused", "stop")
    assert not rig.daq.commands.armed


def test_tripped_rig_refuses_a_plan(bench, spin):
    rig = bench(spin)
    rig.daq.serve(Command(name="trip", who="bob"))
    rig.run(0.1)
    assert rig.kinds() == ["plan_end"]
    assert rig.last.details["reason"].startswith("arming was refused: the rig is tripped")


def test_person_arms_moves_and_stops(bench):
    rig = bench()
    rig.run(0.1)
    assert rig.command("speed", {"speed_hz": 2.0}).text == "the rig is not armed: arm it first"
    armed = rig.command("arm")
    assert armed.accepted
    assert armed.lease == ""  # it stays with the operator
    assert rig.command("speed", {"speed_hz": 2.0}).accepted
    rig.run(1.0)
    assert rig.daq.commands.armed
    assert rig.command("stop").accepted
    rig.run(0.5)
    assert rig.operation.lease == ""
    assert rig.command("speed", {"speed_hz": 2.0}).text == "the rig is not armed: arm it first"
    assert rig.events == []


def test_lease_lost_is_noticed_and_a_new_one_can_be_taken(bench):
    rig = bench()
    rig.run(0.1)
    rig.command("arm")
    rig.run(0.1)
    for _ in range(10):  # silence, as the daq's clock counts it
        rig.daq.elapse(0.025)
    rig.run(0.1)
    assert rig.operation.lease == ""
    assert rig.operation.state == "idle"
    assert "tripped" in rig.command("arm").text
    assert rig.command("reset").accepted
    assert rig.command("arm").accepted
    rig.run(0.1)
    assert rig.operation.lease


def test_event_from_before_the_lease_does_not_end_it(bench):
    rig = bench()
    rig.run(0.1)
    rig.command("arm")
    rig.run(0.1)
    rig.command("stop")
    rig.daq.step()  # the event `stop` is still on its way when the rig is armed again
    rig.command("arm")
    rig.run(0.1)
    assert rig.operation.lease


def test_end_brings_the_rotor_to_rest(bench, spin):
    rig = bench(spin)
    rig.run(0.3)
    rig.operation.end("the operator was told to end")
    assert rig.last.details["reason"] == "the operator was told to end"
    rig.run(1.0)
    assert rig.daq.at_rest
    assert rig.daq.state == "idle"


def test_end_stops_what_a_person_armed(bench):
    rig = bench()
    rig.run(0.1)
    rig.command("arm")
    rig.operation.end("the operator was told to end")
    assert not rig.daq.commands.armed
    assert rig.events == []


def test_plan_waits_for_the_daq_to_answer(bench, spin):
    rig = bench(spin)
    rig.cut = NoAnswer("nobody answers")
    rig.run(0.5)
    assert rig.events == []
    rig.cut = None
    rig.run(1.0)
    assert rig.last.details["completed"] == "yes"


def test_plan_gives_up_a_daq_that_does_not_answer(bench, spin):
    rig = bench(spin)
    rig.cut = NoAnswer("nobody answers")
    rig.run(5.2)
    assert rig.kinds() == ["plan_end"]
    assert "the daq does not answer: nobody answers" in rig.last.text


def test_line_that_is_cut_ends_the_plan_and_is_said_to_people(bench, spin):
    rig = bench(spin)
    rig.run(0.3)
    rig.cut = LinkError("the line is cut")
    rig.run(0.6)
    assert rig.kinds()[-2:] == ["refused", "plan_end"]
    assert "the daq does not answer: the line is cut" in rig.last.details["reason"]
    assert rig.operation.lease == ""
    assert rig.command("mark", texts={"text": "hello"}).text == "the daq does not answer: the line is cut"


def test_daq_that_is_started_anew_ends_plan_and_lease(bench, spin):
    rig = bench(spin)
    rig.run(0.3)
    rig.start("run-2")
    rig.run(0.2)
    assert rig.last.details["reason"] == "the daq was started anew"
    assert rig.last.run == "run-1"
    assert rig.operation.lease == ""
    assert rig.daq.state == "idle"


def test_end_of_the_run_ends_the_plan(bench, spin):
    rig = bench(spin)
    rig.run(0.3)
    rig.daq.end()
    rig.deliver()
    assert rig.last.details["reason"].startswith("run ended after 0.30 s")


def test_a_plan_is_given_to_an_operator_that_has_none(bench):
    rig = bench()
    rig.run(0.1)
    answer = rig.command("plan", texts={"toml": SPIN})
    assert answer.accepted
    assert answer.text == "plan spin: 5 steps, about 1 s"
    rig.run(1.0)
    assert rig.kinds() == ["plan", "plan_start", *["step"] * 5, "plan_end"]
    assert rig.last.details["completed"] == "yes"
    assert rig.command("resume").text == "no plan was cut short: there is nothing to resume"


def test_plans_that_cannot_be_performed_are_refused(bench, spin):
    rig = bench()
    assert rig.command("plan", texts={"toml": SPIN}).text == "the run has not started yet"
    rig.run(0.1)
    too_fast = SPIN.replace("speed_hz = 4.0", "speed_hz = 99.0")
    assert "speed_hz = 99 is above 25" in rig.command("plan", texts={"toml": too_fast}).text
    assert rig.command("arm").accepted
    assert rig.command("plan", texts={"toml": SPIN}).text == "the rig is armed by hand: stop it first"
    assert rig.operation.state == "armed"
    busy = bench(spin)
    busy.run(0.1)
    assert busy.command("plan", texts={"toml": SPIN}).text.startswith("plan spin is running")


def test_a_plan_stops_at_a_trip_and_goes_on_only_when_told(bench, spin):
    rig = bench(spin)
    rig.run(0.3)  # 4 Hz are reached after 0.2 s; the wait of step 3 goes on to 0.5 s
    assert rig.command("trip").accepted
    rig.run(2.0)
    assert rig.operation.state == "idle"
    assert rig.daq.at_rest
    assert rig.command("resume").text.startswith("arming was refused: the rig is tripped")
    assert rig.command("reset").accepted
    assert rig.command("resume").accepted
    rig.run(1.5)
    assert rig.last.details["completed"] == "yes"
    resumed = [event.text for event in rig.events if event.kind == "step"][3:]
    assert resumed == [
        "step 1 of 4: 4 Hz by the default ramp (back to where the plan was)",
        "step 2 of 4: wait 0.3 s",
        "step 3 of 4: solenoid horizontal hits with 5 N for 10 ms",
        "step 4 of 4: wait 0.2 s",
    ]


WATCHED = """
[plan]
name = "watched"
description = "for a test"
[[step]]
do = "speed"
speed_hz = 6.0
ramp_hz_per_s = 20.0
[[step]]
do = "settle"
quantity = "speed"
within = 0.05
hold = 0.2
timeout = 3.0
[[step]]
do = "mark"
text = "settled"
[[abort]]
quantity = "speed"
above = 8.0
"""


def test_a_step_waits_until_the_speed_has_settled(bench):
    rig = bench(plan_from_text(WATCHED, RIG))
    rig.run(3.0)
    assert rig.last.details["completed"] == "yes"
    (mark,) = [event for event in rig.daq_events if event.kind == "mark"]
    (begin,) = [event for event in rig.events if event.kind == "step" and event.details["step"] == "2"]
    waited = (mark.sample - int(begin.details["due"])) / RIG.acquisition.rate
    assert 0.2 <= waited <= 1.5  # the controller overshoots a little before it settles


def test_what_does_not_settle_cuts_the_plan_short(bench):
    restless = WATCHED.replace("within = 0.05", "within = 0.0").replace("timeout = 3.0", "timeout = 0.3")
    rig = bench(plan_from_text(restless, RIG))
    rig.run(1.5)
    assert rig.last.details["reason"] == "the speed did not settle within 0 Hz in 0.3 s"
    assert not rig.daq.commands.armed


def test_an_abort_condition_cuts_the_plan_short_before_a_trip(bench):
    rig = bench(plan_from_text(WATCHED.replace("above = 8.0", "above = 3.0"), RIG))
    rig.run(1.0)
    reason = rig.last.details["reason"]
    assert reason.startswith("abort condition: speed 3.")
    assert reason.endswith("Hz is above 3 Hz")
    assert rig.daq.state == "idle"
    assert rig.daq_events[-1].kind == "stop"


def test_a_hit_at_a_shaft_angle_is_the_daqs_to_time(bench):
    angled = SPIN.replace("force = 5.0", "force = 5.0\nangle_deg = 90.0")
    rig = bench(plan_from_text(angled, RIG))
    rig.run(1.2)
    (hit,) = [event for event in rig.daq_events if event.kind == "hit"]
    assert float(hit.details["angle"]) == pytest.approx(1.5707963)
    assert rig.last.details["completed"] == "yes"


class Hardware(Emulator):
    """The emulated rig as a device behind which a real one would be, and that times no pulse."""

    def __init__(self):
        super().__init__(paced=False)
        self.capabilities = self.capabilities._replace(emulated=False, longest_pulse_s=None)


def test_a_plan_with_hits_is_refused_before_a_device_that_times_none_is_armed(bench):
    rig = bench(device=Hardware)
    rig.run(0.1)
    said = "arming was refused: the device does not end a hit by its own timing: hits are refused"
    assert rig.command("plan", texts={"toml": SPIN}).text == said
    assert rig.operation.state == "idle"
    rig.run(0.1)
    assert [event.kind for event in rig.daq_events] == ["start", "refused"]


def test_a_plan_that_hardware_was_started_with_arms_it(bench):
    rig = bench(plan_from_text(WATCHED, RIG), device=Hardware)
    rig.run(0.1)
    (arm,) = [event for event in rig.daq_events if event.kind == "arm"]
    assert (arm.details["plan"], arm.text) == ("watched", "plan watched: armed for watched")


def test_hardware_is_not_armed_by_hand_before_a_plan_is_named(bench):
    rig = bench(device=Hardware)
    rig.run(0.1)
    assert "`rigtwin plan run PLAN`" in rig.command("arm").text
    assert "`rigtwin plan run PLAN`" in rig.command("arm", texts={"plan": "one that nobody has read"}).text
    assert rig.command("plan", texts={"toml": WATCHED}).accepted
    rig.run(0.1)
    assert rig.command("stop").accepted
    assert rig.command("arm").accepted
