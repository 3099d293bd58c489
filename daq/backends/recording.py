"""A recording played as a device: its samples, as raw readings, at the pace at which they were taken."""

from collections.abc import Callable, Iterator
from time import monotonic

import numpy as np
from numpy.typing import NDArray

from daq import keys
from daq.backend import BackendError, Capabilities, Output, Reading, RestOutput, address_of, take_rest
from daq.messages import BlockStatus, Series, decode_series
from daq.recording.reader import Recording
from daq.recording.storage import RecordingError
from daq.rig import Rig
from daq.rig.channels import ChannelTable
from simulator.validation import nearest

RATES = (1e-3, 1e9)
OVERRUN, CLIPPED = int(BlockStatus.OVERRUN), int(BlockStatus.CLIPPED)


class RecordedDevice:
    """Plays a recording's samples (a `Backend`), so that the whole daq runs on what was once measured.

    `[device] address` is the recording. Its channels are matched to the rig's by name, and their values
    are turned back to volts by the rig's sensitivities and offsets. Samples that the recording lacks are a
    gap anew. Nothing can be moved. When the recording is over, reading raises `BackendError`.

    Args:
        paced: whether a sample is there once its time has come; otherwise whenever it is asked for.
        clock: seconds that never go back.
    """

    def __init__(self, paced: bool = True, clock: Callable[[], float] = monotonic) -> None:
        self.capabilities = Capabilities(
            rates=RATES,
            outputs=(RestOutput,),
            hardware_timing=False,
            watchdog_s=None,
            emulated=True,
            paced=paced,
        )
        self._now = clock
        self._recording: Recording | None = None
        self._blocks: Iterator[Series] | None = None

    def open(self, rig: Rig) -> None:
        """Open the recording and match its channels."""
        address = address_of(rig, "the recording to play")
        try:
            self._recording = Recording(address)
            first = next(self._all_blocks(), None)
        except RecordingError as error:
            raise BackendError(str(error)) from error
        if first is None:
            raise BackendError(f"{address} holds no samples")
        if first.rate != rig.acquisition.rate:
            raise BackendError(
                f"{address} was sampled with {first.rate:g} Hz: write [acquisition] rate = {first.rate!r}"
            )
        self._rate = rig.acquisition.rate
        self._origin_sample = first.first_sample
        self._rows = rows_of(rig.channels, first.names, address)
        self._channels = rig.channels

    def start(self) -> None:
        """Begin with the recording's first sample, as sample 0."""
        self._opened()
        self._blocks = self._all_blocks()
        self._part = self._next_block()
        self._next = 0
        self._began = self._now()

    def clock(self) -> int:
        """Return the number of samples taken."""
        self._playing()
        return int((self._now() - self._began) * self._rate) if self.capabilities.paced else self._next

    def read(self, out: NDArray[np.float64]) -> Reading:
        """Give the oldest samples, up to the end of a recorded block."""
        self._playing()
        if not self._part.samples.shape[1]:
            self._part = self._next_block()
        first = self._part.first_sample - self._origin_sample
        count = min(out.shape[1], self._part.samples.shape[1])
        if self.capabilities.paced:
            count = min(count, self.clock() - first)
        if count <= 0:
            return Reading(self._next, 0, 0)
        self._to_raw(self._part.samples[self._rows, :count], out[:, :count])
        flags = OVERRUN if first > self._next else 0
        flags |= self._part.status & CLIPPED
        self._next = first + count
        self._forget(count)
        return Reading(first, count, flags)

    def write(self, output: Output, at_sample: int | None = None) -> int:
        """Accept `RestOutput`, which does nothing, and no other."""
        return take_rest(output, at_sample, self.clock(), "a recording")

    def stop(self) -> None:
        """End playing."""
        self._blocks = None

    def close(self) -> None:
        """Close the recording."""
        self.stop()
        if self._recording is not None:
            self._recording.close()
            self._recording = None

    def _opened(self) -> Recording:
        if self._recording is None:
            raise BackendError("the recording is not open: call open(rig) first")
        return self._recording

    def _playing(self) -> Iterator[Series]:
        if self._blocks is None:
            raise BackendError("the recording is not playing: call start() first")
        return self._blocks

    def _all_blocks(self) -> Iterator[Series]:
        """Yield the recorded blocks that hold samples."""
        recording = self._opened()
        for message in recording.messages(keys.block(recording.description.rig)):
            series = decode_series(message.payload)
            if series.samples.shape[1]:
                yield series

    def _next_block(self) -> Series:
        block = next(self._playing(), None)
        if block is None:
            path = self._opened().path
            raise BackendError(f"{path} is over after {self._next / self._rate:.3f} s")
        return block

    def _forget(self, count: int) -> None:
        """Go on behind samples that have been read."""
        part = self._part
        self._part = part._replace(first_sample=part.first_sample + count, samples=part.samples[:, count:])

    def _to_raw(self, values: NDArray[np.float32], out: NDArray[np.float64]) -> None:
        """Turn values into the volts or counts that gave them."""
        for row, channel in enumerate(self._channels):
            out[row] = values[row].astype(np.float64) * channel.sensitivity + channel.offset


def rows_of(channels: ChannelTable, recorded: tuple[str, ...], source: str) -> list[int]:
    """Return the recorded row of each channel. Raises `BackendError` for one that was not recorded."""
    for name in channels.names:
        if name not in recorded:
            raise BackendError(f"{source} has no channel {name}{nearest(name, recorded, 'it has')}")
    return [recorded.index(name) for name in channels.names]
