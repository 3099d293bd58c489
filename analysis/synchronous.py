"""The 1X vector: the part of a signal that turns with the shaft, by least squares over whole revolutions.

A signal is modelled as `offset + Re(V exp(i theta))` with the shaft angle theta from the encoder's zero.
`abs(V)` is the amplitude, `angle(V)` the phase from that zero, with the direction of rotation: a positive
phase means that the signal peaks before the zero mark comes round. Fitting against the angle, not against
time, keeps the vector right through a change of speed, and does not need evenly spaced angles.
"""

from typing import NamedTuple

import numpy as np

TURN = 2.0 * np.pi


class Synchronous(NamedTuple):
    """The 1X part of signals over whole revolutions."""

    vector: np.ndarray  # (n_signals,) complex, in the signals' unit: amplitude and phase
    offset: np.ndarray  # (n_signals,) mean position
    residual: np.ndarray  # (n_signals,) rms of what is neither offset nor 1X
    revolutions: int  # that the fit covers

    @property
    def amplitude(self) -> np.ndarray:
        """Peak amplitude of each signal, in its unit."""
        return np.abs(self.vector)

    @property
    def phase(self) -> np.ndarray:
        """Phase of each signal in rad, in (-pi, pi], from the encoder's zero with rotation."""
        return np.angle(self.vector)


def last_whole_revolutions(angle: np.ndarray, most: int | None = None) -> tuple[int, int]:
    """Return `(start, revolutions)`: from `start` to the end, `angle` runs through whole revolutions.

    `angle` (n,) is the unwrapped shaft angle in rad, running one way. `most` limits the revolutions that
    are taken. `(n, 0)` when there is less than one revolution.
    """
    turned = np.abs(angle - angle[-1]) if angle.size else np.empty(0)
    revolutions = int(np.max(turned, initial=0.0) / TURN + 1e-9)
    if most is not None:
        revolutions = min(revolutions, most)
    if revolutions == 0:
        return angle.size, 0
    inside = turned < TURN * revolutions - 1e-9
    return int(angle.size - np.argmin(inside[::-1])) if not inside.all() else 0, revolutions


def synchronous(angle: np.ndarray, signals: np.ndarray, most: int | None = None) -> Synchronous:
    """Fit offset and 1X vector of `signals` (n_signals, n) against the unwrapped shaft `angle` (n,) in rad.

    Only the last whole revolutions are used, `most` of them when given. Raises ValueError when there is
    not one whole revolution.
    """
    start, revolutions = last_whole_revolutions(angle, most)
    if revolutions == 0:
        raise ValueError("a 1X vector needs at least one whole revolution of the shaft")
    turned, values = angle[start:], np.atleast_2d(signals)[:, start:]
    basis = np.stack([np.ones_like(turned), np.cos(turned), -np.sin(turned)])
    weights = np.linalg.solve(basis @ basis.T, basis @ values.T)
    residual = np.sqrt(np.mean((values - weights.T @ basis) ** 2, axis=1))
    return Synchronous(weights[1] + 1j * weights[2], weights[0], residual, revolutions)


def whirl_vectors(vector_x: complex, vector_y: complex) -> tuple[complex, complex]:
    """Split an orbit's 1X vectors along x and y into `(forward, backward)` circular parts.

    The orbit is `x + i y = forward exp(i theta) + backward exp(-i theta)`; a circular orbit with the
    rotation has no backward part.
    """
    return (vector_x + 1j * vector_y) / 2.0, (np.conj(vector_x) + 1j * np.conj(vector_y)) / 2.0
