"""Readings that come late: what was measured `delay_s` before the sample in which it stands.

The observer's state is that of the sample. What a late sensor saw is that less the way since, and of the way
the prediction tells: so the ways of the last ticks are kept, and a reading is compared with the state less
the ways of its last ticks, the part of a tick in proportion. A correction since then moves past and present
alike, so that no correction is made twice. That the way is doubted too counts as noise of the reading.
"""

import numpy as np

from simulator.compile import kernel
from twin.layout import HOUSE, LONGEST, TILT, Memory


@kernel
def begin_way(memory: Memory) -> None:
    """Note where rotor and house are before a tick's prediction."""
    ways, head = memory.ways, (int(memory.latest[0]) + 1) % LONGEST
    memory.latest[0] = head
    for axis in range(2):
        ways[head, axis] = -memory.state[TILT + axis]
        ways[head, 2 + axis] = -memory.state[HOUSE + axis]


@kernel
def end_way(memory: Memory) -> None:
    """Note how far they have come with it."""
    ways, head = memory.ways, int(memory.latest[0])
    for axis in range(2):
        ways[head, axis] += memory.state[TILT + axis]
        ways[head, 2 + axis] += memory.state[HOUSE + axis]


@kernel
def way_since(memory: Memory, column: int, ticks: float) -> float:
    """Return how far a state of `TILT` or `HOUSE` has come by prediction in the last `ticks`."""
    place = column - TILT if column < HOUSE else column - HOUSE + 2
    head, total = int(memory.latest[0]), 0.0
    for age in range(LONGEST):
        share = min(ticks - age, 1.0)
        if share <= 0.0:
            break
        total += share * memory.ways[(head - age) % LONGEST, place]
    return total


@kernel
def way_variance(memory: Memory, columns: np.ndarray, weights: np.ndarray, seconds: float) -> float:
    """Return the variance of a reading because the rates are doubted, by which its way was predicted."""
    a, b = columns[0] + 2, columns[1] + 2  # the rates follow the places in `twin.layout`
    covariance = memory.covariance
    square = weights[0] * (weights[0] * covariance[a, a] + weights[1] * covariance[a, b])
    square += weights[1] * (weights[0] * covariance[b, a] + weights[1] * covariance[b, b])
    return square * seconds * seconds


@kernel
def forget_ways(memory: Memory) -> None:
    """Forget how rotor and house came where they are: they have just been set."""
    for age in range(memory.ways.shape[0]):
        for place in range(memory.ways.shape[1]):
            memory.ways[age, place] = 0.0
