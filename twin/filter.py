"""The observer's loop over the samples of a block: predict, track the encoder, correct, write out."""

from typing import NamedTuple

import numpy as np

from simulator.compile import kernel
from simulator.contact import candidate_count, contact_force, relative_motion, wall
from simulator.dynamics import Tick
from simulator.rig import Model
from simulator.state import State
from twin.correction import correct
from twin.layout import (
    DYNAMIC,
    HOUSE,
    HOUSE_RATE,
    RESIDUAL,
    RING,
    TILT,
    TILT_RATE,
    UNBALANCE,
    Memory,
    Tuning,
)
from twin.prediction import predict, state_of
from twin.tracking import ANGLE, SPEED, lock, track

PLACE_DOUBT = 2e-6  # rad, of the tilt where the observer starts from one reading
RATE_DOUBT = 1.0  # rad/s
HOUSE_DOUBT = 1e-6  # m
HOUSE_RATE_DOUBT = 2e-3  # m/s
RING_DOUBT = 20.0  # rad/s


class Sensors(NamedTuple):
    """The channels that correct the observer, one entry each; reading = weights @ state[columns] + noise."""

    channel: np.ndarray  # (n,) int, row in the block
    columns: np.ndarray  # (n, 2) int, into the state
    weights: np.ndarray  # (n, 2) unit of the channel per unit of the state
    variance: np.ndarray  # (n,) of the noise
    low: np.ndarray  # (n,) a reading below is not used
    high: np.ndarray  # (n,) a reading above is not used


class Feeds(NamedTuple):
    """The channels that drive the observer."""

    angle: int  # row of the encoder's angle in the block
    sense: float  # 1 when that angle grows from x towards y, else -1
    currents: np.ndarray  # (m,) int, rows of the solenoids' currents
    moments: np.ndarray  # (m, 2) N m per A, along x and y


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
            predict(model, tick, memory, tuning, mean_x, mean_y)
            last_moment[0] = moment_x
            last_moment[1] = moment_y
            track(memory.shaft, feeds.sense * samples[feeds.angle, k], tick.length)
        column = k // stride if k % stride == 0 else -1
        correct_all(memory, sensors, samples, k, column, residuals, tally)
        report(model, memory, column, out, tally)


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
) -> None:
    """Correct by every sensor whose reading at sample `k` is within its range; keep the innovations."""
    state = memory.state
    for i in range(sensors.channel.size):
        reading = float(samples[sensors.channel[i], k])
        if not sensors.low[i] < reading < sensors.high[i]:
            if column >= 0:
                residuals[i, column] = np.nan
            continue
        columns, weights = sensors.columns[i], sensors.weights[i]
        innovation = reading - weights[0] * state[columns[0]] - weights[1] * state[columns[1]]
        if column >= 0:
            residuals[i, column] = innovation
        tally.squares[i] += innovation * innovation
        tally.counts[i] += 1.0
        tally.ratios[i] += correct(
            state, memory.covariance, weights, columns, innovation, sensors.variance[i], memory.vector_work
        )


@kernel
def report(model: Model, memory: Memory, column: int, out: np.ndarray, tally: Tally) -> None:
    """Write states and virtual sensors to column `column` of `out`, unless it is negative; keep the peaks."""
    state = state_of(memory.state, memory.shaft)
    force = contact_force(model, memory.candidates, state)
    force_x, force_y, normal = force.force_x, force.force_y, force.normal
    if normal > 0.0:
        nx, ny = outward(model, memory.candidates, state)
        residual_x, residual_y = memory.state[RESIDUAL], memory.state[RESIDUAL + 1]
        normal = max(0.0, normal - nx * residual_x - ny * residual_y)
        force_x += residual_x
        force_y += residual_y
    station = model.rotor.bearing_station
    x, y = station * state.tilt_x, station * state.tilt_y
    tally.peak[0] = max(tally.peak[0], normal)
    tally.peak[1] = max(tally.peak[1], np.sqrt(x * x + y * y))
    if column < 0:
        return
    for i in range(DYNAMIC):
        out[i, column] = memory.state[i]
    out[DYNAMIC, column] = x
    out[DYNAMIC + 1, column] = y
    out[DYNAMIC + 2, column] = force_x
    out[DYNAMIC + 3, column] = force_y
    out[DYNAMIC + 4, column] = normal
    out[DYNAMIC + 5, column] = force.penetration
    out[DYNAMIC + 6, column] = memory.state[UNBALANCE]
    out[DYNAMIC + 7, column] = memory.state[UNBALANCE + 1]
    out[DYNAMIC + 8, column] = memory.shaft[ANGLE]
    out[DYNAMIC + 9, column] = memory.shaft[SPEED]


@kernel
def outward(model: Model, candidates: np.ndarray, state: State) -> tuple[float, float]:
    """Return the unit normal (x, y), from shaft to wall, where the shaft is deepest in the bearing."""
    x, y, _, _ = relative_motion(model, state)
    bearing, radius = model.backup_bearing, model.rotor.shaft_radius
    nx, ny, deepest = wall(bearing, candidates, radius, 0, x, y)
    for index in range(1, candidate_count(bearing)):
        other_x, other_y, depth = wall(bearing, candidates, radius, index, x, y)
        if depth > deepest:
            nx, ny, deepest = other_x, other_y, depth
    return nx, ny


@kernel
def restart(memory: Memory, sensors: Sensors, feeds: Feeds, samples: np.ndarray, step: float) -> None:
    """Set what moves (rotor, house, ring, shaft) anew from the first of `samples`; keep what is slow.

    Tilt from the sensors that see it, by their least squares; velocities and house at zero; all with
    the doubt that this deserves. Unbalance and static moments keep value and doubt.
    """
    lock(memory.shaft, samples[feeds.angle], feeds.sense, step)
    set_tilt(memory.state, sensors, samples)
    for i in range(TILT_RATE, RING):
        memory.state[i] = 0.0
    memory.state[RESIDUAL] = 0.0
    memory.state[RESIDUAL + 1] = 0.0
    for i in range(RESIDUAL + 2):
        if i < DYNAMIC or i >= RESIDUAL:
            for j in range(RESIDUAL + 2):
                memory.covariance[i, j] = 0.0
                memory.covariance[j, i] = 0.0
    for axis in range(2):
        memory.covariance[TILT + axis, TILT + axis] = PLACE_DOUBT**2
        memory.covariance[TILT_RATE + axis, TILT_RATE + axis] = RATE_DOUBT**2
        memory.covariance[HOUSE + axis, HOUSE + axis] = HOUSE_DOUBT**2
        memory.covariance[HOUSE_RATE + axis, HOUSE_RATE + axis] = HOUSE_RATE_DOUBT**2
    memory.covariance[RING, RING] = RING_DOUBT**2


@kernel
def set_tilt(state: np.ndarray, sensors: Sensors, samples: np.ndarray) -> None:
    """Set the tilt by least squares from the first reading of each sensor that sees it."""
    xx, xy, yy, to_x, to_y = 0.0, 0.0, 0.0, 0.0, 0.0
    for i in range(sensors.channel.size):
        reading = float(samples[sensors.channel[i], 0])
        if sensors.columns[i, 0] == TILT and sensors.low[i] < reading < sensors.high[i]:
            along, across = sensors.weights[i, 0], sensors.weights[i, 1]
            xx += along * along
            xy += along * across
            yy += across * across
            to_x += along * reading
            to_y += across * reading
    scale = xx * yy - xy * xy
    if scale > 0.0:
        state[TILT] = (yy * to_x - xy * to_y) / scale
        state[TILT + 1] = (xx * to_y - xy * to_x) / scale
