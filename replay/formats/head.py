"""What an exported file says of its samples: where they come from, when they were taken, of what channels."""

from typing import NamedTuple

import numpy as np

from daq.timing import SampleClock


class Column(NamedTuple):
    """One channel; the last four are known of a rig's own channels only."""

    name: str
    unit: str
    quantity: str = ""
    station: float | None = None
    """m, on the shaft from the pivot."""
    angle_deg: float | None = None
    """Direction, from +x towards +y."""
    full_scale: float = 1.0
    """Largest magnitude that can be measured, in the unit."""

    def facts(self) -> dict[str, str | float]:
        """Return what is known of the channel, without its name."""
        known = {
            "unit": self.unit,
            "quantity": self.quantity,
            "station_m": self.station,
            "angle_deg": self.angle_deg,
        }
        return {name: value for name, value in known.items() if value not in (None, "")}


class Head(NamedTuple):
    """What holds for all of an export."""

    rig: str
    run: str
    mode: str
    """LIVE, EMULATED, ..."""
    series: str
    """block, estimate, smoothed or truth."""
    first_sample: int
    """Index of the first column since the run's start."""
    stride: int
    """Samples of the index between two columns."""
    index_rate: float
    """Hz, of the sample index."""
    t0_ns: int
    """UTC of sample 0, ns since 1970."""
    columns: tuple[Column, ...]

    @property
    def rate(self) -> float:
        """Columns in a second."""
        return self.index_rate / self.stride

    @property
    def start_ns(self) -> int:
        """UTC of the first column, ns since 1970."""
        return SampleClock(self.t0_ns, self.index_rate).ns(self.first_sample)

    @property
    def start(self) -> np.datetime64:
        """UTC of the first column."""
        return np.datetime64(self.start_ns, "ns")

    def facts(self) -> dict[str, str | float]:
        """Return all but the channels, by plain names, for formats that hold such pairs."""
        return {
            "rig": self.rig,
            "run": self.run,
            "mode": self.mode,
            "series": self.series,
            "rate_hz": self.rate,
            "start": f"{self.start}Z",
            "first_sample": self.first_sample,
            "sample_step": self.stride,
            "sample_rate_hz": self.index_rate,
        }
