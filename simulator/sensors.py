"""From true signals to the raw readings of a device: volts after a converter, or counts of an encoder.

A channel is a weighted sum of two true signals (a probe sees the tilts' components along its axis), plus
seeded noise, turned to volts by its sensitivity and offset, cut at the input's range and rounded to the
converter's steps. An encoder's channels count instead. Noise depends on seed, channel and
sample index alone, so equal samples are equal however they are read.
"""

from collections.abc import Iterable, Sequence
from math import floor, inf, sqrt, tau
from typing import NamedTuple

import numpy as np

from simulator.compile import inlined, kernel
from simulator.instruments import Encoder, Imperfections, Probe
from simulator.numeric import direction, normal_noise, stream_key
from simulator.rig import Model, RigError, Solenoid
from simulator.state import SIGNALS

VOLTS, ANGLE_COUNTS, TURN_COUNTS = 0, 1, 2

CURRENT = "solenoid_current"
"""Channel of all solenoids' current together; with `_<name>` behind it, of one solenoid's own."""
CLOSED = 1.0
"""What a safety contact gives as long as nothing is wrong; a fault `open` opens it."""

ROWS = {name: row for row, name in enumerate(SIGNALS)}


class SensorTable(NamedTuple):
    """One entry for each channel in each array, shape (n_channels,); made by `sensor_table`."""

    kind: np.ndarray  # int64: VOLTS, ANGLE_COUNTS or TURN_COUNTS
    row_a: np.ndarray  # int64: a row of `SIGNALS`
    row_b: np.ndarray  # int64: another
    gain_a: np.ndarray  # V (or counts) of one unit of the first row
    gain_b: np.ndarray  # V (or counts) of one unit of the second row
    offset: np.ndarray  # V (or counts) of zero
    low: np.ndarray  # V (or counts), lower end of the input's range
    high: np.ndarray  # V (or counts), upper end
    noise: np.ndarray  # V rms, of sensor and converter together
    step: np.ndarray  # V, the converter's; 0 for one that is not quantised
    counts: np.ndarray  # of a turn, for an encoder's channels


class Source(NamedTuple):
    """Which true signals a channel sees, in SI units, and its sensor's noise."""

    kind: int
    row_a: int
    row_b: int
    weight_a: float
    weight_b: float
    constant: float  # added to the weighted sum
    noise: float  # rms, SI unit
    converted: bool  # whether a converter with noise of its own stands behind it


def sensor_table(
    channels: Iterable[Probe],
    model: Model,
    encoder: Encoder | None,
    force_per_ampere: float,
    imperfections: Imperfections,
    solenoids: Sequence[Solenoid] = (),
) -> SensorTable:
    """Return the table for the channels of a simulated rig, in their order.

    `force_per_ampere` (N/A) turns the solenoids' force into `solenoid_current`. `solenoids` are those whose
    own force stands in a row of its own behind `SIGNALS`; their channels are `solenoid_current_<name>`.
    Raises `RigError` for a channel that the simulation has no signal for.
    """
    channels = list(channels)
    sources = [
        own_current(channel, solenoids) or source_of(channel, model, encoder, force_per_ampere, imperfections)
        for channel in channels
    ]
    pairs = list(zip(channels, sources, strict=True))
    steps = [converter_step(channel, source, imperfections) for channel, source in pairs]
    return SensorTable(
        kind=np.array([source.kind for source in sources], dtype=np.int64),
        row_a=np.array([source.row_a for source in sources], dtype=np.int64),
        row_b=np.array([source.row_b for source in sources], dtype=np.int64),
        gain_a=np.array([channel.sensitivity * source.weight_a for channel, source in pairs]),
        gain_b=np.array([channel.sensitivity * source.weight_b for channel, source in pairs]),
        offset=np.array(
            [channel.offset + channel.sensitivity * source.constant for channel, source in pairs]
        ),
        low=np.array([min(channel.range) for channel in channels], dtype=np.float64),
        high=np.array([max(channel.range) for channel in channels], dtype=np.float64),
        noise=np.array(
            [noise_volts(*pair, step, imperfections) for pair, step in zip(pairs, steps, strict=True)]
        ),
        step=np.array(steps),
        counts=np.full(len(channels), float(encoder.counts_per_turn) if encoder else inf),
    )


def own_current(channel: Probe, solenoids: Sequence[Solenoid]) -> Source | None:
    """Return the source of the current of one solenoid; None for any other channel."""
    for number, solenoid in enumerate(solenoids):
        if channel.name == f"{CURRENT}_{solenoid.name}":
            row = len(SIGNALS) + number
            return Source(VOLTS, row, row, 1.0 / solenoid.force_per_ampere, 0.0, 0.0, 0.0, converted=True)
    return None


def source_of(
    channel: Probe,
    model: Model,
    encoder: Encoder | None,
    force_per_ampere: float,
    imperfections: Imperfections,
) -> Source:
    """Return what a channel sees, by its quantity and place or by its name. Raises `RigError`."""
    if channel.quantity == "displacement":
        station = needed(channel, "station")
        return along(channel, "tilt", station, imperfections.displacement_noise)
    if channel.quantity == "force":
        return along(channel, "house", model.housing.transducer_stiffness, imperfections.force_noise)
    if channel.quantity == "contact":
        return Source(VOLTS, 0, 0, 0.0, 0.0, CLOSED, 0.0, converted=False)
    if channel.name in ("encoder_angle", "encoder_turns"):
        return encoder_source(channel, encoder)
    named = {
        "motor_speed": ("speed", 1.0, True),
        "motor_speed_command": ("speed_command", 1.0, False),
        CURRENT: ("solenoid_force", 1.0 / force_per_ampere, True),
    }
    if channel.name not in named:
        raise RigError(
            f"[[channel]] {channel.name} ({channel.quantity}) is nothing that the emulated rig measures; "
            f"it has displacement and force channels, encoder_angle, encoder_turns and {', '.join(named)}"
        )
    signal, weight, converted = named[channel.name]
    return Source(VOLTS, ROWS[signal], ROWS[signal], weight, 0.0, 0.0, 0.0, converted)


def along(channel: Probe, vector: str, scale: float, noise: float) -> Source:
    """Return the source of a channel that sees a vector's component along its axis, times `scale`."""
    x, y = direction(needed(channel, "angle_deg"))
    return Source(VOLTS, ROWS[f"{vector}_x"], ROWS[f"{vector}_y"], scale * x, scale * y, 0.0, noise, True)


def encoder_source(channel: Probe, encoder: Encoder | None) -> Source:
    """Return the source of an encoder's channel: turns from the index pulse, in its direction."""
    if encoder is None:
        raise RigError(f"[[channel]] {channel.name} needs the table [encoder]")
    kind = ANGLE_COUNTS if channel.name == "encoder_angle" else TURN_COUNTS
    turn = encoder.direction / tau / channel.sensitivity  # it counts turns, whatever a count is called
    row = ROWS["angle"]
    return Source(kind, row, row, turn, 0.0, -encoder.index_angle * turn, 0.0, False)


def needed(channel: Probe, key: str) -> float:
    """Return a channel's station or angle. Raises `RigError` where it has none."""
    value = getattr(channel, key)
    if value is None:
        raise RigError(f"[[channel]] {channel.name} lacks {key}: the emulated rig must know what it sees")
    return float(value)


def converter_step(channel: Probe, source: Source, imperfections: Imperfections) -> float:
    """Return the step of the converter behind a channel, V; counters and their like have none."""
    if source.kind != VOLTS:
        return 0.0
    return float(abs(channel.range[1] - channel.range[0]) / 2.0**imperfections.adc_bits)


def noise_volts(channel: Probe, source: Source, step: float, imperfections: Imperfections) -> float:
    """Return the noise of sensor and converter together, V rms."""
    converter = step * imperfections.adc_noise if source.converted else 0.0
    return sqrt((channel.sensitivity * source.noise) ** 2 + converter**2)


@kernel
def read_sensors(
    table: SensorTable, signals: np.ndarray, first_sample: int, seed: int, raw: np.ndarray
) -> bool:
    """Turn true signals (17, n) into raw readings `raw` (n_channels, n); return whether an input was clipped.

    `first_sample` is the index of column 0; `raw` may have more columns, which are left alone. Volts are
    multiples of the converter's step within its range; counts are whole numbers, the nearest, and the
    angle's are wrapped to one turn.
    """
    clipped = False
    for channel in range(raw.shape[0]):
        if table.kind[channel] == VOLTS:
            clipped = read_volts(table, channel, signals, first_sample, seed, raw) or clipped
        else:
            read_counts(table, channel, signals, raw)
    return clipped


@inlined
def read_volts(
    table: SensorTable, channel: int, signals: np.ndarray, first_sample: int, seed: int, raw: np.ndarray
) -> bool:
    """Fill one row of `raw` with converted volts; return whether the range cut any."""
    a, b = table.row_a[channel], table.row_b[channel]
    gain_a, gain_b, offset = table.gain_a[channel], table.gain_b[channel], table.offset[channel]
    low, high, noise, step = (
        table.low[channel],
        table.high[channel],
        table.noise[channel],
        table.step[channel],
    )
    key = stream_key(seed, channel)
    clipped = False
    for column in range(signals.shape[1]):
        volts = gain_a * signals[a, column] + gain_b * signals[b, column] + offset
        if noise > 0.0:
            volts += noise * normal_noise(key, first_sample + column)
        code = floor((volts - low) / step + 0.5)
        most = floor((high - low) / step + 0.5) - 1.0
        if code < 0.0 or code > most:
            clipped = True
            code = min(max(code, 0.0), most)
        raw[channel, column] = low + code * step
    return clipped


@inlined
def read_counts(table: SensorTable, channel: int, signals: np.ndarray, raw: np.ndarray) -> None:
    """Fill one row of `raw` with an encoder's counts within the turn, or with its full turns."""
    per_turn = table.counts[channel]
    row, turn, begin = table.row_a[channel], table.gain_a[channel], table.offset[channel]
    for column in range(signals.shape[1]):
        counts = floor((turn * signals[row, column] + begin) * per_turn + 0.5)
        turns = floor(counts / per_turn)
        raw[channel, column] = turns if table.kind[channel] == TURN_COUNTS else counts - turns * per_turn
