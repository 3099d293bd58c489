"""A double of NI's driver at its lowest interface in Python: nidaqmx's own code runs above it.

A device "Dev1" with a 20 MHz timebase: analog inputs give volts that a test sets, `_ao0_vs_aognd` what the
output gives, `ai7` the pulses of all counters, a counter counts an encoder that turns at the test's speed.
Times are those of `clock`.
"""

import time
from collections import defaultdict

import numpy as np
from nidaqmx._base_interpreter import BaseInterpreter
from nidaqmx.errors import DaqError

TIMEBASE = 20e6
SOLENOID = "ai7"
AVAILABLE, ACQUIRED, CHANNELS_READ = 0x1223, 0x192A, 0x217B
GENERATED, CHANNELS_WRITTEN = 0x192B, 0x217E
SAMPLE_RATE = 0x1344
OVERWRITTEN, RESERVED, NO_DEVICE = -200279, -50103, -200220


class Task:
    """What the double knows of one task."""

    def __init__(self):
        self.channels = []
        self.rate = self.depth = None
        self.source = ""
        self.started = None  # s of the clock
        self.read = 0  # samples read since the start
        self.written = np.zeros(0)
        self.pulse = None


class Double(BaseInterpreter):
    """The driver. `volts`, `speed` (turns/s) and `busy` are the test's; `pulses` and `lines` were done."""

    __slots__ = ("__dict__",)

    def __init__(self):
        self.clock = time.monotonic
        self.tasks, self.made = {}, 0
        self.volts = defaultdict(float)
        self.speed = 0.0
        self.ticks_per_turn = 4096
        self.busy = False
        self.held = defaultdict(float)  # V that an analog output holds
        self.pulses, self.lines = [], []
        self.on = {}  # s of the clock from and to which a task's pulse is on

    def create_task(self, session_name):
        self.made += 1
        self.tasks[handle := self.made] = Task()
        return handle, True

    def get_system_info_attribute_uint32(self, attribute):
        return 26  # a version of the driver

    def get_task_attribute_string(self, task, attribute):
        return ", ".join(self.tasks[task].channels)

    def clear_task(self, task):
        self._settle(self.tasks[task])
        if task in self.on:
            begin, end = self.on[task]
            self.on[task] = begin, min(end, self.clock())
        del self.tasks[task]

    def _add(self, task, channel):
        if not channel.startswith("Dev1/"):
            raise DaqError(f"Device identifier is invalid.\n\nDevice Specified: {channel}", NO_DEVICE)
        self.tasks[task].channels.append(channel.removeprefix("Dev1/"))

    def create_ai_voltage_chan(self, task, physical_channel, *_):
        self._add(task, physical_channel)

    def create_ao_voltage_chan(self, task, physical_channel, *_):
        self._add(task, physical_channel)

    def create_do_chan(self, task, lines, *_):
        self._add(task, lines)

    def create_ci_ang_encoder_chan(self, task, counter, name, decoding, zidx, *rest):
        self._add(task, counter)
        assert zidx
        assert rest[-3] == self.ticks_per_turn // 4

    def create_co_pulse_chan_time(self, task, counter, name, units, idle, delay, low, high):
        self._add(task, counter)
        self.tasks[task].pulse = (counter, high)

    def cfg_implicit_timing(self, task, sample_mode, samps_per_chan):
        assert samps_per_chan == 1

    def cfg_samp_clk_timing(self, task, rate, source, active_edge, sample_mode, samps_per_chan):
        task = self.tasks[task]
        task.rate, task.depth, task.source = TIMEBASE / round(TIMEBASE / rate), samps_per_chan, source

    def get_timing_attribute_double(self, task, attribute):
        assert attribute == SAMPLE_RATE
        return self.tasks[task].rate

    def start_task(self, task):
        if self.busy:
            raise DaqError("The specified resource is reserved.\n\nStatus Code: -50103", RESERVED)
        handle, task = task, self.tasks[task]
        task.started, task.read = self.clock(), 0
        if task.pulse:
            self.pulses.append(task.pulse)
            self.on[handle] = task.started, task.started + task.pulse[1]

    def stop_task(self, task):
        self._settle(self.tasks[task])

    def wait_until_task_done(self, task, time_to_wait):
        task = self.tasks[task]
        time.sleep(max(0.0, task.started + len(task.written) / task.rate - self.clock()))

    def _settle(self, task):
        """End a task; an analog output holds what it has come to."""
        if task.started is not None and len(task.written):
            self.held[task.channels[0]] = task.written[min(self._passed(task), len(task.written) - 1)]
        task.started = None

    def _passed(self, task):
        """Samples of a running task until now; a counter's task goes by the analog inputs' clock."""
        clock = task
        if task.source:
            assert task.source == "/Dev1/ai/SampleClock"
            clock = next(
                other for other in self.tasks.values() if other.rate and other.channels[0][:2] != "ct"
            )
        return 0 if clock.started is None else int((self.clock() - clock.started) * clock.rate)

    def get_read_attribute_uint32(self, task, attribute):
        task = self.tasks[task]
        if attribute == CHANNELS_READ:
            return len(task.channels)
        assert attribute == AVAILABLE
        waiting = self._passed(task) - task.read
        if waiting > task.depth:
            raise DaqError("The application is not able to keep up.\n\nStatus Code: -200279", OVERWRITTEN)
        return waiting

    def get_read_attribute_uint64(self, task, attribute):
        assert attribute == ACQUIRED
        return self._passed(self.tasks[task])

    def get_write_attribute_uint32(self, task, attribute):
        assert attribute == CHANNELS_WRITTEN
        return len(self.tasks[task].channels)

    def get_write_attribute_uint64(self, task, attribute):
        assert attribute == GENERATED
        return min(self._passed(self.tasks[task]), len(self.tasks[task].written))

    def read_analog_f64(self, task, num_samps_per_chan, timeout, fill_mode, read_array):
        task = self.tasks[task]
        assert num_samps_per_chan <= self._passed(task) - task.read
        indices = task.read + np.arange(num_samps_per_chan)
        for row, channel in enumerate(task.channels):
            read_array[row] = self._input(task, channel, indices)
        task.read += num_samps_per_chan
        return read_array, num_samps_per_chan

    def _input(self, task, channel, indices):
        if channel == SOLENOID:
            times = task.started + indices / task.rate
            return self.volts[channel] + sum(1.0 * ((a <= times) & (times < b)) for a, b in self.on.values())
        if not channel.startswith("_ao0"):
            return self.volts[channel]
        for output in self.tasks.values():
            if output.channels == ["ao0"] and output.started is not None:
                age = task.started + indices / task.rate - output.started
                steps = np.clip((age * output.rate).astype(int), 0, len(output.written) - 1)
                return np.where(age < 0.0, self.held["ao0"], output.written[steps])
        return self.held["ao0"]

    def read_counter_f64_ex(self, task, num_samps_per_chan, timeout, fill_mode, read_array):
        task = self.tasks[task]
        turns = self.speed * (task.read + np.arange(num_samps_per_chan)) / task.rate
        read_array[:] = np.floor(turns * self.ticks_per_turn) % self.ticks_per_turn
        task.read += num_samps_per_chan
        return read_array, num_samps_per_chan

    def write_analog_f64(self, task, num_samps_per_chan, auto_start, timeout, data_layout, write_array):
        assert not auto_start
        self.tasks[task].written = write_array.copy()
        return num_samps_per_chan

    def write_digital_lines(self, task, num_samps_per_chan, auto_start, timeout, data_layout, write_array):
        assert auto_start
        self.lines.append((self.tasks[task].channels[0], bool(write_array[0])))
        return num_samps_per_chan


Double.__abstractmethods__ = frozenset()  # what is not made here raises NotImplementedError
