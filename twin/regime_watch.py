"""Follows the regime revolution by revolution, settles on a change, and says how sure it is."""

from collections import deque

import numpy as np

from analysis.regime import REST_SPEED, WINDOW, Regime, likeliest, weigh
from analysis.turns import Turn, turn_of
from simulator.rig import BackupBearing, BearingKind
from twin.estimate import Estimated

CONFIRMATIONS = 3  # revolutions in a row that must agree before a new regime is announced
VOTING = 5  # revolutions over which the confidence is the mean
LONGEST_TURN = 0.5  # s that stand for a revolution where one takes longer
STILL_TURN = 0.1  # s that do where the shaft stands still


ROWS = ("displacement_x", "displacement_y", "contact_force_x", "contact_force_y", "normal_force")


class RegimeWatch:
    """Judges each revolution together with the last ones.

    Args:
        bearing: whose clearance and kind count.
    """

    def __init__(self, bearing: BackupBearing) -> None:
        self._clearance = bearing.clearance
        self._pins = bearing.kind == BearingKind.PINNED
        self._turns: deque[Turn] = deque(maxlen=WINDOW)
        self._weights: deque[dict[Regime, float]] = deque(maxlen=VOTING)
        self._verdict = Regime.UNKNOWN
        self._agreements = 0
        self._pending = np.empty((1 + len(ROWS), 0))  # shaft angle and `ROWS` since the last revolution's end
        self.regime = Regime.UNKNOWN
        """As it was announced last."""

    @property
    def confidence(self) -> float:
        """How likely the announced regime is, 0 to 1: the mean over the last `VOTING` revolutions."""
        weights = [each.get(self.regime, 0.0) for each in self._weights]
        return sum(weights) / len(weights) if weights else 0.0

    def add(self, estimated: Estimated) -> None:
        """Take in the next estimate; one that starts anew forgets the revolutions, not the regime."""
        if estimated.restarted:
            self._turns.clear()
            self._pending = self._pending[:, :0]
        new = np.stack([estimated.shaft_angle, *(estimated.row(name) for name in ROWS)])
        self._pending = np.concatenate([self._pending, new], axis=1)
        rate = estimated.rate / estimated.stride
        while end := end_of_turn(self._pending[0], rate):
            self._judge(self._pending[:, : end + 1], rate)
            self._pending = self._pending[:, end:]

    def _judge(self, rows: np.ndarray, rate: float) -> None:
        """Judge the revolution that is over, and settle on what enough of them in a row agree on."""
        angle, x, y, force_x, force_y, normal = rows
        self._turns.append(turn_of(angle, x + 1j * y, force_x + 1j * force_y, normal, self._clearance, rate))
        weights = weigh(list(self._turns), self._pins)
        verdict = likeliest(weights)
        self._agreements = self._agreements + 1 if verdict == self._verdict else 1
        self._verdict = verdict
        self._weights.append(weights)
        if self._agreements >= CONFIRMATIONS:
            self.regime = verdict


def end_of_turn(angle: np.ndarray, rate: float) -> int:
    """Return the index of the first sample behind the shaft's zero, or behind the longest time; 0: none yet.

    `angle` (n,) is the unwrapped shaft angle in rad at `rate` Hz. A shaft that trembles about its zero does
    not pass it: it must have turned by half a revolution.
    """
    if angle.size < 2:
        return 0
    standing = abs(angle[-1] - angle[0]) * rate < REST_SPEED * (angle.size - 1)
    longest = round((STILL_TURN if standing else LONGEST_TURN) * rate)
    passed = np.diff(np.floor(angle / (2.0 * np.pi))) != 0.0
    passages = np.flatnonzero(passed & (np.abs(angle[1:] - angle[0]) > np.pi))
    end = int(passages[0]) + 1 if passages.size else longest
    return min(end, longest) if min(end, longest) < angle.size else 0
