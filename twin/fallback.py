"""The linear filter beside the observer: what it falls back on when the contact model fails it.

For each axis a Kalman filter with constant gain on the probes alone. Its state is tilt u, rate u' and an
angular acceleration a that wanders at random,

    u'' = -(K l_Q^2 + k_t) / I u - c l_Q^2 / I u' + a,

so that contact, unbalance, weight, gyroscopic moment and solenoid are all the same to it. It knows of no
contact and therefore cannot be wrong about one: it smears an impact, but it is never lost.
"""

from typing import NamedTuple

import numpy as np

from simulator.compile import kernel
from simulator.rig import Model
from twin.layout import TILT, TILT_RATE, Memory, Sensors
from twin.linear import discretise

FORCE_WALK = 100.0  # N/sqrt(s) at the backup bearing: how fast the contact force is taken to wander
GAIN_TICKS = 4000  # until the gain is constant
WARM_TICKS = 250  # after which its state is as certain as it gets
BLIND_WANDER = 0.96  # of the acceleration is left after a tick without a measurement: it is unknown soon
UNSEEN_DOUBT = 5e-3  # rad, of a tilt that no reading tells: a clearance of 1.5 mm at 0.3 m
UNSEEN = (UNSEEN_DOUBT**2, (UNSEEN_DOUBT * 100.0) ** 2)  # of tilt (rad2) and rate (rad2/s2), at 16 Hz
LEAST_ANGLE = 0.01  # rad, about, between two probes that are to tell both directions


class Fallback(NamedTuple):
    """The linear filter's arrays; both axes share flow, gain and covariance. SI units."""

    state: np.ndarray  # (2, 3) tilt, rate and acceleration of each axis
    ticks: np.ndarray  # (1,) with a measurement less those without, since it was set anew
    flow: np.ndarray  # (3, 3) of one tick
    gain: np.ndarray  # (3,)
    covariance: np.ndarray  # (3, 3) after a correction, once constant


def fallback_of(model: Model, step: float, variance: float) -> Fallback:
    """Return the filter of a rig for ticks of `step` s, `variance` (rad2) being that of a measured tilt."""
    rotor, magnet = model.rotor, model.magnetic_bearing
    arm = rotor.magnet_station**2
    stiffness = (magnet.stiffness * arm + rotor.pivot_stiffness) / rotor.inertia
    damping = magnet.damping * arm / rotor.inertia
    flow, short = np.eye(3), np.empty((2, 3))
    rates = np.array([[0.0, 1.0], [-stiffness, -damping]])
    discretise(rates, np.array([[0.0], [1.0]]), step, 1, short, np.empty((2, 2, 3)))
    flow[:2] = short
    noise = np.zeros((3, 3))
    noise[2, 2] = (FORCE_WALK * rotor.bearing_station / rotor.inertia) ** 2 * step
    covariance = np.diag([variance, 1.0, noise[2, 2]])
    gain = np.zeros(3)
    for _ in range(GAIN_TICKS):
        covariance = flow @ covariance @ flow.T + noise
        gain = covariance[:, 0] / (covariance[0, 0] + variance)
        covariance = covariance - np.outer(gain, covariance[0])
    return Fallback(np.zeros((2, 3)), np.zeros(1), flow, gain, covariance)


@kernel
def advance(fallback: Fallback, tilt: tuple[float, float]) -> None:
    """Go on by one tick and correct by a measured `tilt` (x, y), rad; NaN where nothing was measured."""
    state, flow, gain = fallback.state, fallback.flow, fallback.gain
    first = fallback.ticks[0] == 0.0
    for axis in range(2):
        u, rate, wander = state[axis, 0], state[axis, 1], state[axis, 2]
        for i in range(2):
            state[axis, i] = flow[i, 0] * u + flow[i, 1] * rate + flow[i, 2] * wander
        innovation = tilt[axis] - state[axis, 0]
        if not np.isfinite(innovation):
            state[axis, 2] *= BLIND_WANDER
            continue
        if first:
            state[axis, 0], state[axis, 1], state[axis, 2] = tilt[axis], 0.0, 0.0
            continue
        for i in range(3):
            state[axis, i] += gain[i] * innovation
    if np.isfinite(tilt[0]) and np.isfinite(tilt[1]):
        fallback.ticks[0] += 1.0
    elif fallback.ticks[0] > 0.0:
        fallback.ticks[0] = max(fallback.ticks[0] - 1.0, 1.0)


@kernel
def follow(fallback: Fallback, sensors: Sensors, samples: np.ndarray, stride: int, out: np.ndarray) -> None:
    """Run over `samples` (n_channels, n); each `stride`-th tilt, rate and acceleration go to `out` (6, n)."""
    state = fallback.state
    for k in range(samples.shape[1]):
        advance(fallback, measured_tilt(sensors, samples, k))
        if k % stride == 0:
            for i in range(3):
                out[2 * i, k // stride], out[2 * i + 1, k // stride] = state[0, i], state[1, i]


@kernel
def measured_tilt(sensors: Sensors, samples: np.ndarray, k: int) -> tuple[float, float]:
    """Return the tilt (x, y), rad, by least squares of the readings of sample `k` that see it, else NaN."""
    xx, xy, yy, to_x, to_y = 0.0, 0.0, 0.0, 0.0, 0.0
    for i in range(sensors.channel.size):
        reading = float(samples[sensors.channel[i], k])
        if sensors.columns[i, 0] == TILT and sensors.low[i] < reading < sensors.high[i]:
            along, across = sensors.weights[i, 0], sensors.weights[i, 1]
            xx += along * along
            xy += along * across
            yy += across * across
            to_x += along * reading
            to_y += across * reading
    scale = xx * yy - xy * xy
    if not scale > LEAST_ANGLE**2 * (xx + yy) ** 2:
        return np.nan, np.nan
    return (yy * to_x - xy * to_y) / scale, (xx * to_y - xy * to_x) / scale


def tilt_variance(sensors: Sensors) -> float:
    """Return the variance (rad2) of the measured tilt along one axis, the mean of both."""
    seen = sensors.columns[:, 0] == TILT
    weights, precision = sensors.weights[seen], 1.0 / sensors.variance[seen]
    return float(np.trace(np.linalg.inv(weights.T * precision @ weights)) / 2.0)


def forget(fallback: Fallback) -> None:
    """Begin anew with the next measurement."""
    fallback.state[:] = 0.0
    fallback.ticks[0] = 0.0


def is_warm(fallback: Fallback) -> bool:
    """Tell whether its state is as certain as its covariance says."""
    return bool(fallback.ticks[0] >= WARM_TICKS and np.isfinite(fallback.state).all())


def hand_over(fallback: Fallback, motion: np.ndarray, memory: Memory) -> None:
    """Set the rotor's motion in the observer's `memory`, with its covariance, to the linear filter's.

    `motion` (6,) holds its tilt (rad), rate (rad/s) and acceleration along x, y at the sample in question.
    """
    memory.state[TILT : TILT + 2] = motion[:2]
    memory.state[TILT_RATE : TILT_RATE + 2] = motion[2:4]
    covariance = fallback.covariance[:2, :2] if is_warm(fallback) else np.diag(UNSEEN)
    for axis in range(2):
        pair = np.ix_([TILT + axis, TILT_RATE + axis], [TILT + axis, TILT_RATE + axis])
        memory.covariance[pair] = covariance


def hand_over_rates(fallback: Fallback, memory: Memory) -> None:
    """Set the rotor's rates in the observer's `memory` to those of the sample before, doubted twice."""
    memory.state[TILT_RATE : TILT_RATE + 2] = fallback.state[:, 1]
    for axis in range(2):
        memory.covariance[TILT_RATE + axis, TILT_RATE + axis] = 4.0 * fallback.covariance[1, 1]
