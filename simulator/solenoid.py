"""Half-sine force pulses of the solenoids."""

import numpy as np

from simulator.compile import inlined
from simulator.numeric import direction, sine_cosine
from simulator.rig import Solenoid

PI = 3.14159265358979312

# A pulse is a row of five: the sample at which it begins, its duration (s), the peaks of its moment along x
# and along y (N m: station times force), and the peak of its force (N).
PULSE_FIELDS = 5


def pulse_row(solenoid: Solenoid, force: float, duration: float, sample: int) -> np.ndarray:
    """Return the row, shape (1, 5), of a pulse with peak `force` (N) and `duration` (s) from `sample` on."""
    x, y = direction(solenoid.angle_deg)
    moment = solenoid.station * force
    return np.array([[float(sample), duration, moment * x, moment * y, force]])


@inlined
def pulse_height(pulses: np.ndarray, index: int, sample: int, offset: float, tick: float) -> float:
    """Return a pulse's height, 0 to 1, `offset` seconds after a sample; `tick` (s) divides samples."""
    elapsed = (sample - pulses[index, 0]) * tick + offset
    duration = pulses[index, 1]
    if elapsed <= 0.0 or elapsed >= duration:
        return 0.0
    return sine_cosine(PI * (elapsed / duration))[0]


@inlined
def solenoid_moment(pulses: np.ndarray, sample: int, offset: float, tick: float) -> tuple[float, float]:
    """Return the moment (x, y) of all pulses, N m, `offset` seconds after a sample."""
    moment_x, moment_y = 0.0, 0.0
    for index in range(pulses.shape[0]):
        height = pulse_height(pulses, index, sample, offset, tick)
        moment_x += height * pulses[index, 2]
        moment_y += height * pulses[index, 3]
    return moment_x, moment_y


@inlined
def solenoid_force(pulses: np.ndarray, sample: int, tick: float) -> float:
    """Return the sum of all pulses' forces at a sample, N."""
    force = 0.0
    for index in range(pulses.shape[0]):
        force += pulse_height(pulses, index, sample, 0.0, tick) * pulses[index, 4]
    return force


@inlined
def pulse_in_tick(pulses: np.ndarray, sample: int, tick: float) -> bool:
    """Tell whether any pulse acts between a sample and the next."""
    for index in range(pulses.shape[0]):
        since = (sample - pulses[index, 0]) * tick
        if since > -tick and since < pulses[index, 1]:
            return True
    return False
