"""A small run made by hand, for tests of recordings and replay: the messages of daq, emulator and twin."""

from collections.abc import Iterator
from importlib.resources import files
from pathlib import Path

import numpy as np

from daq import keys
from daq.messages import BlockStatus, SeriesEncoder
from daq.messages_pb2 import Description, Event, Summary
from daq.recording import RecordingWriter

RIG, RUN, RATE, BLOCK = "thesis-ball", "run-1", 25000.0, 250
T0_NS = 1_800_000_000_123_456_789
NAMES = ("proximity_x", "proximity_y", "force_top", "force_bottom", "force_left", "force_right")
UNITS = ("m", "m", "N", "N", "N", "N")


def description(**changes) -> Description:
    toml = files("rigs").joinpath("thesis-ball.toml").read_text()
    facts = {
        "run": RUN,
        "rig": RIG,
        "toml": toml,
        "rate": RATE,
        "t0_ns": T0_NS,
        "t0_uncertainty_ns": 1_000_000,
        "t0_source": "host clock",
        "mode": "EMULATED",
        "versions": {"rigtwin": "0.1.0"},
    }
    return Description(**(facts | changes))


def samples(first: int, rows: int, columns: int, stride: int = 1) -> np.ndarray:
    """Values that tell row and sample index: row + index / 1e6, with something to compress."""
    index = first + stride * np.arange(columns)
    return (np.arange(rows)[:, None] + np.sin(index / 97.0) + index / 1e6).astype(np.float32)


def time_of(sample: int) -> float:
    return T0_NS / 1e9 + sample / RATE


class Maker:
    """Makes the messages of the run, block by block."""

    def __init__(self, run: str = RUN) -> None:
        self.run = run
        self._block = SeriesEncoder(run, RATE, NAMES, UNITS)
        self._truth = SeriesEncoder(run, RATE, ("tilt_x", "tilt_y"), ("rad", "rad"), stride=5)
        self._estimate = SeriesEncoder(
            run, RATE, ("tilt_x", "tilt_y", "unbalance_x"), ("rad", "rad", "kg m"), stride=5
        )

    def block(self, number: int, status: int = BlockStatus.EMULATED) -> tuple[str, bytes]:
        first = number * BLOCK
        payload = self._block.encode(time_of(first), first, status, samples(first, len(NAMES), BLOCK))
        return keys.block(RIG), payload

    def truth(self, number: int) -> tuple[str, bytes]:
        first = number * BLOCK
        payload = self._truth.encode(time_of(first), first, 0, samples(first, 2, BLOCK // 5, 5))
        return keys.truth(RIG), payload

    def estimate(self, number: int) -> tuple[str, bytes]:
        first = number * BLOCK
        payload = self._estimate.encode(time_of(first), first, 0, samples(first, 3, BLOCK // 5, 5))
        return keys.estimate(RIG), payload

    def summary(self, number: int) -> tuple[str, bytes]:
        first = number * BLOCK
        message = Summary(
            timestamp=time_of(first), run=self.run, first_sample=first, n_samples=BLOCK, speed_hz=5.0
        )
        return keys.summary(RIG), message.SerializeToString()

    def event(
        self, sample: int, sequence: int, kind: str, source: str = "daq", **details: str
    ) -> tuple[str, bytes]:
        message = Event(
            timestamp=time_of(sample),
            run=self.run,
            sample=sample,
            sequence=sequence,
            source=source,
            kind=kind,
            text=f"{kind} at {sample}",
            details=details,
        )
        return keys.event(RIG, source), message.SerializeToString(deterministic=True)

    def end(self, blocks: int, sequence: int = 1) -> tuple[str, bytes]:
        return self.event(blocks * BLOCK, sequence, "end", samples=str(blocks * BLOCK))

    def all(self, number: int) -> list[tuple[str, bytes]]:
        """All that belongs to one block, in the order in which it travels."""
        return [self.truth(number), self.block(number), self.summary(number), self.estimate(number)]


def messages(blocks: int, *, end: bool = True) -> Iterator[tuple[str, bytes]]:
    """Yield the messages of a whole run."""
    make = Maker()
    yield make.event(0, 0, "start")
    for number in range(blocks):
        yield from make.all(number)
        if number == 3:
            yield make.event(3 * BLOCK + 7, 0, "mark", "operator")
    if end:
        yield make.end(blocks)


def record(path: Path, blocks: int = 100, *, end: bool = True) -> list[tuple[str, bytes]]:
    """Write a run of some blocks; return its messages."""
    written = list(messages(blocks, end=end))
    with RecordingWriter(path, description()) as writer:
        for number, (key, payload) in enumerate(written):
            writer.add(key, payload)
            if number % 40 == 39:  # about as often as a live recorder flushes
                writer.flush()
        writer.close(clean=end)
    return written
