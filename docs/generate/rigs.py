"""The tables of a rig description."""

from daq.rig import limits, load_rig, settings, shipped_rigs
from daq.rig.channels import QUANTITIES, Channel
from daq.rig.description import Head
from docs.generate.fields import section
from docs.generate.markdown import table
from simulator import faults, unbalance
from simulator import rig as model

REASON = {"reason": "why the levels are what they are; for whoever wants to change them"}
PLACES = {
    "centre_of_mass_station": "centre of mass, without the unbalance",
    "bearing_station": "where shaft and backup bearing meet:",
}
HOUSE = {
    "inner_mass": "house that holds the bearing; moves vertically against the outer one",
    "outer_mass": "the house around it, which moves horizontally together with it;",
    "horizontal_damping": "of each of the two horizontal transducers",
    "vertical_damping": "of each of the two vertical transducers",
}
BEARING = {
    "kind": "a ring that can turn, a fixed wall, or pins around the shaft",
    "law": "normal force of the contact; formulas and sources are in `simulator/law.py`",
    "damping_mode": "whether `damping_factor` is used, or one found from `restitution` at each impact",
}
FAULT = {
    "kind": "what goes wrong: first a sensor's faults, then the rig's, then the device's (from `dropped` on)",
    "size": "of a gain the factor; of drift (a second), runout (once a turn) and noise (rms) in the "
    "channel's SI unit; of a skew and of dropped and repeated ones in samples; of an unbalance in kg m; of a "
    "pin's or the clearance's change in m; of `late` in s; of a clock's drift in ppm:",
    "channel": "the sensor's, for its faults;",
    "name": "for `--set` and for rows of a base;",
}
CHANNEL = {
    "name": "unique;",
    "quantity": "see [quantities](#quantities)",
    "unit": "the quantity's SI unit, in which samples travel and are recorded",
    "display_unit": "shown to people",
    "terminal": "of the device, in the backend's words; only an angle and its count may share one",
    "station": "with `angle_deg`, or neither:",
    "cutoff_hz": "for information:",
    "anti_alias": "whether an analogue anti-alias filter stands before the converter; without one a warning",
    "stuck": "an analogue sensor always has some noise;",
    "certificate": "of the calibration",
    "calibrated": "day of the calibration",
    "due": "last day of the calibration; after it a warning, and no arming without `allow_overdue`",
}

TABLES: tuple[tuple[type, str, dict[str, str]], ...] = (
    (
        Head,
        "`[rig]`",
        {
            "name": "part of every key and file name;",
            "description": "one line for people",
            "plan": "what `rigtwin live` performs on an emulated rig unless told otherwise: name or path",
        },
    ),
    (model.Rotor, "`[rotor]`", PLACES),
    (unbalance.UnbalanceMass, "`[[unbalance_mass]]`", {"name": "for `--set` and for rows of a base;"}),
    (model.MagneticBearing, "`[magnetic_bearing]`", {"stiffness": "radial", "damping": "radial"}),
    (model.BackupBearing, "`[backup_bearing]`", BEARING),
    (model.Pin, "`[backup_bearing.pin.3]`", {}),
    (model.Housing, "`[housing]`", HOUSE),
    (
        model.Drive,
        "`[drive]`",
        {
            "mode": "the speed follows its set-point exactly, or a motor and a PI controller make it",
            "proportional_gain": "torque per speed error",
            "integral_gain": "torque per integral of the speed error",
            "max_torque": "the motor gives no more, either way",
        },
    ),
    (model.Solenoid, "`[[solenoid]]`", {"name": "unique;"}),
    (
        settings.AcquisitionSettings,
        "`[acquisition]`",
        {
            "backend": "`emulator`, or what reads [another device](../how-to/connect-a-device.md)",
        },
    ),
    (
        settings.EncoderSettings,
        "`[encoder]`",
        {"direction": "1: counts up when the shaft turns counter-clockwise seen from the free end; -1: down"},
    ),
    (Channel, "`[[channel]]`", CHANNEL),
    (limits.DisplacementLimit, "`[limits.displacement]`", REASON),
    (limits.ForceLimit, "`[limits.force]`", REASON),
    (limits.SpeedLimit, "`[limits.speed]`", REASON),
    (limits.SpeedRateLimit, "`[limits.speed_rate]`", REASON),
    (
        settings.CommandSettings,
        "`[command]`",
        {"allow_overdue": "whether the rig may be armed although a channel's calibration is overdue"},
    ),
    (settings.SafeStateSettings, "`[safe_state]`", {}),
    (settings.CaptureSettings, "`[capture]`", {}),
    (
        settings.TwinSettings,
        "`[twin]`",
        {"model": "`none` for a rig that has no model: everything else works"},
    ),
    (
        settings.LinkSettings,
        "`[link]`",
        {
            "host": "address to listen on; a loopback address",
            "daq": "blocks, summaries and events:",
            "control": "commands and lease:",
            "twin": "estimates:",
            "operator": "people's commands:",
        },
    ),
    (settings.EmulatorSettings, "`[emulator]`", {}),
    (faults.Fault, "`[[emulator.fault]]`", FAULT),
)


def tables() -> str:
    """Return a section for each table."""
    return "\n\n".join(section(*row) for row in TABLES)


def quantities() -> str:
    """Return the quantities with their units."""
    rows = []
    for name, units in QUANTITIES.items():
        si, *others = units
        rows.append([f"`{name}`", f"`{si}`", ", ".join(f"`{unit}`" for unit in others) or "–"])
    return table(("quantity", "unit (SI)", "display units besides it"), rows)


def shipped() -> str:
    """Return the rigs that come with the product."""
    rigs = [load_rig(name) for name in shipped_rigs()]
    return table(
        ("name", "is", "plan"),
        [[f"`{rig.name}`", rig.description, f"`{rig.plan}`" if rig.plan else "–"] for rig in rigs],
    )
