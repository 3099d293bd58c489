"""What has changed when a steady contact-free orbit has: one of its probes, or the rotor's unbalance.

At constant speed, without contact and when free vibration has nearly died away, each probe reads

    r(t) = mean + slope t + Re(R exp(i theta)) + exp(-d t) (a cos w t + b sin w t) + noise

with the shaft's angle theta and the rotor's natural frequency w. A rotor on an isotropic bearing has a
circular orbit: R = conj(n) F, with a probe's direction n = exp(i angle) and the orbit's vector F. So a change
of two probes' means and vectors tells its cause: unbalance changes F and both probes alike; a probe's gain
changes its own mean and R in proportion, a lag by t turns its R by -speed t, runout adds any vector to its R,
and drift moves its mean. Each cause explains the change by least squares, with one or two unknowns; the one
that leaves least, by Schwarz's criterion (Annals of Statistics 6, 1978), is named. This is the generalised
likelihood ratio test of Basseville and Nikiforov, Detection of Abrupt Changes (1993), section 2.4.3, for
Gaussian noise.
"""

from collections.abc import Iterator, Sequence
from math import exp, log
from typing import NamedTuple

import numpy as np

MEAN_DEVIATION = 0.1e-6  # m, of a mean over a window: noise, the converter's steps, what is left of vibration
VECTOR_DEVIATION = 0.1e-6  # m, of a vector's part, likewise
MISFIT = (
    0.01  # of the largest change: what a right cause may leave, as speed and vibration are not quite steady
)
PENALTY = 2.0  # times Schwarz's, for each unknown: what is left of vibration is not independent noise
NUMBERS = 3  # of each probe: mean, and both parts of its vector


class Steady(NamedTuple):
    """A steady orbit as each probe sees it."""

    mean: np.ndarray  # (n_probes,) m
    vector: np.ndarray  # (n_probes,) complex, m: 1X amplitude and phase
    residual: np.ndarray  # (n_probes,) m rms of what the fit leaves


class Cause(NamedTuple):
    """What a change comes from."""

    kind: str  # drift, gain, skew, runout or unbalance
    probe: int  # -1: it is the rotor's
    size: complex  # m of drift, factor of gain, s of skew, m of runout or of the orbit by unbalance: a vector
    confidence: float  # 0 to 1, among the causes that are known


def steady_orbit(
    angle: np.ndarray, time: np.ndarray, readings: np.ndarray, frequency: float, decay: float
) -> Steady:
    """Fit a window: shaft `angle` (n,) rad, `time` (n,) s, `readings` (n_probes, n) m.

    `frequency` (rad/s) and `decay` (1/s) are the free vibration's. The mean is that at the window's middle.
    """
    fading, phase = np.exp(-decay * time), frequency * time
    basis = np.stack(
        [
            np.ones_like(angle),
            np.cos(angle),
            -np.sin(angle),
            time - np.mean(time),
            fading * np.cos(phase),
            fading * np.sin(phase),
        ]
    )
    weights = np.linalg.solve(basis @ basis.T, basis @ readings.T)
    residual = np.sqrt(np.mean((readings - weights.T @ basis) ** 2, axis=1))
    return Steady(weights[0], weights[1] + 1j * weights[2], residual)


def difference(reference: Steady, now: Steady) -> np.ndarray:
    """Return the change in standard deviations: for each probe its mean and both parts of its vector."""
    vector = now.vector - reference.vector
    parts = np.stack(
        [
            (now.mean - reference.mean) / MEAN_DEVIATION,
            vector.real / VECTOR_DEVIATION,
            vector.imag / VECTOR_DEVIATION,
        ],
        axis=1,
    )
    return parts.ravel()


def cause_of(reference: Steady, now: Steady, directions: Sequence[complex], speed: float) -> Cause:
    """Name what has changed between two steady orbits at the same `speed` (rad/s).

    `directions` are the probes', as exp(i angle) from +x towards +y.
    """
    change = difference(reference, now)
    deviation = max(1.0, MISFIT * float(np.abs(change).max()))
    found = []
    for kind, probe, patterns in causes(reference, directions, speed):
        sizes = np.linalg.lstsq(patterns.T, change, rcond=None)[0]
        left = float(np.sum((change - sizes @ patterns) ** 2)) / deviation**2
        size = complex(sizes[0], sizes[1] if len(sizes) > 1 else 0.0)
        found.append((left + PENALTY * len(sizes) * log(change.size), kind, probe, size))
    best = min(found, key=lambda each: each[0])
    weight = sum(exp(-0.5 * min(each[0] - best[0], 700.0)) for each in found)
    return Cause(best[1], best[2], best[3], 1.0 / weight)


def causes(
    reference: Steady, directions: Sequence[complex], speed: float
) -> Iterator[tuple[str, int, np.ndarray]]:
    """Yield each cause: kind, probe, and what one unit of each of its unknowns changes, in deviations."""
    count = len(directions)
    for probe in range(count):
        vector = reference.vector[probe]
        yield "drift", probe, np.array([changed(count, probe, 1.0, 0.0)])
        yield "gain", probe, np.array([changed(count, probe, float(reference.mean[probe]), vector)])
        yield "skew", probe, np.array([changed(count, probe, 0.0, -1j * speed * vector)])
        yield "runout", probe, np.array([changed(count, probe, 0.0, unit) for unit in (1.0, 1j)])
    yield (
        "unbalance",
        -1,
        np.array(
            [
                sum(changed(count, probe, 0.0, np.conj(n) * unit) for probe, n in enumerate(directions))
                for unit in (1.0, 1j)
            ]
        ),
    )


def changed(count: int, probe: int, mean: float, vector: complex) -> np.ndarray:
    """Return the change, in deviations, of one probe's mean and vector."""
    parts = np.zeros((count, NUMBERS))
    parts[probe] = mean / MEAN_DEVIATION, vector.real / VECTOR_DEVIATION, vector.imag / VECTOR_DEVIATION
    return parts.ravel()
