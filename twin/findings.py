"""What the estimate amounts to over a stretch: 1X vector, maxima, impacts and regime, each 0.1 s."""

from collections import deque
from typing import NamedTuple

import numpy as np

from analysis.regime import Regime
from analysis.synchronous import last_whole_revolutions, synchronous, whirl_vectors
from analysis.turns import TOUCH
from daq.messages_pb2 import TwinSummary
from daq.rig import Rig
from twin.estimate import Estimated
from twin.regime_watch import RegimeWatch

PERIOD = 0.1  # s that one summary covers
WINDOW = 0.5  # s that the 1X vector may look back
MOST_REVOLUTIONS = 5  # that it looks back


class RegimeChange(NamedTuple):
    """A regime that has settled."""

    before: Regime
    now: Regime
    confidence: float  # 0 to 1, see `twin.regime_watch`


class Findings:
    """Collects estimates, block by block, and sums them up.

    Args:
        rig: with a model.
    """

    def __init__(self, rig: Rig) -> None:
        assert rig.model is not None
        self._watch = RegimeWatch(rig.model.backup_bearing)
        self._probes = [
            f"residual_{channel.name}" for channel in rig.channels if channel.quantity == "displacement"
        ]
        self._window: deque[Estimated] = deque()
        self._stretch: list[Estimated] = []
        self._touching = False
        self._announced = Regime.UNKNOWN

    def add(self, estimated: Estimated) -> None:
        """Take in the next estimate; one that starts anew forgets what was before."""
        if estimated.restarted:
            self._window.clear()
            self._touching = False
        self._watch.add(estimated)
        self._window.append(estimated)
        self._stretch.append(estimated)
        columns = sum(each.samples.shape[1] for each in self._window)
        while columns - self._window[0].samples.shape[1] >= WINDOW * estimated.rate / estimated.stride:
            columns -= self._window.popleft().samples.shape[1]

    @property
    def is_due(self) -> bool:
        """Whether a summary's time is over."""
        if not self._stretch:
            return False
        first = self._stretch[0]
        return self._end() - first.first_sample >= round(PERIOD * first.rate)

    def summarise(self) -> tuple[TwinSummary, RegimeChange | None]:
        """Return the summary of what came since the last one, without run and time; a change of regime."""
        vector = forward_vector(*self._look_back())
        first = self._stretch[0]
        summary = TwinSummary(
            first_sample=first.first_sample,
            n_samples=self._end() - first.first_sample,
            speed_hz=float(np.mean(self._row("speed"))) / (2.0 * np.pi),
            amplitude_1x=abs(vector),
            phase_1x=float(np.angle(vector)),
            contact_force_maximum=max(each.largest_force for each in self._stretch),
            orbit_maximum=max(each.largest_radius for each in self._stretch),
            regime=self._watch.regime.value,
            regime_confidence=self._watch.confidence,
            valid=all(each.settled for each in self._stretch),
            residual_rms=self._residual_rms(),
            impacts=self._count_impacts(),
        )
        self._stretch.clear()
        return summary, self._change()

    def _end(self) -> int:
        """Return the index behind the last sample of the stretch."""
        last = self._stretch[-1]
        return last.first_sample + last.n_samples

    def _row(self, name: str) -> np.ndarray:
        """Return one output over the stretch."""
        return np.concatenate([each.row(name) for each in self._stretch])

    def _look_back(self) -> tuple[np.ndarray, np.ndarray]:
        """Return shaft angle and shaft centre of the last whole revolutions, or of all."""
        angle = np.concatenate([each.shaft_angle for each in self._window])
        x, y = (
            np.concatenate([each.row(name) for each in self._window])
            for name in ("displacement_x", "displacement_y")
        )
        start, revolutions = last_whole_revolutions(angle, MOST_REVOLUTIONS)
        chosen = slice(start if revolutions else 0, None)
        return angle[chosen], (x + 1j * y)[chosen]

    def _change(self) -> RegimeChange | None:
        """Return the change of regime since the last summary, if there is one."""
        before, self._announced = self._announced, self._watch.regime
        if before == self._announced:
            return None
        return RegimeChange(before, self._announced, self._watch.confidence)

    def _count_impacts(self) -> int:
        """Return how many impacts began in the stretch."""
        touching = np.append(self._touching, self._row("normal_force") > TOUCH)
        self._touching = bool(touching[-1])
        return int(np.count_nonzero(touching[1:] & ~touching[:-1]))

    def _residual_rms(self) -> float:
        """Return the rms of the probes' innovations over the stretch, m; 0 when no probe was used."""
        values = np.concatenate([self._row(name) for name in self._probes])
        values = values[np.isfinite(values)]
        return float(np.sqrt(np.mean(values**2))) if values.size else 0.0


def forward_vector(angle: np.ndarray, centre: np.ndarray) -> complex:
    """Return the orbit's forward 1X vector in m; 0 when the window holds no whole revolution."""
    if last_whole_revolutions(angle)[1] == 0:
        return 0j
    found = synchronous(angle, np.stack([centre.real, centre.imag]))
    return complex(whirl_vectors(*found.vector)[0])
