"""Which sensors the observer believes: one with a fault is left out, and taken in again once it is good.

What the observer learnt from a faulty sensor before the fault was named is undone: it goes back to before the
fault's onset and over the blocks since then again, without the sensor. All depends on the blocks alone, so a
re-run decides the same at the same samples.
"""

from collections import deque
from typing import NamedTuple

import numpy as np

from daq.messages import Series
from twin.estimate import Estimated
from twin.fault import Fault
from twin.observer import Observer, Saved

CONFIDENT = 0.9  # of a fault, from which its sensor is left out
STRETCH = 0.5  # s between two states that are kept, and over which a sensor that is left out is judged
KEPT = 8  # such stretches: how far the observer can go back
MARGIN = 1.5  # s before the onset, which is known about so well, that it goes back to
GOOD = 3  # stretches in a row in which a sensor must be good to be taken in again
EXPECTED = 4.0  # times the variance that its distance from the estimate may have then: twice the deviation
BETTER = 1.0 / 3.0
"""Of the largest distance since it was left out, or of the fault's, relative to what it should read."""
QUIET = 3.0  # times the sensor's noise that it should read, or it cannot show whether its gain is right
NEEDS_SIGNAL = ("gain", "skew")
SQUARES = {"drift": 1.0, "noise": 1.0, "runout": 0.5}
"""Mean square of what a fault adds to a reading, over the square of its size."""


class Change(NamedTuple):
    """A sensor that is left out from a sample on, or taken in again."""

    channel: str
    left_out: bool
    sample: int


class Stretch(NamedTuple):
    """The observer at a stretch's first sample, and the blocks since then."""

    saved: Saved
    blocks: list[Series]


class Suspect:
    """A sensor that is left out: how far it is from what the estimate says that it should read.

    Args:
        index: of the sensor among the observer's.
        fault: that was named.
    """

    def __init__(self, index: int, fault: Fault) -> None:
        self.index, self.fault = index, fault
        self._squares: list[tuple[float, float, float]] = []  # of distance, expectation, what it should read
        self._worst = 0.0
        self._good = 0

    def add(self, observer: Observer, block: Series, estimated: Estimated) -> None:
        """Take in a block with its estimate."""
        sensors, i = observer.sensors, self.index
        names = [estimated.names[column] for column in sensors.columns[i]]
        should = sensors.weights[i] @ np.stack([estimated.row(name) for name in names])
        distance = block.samples[sensors.channel[i], :: estimated.stride] - should
        expected = observer.variance_of(i)
        self._squares.append((float(np.mean(distance**2)), expected, float(np.mean(should**2))))

    def is_good(self, blocks: int, noise: float) -> bool:
        """Tell whether it has been good for long; `noise` is the sensor's variance."""
        if len(self._squares) >= blocks:
            self._judge(noise)
        return self._good >= GOOD

    def begin(self) -> None:
        """Count from here on for how long it has been good."""
        self._squares.clear()
        self._good = 0

    def _judge(self, noise: float) -> None:
        """Judge the stretch that is over."""
        distance, expected, should = np.mean(self._squares, axis=0)
        self._squares.clear()
        if self.fault.kind in NEEDS_SIGNAL and should < QUIET**2 * noise:
            return
        relative = float(distance / (should + noise))
        self._worst = max(self._worst, relative, claimed(self.fault, should) / (should + noise))
        good = distance < EXPECTED * expected and relative < BETTER**2 * self._worst
        self._good = self._good + 1 if good else 0


class Trust:
    """Follows which sensors of an observer have a fault, and tells it to leave them out.

    Args:
        observer: whose first block is still to come.
    """

    def __init__(self, observer: Observer) -> None:
        self._observer = observer
        rig = observer.rig
        self._blocks = max(1, round(STRETCH * rig.acquisition.rate / rig.acquisition.block))
        self._past: deque[Stretch] = deque([Stretch(observer.saved(), [])], maxlen=KEPT)
        self._suspects: dict[str, Suspect] = {}

    def add(self, block: Series, estimated: Estimated, faults: list[Fault]) -> list[Change]:
        """Take in the block that the observer has just estimated over, with the faults that it proves.

        Returns the changes, which count from the next block on.
        """
        end = block.first_sample + block.samples.shape[1]
        if estimated.missing:
            self._past.clear()
            self._past.append(Stretch(self._observer.saved(), []))
        else:
            self._past[-1].blocks.append(block)
        changes = [self._take_in(name, end) for name in self._good(block, estimated)]
        changes += [self._leave_out(fault, end) for fault in faults if self._matters(fault)]
        if len(self._past[-1].blocks) >= self._blocks:
            self._past.append(Stretch(self._observer.saved(), []))
        return changes

    def _matters(self, fault: Fault) -> bool:
        """Tell whether a fault's sensor is to be left out: never one without which nothing sees the rotor."""
        observer = self._observer
        if fault.channel not in observer.sensor_names or fault.channel in self._suspects:
            return False
        return (
            fault.confidence >= CONFIDENT and fault.kind != "lost" and observer.can_do_without(fault.channel)
        )

    def _good(self, block: Series, estimated: Estimated) -> list[str]:
        """Return the sensors that have been good for long."""
        found = []
        for name, suspect in self._suspects.items():
            suspect.add(self._observer, block, estimated)
            if suspect.is_good(self._blocks, self._noise(suspect)):
                found.append(name)
        return found

    def _noise(self, suspect: Suspect) -> float:
        """Return the variance of a sensor's noise."""
        return float(self._observer.sensors.variance[suspect.index])

    def _take_in(self, name: str, sample: int) -> Change:
        del self._suspects[name]
        self._observer.take_in(name)
        self._past.clear()  # what it learnt without the sensor is not to be learnt again with it
        self._past.append(Stretch(self._observer.saved(), []))
        return Change(name, False, sample)

    def _leave_out(self, fault: Fault, sample: int) -> Change:
        """Leave out a fault's sensor, as from before its onset."""
        observer, rate = self._observer, self._observer.rig.acquisition.rate
        suspect = Suspect(observer.sensor_names.index(fault.channel), fault)
        self._suspects[fault.channel] = suspect
        since = fault.onset - MARGIN * rate
        first = max((i for i, each in enumerate(self._past) if begin_of(each, sample) <= since), default=0)
        again = list(self._past)[first:]
        observer.go_back(again[0].saved)
        observer.leave_out(fault.channel)
        while len(self._past) > first:
            self._past.pop()
        for stretch in again:
            self._past.append(Stretch(observer.saved(), stretch.blocks))
            for block in stretch.blocks:
                suspect.add(observer, block, observer.update(block))
                suspect.is_good(self._blocks, self._noise(suspect))
        suspect.begin()
        return Change(fault.channel, True, sample)


def claimed(fault: Fault, should: float) -> float:
    """Return the mean square by which a fault moves a reading; `should` is that of what it should read.

    0 where the fault says nothing of it: then only the sensor's own worst tells that it has become better.
    """
    if fault.kind == "gain":
        return (fault.size - 1.0) ** 2 * should
    return SQUARES.get(fault.kind, 0.0) * fault.size**2


def begin_of(stretch: Stretch, now: int) -> int:
    """Return a stretch's first sample, which for one without a block is `now`."""
    return stretch.blocks[0].first_sample if stretch.blocks else now
