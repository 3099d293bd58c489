"""Which channels of a rig drive the observer, and which correct it."""

from math import cos, radians, sin

import numpy as np

from daq.rig import Rig, RigError
from daq.rig.channels import Channel
from daq.shaft import ENCODER, sense_of
from simulator.rig import Solenoid
from simulator.sensors import CURRENT
from twin.layout import HOUSE, LONGEST, TILT, Feeds, Sensors, Tuning

HOUSE_LATE = 1.0  # ticks by which a transducer's reading may be late
LEAST_CROSSING = 0.1  # determinant of the probes' directions below which they lie in one line


def sensors_of(rig: Rig, tuning: Tuning) -> Sensors:
    """Return the displacement and force channels with a station, as corrections. Raises `RigError`."""
    assert rig.model is not None
    stiffness = rig.model.housing.transducer_stiffness
    rows = [
        sensor_row(index, channel, stiffness, tuning, late_ticks(rig, channel))
        for index, channel in enumerate(rig.channels)
        if channel.quantity in ("displacement", "force") and channel.station is not None
    ]
    weights = np.array([weights for _, columns, weights, *_ in rows if columns[0] == TILT])
    if weights.size == 0 or np.linalg.matrix_rank(weights, tol=LEAST_CROSSING * np.abs(weights).max()) < 2:
        raise RigError(
            f"{rig.name}: the twin needs two displacement channels with station and angle_deg, "
            "not in one line"
        )
    return Sensors(*(np.array(values) for values in zip(*rows, strict=True)))


def sensor_row(index: int, channel: Channel, stiffness: float, tuning: Tuning, late: float) -> tuple:
    """Return one sensor: row in the block, states, weights, variance, range in which it is used, delay."""
    assert channel.angle_deg is not None
    assert channel.station is not None
    direction = np.array([cos(radians(channel.angle_deg)), sin(radians(channel.angle_deg))])
    low, high = sorted((end - channel.offset) / channel.sensitivity for end in channel.ok or channel.range)
    if channel.quantity == "displacement":
        columns, weights, noise = (TILT, TILT + 1), channel.station * direction, tuning.displacement_noise
    else:
        columns, weights, noise = (HOUSE, HOUSE + 1), stiffness * direction, tuning.force_noise
    return index, columns, weights, noise**2, low, high, late


def late_ticks(rig: Rig, channel: Channel) -> float:
    """Return by how many ticks a channel's readings are late; 0 for more than can be made up for.

    Along the last ticks the rotor's way is nearly straight, the house's is not: it swings at 1.6 kHz.
    """
    late = channel.delay_s * rig.acquisition.rate
    return late if late <= (HOUSE_LATE if channel.quantity == "force" else LONGEST) else 0.0


def too_late(rig: Rig) -> list[str]:
    """Return the channels whose delay is longer than the observer makes up for."""
    return [
        channel.name
        for channel in rig.channels
        if channel.quantity in ("displacement", "force") and channel.delay_s and not late_ticks(rig, channel)
    ]


def feeds_of(rig: Rig) -> Feeds:
    """Return the channels of the shaft's angle and of the solenoids' currents. Raises `RigError`."""
    if ENCODER not in rig.channels:
        raise RigError(f"{rig.name}: the twin needs a channel {ENCODER} for the shaft's angle")
    currents, moments = [], []
    for name, solenoid in solenoid_currents(rig).items():
        angle, moment = radians(solenoid.angle_deg), solenoid.station * solenoid.force_per_ampere
        currents.append(rig.channels.index(name))
        moments.append((moment * cos(angle), moment * sin(angle)))
    return Feeds(
        rig.channels.index(ENCODER),
        sense_of(rig),
        np.array(currents, dtype=np.int64),
        np.array(moments, dtype=np.float64).reshape(-1, 2),
        rig.channels[ENCODER].delay_s,
    )


def solenoid_currents(rig: Rig) -> dict[str, Solenoid]:
    """Return the channels of the solenoids' currents, each with its solenoid.

    Where solenoids have channels of their own, those count; else the one channel is the first solenoid's.
    """
    own = {f"{CURRENT}_{solenoid.name}": solenoid for solenoid in rig.solenoids}
    found = {name: solenoid for name, solenoid in own.items() if name in rig.channels}
    if found or CURRENT not in rig.channels or not rig.solenoids:
        return found
    return {CURRENT: rig.solenoids[0]}
