"""The rig's parameters: immutable named tuples, validated from plain mappings.

A rig description (TOML, read by `daq.rig`) has one table for each tuple below, with the tuple's field
names as its keys. Every number is SI; each field states its unit, the range outside which a value is
refused (a wrong unit is nearly always out of range) and its meaning. Symbols in brackets are those of
the thesis (Fonseca 2017), articles P1, P2 and P3. This module imports no numba, so that reading a rig
description stays quick; numba's kernels take a `Model` as it is.
"""

import re
from collections.abc import Mapping
from enum import IntEnum
from functools import partial
from typing import Annotated, Any, NamedTuple, cast, get_type_hints

from simulator.validation import NAME, Derived, Quantity, RigError, keys_of, tuple_at

__all__ = [
    "BackupBearing",
    "BearingKind",
    "ContactLaw",
    "DampingMode",
    "Drive",
    "DriveMode",
    "Housing",
    "MagneticBearing",
    "Model",
    "Pin",
    "Quantity",
    "RigError",
    "Rotor",
    "Solenoid",
    "model_from_mapping",
]


MOST_PINS = 8


class BearingKind(IntEnum):
    """Geometry of the backup bearing (P2, P3)."""

    BALL = 0
    PLAIN = 1
    PINNED = 2


class ContactLaw(IntEnum):
    """Normal force of the contact; formulas and sources are in `simulator.law`."""

    HUNT_CROSSLEY = 0
    HERTZ = 1
    KELVIN_VOIGT = 2
    LANKARANI_NIKRAVESH = 3
    FLORES = 4
    GONTHIER = 5


class DampingMode(IntEnum):
    """How the contact's damping factor is set: a constant of the material, or anew at each impact."""

    FIXED = 0
    LATCHED = 1


class DriveMode(IntEnum):
    """Whether the speed is prescribed (as in the thesis) or made by a motor with a controller."""

    IDEAL = 0
    MOTOR = 1


class Rotor(NamedTuple):
    """Rigid rotor on the spherical pivot O; stations are measured from O towards the magnet."""

    mass: Annotated[float, Quantity("kg", 1e-3, 1e5, "mass without unbalance [m]")]
    inertia: Annotated[float, Quantity("kg m2", 1e-7, 1e6, "transverse inertia about the pivot [Ixx = Iyy]")]
    polar_inertia: Annotated[float, Quantity("kg m2", 0.0, 1e6, "inertia about the shaft axis [Izz]")]
    shaft_radius: Annotated[float, Quantity("m", 1e-4, 1.0, "radius at the backup bearing [r_s]")]
    centre_of_mass_station: Annotated[float, Quantity("m", -5.0, 5.0, "[l_A]")]
    bearing_station: Annotated[float, Quantity("m", 1e-3, 5.0, "plane of the backup bearing [l_S]")]
    disk_station: Annotated[float, Quantity("m", 1e-3, 5.0, "disk, probes and unbalance [l_D = l_U]")]
    magnet_station: Annotated[float, Quantity("m", 1e-3, 5.0, "magnetic bearing [l_Q]")]
    coupling_station: Annotated[float, Quantity("m", -5.0, 5.0, "motor coupling, behind the pivot [l_C]")]
    coupling_force: Annotated[
        float, Quantity("N", -1e4, 1e4, "vertical force of the coupling, up positive [F_C]")
    ]
    pivot_stiffness: Annotated[float, Quantity("N m/rad", 0.0, 1e6, "weak torsional spring [k_t]")]
    unbalance: Annotated[float, Quantity("kg m", 0.0, 1.0, "mass times eccentricity in the disk plane [U]")]
    unbalance_angle: Annotated[
        float, Quantity("rad", -10.0, 10.0, "from the encoder's zero, with rotation [phi]")
    ]
    gravity: Annotated[float, Quantity("m/s2", 0.0, 30.0, "acceleration along -y [g]")]


class MagneticBearing(NamedTuple):
    """Passive magnetic bearing: linear, isotropic, weakly damped (P3 section 4)."""

    stiffness: Annotated[float, Quantity("N/m", 0.0, 1e9, "[K]")]
    damping: Annotated[float, Quantity("N s/m", 0.0, 1e6, "[c]")]


class Pin(NamedTuple):
    """`[backup_bearing.pin.3]`: what is different at pin number 3, counted with rotation; pinned only.

    One table for each pin that is not like the others.
    """

    wear: Annotated[
        float, Quantity("m", -0.01, 0.01, "what the gap under it is wider by; below 0: the pin is longer")
    ] = 0.0
    stiffness: Annotated[
        float | None, Quantity("N/m^1.5", 1.0, 1e13, "of its contact, instead of the bearing's")
    ] = None
    friction: Annotated[
        float | None, Quantity("1", 0.0, 2.0, "in sliding and at rest, instead of the bearing's")
    ] = None
    number: Annotated[int, Derived("that of its table")] = 0


class BackupBearing(NamedTuple):
    """Backup bearing: geometry, law of the contact and regularised friction.

    `clearance` is the radial gap of a ball or plain bearing, or the gap under a pin's tip. Keys with a
    default came after the first recordings; the defaults are what those were made with.
    """

    kind: BearingKind
    clearance: Annotated[float, Quantity("m", 1e-6, 0.02, "radial gap, or gap under each pin tip [g_p]")]
    stiffness: Annotated[
        float, Quantity("N/m^1.5", 1.0, 1e13, "of the contact, exponent 3/2 [k]; law kelvin-voigt: in N/m")
    ]
    damping_mode: DampingMode
    damping_factor: Annotated[float, Quantity("s/m", 0.0, 100.0, "Hunt-Crossley factor, mode fixed [eta]")]
    restitution: Annotated[float, Quantity("1", 0.0, 1.0, "coefficient of restitution, mode latched [c_e]")]
    friction: Annotated[float, Quantity("1", 0.0, 2.0, "Coulomb coefficient [mu]")]
    slip_speed: Annotated[float, Quantity("m/s", 1e-5, 1.0, "below which friction is regularised [v_eps]")]
    ring_inertia: Annotated[
        float, Quantity("kg m2", 0.0, 1e3, "inner ring and balls; ball bearing only [I_ir]")
    ]
    ring_damping: Annotated[float, Quantity("N m s", 0.0, 1e3, "drag of the ring; ball bearing only [c_ir]")]
    pin_tip_radius: Annotated[float, Quantity("m", 0.0, 10.0, "sphere at a pin's tip; pinned only [r_t]")]
    law: ContactLaw = ContactLaw.HUNT_CROSSLEY
    damping: Annotated[float, Quantity("N s/m", 0.0, 1e7, "of the contact; law kelvin-voigt only [c]")] = 0.0
    static_friction: Annotated[
        float, Quantity("1", 0.0, 2.0, "coefficient at rest; below `friction`: as in sliding [mu_s]")
    ] = 0.0
    stribeck_speed: Annotated[
        float, Quantity("m/s", 1e-4, 10.0, "slip that halves what static friction adds [v_s]")
    ] = 0.05
    pin_count: Annotated[int, Quantity("1", 3, MOST_PINS, "pins, evenly around the shaft; pinned only")] = 4
    pin_angle_deg: Annotated[
        float, Quantity("deg", -360.0, 360.0, "of the first pin, from +x towards +y; pinned only")
    ] = 45.0
    pin_length: Annotated[float, Quantity("m", 0.0, 1.0, "from a pin's tip to the casing; pinned only")] = (
        2e-3
    )
    pins: Annotated[tuple[Pin, ...], Derived("those that differ, in order, from tables of their own")] = ()


class Housing(NamedTuple):
    """Inner and outer house on the force transducers (P3 eq 15-16)."""

    inner_mass: Annotated[float, Quantity("kg", 1e-3, 1e6, "[m_ih]")]
    outer_mass: Annotated[float, Quantity("kg", 1e-3, 1e6, "without the inner house [M_oh]")]
    horizontal_damping: Annotated[float, Quantity("N s/m", 0.0, 1e7, "[c_h]")]
    vertical_damping: Annotated[float, Quantity("N s/m", 0.0, 1e7, "[c_v]")]
    transducer_stiffness: Annotated[float, Quantity("N/m", 1e3, 1e12, "of one force transducer [k_ft]")]


class Drive(NamedTuple):
    """Motor and speed controller, of which the thesis gives no values."""

    mode: DriveMode
    inertia: Annotated[float, Quantity("kg m2", 1e-9, 1e4, "of the motor [J_m]")]
    proportional_gain: Annotated[float, Quantity("N m s/rad", 0.0, 1e5, "[k_p]")]
    integral_gain: Annotated[float, Quantity("N m/rad", 0.0, 1e5, "[k_i]")]
    max_torque: Annotated[float, Quantity("N m", 1e-6, 1e6, "[T_max]")]


class Model(NamedTuple):
    """All that the equations of motion need; passed to the numba kernels unchanged."""

    rotor: Rotor
    magnetic_bearing: MagneticBearing
    backup_bearing: BackupBearing
    housing: Housing
    drive: Drive


class Solenoid(NamedTuple):
    """An actuator that can hit the shaft with a half-sine force pulse."""

    name: NAME
    station: Annotated[float, Quantity("m", 1e-3, 5.0, "where it hits [l_hit]")]
    angle_deg: Annotated[float, Quantity("deg", -360.0, 360.0, "direction of the force, from +x towards +y")]
    max_force: Annotated[float, Quantity("N", 0.0, 1e5, "largest peak that may be commanded")]
    max_duration: Annotated[float, Quantity("s", 1e-4, 1.0, "longest pulse that may be commanded")]
    force_per_ampere: Annotated[float, Quantity("N/A", 1e-3, 1e5, "turns the current channel into a force")]
    max_duty: Annotated[float, Quantity("1", 0.0, 1.0, "share of any 10 s in which it may be on")] = 1.0


def model_from_mapping(tables: Mapping[str, Mapping[str, Any]], parent: str = "") -> Model:
    """Validate the tables `rotor` ... `drive` and return the `Model`.

    `parent` is the table that holds them, for messages: "" or, say, "emulator.actual". Raises `RigError`.
    """
    prefix = f"{parent}." if parent else ""
    parts: dict[str, Any] = {}
    for name, part in get_type_hints(Model).items():
        if name not in tables:
            raise RigError(f"table [{prefix}{name}] is missing; it holds: {', '.join(keys_of(part))}")
        place = f"{prefix}{name}"
        read = backup_bearing_at if part is BackupBearing else partial(tuple_at, part)
        parts[name] = read(tables[name], f"[{place}]")
    return Model(**parts)


def backup_bearing_at(table: Any, place: str) -> BackupBearing:
    """Validate the table of a backup bearing, with the tables of its pins. Raises `RigError`."""
    if not isinstance(table, Mapping) or "pin" not in table:
        return cast(BackupBearing, tuple_at(BackupBearing, table, place))
    own = {key: value for key, value in table.items() if key != "pin"}
    pins = pins_at(table["pin"], f"{place.strip('[]')}.pin")
    return cast(BackupBearing, tuple_at(BackupBearing, own, place)._replace(pins=pins))


def pins_at(tables: Any, place: str) -> tuple[Pin, ...]:
    """Return the pins that have tables, in order. Raises `RigError`."""
    if not isinstance(tables, Mapping):
        raise RigError(f"[{place}] must be tables, one for each pin that differs, as [{place}.3]")
    for key in tables:
        if not re.fullmatch("[1-9]", key):
            raise RigError(f"[{place}.{key}] is no pin's number; pins count from 1, as in [{place}.3]")
    pins = ((int(key), tuple_at(Pin, tables[key], f"[{place}.{key}]")) for key in sorted(tables))
    return tuple(pin._replace(number=number) for number, pin in pins)
