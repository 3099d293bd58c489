"""What the rotor does in its backup bearing, by plain rules over a window of whole revolutions.

The rules look at three numbers: how fast the shaft turns, for which share of the time it touches, and how
often its centre runs round the bearing's centre while touching. They are in `classify`, in order; the
first that fits is the answer.
"""

from enum import StrEnum
from typing import NamedTuple

import numpy as np

REST_SPEED = 2.0 * np.pi * 0.1  # rad/s below which the shaft stands still
REST_MOTION = 0.05  # share of the clearance that a shaft at rest may still move
PERMANENT_SHARE = 0.95  # share of the time in contact from which contact is permanent
TOUCH_SHARE = 0.002  # share of the time in contact below which the shaft counts as free
WHIRL_TURNS = 0.8  # runs of the centre round the bearing per revolution of the shaft


class Regime(StrEnum):
    """Names of the regimes."""

    UNKNOWN = "unknown"
    AT_REST = "at rest"
    FREE_DECAY = "free decay"
    CONTACT_FREE = "contact-free 1X"
    BOUNCING = "bouncing"
    PERMANENT = "permanent contact"
    FORWARD_WHIRL = "forward whirl"
    BACKWARD_WHIRL = "backward whirl"


class Features(NamedTuple):
    """The numbers that the rules look at, over one window."""

    speed: float  # rad/s, mean shaft speed with sign
    contact_share: float  # 0 to 1, share of the samples in contact
    turns: float  # runs of the shaft's centre round the bearing's centre, counter-clockwise positive
    revolutions: float  # of the shaft, counter-clockwise positive
    motion: float  # peak-to-peak movement of the centre over the clearance


def features(
    angle: np.ndarray, speed: float, centre: np.ndarray, force: np.ndarray, clearance: float
) -> Features:
    """Condense a window into `Features`.

    `angle` (n,) unwrapped shaft angle in rad; `speed` its mean rate in rad/s; `centre` (n,) complex
    position of the shaft's centre in the bearing in m; `force` (n,) normal contact force in N; `clearance`
    in m.
    """
    bearing = np.unwrap(np.angle(centre))
    span = max(np.ptp(centre.real), np.ptp(centre.imag)) if centre.size else 0.0
    return Features(
        speed=speed,
        contact_share=float(np.mean(force > 0.0)) if force.size else 0.0,
        turns=float(bearing[-1] - bearing[0]) / (2.0 * np.pi) if centre.size else 0.0,
        revolutions=float(angle[-1] - angle[0]) / (2.0 * np.pi) if angle.size else 0.0,
        motion=float(span) / clearance,
    )


def classify(seen: Features) -> Regime:
    """Name the regime that `Features` show."""
    touching = seen.contact_share > TOUCH_SHARE
    if not touching and abs(seen.speed) >= REST_SPEED:
        return Regime.CONTACT_FREE
    if not touching:
        return Regime.AT_REST if seen.motion < REST_MOTION else Regime.FREE_DECAY
    if seen.contact_share < PERMANENT_SHARE:
        return Regime.BOUNCING
    if abs(seen.turns) < WHIRL_TURNS * max(abs(seen.revolutions), 1.0):
        return Regime.PERMANENT
    forward = seen.turns * (seen.speed if seen.revolutions == 0.0 else seen.revolutions) > 0.0
    return Regime.FORWARD_WHIRL if forward else Regime.BACKWARD_WHIRL
