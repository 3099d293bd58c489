"""The observer: the rig's contact model alongside the stream, corrected by what the sensors say.

An extended Kalman filter on the simulator's own kernels. Its state z (order: `twin.layout`) is

    u, u'       tilt of the rotor and its rate                       4
    h, h'       displacement of the house and its rate               4
    w_r         spin of the bearing's inner ring                     1
    Uc, Us      unbalance along and across the encoder's zero        2
    Mx, My      static moment: weight, coupling, probes' offsets     2
    rx, ry      contact force that the contact law does not explain  2

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

from enum import IntFlag
from typing import NamedTuple

import numpy as np

from daq.messages import TIMING_FLAGS, Series
from daq.rig import Rig, RigError
from simulator.candidates import candidates_of, for_kernels
from simulator.rig import DriveMode, Model
from simulator.simulation import checked
from simulator.tick import tick_of
from twin.filter import Tally, observe, restart
from twin.inputs import feeds_of, sensors_of
from twin.layout import MOMENT, SIZE, UNBALANCE, Memory, Tuning, new_memory

STRIDE = 5  # samples between two columns of an estimate
SETTLING_TIME = 0.1  # s after a restart during which the estimate is not vouched for
LOST_RATIO = 100.0  # mean innovation variance over its expectation at which the observer starts anew
UNBALANCE_PRIOR = 2.0  # times the described unbalance: how large the true one may be
MOMENT_PRIOR = 0.2  # of the described static moment

OUTPUTS = {
    "tilt_x": "rad",
    "tilt_y": "rad",
    "tilt_rate_x": "rad/s",
    "tilt_rate_y": "rad/s",
    "house_x": "m",
    "house_y": "m",
    "house_rate_x": "m/s",
    "house_rate_y": "m/s",
    "ring_speed": "rad/s",
    "displacement_x": "m",
    "displacement_y": "m",
    "contact_force_x": "N",
    "contact_force_y": "N",
    "normal_force": "N",
    "penetration": "m",
    "unbalance_x": "kg m",
    "unbalance_y": "kg m",
    "angle": "rad",
    "speed": "rad/s",
}
"""Name and unit of each row of an estimate but the residuals, which follow. Displacements are the shaft
centre's at the backup bearing's plane; forces act on the rotor; the angle is within one turn."""


class EstimateStatus(IntFlag):
    """Flags in an estimate's `status`, beside those of `daq.messages.BlockStatus` that its block carried."""

    RESTARTED = 256
    """The state was set anew from the measurement: at the start, after a gap, or because it was lost."""
    SETTLING = 512
    """Less than 0.1 s since then."""
    LOST = 1024
    """Measurement and model disagreed so much, or the state was no number, that the observer starts anew."""


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
    missing: (
        tuple[int, int] | None
    )  # first and last sample that were expected before this block and did not come
    largest_force: float  # N, normal contact force, over every sample of the block
    largest_radius: float  # m, of the shaft's centre at the backup bearing, likewise
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
        self.memory = first_memory(rig.model)
        self.expected: int | None = None
        self._settled_from = 0
        self._lost = True
        self._moment = np.zeros(2)
        self.sensor_names = tuple(rig.channels.names[i] for i in self.sensors.channel)
        units = tuple(rig.channels.units[i] for i in self.sensors.channel)
        self.names = (*OUTPUTS, *(f"residual_{name}" for name in self.sensor_names))
        self.units = (*OUTPUTS.values(), *units)

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
            self._restart(series)
            start = 1
            status |= EstimateStatus.RESTARTED
        estimated = self._run(series, start, status, missing)
        self.expected = series.first_sample + series.samples.shape[1]
        return estimated

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

    def _restart(self, series: Series) -> None:
        """Set the moving states from the block's first sample."""
        restart(self.memory, self.sensors, self.feeds, series.samples, self.tick.length)
        self.memory.candidates[:] = candidates_of(self.described)
        self._moment[:] = 0.0
        self._lost = False
        self._settled_from = series.first_sample + round(SETTLING_TIME * series.rate)

    def _run(self, series: Series, start: int, status: int, missing: tuple[int, int] | None) -> Estimated:
        """Run the kernel over the block and judge what came out."""
        count, sensors = series.samples.shape[1], self.sensors.channel.size
        columns = -(-count // STRIDE)
        out = np.empty((len(OUTPUTS) + sensors, columns))
        tally = Tally(np.zeros(sensors), np.zeros(sensors), np.zeros(sensors), np.zeros(2))
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
            out[: len(OUTPUTS)],
            out[len(OUTPUTS) :],
            tally,
        )
        if self._is_lost(out, tally, start):
            status |= EstimateStatus.LOST
            self._lost = True
            self.memory = first_memory(self.described)
        if series.first_sample < self._settled_from:
            status |= EstimateStatus.SETTLING
        return self._estimated(series, out, status, missing, tally)

    def _is_lost(self, out: np.ndarray, tally: Tally, start: int) -> bool:
        """Tell whether the state is no number, or the sensors contradict the model beyond all expectation."""
        if not np.isfinite(out[: len(OUTPUTS)]).all():
            return True
        used = tally.counts > 0
        ratios = tally.ratios[used] / tally.counts[used]
        return bool(start == 0 and ratios.size and ratios.max() > LOST_RATIO)

    def _estimated(
        self, series: Series, out: np.ndarray, status: int, missing: tuple[int, int] | None, tally: Tally
    ) -> Estimated:
        """Put the estimate together; what is no number is published as zero, with the flag LOST."""
        angle = out[self.names.index("angle")].copy()
        out[self.names.index("angle")] %= 2.0 * np.pi
        if status & EstimateStatus.LOST:
            np.nan_to_num(out[: len(OUTPUTS)], copy=False, nan=0.0, posinf=0.0, neginf=0.0)
        with np.errstate(invalid="ignore"):
            rms = np.sqrt(tally.squares / tally.counts)
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
            float(np.nan_to_num(tally.peak[0])),
            float(np.nan_to_num(tally.peak[1])),
            rms,
        )


def bare(model: Model) -> Model:
    """Return the model without unbalance, weight and coupling, which are states, and with a given speed."""
    rotor = model.rotor._replace(unbalance=0.0, gravity=0.0, coupling_force=0.0)
    return checked(model._replace(rotor=rotor, drive=model.drive._replace(mode=DriveMode.IDEAL)))


def first_memory(model: Model) -> Memory:
    """Return the memory of an observer that has seen nothing: what the rig's description says, with doubt."""
    memory = new_memory()
    memory.candidates[:] = candidates_of(model)
    rotor = model.rotor
    weight = -rotor.mass * rotor.gravity * rotor.centre_of_mass_station
    moment = weight + rotor.coupling_station * rotor.coupling_force
    memory.state[MOMENT + 1] = moment
    doubt = np.zeros(SIZE)
    doubt[UNBALANCE : UNBALANCE + 2] = UNBALANCE_PRIOR * rotor.unbalance
    doubt[MOMENT : MOMENT + 2] = MOMENT_PRIOR * max(abs(weight), abs(moment))
    memory.covariance[np.diag_indices(SIZE)] = doubt**2
    return memory
