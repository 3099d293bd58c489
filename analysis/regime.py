"""What the rotor does in its backup bearing, by plain rules over the last revolutions of the shaft.

The rules stand in `classify`, in order; the first that fits is the answer. Their bounds are data: `Bounds`.
The direction of a whirl, the share of time in contact and the places of contact are those that the thesis
tells regimes apart by (P1 section 5, P2 sections 4 to 7, P3 section 5).
"""

from collections.abc import Iterable, Sequence
from enum import StrEnum
from typing import NamedTuple

import numpy as np

from analysis.turns import Turn

WINDOW = 24
"""Revolutions that the rules look back over."""
SETTLED = 12
"""The last of them, in which a motion must repeat to have settled."""
RECENT = 3
"""The last of those, which tell whether there is contact, and how much."""
LONGEST_PERIOD = 6
"""Revolutions after which a motion that is not chaotic has repeated."""
MARGIN = 1.5
"""Factor by which the bounds are moved, up and down, to see whether the answer depends on them."""


class Regime(StrEnum):
    """Names of the regimes."""

    UNKNOWN = "unknown"
    AT_REST = "at rest"
    FREE_DECAY = "free decay"
    CONTACT_FREE = "contact-free 1X"
    BOUNCING = "bouncing"  # not for long enough to tell where, or all round
    ONE_PLACE = "bouncing on 1 place"
    TWO_PLACES = "bouncing on 2 places"
    THREE_PLACES = "bouncing on 3 places"
    MANY_PLACES = "bouncing on many places"
    DIAGONAL = "single-pin diagonal"
    CHAOTIC = "chaotic"
    PERMANENT = "permanent contact"
    FORWARD_WHIRL = "forward whirl"
    BACKWARD_WHIRL = "backward whirl"


PLACES = {1: Regime.ONE_PLACE, 2: Regime.TWO_PLACES, 3: Regime.THREE_PLACES}


class Bounds(NamedTuple):
    """The numbers that the rules compare with."""

    rest_speed: float = 2.0 * np.pi * 0.1  # rad/s below which the shaft stands still
    rest_motion: float = 0.05  # share of the clearance that a shaft at rest may still move
    touch: float = 0.002  # share of the time in contact below which the shaft counts as free
    rub: float = 0.45  # share of the time in contact from which a centre that runs round the bearing rubs it
    sweep: float = 0.5  # runs round the bearing per revolution from which that is a whirl
    lift: float = 0.05  # share of the time without contact below which contact is permanent
    place_gap: float = np.radians(30.0)  # rad without any hit that part two places
    dispersion: float = 0.02  # of the Poincaré marks, share of the clearance, from which motion is chaotic
    flatness: float = 0.4  # minor over major axis below which an orbit is a line

    def moved(self, factor: float) -> "Bounds":
        """Return the bounds times a factor."""
        return Bounds(*(factor * bound for bound in self))


LOOKS = (Bounds(), Bounds().moved(MARGIN), Bounds().moved(1.0 / MARGIN))
"""The stated bounds first, then moved up and down."""


def classify(turns: Sequence[Turn], pins: bool = False, bounds: Bounds = LOOKS[0]) -> Regime:
    """Name the regime that the last revolutions show, oldest first; unknown without any.

    `pins` tells that the bearing is pinned: an orbit that is a line onto one place is its diagonal then.
    """
    if not turns:
        return Regime.UNKNOWN
    recent = turns[-RECENT:]
    duty, sweep = mean(turn.duty for turn in recent), mean(turn.sweep for turn in recent)
    if duty <= bounds.touch:
        return free(recent, bounds)
    if duty >= bounds.rub and abs(sweep) >= bounds.sweep:
        return Regime.FORWARD_WHIRL if sweep > 0.0 else Regime.BACKWARD_WHIRL
    return Regime.PERMANENT if duty >= 1.0 - bounds.lift else bouncing(turns[-WINDOW:], pins, bounds)


def free(turns: Sequence[Turn], bounds: Bounds) -> Regime:
    """Name the regime of a shaft that does not touch."""
    if abs(mean(turn.speed for turn in turns)) >= bounds.rest_speed:
        return Regime.CONTACT_FREE
    still = max(turn.span for turn in turns) < bounds.rest_motion
    return Regime.AT_REST if still else Regime.FREE_DECAY


def bouncing(turns: Sequence[Turn], pins: bool, bounds: Bounds) -> Regime:
    """Name the kind of bouncing; plain `BOUNCING` while it settles.

    Chaotic is what repeats neither in the last `SETTLED` revolutions nor in those before, so that what dies
    out after a first contact is not called so.
    """
    last, before = turns[-SETTLED:], turns[:-SETTLED]
    if not begun(last, bounds):
        return Regime.BOUNCING
    if not repeats(last, bounds):
        return Regime.CHAOTIC if begun(before, bounds) and not repeats(before, bounds) else Regime.BOUNCING
    count = places(np.concatenate([turn.hits for turn in last]), bounds.place_gap)
    if pins and count == 1 and mean(turn.flatness for turn in last) < bounds.flatness:
        return Regime.DIAGONAL
    return PLACES.get(count, Regime.MANY_PLACES if count else Regime.BOUNCING)


def begun(turns: Sequence[Turn], bounds: Bounds) -> bool:
    """Whether there is contact from the beginning of `SETTLED` revolutions on."""
    return len(turns) == SETTLED and any(turn.duty > bounds.touch for turn in turns[:LONGEST_PERIOD])


def repeats(turns: Sequence[Turn], bounds: Bounds) -> bool:
    """Whether the motion repeats within `LONGEST_PERIOD` revolutions, as far as its marks are known."""
    return not dispersion(np.array([turn.mark for turn in turns])) > bounds.dispersion


def dispersion(marks: np.ndarray) -> float:
    """Return how far the Poincaré marks (n,), complex, are from repeating; NaN when they are not all known.

    It is the median distance between marks p revolutions apart, for the p up to `LONGEST_PERIOD` for which it
    is least: zero for a periodic motion, near the attractor's size for a chaotic one.
    """
    longest = min(LONGEST_PERIOD, marks.size - 1)
    apart = [float(np.median(np.abs(marks[p:] - marks[:-p]))) for p in range(1, longest + 1)]
    return min(apart, default=float("nan"))


def places(directions: np.ndarray, gap: float, least: float = 0.1) -> int:
    """Return on how many places hits fall: groups of their directions on the circle, `gap` rad apart.

    `directions` (n,) in rad. A group with less than the share `least` of the hits is a stray. 0 when there is
    no hit, or when they go all round without a gap.
    """
    if directions.size == 0:
        return 0
    ordered = np.sort(directions % (2.0 * np.pi))
    gaps = np.diff(np.append(ordered, ordered[0] + 2.0 * np.pi))
    ends = np.flatnonzero(gaps > gap)
    if ends.size == 0:
        return 0
    sizes = np.diff(np.append(ends, ends[0] + directions.size))
    return int(np.count_nonzero(sizes >= least * directions.size))


def named(regime: str, confidence: float) -> str:
    """Return a regime for people to read, with its confidence (0 to 1) where there is any."""
    return f"{regime} ({100.0 * confidence:.0f} %)" if confidence > 0.0 else regime


def mean(values: Iterable[float]) -> float:
    """Return the mean of some numbers; there must be at least one."""
    return float(np.mean(np.fromiter(values, float)))
