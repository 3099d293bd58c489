"""The state of the equations of motion and what is held constant while they are integrated."""

from typing import NamedTuple


class State(NamedTuple):
    """State of the rig, SI units, in the inertial frame: x horizontal, y up, z from the pivot to the magnet.

    Numba kernels pass it by value. Displacements at a station are station times tilt. As a rate of
    change the same tuple holds the derivative of each field.
    """

    tilt_x: float  # rad: horizontal displacement of the shaft's centre per distance from the pivot
    tilt_y: float  # rad: vertical displacement, likewise
    tilt_rate_x: float  # rad/s
    tilt_rate_y: float  # rad/s
    house_x: float  # m: both houses move horizontally, from the tared position
    house_y: float  # m: the inner house moves vertically
    house_rate_x: float  # m/s
    house_rate_y: float  # m/s
    ring_speed: float  # rad/s, spin of the ball bearing's inner ring
    angle: float  # rad, shaft angle from the encoder's zero, x towards y, not wrapped
    speed: float  # rad/s, of the shaft
    speed_error_integral: float  # rad, of the speed controller


STATE = State._fields
TRUTH = (*STATE[:11], "contact_force_x", "contact_force_y", "normal_force", "penetration")
SIGNALS = (*TRUTH, "speed_command", "solenoid_force")


class Inputs(NamedTuple):
    """What acts on the rotor from outside; which of the first two counts depends on the drive's mode."""

    torque: float  # N m, of the motor, held through a tick; mode `motor`
    acceleration: float  # rad/s2, prescribed, held through a tick; mode `ideal`
    moment_x: float  # N m, of the solenoids: station times force, along x
    moment_y: float  # N m, along y
