"""No sequence of inputs leaves the rig running unarmed, un-latched or past a limit: a search for one.

The acquisition with its protection, its commands and its envelope runs on a device that only remembers.
"""

from itertools import pairwise
from math import inf, nan, tau

import numpy as np
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, rule

from daq.acquisition import Acquisition
from daq.backend import Capabilities, EnableOutput, HitOutput, Reading, RestOutput, SpeedOutput
from daq.commanding.commands import COUNTED_PAUSE, TAKES
from daq.messages_pb2 import Command
from daq.rig import load_rig

RIG = load_rig("thesis-ball")
READ = RIG.acquisition.read
LATENCY = 25
FORCE = RIG.channels.index("force_top")
NOISY = [index for index, channel in enumerate(RIG.channels) if channel.stuck]
NUMBERS = st.one_of(
    st.sampled_from([0.0, -1.0, 1e9, nan, inf, 1e-9]), st.floats(0.0, 70.0), st.floats(0.0, 0.06)
)


class Device:
    """Takes its samples from the test and performs outputs on a model of set-point, enable and pulses."""

    capabilities = Capabilities(
        (1.0, 1e6), (SpeedOutput, HitOutput, RestOutput, EnableOutput), True, None, True, False, 1.0
    )

    def __init__(self):
        self.sample = 0
        self.force = 0.0
        self.target = 0.0  # rad/s, the last set-point written, scheduled ones too
        self.enabled = False
        self.pulses = []  # (begin, end)
        self.speeds, self.ramps, self.forces = [], [], []

    def start(self):
        pass

    def stop(self):
        pass

    def clock(self):
        return self.sample

    def read(self, out):
        values = np.zeros(out.shape)
        values[NOISY] = 1e-6 * (-1.0) ** np.arange(out.shape[1])
        values[FORCE] += self.force
        out[...] = [
            channel.offset + channel.sensitivity * row
            for channel, row in zip(RIG.channels, values, strict=True)
        ]
        first, self.sample = self.sample, self.sample + out.shape[1]
        return Reading(first, out.shape[1], 0)

    def write(self, output, at_sample=None):
        sample = self.sample + LATENCY if at_sample is None else at_sample
        if isinstance(output, EnableOutput):
            self.enabled = output.energised
        elif isinstance(output, RestOutput):
            self.target = 0.0
            self.pulses = [(begin, min(end, sample)) for begin, end in self.pulses if begin < sample]
        elif isinstance(output, SpeedOutput):
            self.target = output.speed
            self.speeds.append(output.speed)
            self.ramps.append(output.ramp)
        else:
            self.pulses.append((sample, sample + round(output.duration * RIG.acquisition.rate)))
            self.forces.append(output.force)
        return sample


class Safety(RuleBasedStateMachine):
    """Whoever may do something does anything, in any order."""

    @initialize()
    def begin(self):
        self.device = Device()
        self.daq = Acquisition(RIG, self.device, lambda key, payload: None, run="run", t0_ns=0)
        self.daq.begin()
        self.leases = ["", "guessed"]
        self.silence = 0.0
        self.above = 0
        self.first_out = ""

    @rule(name=st.sampled_from(sorted(TAKES)), which=st.integers(0, 5), data=st.data())
    def ask(self, name, which, data):
        numbers, texts = TAKES[name]
        values = {key: data.draw(NUMBERS) for key in numbers if key != "at_sample"}
        if "at_sample" in numbers and data.draw(st.booleans()):
            values["at_sample"] = self.device.sample + data.draw(st.integers(-100, 300_000))
        given = {key: "horizontal" for key in texts if key == "solenoid"}
        command = Command(name=name, who="anyone", lease=self.leases[-(which % len(self.leases)) - 1])
        command.values.update(values)
        command.texts.update(given)
        answer = self.daq.serve(command)
        if answer.lease:
            self.leases.append(answer.lease)
            self.silence = 0.0
        if name == "reset" and answer.accepted:
            assert self.above == 0
            self.first_out = ""

    @rule(speed_hz=st.floats(0.1, 25.0), force=st.floats(0.0, 60.0), duration=st.floats(1e-4, 0.05))
    def run_properly(self, speed_hz, force, duration):
        """Arm, turn and hit as an operator does, so that there is something to stop."""
        answer = self.daq.serve(Command(name="arm", who="op", lease=self.leases[-1]))
        if answer.accepted:
            self.leases.append(answer.lease)
            self.silence = 0.0
            for name, values in (
                ("speed", {"speed_hz": speed_hz}),
                ("hit", {"force": force, "duration": duration}),
            ):
                self.daq.serve(Command(name=name, who="op", lease=answer.lease, values=values))

    @rule(force=st.sampled_from([0.0, 100.0, 160.0, 401.0, 600.0, -401.0, nan]), reads=st.integers(1, 8))
    def acquire(self, force, reads):
        self.device.force = force
        for _ in range(reads):
            self.daq.step()
            self.above = self.above + 1 if not abs(force) <= RIG.limits.force.trip else 0
            if self.above:
                assert self.daq.first_out, "past a limit and not latched"

    @rule(which=st.integers(0, 5))
    def renew(self, which):
        lease = self.leases[-(which % len(self.leases)) - 1]
        self.daq.renew(lease)
        if self.daq.commands.armed and lease == self.leases[-1]:
            self.silence = 0.0

    @rule(seconds=st.floats(0.0, 0.03))
    def elapse(self, seconds):
        self.silence += min(seconds, COUNTED_PAUSE)
        self.daq.elapse(seconds)
        if self.silence >= RIG.command.lease:
            assert not self.daq.commands.armed, "armed for somebody who is silent"

    @rule(really=st.integers(0, 30))
    def end(self, really):
        if really == 30:
            self.daq.rest()

    @invariant()
    def only_an_armed_rig_moves(self):
        if self.daq.first_out or self.daq.ending or not self.daq.commands.armed:
            assert self.device.target == 0.0
            assert all(end <= self.device.sample + LATENCY for _, end in self.device.pulses)

    @invariant()
    def a_trip_is_latched_until_reset_and_drops_the_enable_output(self):
        if self.first_out:
            assert self.daq.first_out == self.first_out
        self.first_out = self.daq.first_out
        assert self.device.enabled == (not self.first_out)
        assert not (self.first_out and self.daq.commands.armed)

    @invariant()
    def outputs_are_within_the_rigs_ranges(self):
        assert all(0.0 <= speed <= 25.0 * tau for speed in self.device.speeds)
        assert all(0.0 < ramp <= 50.0 * tau for ramp in self.device.ramps)
        assert all(0.0 <= force <= 60.0 for force in self.device.forces)
        assert all(end - begin <= 1250 for begin, end in self.device.pulses)
        pulses = sorted(self.device.pulses)
        assert all(before[1] <= after[0] for before, after in pairwise(pulses))


Safety.TestCase.settings = settings(max_examples=60, stateful_step_count=40)
TestSafety = Safety.TestCase
