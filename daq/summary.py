"""Blocks in few numbers, so that a plot tool shows a rig by the names of its channels."""

from collections.abc import Sequence
from math import pi, sqrt

import numpy as np
from numpy.typing import NDArray

from daq.messages_pb2 import ChannelSummary, Summary


class ChannelStatistics:
    """Mean, least, largest and root mean square of every channel over several blocks.

    Args:
        run: run id.
        names: of the channels, in the order of the rows.
        units: of the channels.
    """

    def __init__(self, run: str, names: Sequence[str], units: Sequence[str]) -> None:
        self._messages = [
            ChannelSummary(run=run, name=name, unit=unit) for name, unit in zip(names, units, strict=True)
        ]
        self._count = 0
        self._first_sample = 0
        self._timestamp = 0.0

    @property
    def count(self) -> int:
        """Samples collected since the last `take`."""
        return self._count

    def add(self, timestamp: float, first_sample: int, samples: NDArray[np.float32]) -> None:
        """Take in a block, shape (n_channels, n), n at least 1."""
        lowest, highest = samples.min(axis=1), samples.max(axis=1)
        total = samples.sum(axis=1, dtype=np.float64)
        squares = np.square(samples, dtype=np.float64).sum(axis=1)
        if not self._count:
            self._timestamp, self._first_sample = timestamp, first_sample
            self._lowest, self._highest, self._total, self._squares = lowest, highest, total, squares
        else:
            np.minimum(self._lowest, lowest, out=self._lowest)
            np.maximum(self._highest, highest, out=self._highest)
            self._total += total
            self._squares += squares
        self._count += samples.shape[1]

    def take(self) -> list[ChannelSummary]:
        """Return one message for each channel and begin anew; none when nothing was collected."""
        count, self._count = self._count, 0
        if not count:
            return []
        columns = zip(
            self._messages,
            (self._total / count).tolist(),
            self._lowest.tolist(),
            self._highest.tolist(),
            (self._squares / count).tolist(),
            strict=True,
        )
        for message, mean, lowest, highest, square in columns:
            message.timestamp, message.first_sample, message.n_samples = (
                self._timestamp,
                self._first_sample,
                count,
            )
            message.mean, message.minimum, message.maximum, message.rms = mean, lowest, highest, sqrt(square)
        return self._messages


def summarise(
    message: Summary,
    timestamp: float,
    first_sample: int,
    n_samples: int,
    speed: float,
    radius: float,
    force: float,
) -> bytes:
    """Fill and pack a block's summary: mean speed (rad/s), largest radius (m) and force resultant (N)."""
    message.timestamp, message.first_sample, message.n_samples = timestamp, first_sample, n_samples
    message.speed_hz = speed / (2 * pi)
    message.radius_maximum, message.force_maximum = radius, force
    return message.SerializeToString()
