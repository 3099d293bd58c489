"""The encoder's tracking loop: angle, speed and acceleration of the shaft from quantised counts.

A third-order loop with all three poles at `-w`: it follows a speed ramp without lag, smooths the steps of
the counter (1.5 mrad at 4096 counts a turn) to about 0.1 mrad, and stays put at standstill, where the
count does not change. Its bandwidth is fixed by `TRACKING_BANDWIDTH`; a slower loop misses how impacts
brake the shaft.
"""

from math import pi

import numpy as np

from simulator.compile import kernel

TURN = 2.0 * pi
TRACKING_BANDWIDTH = TURN * 60.0  # rad/s, the poles of the loop

ANGLE, SPEED, ACCELERATION = range(3)


@kernel
def track(shaft: np.ndarray, reading: float, step: float) -> None:
    """Advance the loop by one sample.

    `shaft` (3,) holds the unwrapped angle (rad), speed (rad/s) and acceleration (rad/s2) at the previous
    sample and is changed in place; `reading` is the encoder's angle now in rad, wrapped or not; `step` in s.
    Without a reading (NaN) the loop goes on as it was.
    """
    speed = shaft[SPEED] + shaft[ACCELERATION] * step
    angle = shaft[ANGLE] + shaft[SPEED] * step + 0.5 * shaft[ACCELERATION] * step * step
    error = reading - angle
    error -= TURN * np.floor(error / TURN + 0.5)
    if not np.isfinite(error):
        error = 0.0
    gain = TRACKING_BANDWIDTH * step
    shaft[ANGLE] = angle + 3.0 * gain * error
    shaft[SPEED] = speed + 3.0 * gain * gain * error / step
    shaft[ACCELERATION] += gain * gain * gain * error / (step * step)


@kernel
def lock(shaft: np.ndarray, readings: np.ndarray, sense: float, step: float) -> None:
    """Set the loop to the straight line through the first and last of `readings` (n,), as at their start.

    `sense` is -1 where the readings fall when the shaft turns from x towards y, else 1; `step` in s. The
    more readings, the less the counter's steps matter to the speed.
    """
    turned = 0.0
    for i in range(1, readings.size):
        change = readings[i] - readings[i - 1]
        if np.isfinite(change):
            turned += change - TURN * np.floor(change / TURN + 0.5)
    shaft[ANGLE] = sense * readings[0] if np.isfinite(readings[0]) else 0.0
    shaft[SPEED] = sense * turned / (step * max(readings.size - 1, 1))
    shaft[ACCELERATION] = 0.0
