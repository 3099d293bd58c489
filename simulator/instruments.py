"""What the sensors must be told of channels, encoder and their imperfections, whoever describes them."""

from typing import Protocol


class Probe(Protocol):
    """A row of the channel table."""

    @property
    def name(self) -> str:
        """Name of the channel."""

    @property
    def quantity(self) -> str:
        """What it measures: displacement, force, ..."""

    @property
    def sensitivity(self) -> float:
        """Volts (a counter: counts) per SI unit."""

    @property
    def offset(self) -> float:
        """Volts or counts of zero."""

    @property
    def range(self) -> tuple[float, float]:
        """Lowest and highest volts or counts that the input can read."""

    @property
    def station(self) -> float | None:
        """Place along the shaft from the pivot, m."""

    @property
    def angle_deg(self) -> float | None:
        """Direction from +x towards +y, deg."""


class Encoder(Protocol):
    """An incremental encoder."""

    @property
    def counts_per_turn(self) -> int:
        """Lines times edges counted."""

    @property
    def index_angle(self) -> float:
        """Shaft angle at the index pulse, rad."""

    @property
    def direction(self) -> int:
        """1: counts up with positive angle; -1: down."""


class Imperfections(Protocol):
    """Noise of the sensors, and the converter behind them."""

    @property
    def displacement_noise(self) -> float:
        """Of a proximity probe, m rms."""

    @property
    def force_noise(self) -> float:
        """Of a force transducer, N rms."""

    @property
    def adc_bits(self) -> int:
        """Of the converter."""

    @property
    def adc_noise(self) -> float:
        """Of the converter, rms in units of its least significant bit."""
