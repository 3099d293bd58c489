"""The speed's set-point and the motor's controller, which works once a tick."""

import numpy as np

from simulator.compile import inlined
from simulator.rig import Drive, DriveMode

IDEAL = int(DriveMode.IDEAL)

# A ramp is an array (4,): speed at its beginning (rad/s), target (rad/s), slope (rad/s2, positive), and the
# sample of its beginning.
RAMP_FIELDS = 4


@inlined
def set_point(ramp: np.ndarray, sample: int, tick: float) -> float:
    """Return the speed set-point at a sample, rad/s; `tick` is the time between samples, s."""
    begin, target = ramp[0], ramp[1]
    change = ramp[2] * ((sample - ramp[3]) * tick)
    if begin <= target:
        return min(begin + change, target)
    return max(begin - change, target)


@inlined
def put_set_points(ramp: np.ndarray, sample: int, tick: float, count: int, out: np.ndarray) -> None:
    """Fill the first `count` cells of `out` with the set-points from a sample on."""
    begin, target, slope, first = ramp[0], ramp[1], ramp[2], ramp[3]
    for k in range(count):
        change = slope * ((sample + k - first) * tick)
        out[k] = min(begin + change, target) if begin <= target else max(begin - change, target)


@inlined
def motor_torque(drive: Drive, error: float, integral: float) -> float:
    """Return the motor's torque, N m, from the speed error (rad/s) and its integral (rad)."""
    wanted = drive.proportional_gain * error + drive.integral_gain * integral
    return min(max(wanted, -drive.max_torque), drive.max_torque)


@inlined
def next_integral(drive: Drive, error: float, integral: float, tick: float) -> float:
    """Return the speed error's integral after a tick; it waits while the torque is at its limit."""
    if abs(drive.proportional_gain * error + drive.integral_gain * integral) > drive.max_torque:
        return integral
    return integral + error * tick
