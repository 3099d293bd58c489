"""Windows of measurement and estimate together, of equal length, one after the other without a gap."""

from typing import NamedTuple

import numpy as np

from daq.messages import Series
from daq.rig import Rig
from twin.estimate import Estimated

LENGTH = 0.5  # s


class Window(NamedTuple):
    """Half a second of a run: samples, and columns, which are the samples that have an estimate."""

    first_sample: int
    rate: float  # Hz
    columns: np.ndarray  # (n_columns,) int, sample of the window that each column is of
    angle: np.ndarray  # (n_columns,) rad, the shaft's, not wrapped
    speed: np.ndarray  # (n_columns,) rad/s
    normal_force: np.ndarray  # (n_columns,) N, as estimated
    probes: np.ndarray  # (n_probes, n_samples) m, every sample
    forces: np.ndarray  # (n_transducers, n_samples) N, every sample

    @property
    def end(self) -> int:
        """Index behind the last sample."""
        return self.first_sample + self.forces.shape[1]

    @property
    def free(self) -> bool:
        """Whether there was no contact, by the estimate."""
        return not self.normal_force.any()

    @property
    def finite(self) -> bool:
        """Whether every reading is a number."""
        return bool(np.isfinite(self.probes).all() and np.isfinite(self.forces).all())

    @property
    def time(self) -> np.ndarray:
        """Time of the columns since the window's begin, s."""
        return self.columns / self.rate


class Windows:
    """Collects blocks with their estimates into windows.

    Args:
        rig: for its channels.
    """

    def __init__(self, rig: Rig) -> None:
        placed = [(i, each) for i, each in enumerate(rig.channels) if each.station]
        self.probes = [i for i, each in placed if each.quantity == "displacement"]
        self.transducers = [i for i, each in placed if each.quantity == "force"]
        self._parts: list[tuple[Series, Estimated]] = []

    def add(self, series: Series, estimated: Estimated) -> Window | None:
        """Take in the next block with its estimate; return a window when one is full."""
        if estimated.missing:
            self._parts.clear()
        self._parts.append((series, estimated))
        begin = self._parts[0][0].first_sample
        if series.first_sample + series.samples.shape[1] - begin < LENGTH * series.rate:
            return None
        window = self._joined()
        self._parts.clear()
        return window

    def clear(self) -> None:
        """Begin a new window with the next block."""
        self._parts.clear()

    def _joined(self) -> Window:
        blocks, estimates = zip(*self._parts, strict=True)
        first = blocks[0]
        return Window(
            first.first_sample,
            first.rate,
            np.concatenate(
                [
                    each.first_sample - first.first_sample + np.arange(each.samples.shape[1]) * each.stride
                    for each in estimates
                ]
            ),
            np.concatenate([each.shaft_angle for each in estimates]),
            np.concatenate([each.row("speed") for each in estimates]),
            np.concatenate([each.row("normal_force") for each in estimates]),
            np.concatenate([each.samples[self.probes] for each in blocks], axis=1).astype(float),
            np.concatenate([each.samples[self.transducers] for each in blocks], axis=1).astype(float),
        )
