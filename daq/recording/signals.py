"""Samples of some channels over a stretch of a run, put together from messages; what is missing stays so."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from daq.messages import Samples, Series
from daq.optional import optional
from daq.recording.certificate import Coverage
from daq.recording.storage import RecordingError

EXTRA = "export"
"""The extra that installs the packages for tables and file formats."""


@dataclass(frozen=True, eq=False)
class Signals:
    """Samples of some channels over a stretch of a run; `signals["force_top"]` is one channel's.

    Attributes:
        first_sample: index of the first column.
        rate: Hz, of the sample index.
        stride: samples of the index between two columns.
        names: of the channels.
        units: of the channels.
        samples: (n_channels, n_columns), in those units; NaN where samples are missing.
        gaps: (first, last) index of each stretch that is missing.
    """

    first_sample: int
    rate: float
    stride: int
    names: tuple[str, ...]
    units: tuple[str, ...]
    samples: Samples
    gaps: tuple[tuple[int, int], ...]

    def __getitem__(self, name: str) -> Samples:
        return self.samples[self.names.index(name)]

    @property
    def time(self) -> np.ndarray:
        """Time of each column in s since sample 0, (n_columns,)."""
        return (self.first_sample + self.stride * np.arange(self.samples.shape[1])) / self.rate

    def to_pandas(self) -> Any:
        """Return a pandas DataFrame of a column a channel, by time in s; `attrs` has units and rate.

        Raises:
            MissingPackage: pandas is not installed.
        """
        pandas = optional("pandas", "to_pandas", EXTRA)
        index = pandas.Index(self.time, name="time")
        frame = pandas.DataFrame(self.samples.T, index, list(self.names))
        frame.attrs.update(
            {"units": dict(zip(self.names, self.units, strict=True)), "rate": self.column_rate}
        )
        return frame

    def to_xarray(self) -> Any:
        """Return an xarray Dataset of a variable a channel, over `time` in s, each with its units.

        Raises:
            MissingPackage: xarray is not installed.
        """
        xarray = optional("xarray", "to_xarray", EXTRA)
        columns = zip(self.names, self.units, self.samples, strict=True)
        return xarray.Dataset(
            {name: ("time", samples, {"units": unit}) for name, unit, samples in columns},
            {"time": ("time", self.time, {"units": "s"})},
            {"rate": self.column_rate},
        )

    def to_arrow(self) -> Any:
        """Return a pyarrow Table of `time` in s and a column a channel, each field with its unit."""
        import pyarrow

        units = zip(self.names, self.units, strict=True)
        fields = [
            pyarrow.field("time", pyarrow.float64(), metadata={"unit": "s"}),
            *(pyarrow.field(name, pyarrow.float32(), metadata={"unit": unit}) for name, unit in units),
        ]
        schema = pyarrow.schema(fields, metadata={"rate": repr(self.column_rate)})
        return pyarrow.table([pyarrow.array(self.time), *map(pyarrow.array, self.samples)], schema)

    @property
    def column_rate(self) -> float:
        """Columns in a second."""
        return self.rate / self.stride


def series_end(series: Series) -> int:
    """Return the index behind the last sample of a series."""
    return series.first_sample + series.samples.shape[1] * max(series.stride, 1)


def joined(
    found: Sequence[Series], names: Sequence[str] | None, first: int, last: int | None, what: str
) -> Signals:
    """Put some channels of series side by side from index `first` to `last`, or to the end if None.

    Raises:
        RecordingError: there is no series, or not such a channel in it; the text says so of `what`.
    """
    if not found:
        raise RecordingError(f"{what} has no samples from index {first} on")
    known = found[0].names
    unknown = [name for name in names or () if name not in known]
    if unknown:
        raise RecordingError(f"{what} has no channel {unknown[0]!r}: it has {', '.join(known)}")
    return _cut(_join(found, names or known), first, last)


def _join(found: Sequence[Series], names: Sequence[str]) -> Signals:
    """Put series side by side where their index says, with NaN between them."""
    stride = max(found[0].stride, 1)
    first = min(series.first_sample for series in found)
    end = max(series_end(series) for series in found)
    rows = [found[0].names.index(name) for name in names]
    samples = np.full((len(rows), -(-(end - first) // stride)), np.nan, np.float32)
    coverage = Coverage()
    for series in found:
        column = (series.first_sample - first) // stride
        samples[:, column : column + series.samples.shape[1]] = series.samples[rows]
        coverage.add(series.first_sample, series_end(series))
    units = tuple(found[0].units[row] for row in rows)
    gaps = tuple(coverage.gaps(first, end))
    return Signals(first, found[0].rate, stride, tuple(names), units, samples, gaps)


def _cut(signals: Signals, first: int, last: int | None) -> Signals:
    """Return the columns whose index lies between `first` and `last`."""
    before = max(0, -(-(first - signals.first_sample) // signals.stride))
    behind = None if last is None else max(0, (last - signals.first_sample) // signals.stride + 1)
    samples = signals.samples[:, before:behind]
    begin = signals.first_sample + before * signals.stride
    end = begin + samples.shape[1] * signals.stride
    gaps = [(max(start, begin), min(stop, end - 1)) for start, stop in signals.gaps]
    return replace(
        signals,
        first_sample=begin,
        samples=samples,
        gaps=tuple((start, stop) for start, stop in gaps if start <= stop),
    )
