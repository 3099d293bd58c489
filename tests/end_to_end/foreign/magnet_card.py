"""A laboratory's own backend: a card of a rig on active magnetic bearings, here computed."""

import time

import numpy as np

from rigtwin.backend import BackendError, BlockStatus, Capabilities, PastSampleError, Reading, RestOutput

HELD = 10.0  # s of samples that the card's buffer holds
SPEED = 50.0  # Hz
ORBIT = 40e-6  # m
BIAS, CONTROL = 2.0, 0.5  # A


class MagnetCard:
    capabilities = Capabilities(
        rates=(1.0, 204.8e3),
        outputs=(RestOutput,),
        hardware_timing=False,
        watchdog_s=1.0,
        emulated=False,
        paced=True,
    )

    def __init__(self):
        self._started = None

    def open(self, rig):
        self._rate, self._channels = rig.acquisition.rate, tuple(rig.channels)

    def start(self):
        self._started, self._next = time.monotonic(), 0

    def clock(self):
        if self._started is None:
            raise BackendError("the card is not sampling: call start() first")
        return int((time.monotonic() - self._started) * self._rate)

    def read(self, out):
        taken = self.clock()
        lost = max(0, taken - int(HELD * self._rate) - self._next)
        first = self._next + lost
        count = min(out.shape[1], taken - first)
        turns = SPEED * (first + np.arange(count)) / self._rate
        for row, channel in enumerate(self._channels):
            out[row, :count] = channel.offset + channel.sensitivity * value(channel, turns)
        self._next = first + count
        return Reading(first, count, int(BlockStatus.OVERRUN) if lost else 0)

    def write(self, output, at_sample=None):
        if at_sample is not None and at_sample < self.clock():
            raise PastSampleError(f"sample {at_sample} has passed")
        return self.clock()

    def stop(self):
        self._started = None

    close = stop


def value(channel, turns):
    """What a channel measures of a shaft that whirls forward in a circle, in its unit."""
    if channel.name == "keyphasor":
        return -8.0 * (turns % 1.0 < 0.02)  # V: a notch, once a turn
    if channel.quantity == "current":
        return BIAS + CONTROL * np.cos(2 * np.pi * turns)
    size = ORBIT if channel.station < 0.2 else 0.5 * ORBIT
    return size * np.cos(2 * np.pi * turns - np.radians(channel.angle_deg))
