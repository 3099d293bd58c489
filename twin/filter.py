"""The observer's loop over the samples of a block: predict, track the encoder, correct, write out."""

from typing import NamedTuple

import numpy as np

from simulator.compile import kernel
from simulator.dynamics import Tick
from simulator.rig import Model
from twin.correction import correct
from twin.fallback import UNSEEN_DOUBT, measured_tilt
from twin.lateness import begin_way, end_way, forget_ways, way_since, way_variance
from twin.layout import (
    DYNAMIC,
    HOUSE,
    HOUSE_RATE,
    RESIDUAL,
    RING,
    SIZE,
    TILT,
    TILT_RATE,
    Feeds,
    Memory,
    Sensors,
    Tuning,
)
from twin.misfit import FREE, learn
from twin.parameters import bound
from twin.prediction import predict
from twin.tracking import ANGLE, SPEED, lock, track
from twin.virtual import report

PLACE_DOUBT = 2e-6  # rad, of the tilt where the observer starts from one reading
RATE_DOUBT = 1.0  # rad/s
HOUSE_DOUBT = 1e-6  # m
HOUSE_RATE_DOUBT = 2e-3  # m/s
RING_DOUBT = 20.0  # rad/s
SURPRISE_SHARE = 0.1  # of a tick's innovations in the mean that tells of an unforeseen contact


class Tally(NamedTuple):
    """What a block's innovations amount to: sums over its samples, per sensor."""

    squares: np.ndarray  # (n,) of the innovations, in the channel's unit squared
    ratios: np.ndarray  # (n,) of the innovations' squares over their expected variance
    counts: np.ndarray  # (n,) readings used
    peak: np.ndarray  # (2,) largest normal force (N) and largest radius at the bearing (m) of the block


@kernel
def observe(
    model: Model,
    tick: Tick,
    memory: Memory,
    tuning: Tuning,
    sensors: Sensors,
    feeds: Feeds,
    samples: np.ndarray,
    start: int,
    stride: int,
    last_moment: np.ndarray,
    out: np.ndarray,
    residuals: np.ndarray,
    tally: Tally,
) -> None:
    """Run the observer over `samples` (n_channels, n), from column `start` on, a tick apart.

    Columns before `start` (0 or 1) are where the state has just been set; there is nothing to predict.
    Every `stride`-th column goes to `out` (n_outputs, n_columns) and its innovations to `residuals`
    (n_sensors, n_columns). `last_moment` (2,) carries the solenoids' moment from one sample to the next.
    """
    for k in range(samples.shape[1]):
        if k >= start:
            moment_x, moment_y = solenoid_moment(feeds, samples, k)
            mean_x, mean_y = 0.5 * (moment_x + last_moment[0]), 0.5 * (moment_y + last_moment[1])
            begin_way(memory)
            predict(model, tick, memory, tuning, mean_x, mean_y)
            end_way(memory)
            last_moment[0] = moment_x
            last_moment[1] = moment_y
            angle = feeds.sense * samples[feeds.angle, k] + memory.shaft[SPEED] * feeds.late
            track(memory.shaft, angle, tick.length)
        column = k // stride if k % stride == 0 else -1
        correct_all(memory, sensors, samples, k, column, residuals, tally, tick.length)
        learn(memory, tick.length)
        bound(model, memory.state)
        report(model, memory, column, stride, tick.length, out, tally.peak)


@kernel
def solenoid_moment(feeds: Feeds, samples: np.ndarray, k: int) -> tuple[float, float]:
    """Return the moment (x, y) of all solenoids at sample `k`, N m."""
    moment_x, moment_y = 0.0, 0.0
    for i in range(feeds.currents.size):
        current = samples[feeds.currents[i], k]
        if np.isfinite(current):
            moment_x += feeds.moments[i, 0] * current
            moment_y += feeds.moments[i, 1] * current
    return moment_x, moment_y


@kernel
def correct_all(
    memory: Memory,
    sensors: Sensors,
    samples: np.ndarray,
    k: int,
    column: int,
    residuals: np.ndarray,
    tally: Tally,
    step: float,
) -> None:
    """Correct by every sensor whose reading at sample `k` is within its range; keep the innovations."""
    state, total, count = memory.state, 0.0, 0
    for i in range(sensors.channel.size):
        reading = float(samples[sensors.channel[i], k])
        if not sensors.low[i] < reading < sensors.high[i]:
            if column >= 0:
                residuals[i, column] = np.nan
            continue
        columns, weights = sensors.columns[i], sensors.weights[i]
        innovation = reading - weights[0] * state[columns[0]] - weights[1] * state[columns[1]]
        variance = sensors.variance[i]
        if sensors.late[i] > 0.0:
            innovation += weights[0] * way_since(memory, columns[0], sensors.late[i])
            innovation += weights[1] * way_since(memory, columns[1], sensors.late[i])
            variance += way_variance(memory, columns, weights, sensors.late[i] * step)
        if column >= 0:
            residuals[i, column] = innovation
        tally.squares[i] += innovation * innovation
        tally.counts[i] += 1.0
        ratio = correct(state, memory.covariance, weights, columns, innovation, variance, memory.vector_work)
        tally.ratios[i] += ratio
        total += ratio
        count += 1
    if count:
        memory.surprise[0] += SURPRISE_SHARE * (total / count - memory.surprise[0])


@kernel
def restart(memory: Memory, sensors: Sensors, feeds: Feeds, samples: np.ndarray, step: float) -> None:
    """Set what moves (rotor, house, ring, shaft) anew from the first of `samples`; keep what is slow.

    Tilt from the sensors that see it, by their least squares; velocities and house at zero; all with
    the doubt that this deserves. Unbalance, static moment and parameters keep value and doubt.
    """
    lock(memory.shaft, samples[feeds.angle], feeds.sense, step)
    memory.shaft[ANGLE] += memory.shaft[SPEED] * feeds.late
    forget_motion(memory)
    tilt = measured_tilt(sensors, samples, 0)
    for axis in range(2):
        if np.isfinite(tilt[axis]):
            memory.state[TILT + axis] = tilt[axis]
        else:
            memory.covariance[TILT + axis, TILT + axis] = UNSEEN_DOUBT**2


@kernel
def forget_motion(memory: Memory) -> None:
    """Set rotor's rates, house and residual force to zero, with doubt; the tilt stays, with its doubt."""
    for i in range(RESIDUAL + 2):
        if i < DYNAMIC or i >= RESIDUAL:
            if i >= TILT_RATE and i != RING:
                memory.state[i] = 0.0
            for j in range(SIZE):
                memory.covariance[i, j] = 0.0
                memory.covariance[j, i] = 0.0
    for axis in range(2):
        memory.covariance[TILT + axis, TILT + axis] = PLACE_DOUBT**2
        memory.covariance[TILT_RATE + axis, TILT_RATE + axis] = RATE_DOUBT**2
        memory.covariance[HOUSE + axis, HOUSE + axis] = HOUSE_DOUBT**2
        memory.covariance[HOUSE_RATE + axis, HOUSE_RATE + axis] = HOUSE_RATE_DOUBT**2
    memory.covariance[RING, RING] = RING_DOUBT**2
    memory.surprise[0] = 1.0
    memory.misfit[FREE] = 0.0
    forget_ways(memory)
