"""Time to open a long recording and to read one second out of it, against reading the same bytes bare.

The recording is an hour of blocks and summaries of the rig, flushed each 100 ms as a live one; the second is
read from a recording that is yet to be opened. Bare is one read of the bytes in which the second
stands, or of the file's summary, without a look at them. Both come from the system's cache, in turn.
"""

import os
import random
import tempfile
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np

from benchmarks.report import Figure, medians, parser, show
from daq import keys
from daq.describe import describe
from daq.messages import SeriesEncoder
from daq.messages_pb2 import Summary
from daq.recording import Recording, RecordingWriter
from daq.recording.records import RecordFile
from daq.rig import load_rig
from daq.timing import StartTime

RIG = "thesis-ball"
FLUSH = 10  # blocks


def write(path: Path, seconds: float) -> None:
    """Write a recording as long as that, of noise on sines."""
    rig = load_rig(RIG)
    rate, block = rig.acquisition.rate, rig.acquisition.block
    encoder = SeriesEncoder("run", rate, rig.channels.names, rig.channels.units)
    noise = np.random.default_rng(1).normal(size=(50, len(rig.channels), block))
    codes = np.round(300.0 * noise + 1e4 * np.sin(np.arange(block) / 40.0)).astype(np.float32)
    description = describe(rig, "run", StartTime(0, 0, "none"), emulated=True)
    with RecordingWriter(path, description) as writer:
        for number in range(round(seconds * rate / block)):
            first = number * block
            writer.add(
                keys.block(rig.name), encoder.encode(first / rate, first, 0, codes[number % len(codes)])
            )
            summary = Summary(timestamp=first / rate, run="run", first_sample=first, n_samples=block)
            writer.add(keys.summary(rig.name), summary.SerializeToString())
            if number % FLUSH == 0:
                writer.flush()


def read_bare(path: Path, position: int, size: int) -> None:
    """Read bytes as they stand."""
    file = os.open(path, os.O_RDONLY)
    os.pread(file, size, position)
    os.close(file)


def open_it(path: Path) -> None:
    """Open a recording, and find out how it ended."""
    with Recording(path) as recording:
        assert recording.certificate is not None


def read_second(path: Path, first: int, rate: int) -> None:
    """Open a recording and read one second of all channels."""
    with Recording(path) as recording:
        assert recording.series(first=first, last=first + rate - 1).samples.shape[1] == rate


def measure(path: Path, rounds: int) -> dict[str, float]:
    """Return the median time of each action in ms."""
    size = path.stat().st_size
    summary = len(RecordFile(path).summary() or b"")
    with Recording(path) as recording:
        rate = int(recording.description.rate)
        samples = recording.certificate.received if recording.certificate else 0
    piece = (size - summary) * rate // samples
    chance = random.Random(1)
    times: dict[str, list[float]] = {}
    for _ in range(rounds):
        first = chance.randrange(samples - rate)
        position = int((size - summary - piece) * first / samples)
        actions: dict[str, Callable[[], None]] = {
            "open": partial(open_it, path),
            "open_bare": partial(read_bare, path, size - summary, summary),
            "second": partial(read_second, path, first, rate),
            "second_bare": partial(read_bare, path, position, piece),
        }
        for name, action in actions.items():
            began = time.perf_counter()
            action()
            times.setdefault(name, []).append(1e3 * (time.perf_counter() - began))
    return medians(times)


def main() -> None:
    options = parser(__doc__)
    options.add_argument("--rounds", type=int, default=20)
    options.add_argument("--minutes", type=float, default=60.0)
    chosen = options.parse_args()
    with tempfile.TemporaryDirectory() as name:
        path = Path(name) / "hour.mcap"
        write(path, 60.0 * chosen.minutes)
        middle = measure(path, chosen.rounds)
    figures = {
        "open_hour": Figure(middle["open"], "ms", middle["open_bare"], "its summary's bytes"),
        "one_second_of_hour": Figure(middle["second"], "ms", middle["second_bare"], "the same bytes"),
    }
    show(figures, chosen.json)


if __name__ == "__main__":
    main()
