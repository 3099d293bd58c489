"""Contact laws: the normal force of a shaft that presses into the wall, and the friction that goes with it.

All laws but one are one formula with a damping factor eta (s/m) of its own:

    N = max(0, k d^(3/2) (1 + 3/2 eta d')),

d being the penetration (m) and d' its rate (m/s). Where a law asks for a coefficient of restitution e, its
factor is a share of e alone over the closing speed v of the impact, eta = share(e) / v:

| law | 3/2 share(e) | source |
|---|---|---|
| hertz | 0 | Hertz 1881, J. reine angew. Math. 92, 156 |
| hunt-crossley | 3/2 (1 - e) | Hunt and Crossley 1975, J. Appl. Mech. 42, 440; P3 eq 20-21 |
| lankarani-nikravesh | 3/4 (1 - e^2) | Lankarani and Nikravesh 1990, J. Mech. Des. 112, 369; P1 eq 11 |
| flores | 8/5 (1 - e) / e | Flores, Machado, Silva and Martins 2011, Multibody Syst. Dyn. 25, 357 |
| gonthier | (1 - e^2) / e | Gonthier, McPhee, Lange and Piedboeuf 2004, Multibody Syst. Dyn. 11, 209 |

The first three lose as much as e says only for e near 1; the last two are made for all e (Gonthier's
share is the first term of its implicit equation). Kelvin and Voigt's law, N = max(0, k d + c d'), is the
exception: it is linear, its damping does not depend on the impact, and its force jumps at closing.
"""

from math import sqrt
from typing import NamedTuple

from simulator.compile import inlined, kernel
from simulator.rig import BackupBearing, ContactLaw, DampingMode

HERTZ = int(ContactLaw.HERTZ)
KELVIN_VOIGT = int(ContactLaw.KELVIN_VOIGT)
HUNT_CROSSLEY = int(ContactLaw.HUNT_CROSSLEY)
LANKARANI_NIKRAVESH = int(ContactLaw.LANKARANI_NIKRAVESH)
FLORES = int(ContactLaw.FLORES)
GONTHIER = int(ContactLaw.GONTHIER)
LATCHED = int(DampingMode.LATCHED)

LOWEST_CLOSING_SPEED = 0.01  # m/s: a slower closing latches the damping factor of this speed


class Surface(NamedTuple):
    """What a contact is made of; its fields are those of the same names of a `BackupBearing`."""

    law: int
    stiffness: float  # N/m^1.5; N/m with Kelvin and Voigt's law
    damping: float  # N s/m, of that law
    friction: float
    static_friction: float
    slip_speed: float  # m/s
    stribeck_speed: float  # m/s


@kernel
def latched_factor(law: int, restitution: float, closing: float) -> float:
    """Return the damping factor eta, s/m, of an impact that closes at a speed (m/s)."""
    if law == HUNT_CROSSLEY:
        share = 1.0 - restitution
    elif law == LANKARANI_NIKRAVESH:
        share = (1.0 - restitution * restitution) / 2.0
    elif law == FLORES:
        share = 16.0 / 15.0 * (1.0 - restitution) / restitution
    elif law == GONTHIER:
        share = 2.0 / 3.0 * (1.0 - restitution * restitution) / restitution
    else:
        share = 0.0
    return share / max(closing, LOWEST_CLOSING_SPEED)


def constant_factor(bearing: BackupBearing) -> float:
    """Return the damping factor, s/m, that a simulation begins with, and keeps where it is not latched."""
    if bearing.law in (HERTZ, KELVIN_VOIGT):
        return 0.0
    if bearing.damping_mode == LATCHED:
        return latched_factor(bearing.law, bearing.restitution, 0.0)
    return bearing.damping_factor


@inlined
def normal_force(surface: Surface, damping_factor: float, depth: float, rate: float) -> float:
    """Return the force that pushes shaft and wall apart, N, never below zero: see the module's formulas.

    `damping_factor` is eta in s/m, `depth` the penetration d in m, `rate` d' in m/s, positive while closing.
    """
    if depth <= 0.0:
        return 0.0
    if surface.law == KELVIN_VOIGT:
        return max(0.0, surface.stiffness * depth + surface.damping * rate)
    elastic = surface.stiffness * depth * sqrt(depth)
    return max(0.0, elastic * (1.0 + 1.5 * damping_factor * rate))


@inlined
def normal_stiffness(surface: Surface, depth: float) -> float:
    """Return the elastic part's slope, N/m, at a penetration (m)."""
    if surface.law == KELVIN_VOIGT:
        return surface.stiffness
    return 1.5 * surface.stiffness * sqrt(max(depth, 0.0))


@inlined
def normal_damping(surface: Surface, damping_factor: float, depth: float) -> float:
    """Return the force's slope over the closing rate, N s/m, at a penetration (m)."""
    if surface.law == KELVIN_VOIGT:
        return surface.damping
    deep = max(depth, 0.0)
    return 1.5 * damping_factor * surface.stiffness * deep * sqrt(deep)


@inlined
def friction_coefficient(surface: Surface, slip: float) -> float:
    """Return the coefficient of friction at a slip (m/s).

    It falls from that of rest to that of sliding (Stribeck's effect) as Hess and Soom have it (1990,
    J. Tribol. 112, 147): by 1 / (1 + (slip / v_s)^2). Without a coefficient of rest it is constant.
    """
    more = surface.static_friction - surface.friction
    if more <= 0.0:
        return surface.friction
    relative = slip / surface.stribeck_speed
    return surface.friction + more / (1.0 + relative * relative)


@inlined
def friction(surface: Surface, normal: float, slip_t: float, slip_z: float) -> tuple[float, float]:
    """Return the friction on the shaft, N, along the tangent and along the shaft.

    Coulomb's law, regularised: opposite to the slip (m/s, shaft minus wall), zero and smooth at zero slip.
    """
    slip_speed = surface.slip_speed
    slip = sqrt(slip_t * slip_t + slip_z * slip_z + slip_speed * slip_speed)
    scale = -friction_coefficient(surface, slip) * normal / slip
    return scale * slip_t, scale * slip_z
