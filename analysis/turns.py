"""What one revolution of the shaft shows of its regime, in seven numbers."""

from typing import NamedTuple

import numpy as np

TOUCH = 0.5  # N of normal force from which a hit is counted


class Turn(NamedTuple):
    """One revolution of the shaft, or a stretch of a shaft that stands still."""

    speed: float  # rad/s, mean shaft speed with sign
    duty: float  # 0 to 1, share of the samples in contact
    hits: np.ndarray  # (n_hits,) rad: direction in which each hit that began here presses on the bearing
    sweep: float  # runs of the centre round the bearing's centre, positive with the shaft's rotation
    span: float  # peak-to-peak movement of the centre over the clearance
    flatness: float  # minor over major axis of the orbit, 1 for a circle, 0 for a line
    mark: complex  # the centre at the revolution's end over the clearance; NaN where none has ended


def turn_of(
    angle: np.ndarray,
    centre: np.ndarray,
    contact: np.ndarray,
    normal: np.ndarray,
    clearance: float,
    rate: float,
) -> Turn:
    """Condense a revolution into a `Turn`.

    `angle` (n,) unwrapped shaft angle in rad; `centre` (n,) complex position x + i y of the shaft's centre
    in the bearing in m; `contact` (n,) complex contact force on the rotor and `normal` (n,) its normal part,
    in N; `clearance` in m; `rate` of the samples in Hz. The first sample is the last one of the revolution
    before, so that a hit that begins between them is counted once. Raises ValueError below two samples.
    """
    if angle.size < 2:
        raise ValueError(f"a revolution needs at least two samples, not {angle.size}")
    turned = float(angle[-1] - angle[0])
    bearing = np.unwrap(np.angle(centre))
    return Turn(
        speed=turned * rate / (angle.size - 1),
        duty=float(np.mean(normal[1:] > 0.0)),
        hits=hit_directions(contact, normal),
        sweep=float(bearing[-1] - bearing[0]) / (2.0 * np.pi) * float(np.sign(turned)),
        span=max(float(np.ptp(centre.real)), float(np.ptp(centre.imag))) / clearance,
        flatness=flatness(centre),
        mark=mark(angle, centre) / clearance,
    )


def hit_directions(contact: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """Return the direction (n_hits,) in rad, in (-pi, pi], of the impulse of each hit on the bearing.

    `contact` and `normal` as for `turn_of`; friction turns the direction by at most atan(mu).
    """
    touching = normal > TOUCH
    starts = np.flatnonzero(touching[1:] & ~touching[:-1]) + 1
    if starts.size == 0:
        return np.empty(0)
    return np.asarray(np.angle(-np.add.reduceat(np.where(touching, contact, 0.0), starts)))


def flatness(centre: np.ndarray) -> float:
    """Return minor over major axis of an orbit (n,), by its second moments; 1 when it does not move."""
    moving = centre - np.mean(centre)
    mean_square, skew = float(np.mean(np.abs(moving) ** 2)), float(np.abs(np.mean(moving**2)))
    return float(np.sqrt(max(mean_square - skew, 0.0) / (mean_square + skew))) if mean_square > 0.0 else 1.0


def mark(angle: np.ndarray, centre: np.ndarray) -> complex:
    """Return the centre as the shaft passes its zero between the last two samples; NaN if it does not."""
    before, after = angle[-2:] / (2.0 * np.pi)
    zero = max(np.floor(before), np.floor(after))
    if np.floor(before) == np.floor(after):
        return complex(np.nan, np.nan)
    return complex(centre[-2] + (centre[-1] - centre[-2]) * (zero - before) / (after - before))
