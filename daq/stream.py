"""Publishes the samples of a run: blocks, their summaries and, where it is known, the true state."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from daq import keys
from daq.collector import Collector
from daq.events import Publish
from daq.guard import Guard, magnitude, rows_of
from daq.messages import BlockStatus, SeriesEncoder
from daq.messages_pb2 import Summary
from daq.rig import Rig
from daq.summary import ChannelStatistics, summarise
from daq.timing import StartTime

TRUTH_STRIDE = 5
"""Of the true state, samples whose index is a multiple of this are published."""
SUMMARY_PERIOD = 0.1
"""s that one channel summary covers."""
RECORDING_OFF = int(BlockStatus.RECORDING_OFF)


class Stream:
    """Turns readings into what is published of them.

    Args:
        rig: its channels, rate and block length.
        guard: how radius, force and speed follow from the channels.
        run: run id.
        start: UTC of sample 0.
        publish: takes key and payload.
        truth: names and units of the true signals; None when nobody knows them.
    """

    def __init__(
        self,
        rig: Rig,
        guard: Guard,
        run: str,
        start: StartTime,
        publish: Publish,
        truth: tuple[Sequence[str], Sequence[str]] | None = None,
    ) -> None:
        rate, block = rig.acquisition.rate, rig.acquisition.block
        names, units = rig.channels.names, rig.channels.units
        self._rate = rate
        self._start = start
        self._publish = publish
        self._planes = {condition.name: condition.planes for condition in guard.conditions}
        speed = self._planes.get("speed")
        self._speed_row = rows_of(speed[0], len(names))[0] if speed else None
        self._block_key = keys.block(rig.name)
        self._truth_key = keys.truth(rig.name)
        self._summary_key = keys.summary(rig.name)
        self._channel_keys = [keys.channel_summary(rig.name, name) for name in names]
        self._encoder = SeriesEncoder(run, rate, names, units)
        self._blocks = Collector(len(names), block, 1, self._publish_block)
        self._summary = Summary(run=run)
        self._statistics = ChannelStatistics(run, names, units)
        self._statistics_length = max(block, round(SUMMARY_PERIOD * rate))
        self._off_from: int | None = None  # sample from which on recording is off
        self._left_out: tuple[int, int] | None = None  # samples published while it was
        self._truth = None
        if truth:
            self._truth_encoder = SeriesEncoder(run, rate, *truth, stride=TRUTH_STRIDE)
            self._truth = Collector(len(truth[0]), block, TRUTH_STRIDE, self._publish_truth)

    def add(self, samples: NDArray[np.float32], first_sample: int, status: int) -> None:
        """Take in a reading in the channels' units, shape (n_channels, n)."""
        self._blocks.add(samples, first_sample, status)

    def add_truth(self, signals: NDArray[np.float64], first_sample: int, status: int) -> None:
        """Take in the true signals of a reading, shape (n_signals, n)."""
        if self._truth:
            self._truth.add(signals, first_sample, status)

    def record(self, switch: bool, sample: int) -> tuple[int, int] | None:
        """Switch recording on or off at a sample; whole blocks are left out, none of what came before it.

        Returns:
            When switched on: first and last of the samples that were left out; None where none were.
        """
        if not switch and self._off_from is None:
            self._off_from = sample
        if not switch:
            return None
        left_out, self._left_out, self._off_from = self._left_out, None, None
        return left_out

    def flush(self) -> None:
        """Publish what has been collected so far, at the run's end."""
        self._blocks.flush()
        if self._truth:
            self._truth.flush()
        self._publish_statistics()

    def _publish_block(self, first_sample: int, samples: NDArray[np.float32], status: int) -> None:
        timestamp = self._start.timestamp(first_sample, self._rate)
        if flag := self._off(first_sample):
            begin = self._left_out[0] if self._left_out else first_sample
            self._left_out = begin, first_sample + samples.shape[1] - 1
            status |= flag
        self._publish(self._block_key, self._encoder.encode(timestamp, first_sample, status, samples))
        summary = summarise(
            self._summary,
            timestamp,
            first_sample,
            samples.shape[1],
            self._mean_speed(samples),
            self._largest("displacement", samples),
            self._largest("force", samples),
        )
        self._publish(self._summary_key, summary)
        self._statistics.add(timestamp, first_sample, samples)
        if self._statistics.count >= self._statistics_length:
            self._publish_statistics()

    def _publish_truth(self, first_sample: int, signals: NDArray[np.float32], status: int) -> None:
        timestamp = self._start.timestamp(first_sample, self._rate)
        status |= self._off(first_sample)
        payload = self._truth_encoder.encode(timestamp, first_sample, status, signals)
        self._publish(self._truth_key, payload)

    def _off(self, first_sample: int) -> int:
        """Flag a series that begins after recording was switched off."""
        return RECORDING_OFF if self._off_from is not None and first_sample >= self._off_from else 0

    def _publish_statistics(self) -> None:
        for key, message in zip(self._channel_keys, self._statistics.take(), strict=False):
            self._publish(key, message.SerializeToString())

    def _mean_speed(self, samples: NDArray[np.float32]) -> float:
        return float(samples[self._speed_row].mean(dtype=np.float64)) if self._speed_row is not None else 0.0

    def _largest(self, name: str, samples: NDArray[np.float32]) -> float:
        planes = self._planes.get(name)
        return float(magnitude(samples, planes).max()) if planes else 0.0
