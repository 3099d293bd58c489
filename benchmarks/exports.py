"""Speed of exporting a recording, per format, against numpy's .npy of the same samples; and of the catalogue.

Export speeds are MB of samples (float32) a second, reading the recording included; each baseline is
`numpy.save` of the same samples, read before. The catalogue lists 1,000 files, whose pages the system
already holds; its baseline reads as many bytes from the end of each as the files' own summaries take.
"""

import os
import shutil
import struct
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from benchmarks.report import Figure, in_turns, medians, parser, rotated, show, timed
from daq.commanding.plan import load_plan
from daq.recording import Recording
from daq.rig import load_rig
from replay.catalogue import catalogue
from replay.export import export
from replay.formats import FORMATS
from rigtwin.simulate_command import simulate

RIG = "thesis-ball"
FILES = 1000
FOOTER = struct.Struct("<QQI8s")


def export_seconds(path: Path, folder: Path, rounds: int) -> dict[str, float]:
    """Return how long each format takes, and `.npy`."""
    with Recording(path) as recording:
        samples = recording.series().samples

    def plain(target: Path) -> None:
        np.save(target, samples)

    def writer(suffix: str) -> Callable[[Path], object]:
        return plain if suffix == ".npy" else lambda target: export(path, target)

    suffixes = [".npy", *(row.suffix for row in FORMATS)]
    seconds: dict[str, list[float]] = {suffix: [] for suffix in suffixes}
    for order in [suffixes, *rotated(suffixes, rounds)]:  # the first round loads the packages
        for suffix in order:
            target = folder / f"export{suffix}"
            began = time.perf_counter()
            writer(suffix)(target)
            seconds[suffix].append(time.perf_counter() - began)
            target.unlink()
    return medians({suffix: times[1:] for suffix, times in seconds.items()})


def catalogue_seconds(path: Path, folder: Path, rounds: int) -> dict[str, float]:
    """Return how long it takes to list copies of a recording, and to read their ends."""
    for number in range(FILES):
        os.link(path, folder / f"run{number:04}.mcap")
    files = sorted(folder.glob("*.mcap"))

    def tails() -> None:
        for file in files:
            with file.open("rb") as stream:
                stream.seek(-FOOTER.size, os.SEEK_END)
                start, *_ = FOOTER.unpack(stream.read())
                stream.seek(start)
                stream.read()

    return in_turns(
        {"catalogue": lambda: timed(lambda: catalogue([folder])), "tails": lambda: timed(tails)}, rounds
    )


def main() -> None:
    options = parser(__doc__)
    options.add_argument("--rounds", type=int, default=3)
    options.add_argument("--plan", default="impacts")
    chosen = options.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder, path = Path(name), Path(name) / "run.mcap"
        rig = load_rig(RIG)
        simulate(rig, load_plan(chosen.plan, rig), path, twin=False)
        with Recording(path) as recording:
            size = recording.series().samples.nbytes / 1e6
        exports = export_seconds(path, folder, chosen.rounds)
        listed = folder / "listed"
        listed.mkdir()
        lists = catalogue_seconds(path, listed, chosen.rounds)
        shutil.rmtree(listed)
    plain = size / exports.pop(".npy")
    figures = {
        f"export_{suffix[1:]}": Figure(size / seconds, "MB/s", plain, "numpy.save")
        for suffix, seconds in exports.items()
    }
    figures["catalogue_of_1000"] = Figure(lists["catalogue"], "s", lists["tails"], "reading the files' ends")
    show(figures, chosen.json)


if __name__ == "__main__":
    main()
