"""The last check before the device: what may be written to it, whoever made it and whyever.

It trusts nothing that decides on outputs (`daq.commanding`: commands, plans, the operator): it has its own
arithmetic of ranges, schedules and on-times, and asks only for the facts in `Present`. What brings the rig
to rest always passes.
"""

from math import isfinite
from typing import NamedTuple, Protocol

from daq.backend import Capabilities, EnableOutput, HitOutput, Output, RestOutput, SpeedOutput
from daq.rig import Rig

HORIZON = 10.0
"""s: how far ahead an output may be scheduled."""
DUTY_WINDOW = 10.0
"""s in any of which a solenoid may be on for no more than its `max_duty` of the time."""


class EnvelopeError(ValueError):
    """An output that does not leave the computer; the message says what is allowed."""


class Device(Protocol):
    """The part of a `daq.backend.Backend` that an output goes to."""

    @property
    def capabilities(self) -> Capabilities:
        """What the device can do; asked for what it times by itself."""

    def write(self, output: Output, at_sample: int | None = None) -> int:
        """Perform or schedule an output and return the sample at which it takes effect."""


class Present(NamedTuple):
    """What the envelope needs to know of the present."""

    sample: int  # index that the device has reached
    armed: bool
    silence: float  # s since the lease holder's last sign of life
    tripped: bool
    ending: bool


class Pulse(NamedTuple):
    """One stretch during which a solenoid is on."""

    solenoid: str
    begin: int  # sample
    end: int  # sample after the last


class Envelope:
    """Stands between the acquisition and one device.

    Args:
        rig: its ranges, solenoids and safe state.
        device: what is written to.
    """

    def __init__(self, rig: Rig, device: Device) -> None:
        self._rig = rig
        self._rate = rig.acquisition.rate
        self._device = device
        self._pulses: list[Pulse] = []

    def write(self, output: Output, at_sample: int | None, now: Present) -> int:
        """Write an output, or raise `EnvelopeError`; return the sample at which it takes effect."""
        if isinstance(output, RestOutput):
            return self._rest()
        if isinstance(output, EnableOutput):
            return self._enable(output, now)
        self._check_permission(now)
        self._check_schedule(at_sample, now)
        if isinstance(output, SpeedOutput):
            self._check_speed(output)
            return self._device.write(output, at_sample)
        begin = now.sample if at_sample is None else at_sample
        self._check_hit(output, self._pulse(output, begin))
        begin = self._device.write(output, at_sample)
        self._pulses.append(self._pulse(output, begin))
        return begin

    def _rest(self) -> int:
        """Bring the rig to rest by its own safe ramp, which also ends every pulse."""
        sample = self._device.write(RestOutput(self._rig.safe_state.ramp), None)
        self._pulses = [
            pulse._replace(end=min(pulse.end, sample)) for pulse in self._pulses if pulse.begin < sample
        ]
        return sample

    def _enable(self, output: EnableOutput, now: Present) -> int:
        """Drop the enable line at any time; energise it only while nothing is tripped."""
        if output.energised and now.tripped:
            raise EnvelopeError("the enable output stays dropped: the rig is tripped")
        return self._device.write(output, None)

    def _check_permission(self, now: Present) -> None:
        """Refuse whatever moves an unarmed, tripped or ending rig, or one whose holder is silent."""
        if now.tripped:
            raise EnvelopeError("nothing moves: the rig is tripped")
        if now.ending:
            raise EnvelopeError("nothing moves: the run is ending")
        if not now.armed:
            raise EnvelopeError("nothing moves: the rig is not armed")
        if not now.silence < self._rig.command.lease:
            raise EnvelopeError(f"nothing moves: the holder has been silent for {now.silence:g} s")

    def _check_schedule(self, at_sample: int | None, now: Present) -> None:
        """Refuse an output in the past or too far ahead."""
        latest = now.sample + round(HORIZON * self._rate)
        if at_sample is not None and not now.sample < at_sample <= latest:
            raise EnvelopeError(f"sample {at_sample} is not within {now.sample + 1} to {latest}")

    def _check_speed(self, output: SpeedOutput) -> None:
        """Refuse a speed or a rate of change that the rig may not be asked for."""
        allowed = self._rig.command
        if not (isfinite(output.speed) and 0.0 <= output.speed <= allowed.max_speed):
            raise EnvelopeError(
                f"speed {output.speed:g} rad/s is not within 0 to {allowed.max_speed:g} rad/s"
            )
        if not (isfinite(output.ramp) and 0.0 < output.ramp <= allowed.max_ramp):
            raise EnvelopeError(f"ramp {output.ramp:g} rad/s2 is not above 0 to {allowed.max_ramp:g} rad/s2")

    def _check_hit(self, output: HitOutput, pulse: Pulse) -> None:
        """Refuse a pulse that is too strong, too long, too soon, or makes the solenoid too warm."""
        known = {solenoid.name: solenoid for solenoid in self._rig.solenoids}
        if output.solenoid not in known:
            raise EnvelopeError(f"the rig has no solenoid {output.solenoid}")
        solenoid = known[output.solenoid]
        if not (isfinite(output.force) and 0.0 <= output.force <= solenoid.max_force):
            raise EnvelopeError(f"force {output.force:g} N is not within 0 to {solenoid.max_force:g} N")
        if not 0.0 < output.duration <= solenoid.max_duration:
            raise EnvelopeError(f"{output.duration:g} s is not above 0 to {solenoid.max_duration:g} s")
        longest = self._device.capabilities.longest_pulse_s
        if longest is None or not output.duration <= longest:
            raise EnvelopeError(f"the device would not end a pulse of {output.duration:g} s by itself")
        window = round(DUTY_WINDOW * self._rate)
        self._pulses = [each for each in self._pulses if each.end > pulse.end - 2 * window]
        same = [each for each in self._pulses if each.solenoid == pulse.solenoid]
        if any(each.begin < pulse.end and pulse.begin < each.end for each in same):
            raise EnvelopeError(f"solenoid {solenoid.name} is still on then: one pulse at a time")
        if longest_on([*same, pulse], window) > solenoid.max_duty * window:
            raise EnvelopeError(
                f"solenoid {solenoid.name} would be on for more than {100 * solenoid.max_duty:g} % "
                f"of {DUTY_WINDOW:g} s: let it cool down"
            )

    def _pulse(self, output: HitOutput, begin: int) -> Pulse:
        """Return when a pulse is on, in whole samples."""
        duration = output.duration if isfinite(output.duration) else 0.0
        return Pulse(output.solenoid, begin, begin + max(1, round(duration * self._rate)))


def longest_on(pulses: list[Pulse], window: int) -> int:
    """Return the most samples that pulses without overlap are on within any `window` samples.

    The worst window ends with a pulse.
    """
    return max(
        sum(
            max(0, pulse.end - max(pulse.begin, last.end - window))
            for pulse in pulses
            if pulse.end <= last.end
        )
        for last in pulses
    )
