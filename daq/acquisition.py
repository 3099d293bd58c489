"""The acquisition: one device read, protected, published and commanded, without threads or waiting.

Whoever owns an `Acquisition` calls all its methods from one thread: the live service paces `step` by the
device, `daq.offline` calls it as fast as it goes. Both get the same blocks, events and answers.
"""

from collections.abc import Callable
from math import tau

import numpy as np
from numpy.typing import NDArray

from daq import protection
from daq.answers import Answers
from daq.backend import (
    Backend,
    EnableOutput,
    FaultTarget,
    Output,
    OutputRefused,
    Reading,
    RestOutput,
    TruthSource,
)
from daq.commanding.commands import CommandError, Commands, Situation
from daq.continuity import Continuity, DriftWatch
from daq.envelope import Envelope, EnvelopeError, Present
from daq.events import LEFT_OUT, EventLog, Publish
from daq.guard import guard_of
from daq.messages import BlockStatus
from daq.messages_pb2 import ALARM, INFO, WARNING, Answer, Command, Status
from daq.rig import Rig
from daq.shaft import Shaft
from daq.stream import Stream
from daq.timing import StartTime, start_timed
from simulator.faults import Fault

AT_REST = 0.2 * tau
"""rad/s below which the rotor counts as at rest."""
OVERRUN, LATE = int(BlockStatus.OVERRUN), int(BlockStatus.LATE)
SENSOR_NOT_OK, GAP_BEFORE = int(BlockStatus.SENSOR_NOT_OK), int(BlockStatus.GAP_BEFORE)
LEASE_LOST = "lease lost"
MANUAL = "manual"

Reply = Callable[[Answer], object]


class Acquisition:
    """Acquires one run: `begin`, then `step` and `serve` until the end, `rest` until `at_rest`, `end`.

    Args:
        rig: what to acquire and how to protect it.
        backend: an opened device.
        publish: takes key and payload of everything that is published.
        run: run id.
        t0_ns: UTC of sample 0 in ns since 1970; None takes the host's clock when sampling starts.
    """

    def __init__(
        self, rig: Rig, backend: Backend, publish: Publish, *, run: str, t0_ns: int | None = None
    ) -> None:
        n_channels, read = len(rig.channels), rig.acquisition.read
        self.rig = rig
        self.run = run
        self.start_time: StartTime | None = None  # None until sampling has begun
        self.sample = 0  # index of the next sample to be read
        self.lost = 0  # samples that the device lost so far
        self.ending = False  # nothing moves any more
        self.ended = False
        self._rest_sample: int | None = None  # at which the rest for the run's end takes effect
        self.commands = Commands(rig, backend.capabilities)
        self._answers = Answers()
        self._backend = backend
        self._envelope = Envelope(rig, backend)
        self._publish = publish
        self._given_t0 = t0_ns
        self._paced = backend.capabilities.paced
        self._flags = int(BlockStatus.EMULATED) if backend.capabilities.emulated else 0
        self._truth = backend if isinstance(backend, TruthSource) else None
        self._shaft = Shaft(rig)
        self._guard = guard_of(rig)
        self._protection = protection.initial_state(self._guard)
        self._raw = np.empty((n_channels, read))
        self._values = np.empty((n_channels, read), np.float32)
        self._continuity = Continuity(rig.acquisition.rate)
        self._drift = DriftWatch(rig.acquisition.rate)

    @property
    def first_out(self) -> str:
        """Cause of the latched trip; empty when there is none."""
        latched = self._protection.first_out
        return latched.cause if latched else ""

    @property
    def state(self) -> str:
        """`waiting`, `idle`, `armed`, `tripped` or `ended`."""
        if self.start_time is None:
            return "waiting"
        if self.ended:
            return "ended"
        if self.first_out:
            return "tripped"
        return "armed" if self.commands.armed else "idle"

    @property
    def at_rest(self) -> bool:
        """Whether the rotor stood still in the last read; true for a rig that measures no speed."""
        for condition, now in zip(self._guard.conditions, self._protection.conditions, strict=True):
            if condition.name == "speed":
                return now.maximum < AT_REST
        return True

    @property
    def lag(self) -> float:
        """How far the acquisition is behind the device, s."""
        return max(0, self._backend.clock() - self.sample) / self.rig.acquisition.rate

    def begin(self) -> None:
        """Start sampling and publish the event `start`."""
        if self._given_t0 is None:
            self.start_time = start_timed(self._backend.start)
        else:
            self._backend.start()
            self.start_time = StartTime(self._given_t0, 0, "given")
        self._set_enable(True)
        rig, truth = self.rig, self._truth
        named = (truth.truth_names, truth.truth_units) if truth else None
        self._stream = Stream(rig, self._guard, self.run, self.start_time, self._publish, named)
        self._events = EventLog(rig, self.run, self.start_time, self._publish)
        self._events.add("start", f"run {self.run} of {rig.name} started", 0, details={"run": self.run})
        self._overdue = rig.channels.overdue(self.start_time.day)
        for name in self._overdue:
            text = f"channel {name}: its calibration was due on {rig.channels[name].due}"
            self._events.add("warning", text, 0, WARNING, {"cause": f"calibration {name}"})

    def due(self) -> float:
        """Return the seconds until a whole read is there; 0 when one is."""
        if not self._paced:
            return 0.0
        missing = self.sample + self.rig.acquisition.read - self._backend.clock()
        return max(0, missing) / self.rig.acquisition.rate

    def step(self) -> int:
        """Read what is there, at most one read; protect, act, publish. Return the number of samples read."""
        reading = self._receive()
        if not reading.n_samples:
            return 0
        flags = self._flags | reading.flags | self._lateness()
        values = self._calibrate(reading)
        self._shaft.add(values, reading.first_sample)
        verdict = protection.check(values, reading.first_sample, self._protection, self._guard)
        self._protection = verdict.state
        if not verdict.sensors_ok:
            flags |= SENSOR_NOT_OK
        if verdict.trip:
            self._trip("trip", verdict.trip)
        for warned in verdict.warnings:
            self._events.add("warning", warned.text, warned.sample, WARNING, {"cause": warned.cause})
        self._stream.add(values, reading.first_sample, flags)
        self._events.advance(self.sample)
        if self._truth:
            truth = self._truth.truth()[:, -reading.n_samples :]
            self._stream.add_truth(truth, reading.first_sample, flags)
        return reading.n_samples

    def serve(self, command: Command, reply: Reply = lambda answer: None) -> Answer:
        """Judge and carry out a command: the answer goes to `reply` first, then the event is published.

        A request that comes again, known by its id, gets the same answer and is not carried out again.
        """
        if self.start_time is None or self.ended:
            answer = Answer(text="the run has ended" if self.ended else "the run has not started yet")
            reply(answer)
            return answer
        if known := self._answers.get(command.id):
            reply(known)
            return known
        sample = self._backend.clock()
        try:
            answer = self._carry_out(command, sample)
        except (CommandError, EnvelopeError, OutputRefused) as error:
            answer = Answer(text=str(error), sample=sample)
        self._answers.keep(command.id, answer)
        reply(answer)
        self._note_command(command, answer, sample)
        return answer

    def renew(self, lease: str) -> None:
        """Take the lease holder's sign of life."""
        self.commands.renew(lease)

    def elapse(self, seconds: float) -> None:
        """Let time pass by the daq's own clock; a holder that is silent for too long loses the lease."""
        if self.start_time is not None and not self.ended:
            self._watch_clock(seconds)
        if self.commands.elapse(seconds):
            silence = f"{self.commands.holder} was silent for {self.rig.command.lease:g} s"
            text = f"{silence}: lease lost, rig brought to rest"
            self._trip("lease_lost", protection.Trip(LEASE_LOST, self._backend.clock(), text))

    def _watch_clock(self, seconds: float) -> None:
        """Publish when the device's clock and the host's part."""
        excess = self._drift.elapse(seconds, self._backend.clock())
        if excess:
            text = (
                f"the device's clock is {excess:+.0f} ppm off the computer's: look at rate and clock source"
            )
            self._events.add("clock_drift", text, self.sample, WARNING, {"ppm": excess})

    def rest(self) -> None:
        """Bring the rotor to rest for the run's end; no command moves it any more."""
        self.ending = True
        self._rest_sample = self._write_rest()

    def end(self) -> None:
        """Publish what is left and the event `end`, whose detail `samples` is the run's last index plus 1."""
        self._stream.flush()
        self.switch_recording(True)
        self._events.advance(self.sample, ending=True)
        self.ending = self.ended = True
        details = {"samples": self.sample, "lost": self.lost}
        if self._rest_sample is not None:
            details["effect_sample"] = self._rest_sample
        text = f"run ended after {self.sample / self.rig.acquisition.rate:.2f} s"
        self._events.add("end", text, self.sample, details=details)
        self._backend.stop()

    def fail(self, reason: str) -> None:
        """Publish that the device failed, before `end`; recording is switched on for it."""
        self.switch_recording(True)
        self._events.add("failure", reason, self.sample, ALARM)

    def status(self) -> Status:
        """Return the state of the acquisition; the caller adds clocks, queue fill and CPU share."""
        started = self.start_time
        timestamp = started.timestamp(self.sample, self.rig.acquisition.rate) if started else 0.0
        return Status(
            timestamp=timestamp,
            run=self.run,
            sample=self.sample,
            process="daq",
            state=self.state,
            lease_holder=self.commands.holder,
            first_out=self.first_out,
            backend=self.rig.acquisition.backend,
            samples=self.sample - self.lost,
            lost=self.lost,
            lag=self.lag if started and not self.ended else 0.0,
        )

    def _calibrate(self, reading: Reading) -> NDArray[np.float32]:
        """Turn the raw reading into the channels' units, float32."""
        raw = self._raw[:, : reading.n_samples]
        values = self._values[:, : reading.n_samples]
        values[...] = self.rig.channels.calibrate(raw, raw)
        return values

    def _receive(self) -> Reading:
        """Read what is there; leave out what came before, and publish what was wrong with the delivery."""
        reading = self._backend.read(self._raw)
        if not reading.n_samples:
            if self._paced and self.due() <= 0.0:
                self._continuity.nothing(self._backend.clock())
            return reading
        arrival = self._continuity.admit(reading, self._backend.clock())
        fresh = arrival.reading
        old = reading.n_samples - fresh.n_samples
        if old:
            self._raw[:, : fresh.n_samples] = self._raw[:, old : reading.n_samples].copy()
        if arrival.again:
            text = f"{arrival.again} samples came twice: left out"
            self._events.add("repeated", text, self.sample, WARNING, {"samples": arrival.again})
        if arrival.late:
            seconds = arrival.late / self.rig.acquisition.rate
            text = f"the device delivered nothing for {seconds:.3f} s; limits were not checked meanwhile"
            self._events.add("late", text, self.sample, WARNING, {"seconds": seconds})
        if fresh.n_samples:
            flags = self._note_gap(fresh, arrival.missing)
            self.sample = fresh.first_sample + fresh.n_samples
            fresh = fresh._replace(flags=fresh.flags | flags)
        return fresh

    def _note_gap(self, reading: Reading, missing: int) -> int:
        """Publish a gap when samples are missing before this reading."""
        if not missing:
            return 0
        expected = self.sample
        self.lost += missing
        last = reading.first_sample - 1
        overrun = reading.flags & OVERRUN
        cause = "the device's buffer overflowed" if overrun else "the device skipped samples"
        text = f"{missing} samples lost ({missing / self.rig.acquisition.rate:.3f} s): {cause}"
        self._events.add("gap", text, expected, ALARM, {"first": expected, "last": last, "cause": cause})
        return GAP_BEFORE

    def _lateness(self) -> int:
        """Flag a read after which a whole read, or more, is still waiting."""
        late = self._paced and self._backend.clock() - self.sample >= self.rig.acquisition.read
        return LATE if late else 0

    def _carry_out(self, command: Command, sample: int) -> Answer:
        """Perform an accepted command. Raises what it is refused by: rules, envelope or device."""
        now = Situation(sample, self.first_out, self.ending, self._shaft.motion(), self._overdue)
        decision = self.commands.decide(command, now)
        if command.name == "reset":
            self._reset()
        if decision.output:
            sample = self._write(decision.output, decision.at_sample)
        if decision.fault:
            self._inject(decision.fault)
        if command.name == "record":
            self.switch_recording(command.texts["switch"] == "on")
        if command.name in ("stop", "trip"):
            self._disarm()
        if command.name == "trip":
            manual = protection.Trip(MANUAL, sample, decision.text)
            self._latch(manual)
        return Answer(accepted=True, text=decision.text, sample=sample, lease=decision.lease)

    def _note_command(self, command: Command, answer: Answer, sample: int) -> None:
        """Publish a command with who asked for what and the answer."""
        who = command.who or "someone"
        details: dict[str, object] = {"who": who, **command.values, **command.texts}
        details |= {"answer": answer.text, "effect_sample": answer.sample}
        if not answer.accepted:
            text = f"{command.name} refused to {who}: {answer.text}"
            self._events.add("refused", text, sample, WARNING, details | {"command": command.name})
        elif command.name == "trip":
            self._events.add("trip", f"{who}: {answer.text}", sample, ALARM, details | {"cause": MANUAL})
        else:
            self._events.add(command.name, f"{who}: {answer.text}", sample, INFO, details)

    def _reset(self) -> None:
        state, refused = protection.reset(self._protection, self._guard)
        if refused:
            raise CommandError(f"the cause lives: {refused}")
        self._protection = state
        self._set_enable(True)

    def _trip(self, kind: str, trip: protection.Trip) -> None:
        """Bring the rig to rest, latch, and publish why."""
        holder = self.commands.holder
        effect = self._write_rest()
        self._latch(trip)
        details = {"cause": trip.cause, "first_out": self.first_out, "who": holder, "effect_sample": effect}
        self._events.add(kind, trip.text, trip.sample, ALARM, details)

    def _latch(self, trip: protection.Trip) -> None:
        """Keep the cause, unless there is one already, and drop the enable output."""
        self._protection = protection.latch(self._protection, trip)
        self._set_enable(False)

    def _write_rest(self) -> int:
        sample = self._write(RestOutput(self.rig.safe_state.ramp))
        self._disarm()
        return sample

    def _inject(self, fault: Fault) -> None:
        """Let something go wrong with an emulated rig."""
        if not isinstance(self._backend, FaultTarget):
            raise CommandError(f"the backend {self.rig.acquisition.backend} takes no faults")
        self._backend.inject(fault)

    def _disarm(self) -> None:
        """Revoke the lease, and go on recording, which is off for no longer than its holder is there."""
        self.commands.disarm()
        self.switch_recording(True)

    def switch_recording(self, switch: bool, sample: int | None = None) -> None:
        """Switch recording on, or off from a sample on; None: from the present one.

        Blocks that are not to be recorded are flagged; once they are over, an event tells which they were.
        """
        left_out = self._stream.record(switch, self._backend.clock() if sample is None else sample)
        if left_out:
            first, last = left_out
            seconds = (last - first + 1) / self.rig.acquisition.rate
            text = f"{seconds:.2f} s were left out of the recording, as commanded"
            self._events.add(LEFT_OUT, text, self.sample, details={"first": first, "last": last})

    def _set_enable(self, energised: bool) -> None:
        """Energise or drop the trip relay, where the device has one."""
        if EnableOutput in self._backend.capabilities.outputs:
            self._write(EnableOutput(energised))

    def _write(self, output: Output, at_sample: int | None = None) -> int:
        """Write to the device what the envelope lets through; return when it takes effect."""
        commands = self.commands
        now = Present(
            self._backend.clock(), commands.armed, commands.silence, bool(self.first_out), self.ending
        )
        sample = self._envelope.write(output, at_sample, now)
        commands.performed(output, sample)
        return sample
