"""Watches each sensor by itself: whether it reads within its range, changes at all, and is not noisy."""

import numpy as np

from daq.messages import Series
from daq.rig import Rig
from twin.fault import Fault
from twin.windows import Window

LOST = 3  # blocks in a row without one reading in the OK range
STUCK = 5  # blocks in a row in which a reading does not change
NOISY = 3.0  # times the noise that is expected
CERTAIN = 1.0


class ChannelWatch:
    """Looks at every block, and for noise at windows.

    Args:
        rig: for its channels.
        noises: rms that is expected of displacement and force channels, in this order, in their units.
    """

    def __init__(self, rig: Rig, noises: dict[str, float]) -> None:
        channels = list(rig.channels)
        self._rows = [
            i
            for quantity in noises
            for i, each in enumerate(channels)
            if each.quantity == quantity and each.station
        ]
        self._channels = [channels[row] for row in self._rows]
        self._noises = noises
        bounds = [
            sorted((end - each.offset) / each.sensitivity for end in each.ok or each.range)
            for each in self._channels
        ]
        self._low, self._high = np.array(bounds).T
        self._outside = np.zeros(len(self._rows), dtype=int)
        self._still = np.zeros(len(self._rows), dtype=int)
        self._told: set[int] = set()

    @property
    def healthy(self) -> bool:
        """Whether every channel's last block may be believed."""
        return not (self._outside.any() or (self._still >= STUCK).any())

    def add(self, block: Series) -> list[Fault]:
        """Take in a block and return what it proves."""
        values = block.samples[self._rows]
        smallest, largest = values.min(axis=1), values.max(axis=1)
        good = (smallest > self._low) & (largest < self._high)
        if not good.all():
            good = ((values > self._low[:, np.newaxis]) & (values < self._high[:, np.newaxis])).any(axis=1)
        self._outside = np.where(good, 0, self._outside + 1)
        self._still = np.where(largest > smallest, 0, self._still + 1)
        size = values.shape[1]
        faults = []
        for kind, counts, least in (("lost", self._outside, LOST), ("stuck", self._still, STUCK)):
            for index in np.flatnonzero(counts == least):
                onset = block.first_sample - (least - 1) * size
                faults += self._once(int(index), kind, 0.0, onset)
        return faults

    def judge(self, window: Window) -> list[Fault]:
        """Take in a window and return which channels are noisy; transducers ring in contact."""
        readings = np.concatenate([window.probes, window.forces]) if window.free else window.probes
        # Second differences leave white noise, sqrt(6) times as large, and nothing of slow motion.
        rms = np.sqrt(np.mean(np.diff(readings, n=2, axis=1) ** 2, axis=1) / 6.0)
        faults = []
        for index, channel in enumerate(self._channels[: len(rms)]):
            if rms[index] > NOISY * self._noises[channel.quantity]:
                faults += self._once(index, "noise", float(rms[index]), window.first_sample)
        return faults

    def forgive(self, name: str) -> None:
        """Let the faults of a channel be news again."""
        self._told -= {index for index, channel in enumerate(self._channels) if channel.name == name}

    def _once(self, index: int, kind: str, size: float, onset: int) -> list[Fault]:
        """Return a fault of a channel of which none was told."""
        if index in self._told:
            return []
        self._told.add(index)
        channel = self._channels[index]
        return [Fault(kind, channel.name, size, channel.unit, CERTAIN, onset)]
