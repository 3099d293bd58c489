"""The sensors of a simulated rig with what goes wrong with them: the same bytes however they are read."""

from collections.abc import Iterable, Sequence
from math import radians, sqrt

import numpy as np
from numpy.typing import NDArray

from simulator.compile import kernel
from simulator.faults import MOST_KEPT, Fault, FaultKind, Span, edges, schedule, span_of
from simulator.instruments import Probe
from simulator.numeric import sine_cosine
from simulator.rig import RigError
from simulator.sensors import ROWS, VOLTS, SensorTable, read_sensors
from simulator.validation import nearest, written

Signals = NDArray[np.float64]

ANGLE = ROWS["angle"]
COUNTERS_MAY = (FaultKind.SKEW, FaultKind.STUCK)


class Readings:
    """Turns true signals into raw readings, sample after sample, with the sensors' faults.

    `channels` and `table` describe the same channels in the same order; `faults` are those of sensors,
    `rate` is samples a second. Without faults it is `read_sensors`. Raises `RigError` for a fault of a
    channel that cannot have it.
    """

    def __init__(
        self, channels: Iterable[Probe], table: SensorTable, faults: Sequence[Fault], rate: float, seed: int
    ) -> None:
        self.channels = list(channels)
        self.table = table
        self.rate = rate
        self.seed = seed
        names = [channel.name for channel in self.channels]
        self._spans = schedule(faults, rate)
        self._edges = edges(self._spans)
        self._rows = [row_of(span.fault, names, table) for span in self._spans]
        self._memory = memory_of(faults)  # samples of the past that are needed
        self._past: Signals | None = None
        self._held: dict[int, float] = {}  # reading of a stuck channel, by fault

    def add_fault(self, fault: Fault) -> None:
        """Have one more fault, from a sample on that is still to come. Raises `RigError`."""
        row = row_of(fault, [channel.name for channel in self.channels], self.table)
        self._memory = memory_of([*(span.fault for span in self._spans), fault])
        self._spans.append(span_of(fault, self.rate))
        self._rows.append(row)
        self._edges = edges(self._spans)
        lag = lag_of(fault)
        if self._past is not None and lag:
            oldest = np.repeat(self._past[:, :1], lag, axis=1)
            self._past = np.concatenate((oldest, self._past), axis=1) if oldest.size else None

    def read(self, signals: Signals, first_sample: int, raw: Signals) -> bool:
        """Fill `raw` (n_channels, n) from true signals (17, n); return whether an input was clipped.

        Column 0 is sample `first_sample`. With faults, samples must be read in order and without a gap.
        """
        if not self._spans:
            return read_sensors(self.table, signals, first_sample, self.seed, raw)
        count = signals.shape[1]
        if not count:
            return False
        if self._past is None:
            self._past = np.repeat(signals[:, :1], self._memory, axis=1)
        known = np.concatenate((self._past, signals), axis=1)
        begins = [0, *(edge - first_sample for edge in self._edges if 0 < edge - first_sample < count)]
        clipped = False
        for begin, end in zip(begins, [*begins[1:], count], strict=True):
            clipped = self._part(known, begin, end, first_sample + begin, raw) or clipped
        self._past = known[:, count:].copy()
        return clipped

    def miss(self, signals: Signals, first_sample: int) -> None:
        """Take note of samples that nobody reads, so that the next reading follows without a gap."""
        if self._spans:
            self.read(signals, first_sample, np.empty((len(self.channels), signals.shape[1])))

    def _part(self, known: Signals, begin: int, end: int, first_sample: int, raw: Signals) -> bool:
        """Fill the columns from `begin` to `end`, through which the same faults act."""
        active = [index for index, span in enumerate(self._spans) if span.acts(first_sample)]
        signals = known[:, self._memory + begin : self._memory + end]
        table, rows = self._disturbed(known, begin, end, first_sample, active)
        part = np.empty((len(self.channels), end - begin))
        clipped = read_sensors(
            table, np.ascontiguousarray(np.concatenate((signals, *rows))), first_sample, self.seed, part
        )
        for index in active:
            clipped = self._replace(index, part) or clipped
        raw[:, begin:end] = part
        return clipped

    def _disturbed(
        self, known: Signals, begin: int, end: int, first_sample: int, active: list[int]
    ) -> tuple[SensorTable, list[Signals]]:
        """Return the table and the further rows of signals that stand in for what disturbed channels see."""
        table = SensorTable(*(column.copy() for column in self.table))
        rows: list[Signals] = []
        for channel in dict.fromkeys(self._rows[index] for index in active):
            spans = [self._spans[index] for index in active if self._rows[index] == channel]
            lag = sum(lag_of(span.fault) for span in spans)
            seen = known[:, self._memory + begin - lag : self._memory + end - lag]
            row = len(known) + len(rows)
            if table.kind[channel] != VOLTS:
                table.row_a[channel] = row
                rows.append(seen[self.table.row_a[channel]][np.newaxis])
                continue
            rows.append(self._volts(channel, spans, seen, known, begin, first_sample)[np.newaxis])
            table.row_a[channel] = table.row_b[channel] = row
            table.gain_a[channel], table.gain_b[channel], table.offset[channel] = 1.0, 0.0, 0.0
            added = sum(
                (self._scale(channel) * (span.fault.size or 0.0)) ** 2
                for span in spans
                if span.fault.kind == FaultKind.NOISE
            )
            table.noise[channel] = sqrt(table.noise[channel] ** 2 + added)
        return table, rows

    def _volts(
        self,
        channel: int,
        spans: list[Span],
        seen: Signals,
        known: Signals,
        begin: int,
        first_sample: int,
    ) -> Signals:
        """Return what a disturbed sensor gives, V, before noise and converter."""
        table, count = self.table, seen.shape[1]
        offset = table.offset[channel]
        volts: Signals = (
            table.gain_a[channel] * seen[table.row_a[channel]]
            + table.gain_b[channel] * seen[table.row_b[channel]]
            + offset
        )
        for onset, _, fault in spans:
            size = fault.size or 0.0
            if fault.kind == FaultKind.GAIN:
                volts = offset + size * (volts - offset)
            elif fault.kind == FaultKind.DRIFT:
                ages = np.arange(first_sample - onset, first_sample - onset + count) / self.rate
                volts = volts + self._scale(channel) * size * ages
            elif fault.kind == FaultKind.RUNOUT:
                angle = known[ANGLE, self._memory + begin : self._memory + begin + count]
                cosines = np.ascontiguousarray(angle) - radians(fault.angle_deg)
                become_cosines(cosines)
                volts = volts + self._scale(channel) * size * cosines
        return volts

    def _scale(self, channel: int) -> float:
        """Return a channel's volts per SI unit."""
        return self.channels[channel].sensitivity

    def _replace(self, index: int, part: Signals) -> bool:
        """Put in place what no longer depends on the sensor; return whether that is out of range."""
        fault, channel = self._spans[index].fault, self._rows[index]
        if fault.kind == FaultKind.STUCK:
            part[channel] = self._held.setdefault(index, part[channel, 0])
        if fault.kind == FaultKind.OPEN:
            part[channel] = self.table.low[channel]
            return True
        return False


def lag_of(fault: Fault) -> int:
    """Return by how many samples a fault makes its channel lag."""
    return int(fault.size or 0.0) if fault.kind == FaultKind.SKEW else 0


def memory_of(faults: Iterable[Fault]) -> int:
    """Return how many samples of the past faults need together. Raises `RigError` for too many."""
    memory = sum(map(lag_of, faults))
    if memory > MOST_KEPT:
        raise RigError(
            f'[[emulator.fault]] kind = "skew": the sizes add up to {memory} samples, which are all kept; '
            f"they may add up to {MOST_KEPT}"
        )
    return memory


def row_of(fault: Fault, names: Sequence[str], table: SensorTable) -> int:
    """Return the number of a fault's channel. Raises `RigError`."""
    kind = written(FaultKind(fault.kind))
    if fault.channel not in names:
        raise RigError(
            f'[[emulator.fault]] kind = "{kind}" channel = "{fault.channel}" is no channel of the rig'
            f"{nearest(fault.channel, names, 'there are')}"
        )
    row = names.index(fault.channel)
    if table.kind[row] != VOLTS and fault.kind not in COUNTERS_MAY:
        may = ", ".join(map(written, COUNTERS_MAY))
        raise RigError(
            f'[[emulator.fault]] kind = "{kind}" does not go with {fault.channel}, a counter; it may be {may}'
        )
    return row


@kernel
def become_cosines(angles: np.ndarray) -> None:
    """Put the cosine of each angle (rad) in its place, by arithmetic alone."""
    for index in range(angles.shape[0]):
        angles[index] = sine_cosine(angles[index])[1]
