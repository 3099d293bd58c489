"""The tables of a rig description that concern acquisition, commands and the link, as named tuples.

Field names are the keys of the TOML file, units included; properties give the SI values that the
programs compute with.
"""

from math import pi, tau
from typing import Annotated, Literal, NamedTuple

from simulator.validation import Quantity

LOOPBACK = "127.0.0.1"


class AcquisitionSettings(NamedTuple):
    """Table `[acquisition]`: the device and the sizes of its reads and blocks."""

    backend: str
    rate: Annotated[float, Quantity("Hz", 1.0, 1e7, "samples a second of each channel")]
    read: Annotated[int, Quantity("samples", 1, 100_000, "samples a read; protection acts once a read")]
    block: Annotated[int, Quantity("samples", 1, 10_000_000, "samples a block; a multiple of read")]


class CommandSettings(NamedTuple):
    """Table `[command]`: what may be commanded."""

    max_speed_hz: Annotated[float, Quantity("Hz", 0.0, 1e5, "highest speed that may be commanded")]
    max_ramp_hz_per_s: Annotated[float, Quantity("Hz/s", 1e-3, 1e5, "steepest ramp that may be commanded")]
    default_ramp_hz_per_s: Annotated[float, Quantity("Hz/s", 1e-3, 1e5, "ramp when a command names none")]
    lease: Annotated[float, Quantity("s", 0.05, 60.0, "silence of the operator that stops the rig")] = 0.1
    allow_overdue: bool = False

    @property
    def max_speed(self) -> float:
        """Highest speed, rad/s."""
        return tau * self.max_speed_hz

    @property
    def max_ramp(self) -> float:
        """Steepest ramp, rad/s2."""
        return tau * self.max_ramp_hz_per_s

    @property
    def default_ramp(self) -> float:
        """Ramp when a command names none, rad/s2."""
        return tau * self.default_ramp_hz_per_s


class SafeStateSettings(NamedTuple):
    """Table `[safe_state]`: how the rig is brought to rest."""

    ramp_hz_per_s: Annotated[float, Quantity("Hz/s", 1e-2, 1e5, "ramp of the speed to zero")]

    @property
    def ramp(self) -> float:
        """Ramp of the speed to zero, rad/s2."""
        return tau * self.ramp_hz_per_s


class EncoderSettings(NamedTuple):
    """Table `[encoder]`: the shaft's angle is counted from its index pulse."""

    counts_per_turn: Annotated[int, Quantity("counts", 1, 100_000_000, "lines times edges counted")]
    index_angle_deg: Annotated[float, Quantity("deg", -360.0, 360.0, "shaft angle at the index pulse")]
    direction: Literal[1, -1]

    @property
    def index_angle(self) -> float:
        """Shaft angle at the index pulse, rad."""
        return self.index_angle_deg * pi / 180


class CaptureSettings(NamedTuple):
    """Table `[capture]`, which may be missing: the regions that are marked around what happens."""

    before: Annotated[float, Quantity("s", 0.0, 3600.0, "of a region, before what happened")] = 1.0
    after: Annotated[float, Quantity("s", 0.0, 3600.0, "of a region, after it")] = 2.0
    residual: Annotated[float | None, Quantity("m rms", 0.0, 1.0, "of the twin that makes a region")] = None


class TwinSettings(NamedTuple):
    """Table `[twin]`: the model that runs alongside, or none for a rig without a model."""

    model: Literal["contact", "none"]


_PORT = Annotated[int, Quantity("1", 0, 65535, "TCP port; 0 takes a free one")]


class LinkSettings(NamedTuple):
    """Table `[link]`: where the processes listen."""

    host: str = LOOPBACK
    daq: _PORT = 0
    control: _PORT = 0
    twin: _PORT = 0
    operator: _PORT = 0

    def endpoint(self, name: str) -> str:
        """Where a process listens: daq, control, twin or operator, as the link writes it."""
        return f"tcp/{self.host}:{getattr(self, name)}"


class EmulatorSettings(NamedTuple):
    """Table `[emulator]`: what the emulated device does that the twin is not told."""

    seed: Annotated[int, Quantity("1", 0, 2**63 - 1, "of all noise")] = 1
    displacement_noise: Annotated[float, Quantity("m rms", 0.0, 1e-2, "of a proximity probe")] = 0.0
    force_noise: Annotated[float, Quantity("N rms", 0.0, 1e5, "of a force transducer")] = 0.0
    adc_bits: Annotated[int, Quantity("bits", 1, 32, "of the converter")] = 16
    adc_noise: Annotated[float, Quantity("LSB rms", 0.0, 1e6, "of the converter")] = 0.0
    latency: Annotated[float, Quantity("s", 0.0, 1.0, "from a write to its effect")] = 0.001
    buffer: Annotated[float, Quantity("s", 1e-3, 600.0, "of samples that the device holds")] = 4.0
