"""Where the walls of the backup bearing stand, by how far the shaft goes in impacts."""

from collections.abc import Callable
from math import cos, radians, sin

import numpy as np

from analysis.cusum import Cusum
from simulator.clearance import pin_distance
from simulator.rig import BackupBearing, BearingKind, Model
from twin.fault import Fault

LEARNT = 6  # impacts at a wall from which its place is known
SPREAD = 12e-6  # m by which a wall's place varies from impact to impact
USUAL, THRESHOLD, MOST = 4.0, 30.0, 10.0  # of the cumulative sums of squares of deviations
OTHERS = 2  # impacts at another wall that show whether that stands where it did
PATIENCE = 1.0  # s that such impacts may take to come
SURE, UNSURE = 0.95, 0.5  # confidence with such impacts, and without

Depth = Callable[[np.ndarray, np.ndarray], np.ndarray]


class Walls:
    """The ring, or each pin: its place by its first impacts, and whether later ones agree.

    Args:
        model: the described rig.
    """

    def __init__(self, model: Model) -> None:
        self._stiffness = model.backup_bearing.stiffness
        self._depths = depths(model)
        self._known: list[list[float]] = [[] for _ in self._depths]
        self._sums = [Cusum(USUAL, THRESHOLD, MOST) for _ in self._depths]
        self._changes: list[list[tuple[int, float]]] = [[] for _ in self._depths]
        self._suspect: int | None = None
        self._since = 0

    def forget(self) -> None:
        """Learn anew where the walls stand."""
        for known, total, changes in zip(self._known, self._sums, self._changes, strict=True):
            known.clear()
            total.reset()
            changes.clear()
        self._suspect = None

    def meet(self, orbit: np.ndarray, force: float, sample: int) -> None:
        """Take in an impact: the shaft's centre (2, n) about it, m, and its largest force, N.

        The wall is where the shaft is deepest, less what it gives way by Hertz's law.
        """
        reached = [float(depth(*orbit).max()) for depth in self._depths]
        index = int(np.argmax(reached))
        place = reached[index] - (force / self._stiffness) ** (2.0 / 3.0)
        known = self._known[index]
        if len(known) < LEARNT:
            known.append(place)
            return
        change = place - float(np.median(known))
        self._changes[index].append((sample, change))
        if self._sums[index].add((change / SPREAD) ** 2, sample) and self._suspect is None:
            self._suspect, self._since = index, sample

    def judge(self, now: int, rate: float) -> list[Fault]:
        """Return what has changed, once it is clear whether one wall has or all; `now` is a sample index."""
        if self._suspect is None:
            return []
        onset = self._sums[self._suspect].onset or self._since
        later = [[change for sample, change in each if sample >= onset] for each in self._changes]
        change = float(np.median(later[self._suspect]))
        others = [
            float(np.median(each))
            for index, each in enumerate(later)
            if index != self._suspect and len(each) >= OTHERS
        ]
        if len(self._depths) > 1 and not others and now - self._since < PATIENCE * rate:
            return []
        whole = len(self._depths) == 1 or any(other > 0.5 * change for other in others)
        confidence = SURE if others or len(self._depths) == 1 else UNSURE
        pin = self._suspect + 1
        self.forget()
        if whole:
            return [Fault("clearance", "", change, "m", confidence, onset)]
        return [Fault("pin", "", change, "m", confidence, onset, pin)]


def directed(angle_deg: float) -> np.ndarray:
    """Return the unit vector (2,) at an angle."""
    return np.array([cos(radians(angle_deg)), sin(radians(angle_deg))])


def depths(model: Model) -> list[Depth]:
    """Return for each wall a function of the shaft's centre (n,), (n,) that gives its penetration (n,), m."""
    bearing, shaft = model.backup_bearing, model.rotor.shaft_radius
    if bearing.kind != BearingKind.PINNED:
        return [lambda x, y: np.hypot(x, y) - bearing.clearance]
    reach = shaft + bearing.pin_tip_radius
    return [tip(bearing, reach, number) for number in range(bearing.pin_count)]


def tip(bearing: BackupBearing, reach: float, number: int) -> Depth:
    """Return the function of one pin's tip."""
    angle_deg = bearing.pin_angle_deg + number * 360.0 / bearing.pin_count
    place = pin_distance(bearing, reach, number) * directed(angle_deg)
    return lambda x, y: reach - np.hypot(place[0] - x, place[1] - y)
