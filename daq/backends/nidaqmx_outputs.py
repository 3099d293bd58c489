"""What an NI device moves a rig with: a voltage that follows a ramp, a pulse, and a relay."""

from math import ceil
from typing import Any

import numpy as np

from daq.rig.channels import Channel

RAMP_RATE = 1000.0
"""Hz with which a ramp is put out."""
SHORTEST = 1e-5
"""s that a pulse waits before it begins; the device asks for some."""


class SpeedRamp:
    """The speed's set-point as a voltage. A ramp is computed whole and put out by the device's own clock.

    Args:
        driver: the module nidaqmx.
        task: a new one.
        address: of the device.
        channel: the row of the output, whose sensitivity, offset and range turn speeds into volts.
    """

    def __init__(self, driver: Any, task: Any, address: str, channel: Channel) -> None:
        self._driver = driver
        self._task = task
        self._channel = channel
        low, high = channel.range
        task.ao_channels.add_ao_voltage_chan(f"{address}/{channel.terminal}", min_val=low, max_val=high)
        self._writer = driver.stream_writers.AnalogSingleChannelWriter(task.out_stream, auto_start=False)
        self._speeds = np.zeros(1)  # rad/s, of the ramp that is under way or was the last
        self._started = False

    def now(self) -> float:
        """Return the set-point that the device has reached, rad/s."""
        if not self._started:
            return float(self._speeds[-1])
        done = int(self._task.out_stream.total_samp_per_chan_generated)
        return float(self._speeds[min(done, len(self._speeds) - 1)])

    def go(self, speed: float, ramp: float) -> None:
        """Go from where the set-point is to `speed` (rad/s) with `ramp` (rad/s2)."""
        now = self.now()
        count = max(2, ceil(abs(speed - now) / ramp * RAMP_RATE) + 1)
        self._task.stop()
        self._speeds = np.linspace(now, speed, count)
        finite = self._driver.constants.AcquisitionType.FINITE
        self._task.timing.cfg_samp_clk_timing(RAMP_RATE, sample_mode=finite, samps_per_chan=count)
        volts = self._channel.offset + self._channel.sensitivity * self._speeds
        self._writer.write_many_sample(np.clip(volts, *self._channel.range))
        self._task.start()
        self._started = True

    def finish(self) -> None:
        """Wait until the ramp that is under way is over."""
        if self._started:
            self._task.wait_until_done(len(self._speeds) / RAMP_RATE + 1.0)
            self._task.stop()
            self._speeds, self._started = self._speeds[-1:], False


class Pulse:
    """A solenoid switched by a counter: the counter ends the pulse, whatever happens to this program.

    Args:
        driver: the module nidaqmx.
        counter: its physical channel.
    """

    def __init__(self, driver: Any, counter: str) -> None:
        self._driver = driver
        self._counter = counter
        self._task: Any = None

    def fire(self, duration: float) -> None:
        """Switch on now, for `duration` s."""
        self.end()
        self._task = self._driver.Task()
        self._task.co_channels.add_co_pulse_chan_time(
            self._counter, initial_delay=SHORTEST, low_time=SHORTEST, high_time=duration
        )
        finite = self._driver.constants.AcquisitionType.FINITE
        self._task.timing.cfg_implicit_timing(sample_mode=finite, samps_per_chan=1)
        self._task.start()

    def end(self) -> None:
        """Switch off; the line idles low."""
        if self._task is not None:
            self._task.close()
            self._task = None


class Relay:
    """A digital line, low until it is set.

    Args:
        driver: the module nidaqmx.
        task: a new one.
        line: its physical channel.
    """

    def __init__(self, driver: Any, task: Any, line: str) -> None:
        task.do_channels.add_do_chan(line)
        self._writer = driver.stream_writers.DigitalSingleChannelWriter(task.out_stream, auto_start=True)

    def set(self, high: bool) -> None:
        """Drive the line."""
        self._writer.write_one_sample_one_line(high)
