"""The channel table: what each channel measures, where, and how its raw readings become SI values.

value = (raw - offset) / sensitivity, with the sensitivity in volts (a counter: counts) per SI unit. SI is
what travels and is recorded; a display unit is applied only where people look.
"""

import datetime
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from math import pi
from typing import Annotated, NamedTuple, overload

import numpy as np
from numpy.typing import NDArray

from simulator.validation import NAME, Quantity, RigError, nearest

QUANTITIES: dict[str, dict[str, float]] = {
    # quantity: {unit: how many of it make one SI unit}; the first one is the SI unit itself
    "displacement": {"m": 1.0, "mm": 1e3, "µm": 1e6, "um": 1e6},
    "velocity": {"m/s": 1.0, "mm/s": 1e3},
    "acceleration": {"m/s2": 1.0, "g": 1 / 9.80665},
    "force": {"N": 1.0, "kN": 1e-3},
    "torque": {"N m": 1.0},
    "angle": {"rad": 1.0, "deg": 180 / pi},
    "count": {"1": 1.0},
    "speed": {"rad/s": 1.0, "Hz": 0.5 / pi, "rpm": 30 / pi},
    "current": {"A": 1.0, "mA": 1e3},
    "voltage": {"V": 1.0, "mV": 1e3},
    "temperature": {"K": 1.0},
    "contact": {"1": 1.0},
}


class Channel(NamedTuple):
    """One row `[[channel]]` of a rig description; raw means volts, or counts of a counter."""

    name: NAME
    quantity: str
    unit: str
    display_unit: str
    terminal: str
    sensitivity: Annotated[float, Quantity("raw per unit", -1e15, 1e15, "raw reading of one SI unit, not 0")]
    offset: Annotated[float, Quantity("raw", -1e12, 1e12, "raw reading of zero")]
    range: Annotated[tuple[float, float], Quantity("raw", -1e12, 1e12, "what the input can read")]
    ok: Annotated[tuple[float, float] | None, Quantity("raw", -1e12, 1e12, "what a sound sensor gives")] = (
        None
    )
    station: Annotated[float | None, Quantity("m", -5.0, 5.0, "where on the shaft, from the pivot")] = None
    angle_deg: Annotated[float | None, Quantity("deg", -360.0, 360.0, "direction, from +x towards +y")] = None
    cutoff_hz: Annotated[float | None, Quantity("Hz", 1e-3, 1e9, "of the analogue filter")] = None
    delay_s: Annotated[
        float, Quantity("s", 0.0, 1.0, "of sensor and filter: by how much a reading is late")
    ] = 0.0
    anti_alias: bool = False
    stuck: Annotated[float | None, Quantity("s", 1e-4, 600.0, "unchanged for so long, it is not OK")] = None
    runout: Annotated[
        float | None, Quantity("m", 0.0, 1.0, "once a turn in a slow roll; for information, not taken off")
    ] = None
    runout_deg: Annotated[
        float | None, Quantity("deg", -360.0, 360.0, "phase of the runout, from the encoder's zero")
    ] = None
    certificate: str | None = None
    calibrated: datetime.date | None = None
    due: datetime.date | None = None

    @property
    def display_scale(self) -> float:
        """Display units in one SI unit."""
        return QUANTITIES[self.quantity][self.display_unit]

    @property
    def full_scale(self) -> float:
        """Largest magnitude that can be measured, in the SI unit."""
        return max(abs(end - self.offset) for end in self.range) / abs(self.sensitivity)


@dataclass(frozen=True)
class ChannelTable:
    """All channels of a rig, in the order of the blocks; indexed by position or by name."""

    channels: tuple[Channel, ...]

    def __len__(self) -> int:
        return len(self.channels)

    def __iter__(self) -> Iterator[Channel]:
        return iter(self.channels)

    def __contains__(self, name: object) -> bool:
        return name in self.names

    @overload
    def __getitem__(self, key: int | str) -> Channel: ...
    @overload
    def __getitem__(self, key: slice) -> tuple[Channel, ...]: ...
    def __getitem__(self, key: int | str | slice) -> Channel | tuple[Channel, ...]:
        return self.channels[self.index(key) if isinstance(key, str) else key]

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names in the table's order."""
        return tuple(channel.name for channel in self.channels)

    @cached_property
    def units(self) -> tuple[str, ...]:
        """SI units in the table's order."""
        return tuple(channel.unit for channel in self.channels)

    def index(self, name: str) -> int:
        """Return the row of a channel. Raises `RigError` for an unknown name."""
        if name not in self.names:
            raise RigError(f"no channel is named {name}{nearest(name, self.names, 'the channels are')}")
        return self.names.index(name)

    def of_quantity(self, quantity: str) -> tuple[Channel, ...]:
        """Return the channels that measure a quantity."""
        return tuple(channel for channel in self.channels if channel.quantity == quantity)

    def overdue(self, day: datetime.date) -> tuple[str, ...]:
        """Return the names of the channels whose calibration is no longer valid on a day."""
        return tuple(channel.name for channel in self.channels if channel.due and channel.due < day)

    def calibrate(self, raw: NDArray[np.float64], out: NDArray[np.float64]) -> NDArray[np.float64]:
        """Turn raw readings, shape (n_channels, n), into SI values in `out`; may be in place."""
        np.subtract(raw, self._offset, out=out)
        return np.divide(out, self._sensitivity, out=out)

    @cached_property
    def _offset(self) -> NDArray[np.float64]:
        return np.array([[channel.offset] for channel in self.channels])

    @cached_property
    def _sensitivity(self) -> NDArray[np.float64]:
        return np.array([[channel.sensitivity] for channel in self.channels])


def checked_table(channels: list[Channel]) -> ChannelTable:
    """Return the table when its rows are right together. Raises `RigError`."""
    seen: dict[str, Channel] = {}
    for channel in channels:
        _check_channel(channel)
        for other in seen.values():
            _check_pair(channel, other)
        seen[channel.name] = channel
    return ChannelTable(tuple(channels))


def _check_channel(channel: Channel) -> None:
    """Check what one row's values must be to each other."""
    place = f"[[channel]] {channel.name}"
    if channel.quantity not in QUANTITIES:
        known = nearest(channel.quantity, QUANTITIES, "the quantities are")
        raise RigError(f'{place} quantity = "{channel.quantity}" is not a known quantity{known}')
    _check_units(channel, place)
    if channel.sensitivity == 0:
        raise RigError(f"{place} sensitivity = 0 must not be 0: value = (raw - offset) / sensitivity")
    if channel.ok and not channel.range[0] <= channel.ok[0] < channel.ok[1] <= channel.range[1]:
        raise RigError(
            f"{place} ok = {list(channel.ok)} must be inside range = {list(channel.range)}; "
            "outside it a broken sensor would never be noticed"
        )
    if (channel.station is None) != (channel.angle_deg is None):
        raise RigError(f"{place} has only one of station and angle_deg; give both, or none")
    if channel.calibrated and channel.due and channel.due < channel.calibrated:
        raise RigError(f"{place} due = {channel.due} is before calibrated = {channel.calibrated}")


def _check_units(channel: Channel, place: str) -> None:
    """Check that the unit is the quantity's SI unit and the display unit one of its units."""
    units = QUANTITIES[channel.quantity]
    si = next(iter(units))
    if channel.unit != si:
        hint = f'; convert the sensitivity to raw per {si}, and write display_unit = "{channel.unit}"'
        raise RigError(
            f'{place} unit = "{channel.unit}" must be "{si}", the SI unit of {channel.quantity}'
            f"{hint if channel.unit in units else ''}"
        )
    if channel.display_unit not in units:
        raise RigError(f'{place} display_unit = "{channel.display_unit}" must be one of {", ".join(units)}')


def _check_pair(channel: Channel, other: Channel) -> None:
    """Check one row against an earlier one. One counter gives both an angle and its turns."""
    if channel.name == other.name:
        raise RigError(f"[[channel]] {channel.name} stands there twice; each name must be unique")
    if channel.terminal == other.terminal and {channel.quantity, other.quantity} != {"angle", "count"}:
        raise RigError(
            f'[[channel]] {channel.name} terminal = "{channel.terminal}" is taken by {other.name}; '
            "only an angle and its count may share one"
        )
