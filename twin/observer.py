"""The observer: the rig's contact model alongside the stream, corrected by what the sensors say.

An extended Kalman filter on the simulator's own kernels. Its state z (order: `twin.layout`) is

    u, u'       tilt of the rotor and its rate                                 4
    h, h'       displacement of the house and its rate                         4
    w_r         spin of the bearing's inner ring                               1
    Uc, Us      unbalance along and across the encoder's zero                  2
    Mx, My      static moment: weight, coupling, probes' offsets               2
    rx, ry      contact force that the contact law does not explain            2
    ln k, ln eta, ln mu   stiffness, damping, friction of the contact          3
    g           clearance beyond the described one                             1
    K, c        changes of the magnetic bearing's stiffness and damping        2

and its equations are those of the simulator, with the shaft's angle theta, speed Omega and acceleration
alpha from the encoder:

    I u'' - i Izz Omega u' + c l_Q^2 u' + (K l_Q^2 + k_t) u
        = M + l_U (Uc + i Us) (Omega^2 - i alpha) exp(i theta) + l_S (F_c + r) + Q_ax + l_hit F_hit
    m h'' + 2 c_h h' + 2 k_ft h = -(F_c + r)
    I_r w_r' = T_ring - c_r w_r

The gain is K = P H' / (H P H' + R), sensor by sensor. P is carried through each tick by the transition of
small deviations, whose contact part is the slope of the contact law at the middle of the tick: while the
shaft flies the gain is that of a gentle linear filter, in contact it knows how stiff the bearing is. The
derivation and the measured accuracy are in docs/explanation/observer.md.
"""

from copy import deepcopy
from typing import NamedTuple

import numpy as np

from daq.messages import TIMING_FLAGS, Series
from daq.rig import Rig, RigError
from simulator.candidates import candidates_of, for_kernels
from simulator.rig import DriveMode, Model
from simulator.simulation import checked
from simulator.tick import tick_of
from twin.estimate import STRIDE, Estimated, EstimateStatus
from twin.fallback import (
    Fallback,
    fallback_of,
    follow,
    forget,
    hand_over,
    hand_over_rates,
    is_warm,
    tilt_variance,
)
from twin.filter import Tally, forget_motion, observe, restart
from twin.identification import Parameter, identified, not_told
from twin.inputs import feeds_of, sensors_of
from twin.layout import (
    CLEARANCE,
    DAMPING,
    FRICTION,
    MAGNET_DAMPING,
    MAGNET_STIFFNESS,
    MOMENT,
    SIZE,
    STIFFNESS,
    TILT,
    UNBALANCE,
    Memory,
    Tuning,
    new_memory,
)
from twin.outputs import SHAFT, rows_of
from twin.virtual import report

SETTLING_TIME = 0.1  # s after a restart during which the estimate is not vouched for
LOST_RATIO = 100.0  # mean innovation variance over its expectation at which the observer starts anew
LOST_MAGNET_DOUBT = (
    0.5  # relative, of the magnetic bearing's stiffness once the state was lost: it may be gone
)
UNBALANCE_PRIOR = 2.0  # times the described unbalance: how large the true one may be
MOMENT_PRIOR = 0.2  # of the described static moment


class Saved(NamedTuple):
    """What an observer knows at the end of a block, to go back to."""

    memory: Memory
    fallback: Fallback
    expected: int | None
    settled_from: int
    lost: bool
    moment: np.ndarray  # (2,) N m, of the solenoids at the last sample


class Observer:
    """Estimates rotor, house, ring, unbalance and contact force from the blocks of one run.

    A plain object: no input or output, no clock, no chance. Equal blocks in equal order give equal bits.
    It is told the rig's model without its unbalance, and nothing of what is emulated.

    Args:
        rig: with a model, an `encoder_angle` and two displacement channels that do not lie in one line.
        tuning: what it believes about noise.

    Raises:
        RigError: the rig has no model, or not the channels.
    """

    def __init__(self, rig: Rig, tuning: Tuning | None = None) -> None:
        if rig.model is None or rig.twin.model == "none":
            raise RigError(f'{rig.name} has [twin] model = "none": there is no model to run alongside')
        self.rig = rig
        self.described = rig.model
        self.tuning = tuning or Tuning()
        self.model = bare(rig.model)
        self.sensors = sensors_of(rig, self.tuning)
        self.feeds = feeds_of(rig)
        self.tick = tick_of(self.model, 1.0 / rig.acquisition.rate)
        self.memory = first_memory(rig.model, self.tuning)
        self._first = first_memory(rig.model, self.tuning)
        self.fallback = fallback_of(self.model, self.tick.length, tilt_variance(self.sensors))
        self.expected: int | None = None
        self._settled_from = 0
        self._lost = True
        self._moment = np.zeros(2)
        self._doubtful = self.tuning._replace(magnet_stiffness_doubt=LOST_MAGNET_DOUBT)
        self.sensor_names = tuple(rig.channels.names[i] for i in self.sensors.channel)
        units = tuple(rig.channels.units[i] for i in self.sensors.channel)
        rows = rows_of(self.model)
        self.names = (*rows, *(f"residual_{name}" for name in self.sensor_names))
        self.units = (*rows.values(), *units)
        self._told = len(rows)
        self._heard = np.ones(len(self.sensor_names), dtype=bool)  # sensors with a reading in the last block

    def update(self, series: Series) -> Estimated:
        """Take in the next block and return the estimate over it.

        A block that does not begin where the last one ended starts the moving states anew. Raises
        ValueError when the block's channels or rate are not the rig's, or it goes back in time.
        """
        self._check(series)
        missing = self._missing(series)
        start = 0
        status = int(series.status) & ~int(TIMING_FLAGS)
        if self._lost or missing is not None:
            self._restart(series, missing is not None)
            start = 1
            status |= EstimateStatus.RESTARTED
        estimated = self._run(series, start, status, missing)
        self.expected = series.first_sample + series.samples.shape[1]
        return estimated

    def identified(self) -> tuple[list[Parameter], list[str]]:
        """Return the rig's parameters as found so far, and what the data cannot tell, in plain words."""
        return (
            identified(self.described, self.memory, self._first),
            not_told(self.memory, self._first),
        )

    def saved(self) -> Saved:
        """Return what it knows now. Which sensors are left out is no part of that."""
        now = self.memory, self.fallback, self.expected, self._settled_from, self._lost, self._moment
        return Saved(*deepcopy(now))

    def go_back(self, saved: Saved) -> None:
        """Go back to what it knew; the next block is the one that came then."""
        self.memory, self.fallback, self.expected, self._settled_from, self._lost, self._moment = deepcopy(
            saved
        )

    def can_do_without(self, name: str) -> bool:
        """Tell whether another sensor sees the rotor's place, or the sensor is none that does."""
        sees = (self.sensors.columns[:, 0] == TILT) & np.isfinite(self.sensors.low) & self._heard
        sees[self.sensor_names.index(name)] = False
        return bool(sees.any())

    def leave_out(self, name: str) -> None:
        """Correct by a sensor no more."""
        self.sensors.low[self.sensor_names.index(name)] = np.inf  # no reading is above it

    def take_in(self, name: str) -> None:
        """Correct by a sensor that was left out again."""
        index = self.sensor_names.index(name)
        self.sensors.low[index] = sensors_of(self.rig, self.tuning).low[index]

    def variance_of(self, index: int) -> float:
        """Return the variance of a sensor's innovation at the last sample, in its unit squared."""
        columns, weights = self.sensors.columns[index], self.sensors.weights[index]
        return float(
            weights @ self.memory.covariance[np.ix_(columns, columns)] @ weights
            + self.sensors.variance[index]
        )

    def _check(self, series: Series) -> None:
        """Refuse a block of another rig or from the past."""
        if series.names != self.rig.channels.names or series.rate != self.rig.acquisition.rate:
            raise ValueError(
                f"block {series.first_sample} of run {series.run} has other channels or another rate than "
                f"the rig {self.rig.name}: the observer needs the rig description that the run was made with"
            )
        if self.expected is not None and series.first_sample < self.expected:
            raise ValueError(
                f"block {series.first_sample} is before sample {self.expected}, which comes next"
            )

    def _missing(self, series: Series) -> tuple[int, int] | None:
        """Return first and last missing sample before the block."""
        if self.expected is None or series.first_sample == self.expected:
            return None
        return self.expected, series.first_sample - 1

    def _restart(self, series: Series, after_gap: bool) -> None:
        """Set the moving states from the block's first sample, and the rates from the linear filter's."""
        restart(self.memory, self.sensors, self.feeds, series.samples, self.tick.length)
        if after_gap:
            forget(self.fallback)
        elif is_warm(self.fallback):
            hand_over_rates(self.fallback, self.memory)
        self.memory.described[:] = candidates_of(self.described)
        self._moment[:] = 0.0
        self._lost = False
        self._settled_from = series.first_sample + round(SETTLING_TIME * series.rate)

    def _run(self, series: Series, start: int, status: int, missing: tuple[int, int] | None) -> Estimated:
        """Run both filters over the block and judge what came out."""
        count, sensors = series.samples.shape[1], self.sensors.channel.size
        columns = -(-count // STRIDE)
        out, linear = np.empty((self._told + sensors, columns)), np.empty((6, columns))
        tally = Tally(np.zeros(sensors), np.zeros(sensors), np.zeros(sensors), np.zeros(2))
        follow(self.fallback, self.sensors, series.samples, STRIDE, linear)
        observe(
            for_kernels(self.model),
            self.tick,
            self.memory,
            self.tuning,
            self.sensors,
            self.feeds,
            series.samples,
            start,
            STRIDE,
            self._moment,
            out[: self._told],
            out[self._told :],
            tally,
        )
        self._heard = tally.counts > 0.0
        cause = self._cause_of_loss(out, tally, start)
        if cause:
            status |= EstimateStatus.LOST
            self._fall_back(out[: self._told], linear, tally)
        if series.first_sample < self._settled_from:
            status |= EstimateStatus.SETTLING
        return self._estimated(series, out, status, missing, cause, tally)

    def _cause_of_loss(self, out: np.ndarray, tally: Tally, start: int) -> str:
        """Say why the observer has lost the state over a block, if it has."""
        if not np.isfinite(out[: self._told]).all() or not np.isfinite(self.memory.covariance).all():
            return "the state was no number"
        if start:
            return ""
        ratios = np.divide(
            tally.ratios, tally.counts, out=np.zeros(tally.counts.size), where=tally.counts > 0
        )
        worst = int(np.argmax(ratios))
        if ratios[worst] <= LOST_RATIO:
            return ""
        return f"{self.sensor_names[worst]} was {np.sqrt(ratios[worst]):.0f} times as far off as expected"

    def _fall_back(self, out: np.ndarray, linear: np.ndarray, tally: Tally) -> None:
        """Begin anew from the rig's description, and tell over the block what the linear filter saw."""
        shaft = np.nan_to_num(out[SHAFT : SHAFT + 2], nan=0.0, posinf=0.0, neginf=0.0)
        self.memory = first_memory(self.described, self._doubtful)
        self.memory.described[:] = candidates_of(self.described)
        tally.peak[:] = 0.0
        self._lost = True
        forget_motion(self.memory)
        for column in range(linear.shape[1]):
            self.memory.shaft[:2] = shaft[:, column]
            hand_over(self.fallback, linear[:, column], self.memory)
            report(for_kernels(self.model), self.memory, column, STRIDE, self.tick.length, out, tally.peak)

    def _estimated(
        self,
        series: Series,
        out: np.ndarray,
        status: int,
        missing: tuple[int, int] | None,
        cause: str,
        tally: Tally,
    ) -> Estimated:
        """Put the estimate together."""
        angle = out[SHAFT].copy()
        out[SHAFT] %= 2.0 * np.pi
        with np.errstate(invalid="ignore"):
            rms = np.sqrt(tally.squares / tally.counts)
            ratios = tally.ratios / tally.counts
        return Estimated(
            series.first_sample,
            series.samples.shape[1],
            series.rate,
            int(status),
            STRIDE,
            self.names,
            self.units,
            out,
            angle,
            missing,
            cause,
            float(tally.peak[0]),
            float(tally.peak[1]),
            ratios,
            rms,
        )


def bare(model: Model) -> Model:
    """Return the model without unbalance, weight and coupling, which are states, and with a given speed."""
    rotor = model.rotor._replace(unbalance=0.0, gravity=0.0, coupling_force=0.0)
    return checked(model._replace(rotor=rotor, drive=model.drive._replace(mode=DriveMode.IDEAL)))


def first_memory(model: Model, tuning: Tuning) -> Memory:
    """Return the memory of an observer that has seen nothing: what the rig's description says, with doubt."""
    memory = new_memory()
    memory.described[:] = candidates_of(model)
    rotor = model.rotor
    weight = -rotor.mass * rotor.gravity * rotor.centre_of_mass_station
    moment = weight + rotor.coupling_station * rotor.coupling_force
    memory.state[MOMENT + 1] = moment
    memory.weight[1] = weight
    doubt = np.zeros(SIZE)
    doubt[UNBALANCE : UNBALANCE + 2] = UNBALANCE_PRIOR * rotor.unbalance
    doubt[MOMENT : MOMENT + 2] = MOMENT_PRIOR * max(abs(weight), abs(moment))
    doubt[[STIFFNESS, FRICTION]] = tuning.contact_doubt
    doubt[DAMPING] = tuning.damping_doubt
    doubt[CLEARANCE] = tuning.clearance_doubt
    doubt[MAGNET_STIFFNESS] = tuning.magnet_stiffness_doubt
    doubt[MAGNET_DAMPING] = tuning.magnet_damping_doubt
    memory.covariance[np.diag_indices(SIZE)] = doubt**2
    return memory
