"""Readings become blocks: whatever the readings' lengths, whatever is missing between them."""

from itertools import pairwise

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from daq.collector import Collector
from daq.messages import BlockStatus

BLOCK = 20


def collected(readings, stride=1, status=0):
    """Blocks (first sample, values of row 0, flags) of readings (first sample, length)."""
    blocks = []
    collector = Collector(
        2, BLOCK, stride, lambda *block: blocks.append((block[0], block[1].copy(), block[2]))
    )
    for first, length in readings:
        index = np.arange(first, first + length, dtype=float)
        collector.add(np.stack([index, -index]), first, status)
    collector.flush()
    return blocks


lengths = st.lists(st.integers(1, 70), min_size=1, max_size=20)
skips = st.lists(st.just(0) | st.integers(0, 90), min_size=20, max_size=20)


@given(lengths, skips, st.sampled_from([1, 5, 7]))
def test_every_kept_sample_arrives_once_in_blocks_that_end_on_a_multiple(lengths, skips, stride):
    readings, first = [], 0
    for length, skip in zip(lengths, skips, strict=False):
        readings.append((first, length))
        first += length + skip
    blocks = collected(readings, stride)
    expected = [
        sample
        for begin, length in readings
        for sample in range(begin, begin + length)
        if sample % stride == 0
    ]
    arrived = np.concatenate([samples[0] for _, samples, _ in blocks]) if blocks else np.empty(0)
    assert arrived.tolist() == expected
    for first_sample, samples, _ in blocks:
        assert samples[0, 0] == first_sample
        assert first_sample // BLOCK == int(samples[0, -1]) // BLOCK
        assert np.array_equal(samples[1], -samples[0])


@given(lengths)
def test_without_a_gap_all_blocks_but_the_last_are_full(lengths):
    readings, first = [], 0
    for length in lengths:
        readings.append((first, length))
        first += length
    blocks = collected(readings)
    assert all(samples.shape[1] == BLOCK for _, samples, _ in blocks[:-1])
    assert all(after[0] - before[0] == BLOCK for before, after in pairwise(blocks))


def test_flags_of_the_gap_stay_with_the_first_block_after_it():
    blocks = []
    collector = Collector(1, BLOCK, 1, lambda *block: blocks.append(block[2]))
    gap = BlockStatus.GAP_BEFORE | BlockStatus.OVERRUN
    collector.add(np.zeros((1, 50)), 0, int(gap | BlockStatus.EMULATED))
    collector.flush()
    assert blocks == [gap | BlockStatus.EMULATED, BlockStatus.EMULATED, BlockStatus.EMULATED]
