"""The reference recordings: their table, and how each is simulated again."""

import tomllib
from pathlib import Path
from typing import Any, NamedTuple

from daq.commanding.plan import load_plan
from daq.rig import load_rig
from replay.comparison import Comparison, Scales
from replay.history import RepeatableRun
from rigtwin import simulate

FOLDER = Path(__file__).resolve().parent
TABLE = FOLDER / "digests.toml"
SEED = 7
SERIES = ("block", "truth", "estimate")
RIGS = {"ball": "thesis-ball", "pinned": "thesis-pinned", "plain": "thesis-plain"}
"""Rig of each recording; its plan has the recording's name."""

BOUND = 1e-4
"""Share of a channel's largest magnitude by which a simulation on another computer may differ.

A step of the emulated converter is 3e-5 of its range."""


class Reference(NamedTuple):
    """One reference recording."""

    name: str
    rig: str

    @property
    def path(self) -> Path:
        """The stored recording."""
        return FOLDER / f"{self.name}.mcap"

    @property
    def plan(self) -> Path:
        """The plan that it performs."""
        return FOLDER / "plans" / f"{self.name}.toml"

    def simulate(self, path: Path) -> None:
        """Simulate it again, into another file."""
        rig = load_rig(self.rig, [f"emulator.seed={SEED}"])
        simulate(rig, load_plan(self.plan, rig), path)


REFERENCES = tuple(Reference(name, rig) for name, rig in RIGS.items())


def table() -> dict[str, Any]:
    """Return the table of digests."""
    return tomllib.loads(TABLE.read_text(encoding="utf-8"))


def compare(stored: Path, again: Path) -> dict[str, Comparison]:
    """Compare two recordings of one plan, series by series."""
    with RepeatableRun(stored) as before, RepeatableRun(again) as now:
        found = {}
        for name in SERIES:
            scales = Scales()
            for series in before.decoded(name):
                scales.take(series)
            found[name] = comparison = Comparison(BOUND, scales)
            comparison.take_all(before.decoded(name), now.decoded(name))
        return found
