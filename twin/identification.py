"""What the observer has found out about the rig, how surely, and what the data so far cannot tell.

A parameter is *told* when its standard deviation has come down to half of the doubt that it began with. What
has not been told is still the description's value; the notes say of which parameters that is so, and which
of them go together: a correlation near one means that the data know their combination, not each of them.
"""

from math import atan2, hypot, pi, sqrt
from typing import NamedTuple

import numpy as np

from simulator.rig import BackupBearing, ContactLaw, DampingMode, Model
from twin.layout import (
    CLEARANCE,
    DAMPING,
    FRICTION,
    MAGNET_DAMPING,
    MAGNET_STIFFNESS,
    MOMENT,
    STIFFNESS,
    UNBALANCE,
    Memory,
)

TOLD = 0.5  # share of the first doubt below which a parameter has been told by the data
TOGETHER = 0.9  # correlation from which two parameters cannot be told apart
BALANCE_RADIUS = 33e-3  # m, where the disk takes balance masses (P2: 6.2 g at 33 mm are 205 g mm)
SHORT = {
    UNBALANCE: "unbalance_x",
    UNBALANCE + 1: "unbalance_y",
    MOMENT: "moment_x",
    MOMENT + 1: "coupling_force",
    MAGNET_STIFFNESS: "magnet_stiffness",
    MAGNET_DAMPING: "magnet_damping",
    CLEARANCE: "clearance",
    STIFFNESS: "contact_stiffness",
    DAMPING: "contact_damping",
    FRICTION: "contact_friction",
}
"""Name of each slow state in the notes."""


KEYS = (
    "rotor.unbalance",
    "rotor.unbalance_angle",
    "rotor.coupling_force",
    "magnetic_bearing.stiffness",
    "magnetic_bearing.damping",
    "backup_bearing.clearance",
    "backup_bearing.stiffness",
    "backup_bearing.friction",
    "backup_bearing.damping",
    "backup_bearing.damping_factor",
)
"""Keys of the rig description that may be found."""


class Parameter(NamedTuple):
    """One parameter of the rig as found, in SI units."""

    name: str
    unit: str
    value: float
    sigma: float  # standard deviation
    told: bool  # whether the data have told it
    key: str  # of the rig description, "table.key"; empty where it is none


def identified(model: Model, memory: Memory, first: Memory) -> list[Parameter]:
    """Return the parameters that the observer's `memory` holds; `first` is what it held before any data.

    `model` is the rig's description.
    """
    state, deviations = memory.state, np.sqrt(np.diag(memory.covariance))
    told = deviations < TOLD * np.sqrt(np.diag(first.covariance))
    bearing, magnet = model.backup_bearing, model.magnetic_bearing

    def scaled(name: str, unit: str, index: int, described: float, key: str) -> Parameter:
        value, place = described * float(np.exp(state[index])), f"backup_bearing.{key}" if key else ""
        return Parameter(name, unit, value, value * deviations[index], bool(told[index]), place)

    def changed(name: str, unit: str, index: int, described: float, key: str) -> Parameter:
        value, sigma = described * (1.0 + state[index]), described * deviations[index]
        return Parameter(name, unit, value, sigma, bool(told[index]), key)

    found = [
        *unbalance_of(memory, bool(told[UNBALANCE] and told[UNBALANCE + 1])),
        changed("magnet_stiffness", "N/m", MAGNET_STIFFNESS, magnet.stiffness, "magnetic_bearing.stiffness"),
        changed("magnet_damping", "N s/m", MAGNET_DAMPING, magnet.damping, "magnetic_bearing.damping"),
        Parameter(
            "clearance",
            "m",
            bearing.clearance + state[CLEARANCE],
            deviations[CLEARANCE],
            bool(told[CLEARANCE]),
            "backup_bearing.clearance",
        ),
        scaled("contact_stiffness", stiffness_unit(bearing), STIFFNESS, bearing.stiffness, "stiffness"),
        scaled("contact_damping", *damping_of(bearing)),
        scaled("contact_friction", "1", FRICTION, bearing.friction, "friction"),
    ]
    station = model.rotor.coupling_station
    if station != 0.0:
        force = (state[MOMENT + 1] - memory.weight[1]) / station
        sigma = abs(deviations[MOMENT + 1] / station)
        found.append(
            Parameter("coupling_force", "N", force, sigma, bool(told[MOMENT + 1]), "rotor.coupling_force")
        )
    return [each._replace(value=float(each.value), sigma=float(each.sigma)) for each in found]


def stiffness_unit(bearing: BackupBearing) -> str:
    """Return the unit of the contact's stiffness, which depends on the law."""
    return "N/m" if bearing.law == ContactLaw.KELVIN_VOIGT else "N/m^1.5"


def damping_of(bearing: BackupBearing) -> tuple[str, int, float, str]:
    """Return unit, state, described value and key of the contact's damping.

    Where it comes from the restitution, anew at each impact, it has no key: what is told is the factor on it.
    """
    if bearing.law == ContactLaw.KELVIN_VOIGT:
        return "N s/m", DAMPING, bearing.damping, "damping"
    if bearing.damping_mode == DampingMode.LATCHED:
        return "1", DAMPING, 1.0, ""
    return "s/m", DAMPING, bearing.damping_factor, "damping_factor"


def unbalance_of(memory: Memory, told: bool) -> list[Parameter]:
    """Return size and phase of the unbalance, and the mass and place that would balance it."""
    x, y = float(memory.state[UNBALANCE]), float(memory.state[UNBALANCE + 1])
    covariance = memory.covariance[UNBALANCE : UNBALANCE + 2, UNBALANCE : UNBALANCE + 2]
    size, phase = hypot(x, y), atan2(y, x)
    along = np.array([np.cos(phase), np.sin(phase)])
    across = np.array([-along[1], along[0]])
    sigma = sqrt(max(0.0, along @ covariance @ along))
    turn = min(pi, sqrt(max(0.0, across @ covariance @ across)) / size) if size else pi
    return [
        Parameter("unbalance", "kg m", size, sigma, told, "rotor.unbalance"),
        Parameter("unbalance_phase", "rad", phase, turn, told, "rotor.unbalance_angle"),
        Parameter("balance_mass", "kg", size / BALANCE_RADIUS, sigma / BALANCE_RADIUS, told, ""),
        Parameter("balance_angle", "rad", (phase + pi) % (2.0 * pi), turn, told, ""),
    ]


def not_told(memory: Memory, first: Memory) -> list[str]:
    """Return what the data so far cannot tell, in plain words."""
    deviations = np.sqrt(np.diag(memory.covariance))
    before = np.sqrt(np.diag(first.covariance))
    notes = []
    for index, name in SHORT.items():
        if before[index] > 0.0 and deviations[index] >= TOLD * before[index]:
            share = min(1.0, deviations[index] / before[index])
            partners = [
                other
                for place, other in SHORT.items()
                if place != index and abs(correlation(memory.covariance, index, place)) > TOGETHER
            ]
            with_them = f", and goes together with {' and '.join(partners)}" if partners else ""
            notes.append(f"{name} is not told by the data: {share:.0%} of its first doubt is left{with_them}")
    return notes


def correlation(covariance: np.ndarray, one: int, other: int) -> float:
    """Return the correlation of two states; zero where one of them is certain."""
    scale = sqrt(covariance[one, one] * covariance[other, other])
    return float(covariance[one, other] / scale) if scale > 0.0 else 0.0
