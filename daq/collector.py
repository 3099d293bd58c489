"""Cuts the stream of readings into blocks."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from daq.messages import BlockStatus

Deliver = Callable[[int, NDArray[np.float32], int], None]

AT_A_GAP = int(BlockStatus.GAP_BEFORE | BlockStatus.OVERRUN)
"""Flags that belong to the first block after a gap alone."""


class Collector:
    """Collects readings into blocks and hands each on when it is full.

    A block ends on a multiple of `block` samples, so all blocks are equally long, except the last of a
    run and those at a gap: a gap ends the block before it early, and the block after it begins with the
    first sample that is there and ends on the next multiple.

    Args:
        n_rows: rows of the readings.
        block: samples of a block.
        stride: keeps the samples whose index is a multiple of it.
        deliver: takes the index of the first kept sample, the samples as float32 of shape (n_rows, n) and
            the flags; the array is used again after it returns.
    """

    def __init__(self, n_rows: int, block: int, stride: int, deliver: Deliver) -> None:
        self._buffer = np.empty((n_rows, -(-block // stride)), np.float32)
        self._block = block
        self._stride = stride
        self._deliver = deliver
        self._next = 0
        self._first = 0
        self._fill = 0
        self._status = 0

    def add(self, samples: NDArray[np.floating], first_sample: int, status: int) -> None:
        """Take in a reading, shape (n_rows, n); one that does not follow the last one begins a new block."""
        if first_sample != self._next:
            self.flush()
        begin, count = 0, samples.shape[1]
        while begin < count:
            sample = first_sample + begin
            end = min(count, begin + self._block - sample % self._block)
            self._append(samples, begin, end, sample)
            self._status |= status
            status &= ~AT_A_GAP
            begin = end
            if (first_sample + end) % self._block == 0:
                self.flush()
        self._next = first_sample + count

    def flush(self) -> None:
        """Hand on what is there, also when it is less than a block."""
        if self._fill:
            self._deliver(self._first, self._buffer[:, : self._fill], self._status)
            self._fill = 0
            self._status = 0

    def _append(self, samples: NDArray[np.floating], begin: int, end: int, sample: int) -> None:
        offset = -sample % self._stride
        kept = samples[:, begin + offset : end : self._stride]
        if not kept.shape[1]:
            return
        if not self._fill:
            self._first = sample + offset
        self._buffer[:, self._fill : self._fill + kept.shape[1]] = kept
        self._fill += kept.shape[1]
