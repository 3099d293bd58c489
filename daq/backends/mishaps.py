"""What goes wrong with an emulated device as a device: lost, repeated and late samples, a plug, its clock."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from daq.backend import BackendError, Reading
from simulator.faults import Fault, FaultKind, Span, edges, schedule, span_of

TIMING = (FaultKind.LATE, FaultKind.CLOCK_DRIFT)
"""Faults that a device which does not live by the host's clock cannot have."""


class DeviceClock:
    """Turns the host's time into samples taken, at a pace that faults may change.

    Args:
        origin: s of the host's clock at sample 0.
        rate: of the samples, Hz.
        faults: the device's; those of its clock count.
    """

    def __init__(self, origin: float, rate: float, faults: Sequence[Fault]) -> None:
        self.origin = origin  # s at which sample 0 would have been at the present pace
        self.pace = rate
        drifts = [fault for fault in faults if fault.kind == FaultKind.CLOCK_DRIFT]
        self._drifts = schedule(drifts, rate)
        self._edges = edges(self._drifts)  # samples at which the pace is still to change
        self._rate = rate

    def add(self, drift: Fault) -> None:
        """Have one more drift, from a sample on that is still to come."""
        span = span_of(drift, self._rate)
        self._drifts = sorted([*self._drifts, span], key=lambda each: each.begin)
        self._edges = sorted({*self._edges, *edges([span])})

    def samples(self, now: float) -> int:
        """Return the number of samples taken until `now` (s of the host's clock)."""
        taken = (now - self.origin) * self.pace
        while self._edges and taken >= self._edges[0]:
            sample = self._edges.pop(0)
            then = self.origin + sample / self.pace
            self.pace = self._rate * pace_at(self._drifts, sample)
            self.origin = then - sample / self.pace
            taken = (now - self.origin) * self.pace
        return int(taken)


def pace_at(spans: Sequence[Span], sample: int) -> float:
    """Return how many times too fast a clock runs at a sample; of drifts that overlap the last one counts."""
    sizes = [span.fault.size or 0.0 for span in spans if span.acts(sample)]
    return 1.0 + 1e-6 * (sizes[-1] if sizes else 0.0)


class Mishaps:
    """The faults of a device's deliveries, in their order.

    Args:
        faults: the device's.
        rate: of the samples, Hz.
        paced: whether the device lives by the host's clock.
        n_channels: rows of a reading.
    """

    def __init__(self, faults: Sequence[Fault], rate: float, paced: bool, n_channels: int) -> None:
        left_out = (FaultKind.CLOCK_DRIFT,) if paced else TIMING
        self._schedule = schedule([fault for fault in faults if fault.kind not in left_out], rate)
        self._rate = rate
        repeats = [int(fault.size or 0) for fault in faults if fault.kind == FaultKind.REPEATED]
        self._memory = np.empty((n_channels, max(repeats, default=0)))
        self._remembered = 0  # samples in memory, at its end
        self._again = 0  # of those, how many are still to be delivered again

    def add(self, fault: Fault, sample: int) -> None:
        """Have one more fault, not before `sample`, which is still to be delivered.

        A repetition begins at the earliest when as many samples have been delivered as come again.
        """
        span = span_of(fault, self._rate)
        missing = int(fault.size or 0) - self._memory.shape[1]
        if fault.kind == FaultKind.REPEATED:
            span = span._replace(begin=max(span.begin, sample + int(fault.size or 0)))
        if fault.kind == FaultKind.REPEATED and missing > 0:
            empty = np.empty((len(self._memory), missing))
            self._memory = np.concatenate((empty, self._memory), axis=1)
        self._schedule = sorted([*self._schedule, span], key=lambda each: each.begin)

    def room(self, sample: int, count: int) -> int:
        """Return how many of `count` samples from `sample` on come before the next fault."""
        return min(count, self._schedule[0][0] - sample) if self._schedule else count

    def happen(self, sample: int, taken: int | None) -> tuple[bool, int]:
        """Let the faults happen that are due at the next sample.

        Args:
            sample: index of the next sample to be delivered.
            taken: the device's clock; None for one that takes samples when they are asked for.

        Returns:
            Whether the device delivers now, and the sample with which it goes on.

        Raises:
            BackendError: it was unplugged.
        """
        while self._schedule and self._schedule[0][0] <= sample:
            onset, _, fault = self._schedule[0]
            if fault.kind == FaultKind.UNPLUGGED:
                raise BackendError(f"the emulated device was unplugged at sample {onset}")
            if fault.kind == FaultKind.REPEATED:
                self._again = min(int(fault.size or 0), self._remembered)
            else:
                lasts = 1.0 if fault.kind == FaultKind.DROPPED else self._rate
                end = onset + round(lasts * (fault.size or 0.0))
                if taken is not None and taken < end:
                    return False, sample
                if fault.kind == FaultKind.DROPPED:
                    sample = max(sample, end)
            self._schedule.pop(0)
        return True, sample

    def repeat(self, sample: int, out: NDArray[np.float64]) -> Reading | None:
        """Deliver once more what was delivered before `sample`, if that is what goes wrong now."""
        if not self._again:
            return None
        count = min(self._again, out.shape[1])
        begin = self._memory.shape[1] - self._again
        out[:, :count] = self._memory[:, begin : begin + count]
        first = sample - self._again
        self._again -= count
        return Reading(first, count, 0)

    def remember(self, raw: NDArray[np.float64]) -> None:
        """Keep samples that were delivered, as long as they may be delivered again."""
        size = self._memory.shape[1]
        if size:
            self._memory = np.concatenate((self._memory, raw), axis=1)[:, -size:]
            self._remembered = min(size, self._remembered + raw.shape[1])
