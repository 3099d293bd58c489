"""What the runs say: the numbers that stand beside the published ones."""

from collections.abc import Sequence
from typing import NamedTuple

from benchmarks.thesis_runs import Drop, Dwell, Stairs

NEVER = float("nan")


def first_contact(dwells: Sequence[Dwell]) -> float:
    """Return the first speed with contact, Hz, in the order of the run."""
    return next((dwell.hz for dwell in dwells if dwell.touched), NEVER)


def last_contact(dwells: Sequence[Dwell]) -> float:
    """Return the last speed with contact, Hz, in the order of the run."""
    return first_contact(list(reversed(dwells)))


def first_reading(dwells: Sequence[Dwell], clearance: float, scale: float) -> float:
    """Return the first speed at which a radius, read `scale` times too large, reaches the clearance."""
    return next((dwell.hz for dwell in dwells if scale * dwell.radius >= clearance), NEVER)


def hops(dwell: Dwell) -> bool:
    """Tell whether an orbit with contact is at least twice as high as wide."""
    return dwell.touched and dwell.height > 2.0 * dwell.width


def first_hop(dwells: Sequence[Dwell]) -> float:
    """Return the speed from which the rotor hops up to the last speed with contact, Hz."""
    found = NEVER
    for dwell in reversed([dwell for dwell in dwells if dwell.touched]):
        if not hops(dwell):
            break
        found = dwell.hz
    return found


def one_pin(dwells: Sequence[Dwell]) -> tuple[float, float]:
    """Return the first and the last speed of the orbit that hits one pin, once a turn, Hz."""
    speeds = [dwell.hz for dwell in dwells if dwell.touched and abs(dwell.hits - 1.0) < 0.03]
    return (speeds[0], speeds[-1]) if speeds else (NEVER, NEVER)


def largest_force(dwells: Sequence[Dwell]) -> float:
    """Return the largest resultant of a run, N."""
    return max(dwell.force for dwell in dwells)


def largest_force_ever(dwells: Sequence[Dwell]) -> float:
    """Return the largest resultant of a run, with the two seconds after each change of speed, N."""
    return max(float(dwell.start[2].max(initial=dwell.force)) for dwell in dwells)


def backward(dwells: Sequence[Dwell]) -> list[Dwell]:
    """Return the dwells that roll backward: permanent contact with turns against the shaft's."""
    return [dwell for dwell in dwells if dwell.share > 0.95 and dwell.turns < -0.5]


def region(drop: Drop) -> str:
    """Return P1's region of a drop: I at the bottom, III full forward whirl, II what is between.

    I: the settled orbit never passes above the middle and is always in contact. III: it turns once a
    revolution, always in contact. What rolls backward, which P1 never saw, is "B".
    """
    y = drop.crossings[0]
    if drop.turns < -0.5:
        return "B"
    if drop.share < 0.95:
        return "II"
    return "III" if abs(drop.turns - 1.0) < 0.05 else "I" if not (y > 0.0).any() else "II"


class Score(NamedTuple):
    """How a reading of the rig meets the published speeds and the force: differences, ours less published."""

    first_impact: float  # Hz
    hop: float
    jump: float
    return_: float
    peak: float  # N
    pinned_jump: float  # Hz
    one_pin_end: float

    @property
    def met(self) -> int:
        """Items within one step of 0.5 Hz, or 10 N."""
        return sum(abs(value) <= limit for value, limit in zip(self, LIMITS, strict=True))

    @property
    def exact(self) -> int:
        """Items met to the step, or to 10 N."""
        exact = (0.01, 0.01, 0.01, 0.01, 10.0, 0.01, 0.01)
        return sum(abs(value) <= limit for value, limit in zip(self, exact, strict=True))


LIMITS = (0.51, 0.51, 0.51, 0.51, 10.0, 0.51, 0.51)
PUBLISHED = Score(9.0, 14.5, 15.5, 12.0, 90.0, 14.0, 14.0)


def score(ball: Stairs, pinned: Stairs, clearance: float, scale: float = 1.0) -> Score:
    """Compare a reading with what is published; `scale` is that of a displacement as it was read."""
    ours = Score(
        first_reading(ball.up, clearance, scale),
        first_hop(ball.up),
        last_contact(ball.up),
        first_reading(ball.down, clearance, scale),
        largest_force(ball.up),
        last_contact(pinned.up),
        one_pin(pinned.up)[1],
    )
    return Score(*(mine - theirs for mine, theirs in zip(ours, PUBLISHED, strict=True)))
