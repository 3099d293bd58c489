"""What the rotor does in its backup bearing, and how likely it is, from the last revolutions of the shaft.

A few questions are put to measures that the thesis tells regimes apart by: the share of time in contact, the
direction of a whirl, the places of contact, whether the motion repeats (P1 section 5, P2 sections 4 to 7, P3
section 5). Each has a `Bound`, which makes of the measure the odds of the answer; `weigh` multiplies the
answers, and the most likely regime is the answer.
"""

from collections.abc import Iterable, Mapping, Sequence
from enum import StrEnum
from math import exp, log
from typing import NamedTuple

import numpy as np

from analysis.recurrence import dispersion, divergence
from analysis.turns import Turn

WINDOW = 48
"""Revolutions that are looked back over, to tell chaos from motions of two periods."""
SETTLED = 12
"""The last of them, in which a motion of one period must repeat to have settled."""
RECENT = 3
"""The last of those, which tell whether there is contact, and whether it lasts."""
LONGEST_PERIOD = 6
"""Revolutions after which a motion of one period repeats that has settled."""
LONGEST_RETURN = 18
"""Revolutions after which a motion of two periods has come back closely."""
AHEAD = 6
"""Revolutions after which nearly equal motions are compared again."""
FINEST = 1e-3
"""Share of the clearance below which two marks are not told apart."""
STRAY = 0.1
"""Share of the hits below which a group of them is no place."""


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


class Bound(NamedTuple):
    """Where the answer to a question turns, and how sharply."""

    value: float  # of the measure, at which yes and no are as likely
    sharpness: float  # twice the measure makes the odds of yes 2**sharpness times as large

    def evidence(self, measure: float) -> float:
        """Return the logarithm of the odds of yes, from a measure of at least zero."""
        return self.sharpness * log(max(measure, TINY) / self.value)

    def likely(self, measure: float) -> float:
        """Return the probability of yes."""
        return probability(self.evidence(measure))


TINY = 1e-9
REST_SPEED = 2.0 * np.pi * 0.1  # rad/s below which the shaft stands still
REST_MOTION = 0.05  # share of the clearance that a shaft at rest may still move
TOUCH = Bound(0.002, 4.0)  # share of the time in contact, from which the shaft touches
LIFT = Bound(0.05, 4.0)  # share of the time without contact, from which the shaft lifts off
RUB = Bound(0.5, 12.0)  # share of the time in contact, from which a centre that runs round the bearing rubs
ROUND = Bound(0.5, 8.0)  # runs round the bearing per revolution, from which the centre does run round
FLAT = Bound(0.4, 8.0)  # minor over major axis, from which an orbit is no line
PARTED = Bound(np.radians(30.0), 18.0)  # rad without any hit, from which two places are apart
SCATTER = Bound(0.02, 4.0)  # dispersion over the clearance, from which a motion of one period has not settled
STEADY = Bound(0.003, 2.0)  # dispersion of `SETTLED` revolutions, below which nothing is chaotic
RETURN = Bound(0.02, 0.55)  # dispersion of `WINDOW` revolutions from which a motion is chaotic, together with
PARTING = Bound(1.40, 6.0)  # the factor by which nearly equal motions part in `AHEAD` revolutions
"""Both: between `python -m benchmarks.regime --fit` on true marks, and the same on what the twin saw."""


def likeliest(weights: Mapping[Regime, float]) -> Regime:
    """Return the regime with the largest weight."""
    return max(weights, key=weights.__getitem__)


def weigh(turns: Sequence[Turn], pins: bool = False) -> dict[Regime, float]:
    """Return how likely the regimes are that the last revolutions may show; the weights add up to 1.

    `turns` are the last `WINDOW` at most, oldest first; without any the regime is unknown. `pins` tells that
    the bearing is pinned: an orbit that is a line onto one place is its diagonal then.
    """
    if not turns:
        return {Regime.UNKNOWN: 1.0}
    recent = turns[-RECENT:]
    duty, sweep = mean(turn.duty for turn in recent), mean(turn.sweep for turn in recent)
    touching, circling = TOUCH.likely(duty), ROUND.likely(abs(sweep))
    lifting = touching * LIFT.likely(1.0 - duty)
    lasting = touching - lifting
    chaotic = lifting * chaos(turns)
    rubbing = (lifting - chaotic) * circling * RUB.likely(mean(turn.duty for turn in turns[-SETTLED:]))
    whirl = Regime.FORWARD_WHIRL if sweep > 0.0 else Regime.BACKWARD_WHIRL
    return {
        free(recent): 1.0 - touching,
        Regime.PERMANENT: lasting * (1.0 - circling),
        whirl: lasting * circling + rubbing,
        Regime.CHAOTIC: chaotic,
    } | {regime: (lifting - chaotic - rubbing) * weight for regime, weight in bouncing(turns, pins).items()}


def free(turns: Sequence[Turn]) -> Regime:
    """Name the regime of a shaft that does not touch."""
    if abs(mean(turn.speed for turn in turns)) >= REST_SPEED:
        return Regime.CONTACT_FREE
    return Regime.AT_REST if max(turn.span for turn in turns) < REST_MOTION else Regime.FREE_DECAY


def chaos(turns: Sequence[Turn]) -> float:
    """Return how likely the motion is chaotic; 0 as long as contact is younger than `WINDOW`.

    A motion of one or two periods comes back closely, and goes on closely to how it then did; a chaotic one
    does neither.
    What has just settled is not chaotic, although the window still holds what was before.
    """
    marks = marks_of(turns)
    if not begun(turns, WINDOW) or np.isnan(marks).any():
        return 0.0
    evidence = RETURN.evidence(dispersion(marks, LONGEST_RETURN))
    evidence += PARTING.evidence(divergence(marks, AHEAD, FINEST))
    return probability(evidence) * STEADY.likely(dispersion(marks[-SETTLED:], LONGEST_PERIOD))


def bouncing(turns: Sequence[Turn], pins: bool) -> dict[Regime, float]:
    """Return how likely the kinds of bouncing are that is not chaotic; plain `BOUNCING` while it settles."""
    last = turns[-SETTLED:]
    if not begun(last, SETTLED):
        return {Regime.BOUNCING: 1.0}
    marks = marks_of(last)
    scattered = 0.0 if np.isnan(marks).any() else SCATTER.likely(dispersion(marks, LONGEST_PERIOD))
    old = begun(turns, WINDOW)
    seen = turns if old and scattered > 0.5 else last
    count, sure = places(np.concatenate([turn.hits for turn in seen]))
    sure *= 1.0 if old else 1.0 - scattered
    if count == 0:
        return {Regime.BOUNCING: 1.0}
    round_one = FLAT.likely(mean(turn.flatness for turn in last)) if pins and count == 1 else 1.0
    return {
        PLACES.get(count, Regime.MANY_PLACES): sure * round_one,
        Regime.DIAGONAL: sure * (1.0 - round_one),
        Regime.BOUNCING: 1.0 - sure,
    }


def begun(turns: Sequence[Turn], count: int) -> bool:
    """Whether there is contact from the beginning of the last `count` revolutions on."""
    return len(turns) >= count and any(turn.duty > TOUCH.value for turn in turns[-count:][:LONGEST_PERIOD])


def marks_of(turns: Sequence[Turn]) -> np.ndarray:
    """Return the Poincaré marks (n,), complex."""
    return np.array([turn.mark for turn in turns])


def places(directions: np.ndarray) -> tuple[int, float]:
    """Return on how many places hits fall, and how sure that is, 0.5 to 1.

    Places are groups of directions (n,), in rad, with more than `PARTED` between them; groups of less than
    the share `STRAY` of the hits do not count. 0 when there is no hit, or when they go all round. It is as
    sure as the gap is that is nearest to the bound.
    """
    if directions.size == 0:
        return 0, 1.0
    ordered = np.sort(directions % (2.0 * np.pi))
    gaps = np.diff(np.append(ordered, ordered[0] + 2.0 * np.pi))
    sure = min(probability(abs(PARTED.evidence(float(gap)))) for gap in gaps)
    ends = np.flatnonzero(gaps > PARTED.value)
    if ends.size == 0:
        return 0, sure
    sizes = np.diff(np.append(ends, ends[0] + directions.size))
    return int(np.count_nonzero(sizes >= STRAY * directions.size)), sure


def probability(evidence: float) -> float:
    """Return the probability from the logarithm of the odds."""
    return 1.0 / (1.0 + exp(-evidence)) if evidence > -700.0 else 0.0


def named(regime: str, confidence: float) -> str:
    """Return a regime for people to read, with its confidence (0 to 1) where there is any."""
    return f"{regime} ({100.0 * confidence:.0f} %)" if confidence > 0.0 else regime


def mean(values: Iterable[float]) -> float:
    """Return the mean of some numbers; there must be at least one."""
    return float(np.mean(np.fromiter(values, float)))
