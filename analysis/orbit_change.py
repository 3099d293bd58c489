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

LEAST_DOUBT = 0.05e-6
"""m, of a mean or of a vector's part over a window: the converter's steps, a speed that varies."""
UNEVEN = 0.15
"""Of the free vibration, fitted as that of a rotor at rest: how much of it may pass for orbit."""
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
    doubt: np.ndarray  # (n_probes, 3) m: standard deviations of the mean and of both parts of the vector


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
    Near the resonance orbit and vibration look alike for half a second, and the doubt is large.
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
    spread = np.linalg.inv(basis @ basis.T)
    weights = spread @ (basis @ readings.T)
    residual = np.sqrt(np.mean((readings - weights.T @ basis) ** 2, axis=1))
    vibration = np.hypot(weights[4], weights[5])
    noise = np.outer(residual, np.sqrt(np.diag(spread)[:NUMBERS]))
    doubt = np.sqrt(LEAST_DOUBT**2 + noise**2 + (UNEVEN * vibration[:, np.newaxis]) ** 2)
    return Steady(weights[0], weights[1] + 1j * weights[2], residual, doubt)


def combined(orbits: Sequence[Steady]) -> Steady:
    """Return the mean of steady orbits, each with the weight that its doubt deserves."""
    means, vectors, residuals, doubt = (np.array(each) for each in zip(*orbits, strict=True))
    weights = doubt**-2.0 / np.sum(doubt**-2.0, axis=0)
    real, imaginary = weights[..., 1] * vectors.real, weights[..., 2] * vectors.imag
    return Steady(
        np.sum(weights[..., 0] * means, axis=0),
        np.sum(real + 1j * imaginary, axis=0),
        residuals.mean(axis=0),
        np.maximum(np.sum(doubt**-2.0, axis=0) ** -0.5, LEAST_DOUBT),
    )


def numbers(mean: np.ndarray, vector: np.ndarray) -> np.ndarray:
    """Return (n_probes * 3,) m: for each probe its mean and both parts of its vector."""
    return np.stack([mean, vector.real, vector.imag], axis=1).ravel()


def doubts(reference: Steady, now: Steady) -> np.ndarray:
    """Return the standard deviations (n_probes * 3,), m, of the change between two orbits."""
    return np.asarray(np.hypot(reference.doubt, now.doubt)).ravel()


def difference(reference: Steady, now: Steady) -> np.ndarray:
    """Return the change in standard deviations: for each probe its mean and both parts of its vector."""
    return numbers(now.mean - reference.mean, now.vector - reference.vector) / doubts(reference, now)


def cause_of(reference: Steady, now: Steady, directions: Sequence[complex], speed: float) -> Cause:
    """Name what has changed between two steady orbits at the same `speed` (rad/s).

    `directions` are the probes', as exp(i angle) from +x towards +y.
    """
    change, doubt = difference(reference, now), doubts(reference, now)
    deviation = max(1.0, MISFIT * float(np.abs(change).max()))
    found = []
    for kind, probe, unknowns in causes(reference, directions, speed):
        patterns = unknowns / doubt
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
    """Yield each cause: kind, probe, and what one unit of each of its unknowns changes, m."""
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
    """Return the change, m, of one probe's mean and vector among those of all."""
    means, vectors = np.zeros(count), np.zeros(count, complex)
    means[probe], vectors[probe] = mean, vector
    return numbers(means, vectors)
