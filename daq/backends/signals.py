"""The true signals of an emulated rig, and their units."""

from simulator.state import TRUTH

UNITS = {
    "tilt": "rad",
    "tilt_rate": "rad/s",
    "house": "m",
    "house_rate": "m/s",
    "ring_speed": "rad/s",
    "angle": "rad",
    "speed": "rad/s",
    "contact_force": "N",
    "normal_force": "N",
    "penetration": "m",
}
"""Unit of each, by its name without `_x` or `_y`."""
TRUTH_UNITS = tuple(UNITS[name.removesuffix("_x").removesuffix("_y")] for name in TRUTH)

__all__ = ["TRUTH", "TRUTH_UNITS"]
