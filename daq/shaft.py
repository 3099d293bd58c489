"""Where the shaft is and how fast it turns, by the encoder, so that an output can wait for an angle."""

from collections import deque
from math import ceil, tau
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from daq.rig import Rig

ENCODER = "encoder_angle"
WINDOW = 0.1  # s over which the speed is taken: a count of 4096 a turn is then 0.02 % of it at 15 Hz
SLOWEST = 0.5 * tau  # rad/s below which no angle is waited for


class Motion(NamedTuple):
    """The shaft at one sample: angle from the encoder's zero, x towards y, and speed."""

    sample: int
    angle: float  # rad
    speed: float  # rad a sample

    def passage(self, angle: float, earliest: int) -> int:
        """Return the first sample from `earliest` on at which the shaft is at `angle` (rad), or just past it.

        The speed is taken to stay as it is.
        """
        way = np.sign(self.speed)
        there = self.angle + self.speed * (earliest - self.sample)
        return earliest + ceil(way * (angle - there) % tau / abs(self.speed) - 1e-6)


class Shaft:
    """Follows the encoder from read to read.

    Args:
        rig: one without the channel `encoder_angle` has no motion to tell.
    """

    def __init__(self, rig: Rig) -> None:
        self._row = rig.channels.index(ENCODER) if ENCODER in rig.channels else None
        self._sense = sense_of(rig) if self._row is not None else 0.0
        self._rate = rig.acquisition.rate
        self._seen: deque[tuple[int, float]] = deque()  # sample, angle without wrapping

    def add(self, values: NDArray[np.float32], first_sample: int) -> None:
        """Take in a read (n_channels, n) in the channels' units; samples before it may be missing."""
        if self._row is None:
            return
        sample = first_sample + values.shape[1] - 1
        angle = self._sense * float(values[self._row, -1])
        if self._seen:
            before, last = self._seen[-1]
            if sample - before > WINDOW * self._rate:
                self._seen.clear()
            else:
                angle = last + (angle - last + 0.5 * tau) % tau - 0.5 * tau
        self._seen.append((sample, angle))
        while sample - self._seen[0][0] > WINDOW * self._rate:
            self._seen.popleft()

    def motion(self) -> Motion | None:
        """Return how the shaft turns now; None when it hardly does, or that is not known."""
        if len(self._seen) < 2:
            return None
        (before, begin), (sample, angle) = self._seen[0], self._seen[-1]
        speed = (angle - begin) / (sample - before)
        return Motion(sample, angle, speed) if abs(speed) * self._rate >= SLOWEST else None


def sense_of(rig: Rig) -> float:
    """Return 1 when the encoder's angle grows as the shaft turns from x towards y, else -1."""
    direction = rig.encoder.direction if rig.encoder else 1
    return float(np.sign(rig.channels[ENCODER].sensitivity) * direction)
