"""The motion told anew with hindsight: blocks wait until what follows them is known, and are smoothed then.

Only where it helps: where the shaft flies, no solenoid acts, the shaft's acceleration stays, and the observer
has settled, knows the magnetic bearing and believes every probe. Elsewhere the observer's own values stand.
"""

from collections import deque
from typing import NamedTuple

import numpy as np

from daq.messages import Series
from twin.estimate import Estimated
from twin.flights import Held, Window
from twin.layout import MAGNET_DAMPING, MAGNET_STIFFNESS, TILT
from twin.observer import Observer
from twin.outputs import OUTPUTS

MOTION = ("displacement_x", "displacement_y", "velocity_x", "velocity_y")
NAMES = (*MOTION, *(f"{name}_sigma" for name in MOTION), "smoothed")
"""What is told of each column: motion with its standard deviation, and 1 where it is smoothed, else 0."""
UNITS = (*(OUTPUTS[name.removesuffix("_sigma")] for name in NAMES[:-1]), "1")
MAGNET = [MAGNET_STIFFNESS, MAGNET_DAMPING]
WINDOW = 0.4  # s that are told at once
AHEAD = 0.1  # s of what follows, which the smoother sees as well
CLOSE = 20e-6  # m from the wall within which a contact may be overlooked: the clearance is not known better
KNOWN = (5e-4, 0.01)  # relative standard deviation below which the magnetic bearing's K and c are known
ACTS = 0.02  # N m of the solenoids, from which it is more than the noise of their currents
JERK = 20.0  # rad/s2 by which the shaft's acceleration may change from one spell to the next
SPELL = 0.03  # s over which the acceleration is taken
UNREST = 0.1  # s for which the observer has to get over a hit, or over the lag of the encoder's loop


class Smoothed(NamedTuple):
    """The motion over one block; columns are those of its estimate."""

    first_sample: int
    status: int  # of the block's estimate
    samples: np.ndarray  # (len(NAMES), n_columns) float64, SI


class Smoothing:
    """Follows an observer, and tells the motion anew once what comes after is known.

    A plain object that changes nothing of the observer. It holds half a second of blocks.

    Args:
        observer: whose first block is still to come.
    """

    def __init__(self, observer: Observer) -> None:
        self._observer = observer
        self._probes = np.flatnonzero(observer.sensors.columns[:, 0] == TILT)
        self._rate = observer.rig.acquisition.rate
        self._spell = max(1, round(SPELL * self._rate / observer.rig.acquisition.block))  # blocks
        self._speeds: deque[float] = deque(maxlen=2 * self._spell + 1)  # rad/s at each block's begin
        self._calm_from = 0
        self._held: list[Held] = []

    def add(self, block: Series, estimated: Estimated) -> list[Smoothed]:
        """Take in a block and what the observer has just made of it; return what is ready."""
        ready = []
        if estimated.restarted:
            ready = self.finish()
            self._speeds.clear()
        self._note_unrest(block, estimated)
        memory = self._observer.memory
        held = Held(
            estimated,
            self._readings(block),
            self._flies(estimated),
            memory.state.copy(),
            memory.covariance.copy(),
        )
        self._held.append(held)
        end = estimated.first_sample + estimated.n_samples
        if end - self._held[0].estimated.first_sample >= (WINDOW + AHEAD) * self._rate:
            ready += self._take(self._held[0].estimated.first_sample + WINDOW * self._rate)
        return ready

    def finish(self) -> list[Smoothed]:
        """Return what is left, as nothing follows, or not without a break."""
        return self._take(np.inf)

    def _readings(self, block: Series) -> np.ndarray:
        """Return the probes' readings (n_probes, n), NaN where the observer does not take them."""
        sensors, probes = self._observer.sensors, self._probes
        readings = block.samples[sensors.channel[probes]].astype(np.float64)
        taken = (sensors.low[probes, np.newaxis] < readings) & (readings < sensors.high[probes, np.newaxis])
        return np.where(taken, readings, np.nan)

    def _flies(self, estimated: Estimated) -> np.ndarray:
        """Tell for each column (n_columns,) whether it may be smoothed."""
        sensors, memory = self._observer.sensors, self._observer.memory
        known = np.all(np.sqrt(memory.covariance[MAGNET, MAGNET]) < KNOWN)
        believed = np.isfinite(sensors.low[self._probes]).all()
        calm = estimated.first_sample >= self._calm_from
        away = (estimated.row("normal_force") == 0.0) & (estimated.row("penetration") < -CLOSE)
        return away & bool(known and believed and calm and estimated.settled and not estimated.restarted)

    def _note_unrest(self, block: Series, estimated: Estimated) -> None:
        """Smooth neither shortly before nor after a solenoid acts or the shaft's acceleration changes."""
        feeds = self._observer.feeds
        moments = feeds.moments.T @ np.nan_to_num(block.samples[feeds.currents])
        speeds, spell = self._speeds, self._spell
        speeds.append(float(estimated.row("speed")[0]))
        full = len(speeds) == speeds.maxlen
        jerks = full and abs(speeds[0] - 2.0 * speeds[spell] + speeds[-1]) > JERK * SPELL
        if jerks or np.any(np.abs(moments) > ACTS):
            self._calm_from = estimated.first_sample + round(UNREST * self._rate)
            for held in self._held[-2 * spell :]:
                held.flies[:] = False

    def _take(self, end: float) -> list[Smoothed]:
        """Smooth all that is held, and let go of the blocks that begin before sample `end`."""
        if not self._held:
            return []
        told = Window(self._observer, self._probes, self._held).told(NAMES[:-1])
        count = sum(held.estimated.first_sample < end for held in self._held)
        done, self._held = self._held[:count], self._held[count:]
        return [
            Smoothed(held.estimated.first_sample, held.estimated.status, samples)
            for held, samples in zip(done, told, strict=False)
        ]
