"""How often the twin names the regime as it truly is, and whether its confidence is fair."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from analysis.regime import Regime
from simulator.rig import BearingKind
from tests.twin.regime_cases import drawn_case, exponent, motion_of, settled, true_regime, watched_run
from twin.observer import Observer
from twin.regime_watch import RegimeWatch

PLAIN = {
    "calm": Regime.CONTACT_FREE,
    "dropped": Regime.PERMANENT,
    "heavy": Regime.FORWARD_WHIRL,
    "rough": Regime.BACKWARD_WHIRL,
}
"""Kinds of cases whose regime is plain, and which one it mostly is."""
BINS = (0.0, 0.5, 0.7, 0.85, 0.95, 1.0)
"""Edges of the confidences that are looked at together: narrow where most of them are."""


class Naming(NamedTuple):
    """A case as it was, and as it was named."""

    kind: str
    seed: int
    true: Regime
    said: Regime
    confidence: float

    @property
    def right(self) -> bool:
        """Whether it was named by its very name, the number of places included."""
        return self.true == self.said


class Bin(NamedTuple):
    """The cases of about the same confidence."""

    count: int
    said: float  # mean confidence
    right: float  # share that was named right


def naming(seed: int, kind: str = "any") -> Naming:
    """Let the twin watch a drawn case by its sensors, and return what it said at the end."""
    case = drawn_case(seed, kind)
    state = settled(case)
    run = watched_run(case, state)
    bearing = case.rig.emulated_model.backup_bearing
    true = true_regime(motion_of(run), exponent(case, state), bearing.kind == BearingKind.PINNED)
    observer, watch = Observer(case.rig), RegimeWatch(bearing)
    for block in run.blocks:
        watch.add(observer.update(block))
    return Naming(kind, seed, true, watch.regime, watch.confidence)


def accuracy(namings: Sequence[Naming]) -> float:
    """Return the share that was named right."""
    return float(np.mean([each.right for each in namings]))


def brier(namings: Sequence[Naming]) -> tuple[float, float]:
    """Return the mean square of confidence less outcome, and what always saying the accuracy would have.

    Brier, Monthly Weather Review 78, 1950.
    """
    right = np.array([each.right for each in namings], float)
    return float(np.mean((np.array([each.confidence for each in namings]) - right) ** 2)), float(
        np.var(right)
    )


def reliability(namings: Sequence[Naming]) -> list[Bin]:
    """Return the bins of `BINS` that hold any case."""
    found = np.digitize([each.confidence for each in namings], BINS[1:-1])
    bins = []
    for number in np.unique(found):
        these = [each for each, at in zip(namings, found, strict=True) if at == number]
        bins.append(Bin(len(these), float(np.mean([each.confidence for each in these])), accuracy(these)))
    return bins
