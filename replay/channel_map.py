"""Says which column of another program's file is which channel of a rig, in which unit: read from TOML."""

from collections.abc import Mapping
from datetime import UTC, datetime
from math import tau
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from daq.rig.channels import QUANTITIES, Channel, ChannelTable
from daq.rig.toml_source import parse, read
from simulator.validation import NAME, Quantity, RigError, nearest, tuple_at

TURN = float(np.float32(tau))
"""rad; the largest angle of a turn in single precision, which is a little above 2 pi."""


class Layout(NamedTuple):
    """The map's own keys: when the samples were taken, and how text is written."""

    rate: Annotated[float | None, Quantity("Hz", 1e-3, 1e9, "samples a second, where the file says none")] = (
        None
    )
    time: str | None = None
    """Column of times in s; they are compared with the rate."""
    delimiter: str = ","
    """Between the fields of a line of text."""
    decimal: Literal[".", ","] = "."


class Row(NamedTuple):
    """One row `[[channel]]`: the channel's SI values are (reading - offset) * scale."""

    name: NAME
    source: str | None = None
    """Column of the file."""
    value: Annotated[float | None, Quantity("1", -1e15, 1e15, "constant SI value, in place of a source")] = (
        None
    )
    unit: str | None = None
    """Of the column; the SI unit if neither unit nor scale is given."""
    scale: Annotated[float | None, Quantity("1", -1e15, 1e15, "SI units in one unit of the column")] = None
    offset: Annotated[float, Quantity("1", -1e15, 1e15, "reading of zero, in the column's unit")] = 0.0


class Conversion(NamedTuple):
    """How one channel of the rig comes about."""

    source: str | None
    """Column of the file; None: the value is constant."""
    value: float
    """SI, of a constant."""
    scale: float
    """SI units in one unit of the column."""
    offset: float
    """Reading of zero, in the column's unit."""
    wraps: bool
    """Whether values are taken modulo a turn, as angles are recorded."""

    def apply(self, readings: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the SI values of readings."""
        values = (readings - self.offset) * self.scale
        if not self.wraps:
            return values
        return np.where((values < 0.0) | (values > TURN), np.mod(values, tau), values)


class ChannelMap(NamedTuple):
    """A checked map."""

    layout: Layout
    conversions: tuple[Conversion, ...]
    """One for each channel of the rig, in its order."""
    start_ns: int | None
    """UTC of the first sample in ns since 1970, where the map says it."""
    text: str
    """As it was read."""

    @property
    def sources(self) -> list[str]:
        """Columns that are needed, each once."""
        named = [each.source for each in self.conversions if each.source]
        return list(dict.fromkeys([*named, self.layout.time] if self.layout.time else named))

    def channels(self, readings: Mapping[str, NDArray[np.float64]], length: int) -> NDArray[np.float32]:
        """Return the rig's channels, (n_channels, length), of the columns by their names."""
        values = np.empty((len(self.conversions), length), np.float32)
        for row, each in zip(values, self.conversions, strict=True):
            row[:] = each.value if each.source is None else each.apply(readings[each.source])
        return values


def load_map(path: Path | None, table: ChannelTable) -> ChannelMap:
    """Read a map and check it against a rig's channels.

    Args:
        path: of the TOML file; None: each channel is the column of its own name, in its SI unit.
        table: the rig's channels.

    Raises:
        RigError: naming file, row, key and value, and what is allowed.
    """
    if path is None:
        same = tuple(Conversion(channel.name, 0.0, 1.0, 0.0, _wraps(channel)) for channel in table)
        return ChannelMap(Layout(), same, None, "")
    text = read(path)
    tables = parse(text, str(path))
    rows = tables.pop("channel", [])
    try:
        start_ns = _start(tables.pop("start", None))
        layout = tuple_at(Layout, tables, "the map's")
        if len(layout.delimiter) != 1:
            raise RigError(f'delimiter = "{layout.delimiter}" must be one character')
        return ChannelMap(layout, _conversions(rows, table), start_ns, text)
    except RigError as error:
        raise RigError(f"{path}: {error}") from None


def _conversions(rows: Any, table: ChannelTable) -> tuple[Conversion, ...]:
    """Return the rows in the order of the rig's channels."""
    if not isinstance(rows, list) or not rows:
        raise RigError("there are no rows [[channel]]")
    found: dict[str, Conversion] = {}
    for given in rows:
        row: Row = tuple_at(Row, given, "[[channel]]")
        if row.name not in table:
            known = nearest(row.name, table.names, "the channels are")
            raise RigError(f"[[channel]] {row.name} is not a channel of the rig{known}")
        if row.name in found:
            raise RigError(f"[[channel]] {row.name} stands there twice; each name must be unique")
        found[row.name] = _conversion(row, table[row.name])
    for name in table.names:
        if name not in found:
            raise RigError(f"[[channel]] {name} of the rig is missing: give it a source, or a constant value")
    return tuple(found[name] for name in table.names)


def _conversion(row: Row, channel: Channel) -> Conversion:
    place = f"[[channel]] {row.name}"
    if (row.source is None) == (row.value is None):
        raise RigError(f"{place} needs either a source, a column of the file, or a value")
    if row.unit is not None and row.scale is not None:
        raise RigError(f"{place} has both unit and scale; give one")
    scale = _scale(row, channel, place)
    return Conversion(row.source, row.value or 0.0, scale, row.offset, _wraps(channel))


def _scale(row: Row, channel: Channel, place: str) -> float:
    """Return SI units in one unit of the column."""
    if row.scale is not None:
        if row.scale == 0.0:
            raise RigError(f"{place} scale = 0 must not be 0")
        return row.scale
    units = QUANTITIES[channel.quantity]
    unit = channel.unit if row.unit is None else row.unit
    if unit not in units:
        raise RigError(
            f'{place} unit = "{unit}" is no unit of {channel.quantity}: write one of {", ".join(units)}, '
            "or give a scale"
        )
    return 1.0 / units[unit]


def _wraps(channel: Channel) -> bool:
    return channel.quantity == "angle"


def _start(start: Any) -> int | None:
    if start is None:
        return None
    if not isinstance(start, datetime) or start.tzinfo is None:
        raise RigError(f"start = {start} must be a date and time with its zone, as 2026-01-31T12:00:00Z")
    return int(np.datetime64(start.astimezone(UTC).replace(tzinfo=None), "ns").astype(np.int64))
