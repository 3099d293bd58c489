"""What the observer makes of a block, and how it says what that is worth."""

from enum import IntFlag
from typing import NamedTuple

import numpy as np

STRIDE = 5  # samples between two columns of an estimate


class EstimateStatus(IntFlag):
    """Flags in an estimate's `status`, beside those of `daq.messages.BlockStatus` that its block carried."""

    RESTARTED = 256
    """The state was set anew from the measurement: at the start, after a gap, or because it was lost."""
    SETTLING = 512
    """Less than 0.1 s since then."""
    LOST = 1024
    """Measurement and model disagreed so much, or the state was no number, that the observer starts anew.

    What the block's estimate tells is then the linear filter's (`twin.fallback`).
    """


class Estimated(NamedTuple):
    """What the observer makes of one block; column j is sample first_sample + j * stride."""

    first_sample: int
    n_samples: int  # of the block
    rate: float  # Hz
    status: int  # flags of `BlockStatus` and `EstimateStatus`
    stride: int
    names: tuple[str, ...]
    units: tuple[str, ...]
    samples: np.ndarray  # (n_outputs, n_columns) float64, SI
    shaft_angle: np.ndarray  # (n_columns,) rad, not wrapped
    missing: tuple[int, int] | None  # first and last sample that should have come before, and did not
    cause: str  # of LOST, in words; empty otherwise
    largest_force: float  # N, normal contact force, over every sample of the block
    largest_radius: float  # m, of the shaft's centre at the backup bearing, likewise
    ratios: np.ndarray  # (n_sensors,) of the innovations' squares to their expectation, mean; NaN: not used
    residual_rms: np.ndarray  # (n_sensors,) of the innovations of each sensor, in its unit; NaN: not used

    @property
    def settled(self) -> bool:
        """Whether the estimate is vouched for."""
        return not self.status & (EstimateStatus.SETTLING | EstimateStatus.LOST)

    @property
    def restarted(self) -> bool:
        """Whether the state was set anew at this block's first sample."""
        return bool(self.status & EstimateStatus.RESTARTED)

    def row(self, name: str) -> np.ndarray:
        """Return one output (n_columns,)."""
        return self.samples[self.names.index(name)]
