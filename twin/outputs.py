"""Rows of an estimate: names, units and places of what the twin's virtual sensors tell."""

from simulator.rig import BearingKind, Model

OUTPUTS = {
    "tilt_x": "rad",
    "tilt_y": "rad",
    "tilt_rate_x": "rad/s",
    "tilt_rate_y": "rad/s",
    "house_x": "m",
    "house_y": "m",
    "house_rate_x": "m/s",
    "house_rate_y": "m/s",
    "ring_speed": "rad/s",
    "displacement_x": "m",
    "displacement_y": "m",
    "contact_force_x": "N",
    "contact_force_y": "N",
    "normal_force": "N",
    "penetration": "m",
    "unbalance_x": "kg m",
    "unbalance_y": "kg m",
    "angle": "rad",
    "speed": "rad/s",
    "velocity_x": "m/s",
    "velocity_y": "m/s",
    "disk_displacement_x": "m",
    "disk_displacement_y": "m",
    "magnet_displacement_x": "m",
    "magnet_displacement_y": "m",
    "tangential_force": "N",
    "contact_angle": "rad",
    "energy_loss": "J",
    "unbalance": "kg m",
    "unbalance_phase": "rad",
    "coupling_force_x": "N",
    "coupling_force_y": "N",
}
"""Name and unit of what is estimated.

Displacements and velocities are the shaft centre's, at the backup bearing's plane where no other is named;
forces act on the rotor. The normal force is the sum over all contacts; the tangential one is counted along
the wall, with positive rotation, where the shaft is deepest. The contact angle is that of the outward normal
there, or where the wall is nearest. The energy loss is that of the present or the last contact: what went
into it and was not given back. The coupling's force is what the static moment asks for besides the rotor's
weight. The angle is within one turn.
"""

BANDS = (
    "displacement_x",
    "displacement_y",
    "velocity_x",
    "velocity_y",
    "normal_force",
    "tangential_force",
    "penetration",
    "contact_angle",
    "ring_speed",
    "energy_loss",
    "unbalance",
    "unbalance_phase",
    "coupling_force_x",
    "coupling_force_y",
)
"""What has a row `<name>_sigma` as well: its standard deviation."""

NAMES = tuple(OUTPUTS)
PLACE = NAMES.index("displacement_x")
CONTACT = NAMES.index("contact_force_x")
NORMAL = NAMES.index("normal_force")
UNBALANCE_XY = NAMES.index("unbalance_x")
SHAFT = NAMES.index("angle")
VELOCITY = NAMES.index("velocity_x")
DISK = NAMES.index("disk_displacement_x")
MAGNET = NAMES.index("magnet_displacement_x")
TANGENTIAL = NAMES.index("tangential_force")
COUPLING = NAMES.index("coupling_force_x")
BAND = len(OUTPUTS)  # first row of the bands
PIN = BAND + len(BANDS)  # first row of the pins, each with its band


def pins_of(model: Model) -> int:
    """Return how many pins of the backup bearing have a force of their own."""
    bearing = model.backup_bearing
    return bearing.pin_count if bearing.kind == BearingKind.PINNED else 0


def rows_of(model: Model) -> dict[str, str]:
    """Return name and unit of each row of an estimate but the residuals, which follow.

    A pinned bearing adds `pin_1_force`, its band, and so on: the normal force at each pin's tip, the pins
    counted with rotation.
    """
    rows = OUTPUTS | {f"{name}_sigma": OUTPUTS[name] for name in BANDS}
    for number in range(1, pins_of(model) + 1):
        rows |= {f"pin_{number}_force": "N", f"pin_{number}_force_sigma": "N"}
    return rows
