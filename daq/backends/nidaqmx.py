"""National Instruments devices through NI-DAQmx: analog inputs and an encoder by one sample clock, outputs.

`terminal` of a channel is `ai3` (analog input), `ao0` (an analog output, read back) or `ctr0` (encoder).
`[device]` names the device and what moves the rig; see `DeviceSettings` and `daq.backends.nidaqmx_outputs`.
"""

from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from typing import Annotated, Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from daq.backend import (
    BackendError,
    Capabilities,
    EnableOutput,
    HitOutput,
    Output,
    OutputRefused,
    PastSampleError,
    Reading,
    RestOutput,
    SpeedOutput,
    address_of,
)
from daq.backends.nidaqmx_outputs import Pulse, Relay, SpeedRamp
from daq.optional import optional
from daq.rig import Rig
from daq.rig.channels import Channel
from simulator.validation import Quantity, tuple_at

RATES = (0.1, 2e6)
LONGEST_PULSE = 0.8
"""s that any NI counter can time by itself: 24 bits at 20 MHz."""
COERCED = 1e-6
"""Share of the rate by which the driver may change it unnoticed: a converter's clock is less exact."""


class DeviceSettings(NamedTuple):
    """Table `[device]` of a rig on NI-DAQmx; an output that is not named is not there."""

    address: str
    wiring: Literal["default", "rse", "nrse", "diff", "pseudo_diff"] = "default"
    speed_output: str | None = None  # analog output of the speed's set-point; a channel has it as terminal
    enable_output: str | None = None  # digital line that is high while nothing is tripped
    buffer_s: Annotated[float, Quantity("s", 0.1, 60.0, "of samples that the driver holds")] = 4.0


class NiDaqmx:
    """One NI device (a `Backend`). It has no watchdog: its outputs hold their value when the daq dies."""

    def __init__(self) -> None:
        self.capabilities = Capabilities(
            rates=RATES,
            outputs=(RestOutput,),
            hardware_timing=False,
            watchdog_s=None,
            emulated=False,
            paced=True,
            longest_pulse_s=LONGEST_PULSE,
        )
        self._tasks = ExitStack()
        self._ready = self._sampling = False
        self._speed: SpeedRamp | None = None
        self._enable: Relay | None = None
        self._pulses: dict[str, Pulse] = {}

    def open(self, rig: Rig) -> None:
        """Make the tasks for the rig's channels and outputs; nothing is started and nothing moves."""
        for module in ("nidaqmx.stream_readers", "nidaqmx.stream_writers", "nidaqmx"):
            self._driver = optional(module, "the backend nidaqmx", "nidaqmx")
        self._address = address_of(rig, 'the device\'s name in NI MAX, as "Dev1"')
        tables = dict(rig.device)
        solenoids = tables.pop("solenoids", {})
        settings: DeviceSettings = tuple_at(DeviceSettings, tables, "[device]")
        self._rig, self._channels = rig, tuple(rig.channels)
        with ExitStack() as undo:
            undo.callback(self._tasks.close)
            with self._told():
                self._open_inputs(settings)
                self._open_outputs(settings, solenoids)
            undo.pop_all()
        self._ready = True

    def start(self) -> None:
        """Start the counters, which wait for the analog inputs' clock, and then those."""
        if not self._ready:
            raise BackendError("the NI device is not open: call open(rig) first")
        with self._told():
            for encoder in self._encoders.values():
                encoder.task.start()
            self._analog.start()
        self._next = 0
        self._turns = dict.fromkeys(self._encoders, 0)
        self._counted = dict.fromkeys(self._encoders, 0.0)
        self._sampling = True

    def clock(self) -> int:
        """Return the number of samples that the device has acquired."""
        self._running()
        with self._told():
            return int(self._analog.in_stream.total_samp_per_chan_acquired)

    def read(self, out: NDArray[np.float64]) -> Reading:
        """Fetch the oldest samples of all inputs; a buffer that has overflowed is a failure of the device."""
        self._running()
        with self._told():
            waiting = [self._analog, *(encoder.task for encoder in self._encoders.values())]
            count = min(out.shape[1], *(task.in_stream.avail_samp_per_chan for task in waiting))
            if count:
                self._read_analog(out, count)
                for terminal, encoder in self._encoders.items():
                    self._read_encoder(terminal, encoder, out, count)
        first, self._next = self._next, self._next + count
        return Reading(first, count, 0)

    def write(self, output: Output, at_sample: int | None = None) -> int:
        """Perform an output now; it cannot wait for a sample."""
        now = self.clock()
        if at_sample is not None and at_sample < now:
            raise PastSampleError(f"sample {at_sample} is too early: {self._address} is at {now}")
        if at_sample is not None:
            raise OutputRefused(f"{self._address} cannot wait for a sample: its outputs act at once")
        with self._told():
            self._perform(output)
        return self.clock()

    def stop(self) -> None:
        """Bring the outputs to rest, wait until they are there, and end sampling."""
        if not self._sampling:
            return
        self._sampling = False
        with self._told():
            self._perform(RestOutput(self._rig.safe_state.ramp))
            if self._speed:
                self._speed.finish()
            for task in [self._analog, *(encoder.task for encoder in self._encoders.values())]:
                task.stop()

    def close(self) -> None:
        """Give the device back."""
        try:
            self.stop()
        finally:
            self._ready = False
            self._tasks.close()

    def _running(self) -> None:
        if not self._sampling:
            raise BackendError("the NI device is not sampling: call start() first")

    def _perform(self, output: Output) -> None:
        if isinstance(output, RestOutput):
            for pulse in self._pulses.values():
                pulse.end()
            if self._speed:
                self._speed.go(0.0, output.ramp)
        elif isinstance(output, SpeedOutput) and self._speed:
            self._speed.go(output.speed, output.ramp)
        elif isinstance(output, EnableOutput) and self._enable:
            self._enable.set(output.energised)
        elif isinstance(output, HitOutput) and output.solenoid in self._pulses:
            strongest = self._rig.solenoid(output.solenoid).max_force
            if output.force != strongest:
                raise OutputRefused(
                    f"solenoid {output.solenoid} is switched, not controlled: hit with {strongest:g} N"
                )
            self._pulses[output.solenoid].fire(output.duration)
        else:
            raise OutputRefused(f"[device] of the rig names no output for {type(output).__name__}")

    def _open_inputs(self, settings: DeviceSettings) -> None:
        """Make a task for the analog inputs, and one for each encoder on their clock."""
        rate = self._rig.acquisition.rate
        depth = round(settings.buffer_s * rate)
        self._rows = [row for row, channel in enumerate(self._channels) if not of_counter(channel)]
        if not self._rows:
            raise BackendError(f"{self._address} needs an analog input: it gives the sample clock")
        self._analog = self._task()
        wiring = self._driver.constants.TerminalConfiguration[settings.wiring.upper()]
        for row in self._rows:
            channel = self._channels[row]
            low, high = channel.range
            # What an analog output gives is read back on a channel inside the device.
            output = channel.terminal.startswith("ao")
            terminal = f"_{channel.terminal}_vs_aognd" if output else channel.terminal
            self._analog.ai_channels.add_ai_voltage_chan(
                f"{self._address}/{terminal}", terminal_config=wiring, min_val=low, max_val=high
            )
        continuous = self._driver.constants.AcquisitionType.CONTINUOUS
        self._analog.timing.cfg_samp_clk_timing(rate, sample_mode=continuous, samps_per_chan=depth)
        self._check_rate(rate)
        self._analog_reader = self._driver.stream_readers.AnalogMultiChannelReader(self._analog.in_stream)
        terminals = {channel.terminal for channel in self._channels if of_counter(channel)}
        self._encoders = {terminal: self._encoder(terminal, depth) for terminal in sorted(terminals)}

    def _encoder(self, terminal: str, depth: int) -> "Encoder":
        """Make the task of an encoder: four edges a line, set to zero by its index pulse."""
        encoder = self._rig.encoder
        if encoder is None:
            raise BackendError(f"terminal {terminal} is a counter: the rig needs the table [encoder]")
        task, constants = self._task(), self._driver.constants
        task.ci_channels.add_ci_ang_encoder_chan(
            f"{self._address}/{terminal}",
            decoding_type=constants.EncoderType.X_4,
            zidx_enable=True,
            units=constants.AngleUnits.TICKS,
            pulses_per_rev=encoder.counts_per_turn // 4,
        )
        task.timing.cfg_samp_clk_timing(
            self._rig.acquisition.rate,
            source=f"/{self._address}/ai/SampleClock",
            sample_mode=constants.AcquisitionType.CONTINUOUS,
            samps_per_chan=depth,
        )
        rows = {
            channel.quantity: row
            for row, channel in enumerate(self._channels)
            if channel.terminal == terminal
        }
        reader = self._driver.stream_readers.CounterReader(task.in_stream)
        return Encoder(task, reader, float(encoder.counts_per_turn), rows)

    def _open_outputs(self, settings: DeviceSettings, solenoids: Mapping[str, str]) -> None:
        """Make what the rig's description names, and declare what can be moved with it."""
        outputs: list[type] = [RestOutput]
        if settings.speed_output:
            rows = [channel for channel in self._channels if channel.terminal == settings.speed_output]
            if not rows:
                raise BackendError(
                    f'[device] speed_output = "{settings.speed_output}" needs a [[channel]] with that '
                    "terminal, whose sensitivity says how many volts are a rad/s"
                )
            self._speed = SpeedRamp(self._driver, self._task(), self._address, rows[0])
            outputs.append(SpeedOutput)
        for name, counter in solenoids.items():
            self._rig.solenoid(name)
            self._pulses[name] = Pulse(self._driver, f"{self._address}/{counter}")
            self._tasks.callback(self._pulses[name].end)
            outputs.append(HitOutput)
        if settings.enable_output:
            self._enable = Relay(self._driver, self._task(), f"{self._address}/{settings.enable_output}")
            outputs.append(EnableOutput)
        self.capabilities = self.capabilities._replace(outputs=tuple(dict.fromkeys(outputs)))

    def _task(self) -> Any:
        return self._tasks.enter_context(self._driver.Task())

    def _check_rate(self, rate: float) -> None:
        true_rate = self._analog.timing.samp_clk_rate
        if abs(true_rate - rate) > COERCED * rate:
            raise BackendError(
                f"{self._address} samples with {true_rate:.9g} Hz when told {rate:.9g} Hz: "
                f"write [acquisition] rate = {true_rate:.9g}, or one that it supports"
            )

    def _read_analog(self, out: NDArray[np.float64], count: int) -> None:
        volts = np.empty((len(self._rows), count))
        self._analog_reader.read_many_sample(volts, count, timeout=0.0)
        out[self._rows, :count] = volts

    def _read_encoder(self, terminal: str, encoder: "Encoder", out: NDArray[np.float64], count: int) -> None:
        """Fill the rows of an encoder's counts within the turn and of its whole turns."""
        ticks = np.empty(count)
        encoder.reader.read_many_sample_double(ticks, count, timeout=0.0)
        within, turns = turned(ticks, self._counted[terminal], self._turns[terminal], encoder.per_turn)
        self._counted[terminal], self._turns[terminal] = float(within[-1]), int(turns[-1])
        for quantity, values in (("angle", within), ("count", turns)):
            if quantity in encoder.rows:
                out[encoder.rows[quantity], :count] = values

    @contextmanager
    def _told(self) -> Iterator[None]:
        """Turn the driver's errors into one clear line each."""
        try:
            yield
        except self._driver.errors.DaqNotFoundError as error:
            raise BackendError("NI-DAQmx is not installed: get the driver from ni.com") from error
        except self._driver.errors.Error as error:
            lines = [line.strip() for line in str(error).splitlines() if line.strip()]
            raise BackendError(f"{self._address}: {lines[0]} ({lines[-1]})") from error


class Encoder(NamedTuple):
    """An encoder's task and reader, its counts a turn, and its rows by quantity."""

    task: Any
    reader: Any
    per_turn: float
    rows: dict[str, int]


def of_counter(channel: Channel) -> bool:
    """Tell whether a channel is read by a counter."""
    return channel.terminal.startswith("ctr")


def turned(
    ticks: NDArray[np.float64], before: float, turns: int, per_turn: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return counts within the turn (n,) and whole turns (n,) of a counter that its index pulse sets to zero.

    Args:
        ticks: as counted, (n,); less than half a turn from one sample to the next.
        before: count within the turn of the sample before.
        turns: whole turns until then.
        per_turn: counts of a turn.
    """
    within = ticks % per_turn
    steps = np.diff(within, prepend=before)
    return within, turns + np.cumsum((steps < -0.5 * per_turn).astype(float) - (steps > 0.5 * per_turn))
