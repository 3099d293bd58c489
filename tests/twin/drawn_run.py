"""A made-up run for the display: a growing orbit that comes to touch the bearing, with the twin beside it."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from daq import keys
from daq.messages import SeriesEncoder
from daq.messages_pb2 import Description, Event, Status, TwinSummary
from daq.rig import Rig

STRIDE = 5
TWIN_NAMES = (
    "displacement_x", "displacement_y", "contact_force_x", "contact_force_y", "normal_force",
    "residual_proximity_x", "residual_proximity_y",
    "residual_force_top", "residual_force_bottom", "residual_force_left", "residual_force_right",
    "displacement_x_sigma", "displacement_y_sigma", "normal_force_sigma",
)  # fmt: skip
TWIN_UNITS = ("m", "m", "N", "N", "N", "m", "m", "N", "N", "N", "N", "m", "m", "N")
SIGMA, FORCE_SIGMA = (2e-6, 3e-6), 0.05  # m along x, y; share of the force
SPEED_HZ = 10.0
GAP = 1.5e-3  # m
TOUCH = 1.47e-3  # m radius from which there is a contact force
STIFFNESS = 2e6  # N/m


class Motion(NamedTuple):
    """The shaft's centre at the bearing in m, its angle in rad and the contact force in N, each (n,)."""

    x: np.ndarray
    y: np.ndarray
    angle: np.ndarray
    force: np.ndarray


def motion(time: np.ndarray) -> Motion:
    """The run at the given times: the radius grows by 0.3 mm/s until it touches."""
    angle = 2 * np.pi * SPEED_HZ * time
    radius = np.minimum(0.2e-3 + 0.3e-3 * time, 1.5e-3)
    force = np.maximum(radius - TOUCH, 0.0) * STIFFNESS
    return Motion(radius * np.cos(angle - 0.7), radius * np.sin(angle - 0.7), angle, force)


def block_samples(rig: Rig, first: int, count: int) -> np.ndarray:
    """Samples (n_channels, count) float32 of all channels."""
    now = motion(np.arange(first, first + count) / rig.acquisition.rate)
    force_x, force_y = now.force * np.cos(now.angle - 0.7), now.force * np.sin(now.angle - 0.7)
    rows = {
        "proximity_x": now.x,
        "proximity_y": now.y,
        "force_top": force_y / 2,
        "force_bottom": -force_y / 2,
        "force_left": -force_x / 2,
        "force_right": force_x / 2,
        "encoder_angle": now.angle % (2 * np.pi),
        "encoder_turns": now.angle // (2 * np.pi),
        "motor_speed": np.full(count, 2 * np.pi * SPEED_HZ),
        "motor_speed_command": np.full(count, 2 * np.pi * SPEED_HZ),
        "solenoid_current": np.zeros(count),
    }
    station = rig.model.rotor.bearing_station if rig.model else 1.0
    for channel in rig.channels:
        if channel.quantity == "displacement":
            rows[channel.name] = rows[channel.name] * channel.station / station
    return np.stack([rows[name] for name in rig.channels.names]).astype(np.float32)


def twin_samples(rig: Rig, first: int, count: int) -> np.ndarray:
    """Columns (n_outputs, count / STRIDE) float32 of an estimate that is 1 % too large."""
    now = motion(np.arange(first, first + count, STRIDE) / rig.acquisition.rate)
    samples = np.zeros((len(TWIN_NAMES), len(now.x)), np.float32)
    samples[0], samples[1] = 1.01 * now.x, 1.01 * now.y
    samples[2], samples[3] = -now.force * np.cos(now.angle - 0.7), -now.force * np.sin(now.angle - 0.7)
    samples[4] = now.force
    samples[5:7] = 1e-6 * np.sin(now.angle)
    samples[7:11] = 0.2 * np.cos(now.angle)
    samples[11], samples[12] = SIGMA
    samples[13] = FORCE_SIGMA * now.force
    return samples


def messages(
    rig: Rig, run: str, seconds: float, begin: float = 0.0, ahead: float = 0.0
) -> Iterator[tuple[str, bytes]]:
    """All that the display listens to, as (key, payload) in the order of a live run.

    From `begin` to `seconds` of the run; the shaft is where it would be `ahead` s later.
    """
    rate, size, name = rig.acquisition.rate, rig.acquisition.block, rig.name
    blocks = SeriesEncoder(run, rate, rig.channels.names, rig.channels.units)
    estimates = SeriesEncoder(run, rate, TWIN_NAMES, TWIN_UNITS, stride=STRIDE)
    lead = round(ahead * rate)
    yield event(rig, run, int(begin * rate), "start", "the run has started")
    for first in range(int(begin * rate) // size * size, int(seconds * rate) // size * size, size):
        at = first + lead
        yield keys.block(name), blocks.encode(first / rate, first, 0, block_samples(rig, at, size))
        yield keys.estimate(name), estimates.encode(first / rate, first, 0, twin_samples(rig, at, size))
        if first % (10 * size) == 0:
            is_free = motion(np.array([at / rate])).force[0] == 0.0
            regime = "contact-free 1X" if is_free else "permanent contact"
            summary = TwinSummary(run=run, first_sample=first, regime=regime, valid=True)
            yield keys.twin_summary(name), summary.SerializeToString()
            status = Status(run=run, sample=first, process="daq", state="armed")
            yield keys.status(name, "daq"), status.SerializeToString()
    yield event(rig, run, first + size, "end", "the run has ended")


def event(rig: Rig, run: str, sample: int, kind: str, text: str) -> tuple[str, bytes]:
    """One event of the daq."""
    made = Event(run=run, sample=sample, source="daq", kind=kind, text=text)
    return keys.event(rig.name, "daq"), made.SerializeToString()


def description(rig: Rig, run: str, mode: str) -> Description:
    """What the daq says of the run."""
    return Description(
        run=run, rig=rig.name, toml=rig.toml, rate=rig.acquisition.rate, t0_ns=10**18, mode=mode
    )
