"""Natural frequency and damping from a free decay of the rotor at standstill.

The shaft's centre is the complex signal w = x + i y. After a hit an isotropic rotor at rest follows
`w(t) = offset + exp(-zeta w_n t) (A cos(w_d t) + B sin(w_d t))` with complex offset, A and B and
`w_d = w_n sqrt(1 - zeta^2)`: both directions share one frequency and one damping, whatever the direction
of the hit. For given (w_n, zeta) the best offset, A and B are a linear least-squares problem, so only two
numbers are searched (variable projection).
"""

from typing import NamedTuple

import numpy as np
from scipy.optimize import least_squares

TURN = 2.0 * np.pi


class Decay(NamedTuple):
    """What a free decay says about the rotor."""

    frequency: float  # Hz, undamped natural frequency f_n
    damping: float  # 1, damping ratio zeta
    offset: complex  # position of rest, in the signal's unit
    residual: float  # rms of what the decay does not explain, in the signal's unit


def fit_decay(position: np.ndarray, rate: float) -> Decay:
    """Fit the free decay of `position` (n,), complex x + i y, sampled at `rate` Hz.

    The stretch must begin after the hit is over, hold at least three periods, and the shaft must not turn
    or touch. Raises ValueError when there are too few samples or no oscillation is found.
    """
    if position.size < 16 or not np.all(np.isfinite(position)):
        raise ValueError("a decay needs at least 16 finite samples")
    scale = float(np.std(position))
    if scale == 0.0:
        raise ValueError("no decay: the signal does not move")
    time = np.arange(position.size) / rate
    guess = TURN * peak_frequency(position - np.mean(position), rate)
    found = least_squares(
        lambda p: misfit(p, time, position)[0] / scale,
        [guess, 0.02],
        x_scale=[guess * 1e-3, 1e-3],
        xtol=1e-12,
    )
    left, weights = misfit(found.x, time, position)
    residual = float(np.sqrt(np.mean(left**2) * 2.0))
    if residual > 0.5 * scale:
        raise ValueError("no decay: the signal is not one damped oscillation")
    return Decay(float(found.x[0]) / TURN, float(found.x[1]), complex(weights[0]), residual)


def peak_frequency(position: np.ndarray, rate: float) -> float:
    """Return the frequency in Hz, sign dropped, at which complex `position` (n,) is strongest."""
    padded = np.fft.fft(position * np.hanning(position.size), 4 * position.size)
    frequencies = np.abs(np.fft.fftfreq(padded.size, 1.0 / rate))
    power = np.abs(padded) ** 2 * (frequencies > rate / position.size)
    return float(frequencies[np.argmax(power)])


def misfit(parameters: np.ndarray, time: np.ndarray, position: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the residuals (2 n,) of the best decay with `parameters` (w_n rad/s, zeta), and its weights."""
    natural, damping = parameters
    damped = natural * np.sqrt(np.maximum(1.0 - damping**2, 1e-12))
    envelope = np.exp(-damping * natural * time)
    basis = np.stack([np.ones_like(time), envelope * np.cos(damped * time), envelope * np.sin(damped * time)])
    weights = np.linalg.solve(basis @ basis.T, basis @ position)
    left = position - weights @ basis
    return np.concatenate([left.real, left.imag]), weights
