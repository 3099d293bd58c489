"""Who may move the rig, and how far: the rules for commands, without a device, a clock or a link.

A rig moves only while it is armed. `arm` gives one holder a lease; `speed` and `hit` need it. Whoever may
send commands may `stop` and `trip`. A holder that is silent for longer than the rig's `[command] lease`
loses it. Each refusal is one plain sentence that says what is allowed.
"""

from collections.abc import Callable
from math import degrees, isfinite, tau
from typing import NamedTuple
from uuid import uuid4

from daq.backend import Capabilities, HitOutput, Output, RestOutput, SpeedOutput, no_pulse
from daq.commanding import injection
from daq.messages_pb2 import Command
from daq.rig import Rig
from daq.shaft import Motion
from simulator.faults import Fault, FaultKind
from simulator.rig import Solenoid
from simulator.validation import RigError, nearest, written

COUNTED_PAUSE = 0.025
"""s: most that one pause of the daq itself counts towards the holder's silence, so that a daq that was
held up hears the renewals that wait for it before it judges."""
LONGEST_SCHEDULE = 10.0
"""s: how far ahead an output may be scheduled."""
ANGLE_LEAD = 0.02
"""s from a command to the earliest sample of an output that waits for a shaft angle: devices need some."""
LONGEST_TEXT = 500
"""Characters of a mark."""
SLOWEST_RAMP = 0.01
"""Hz/s: slower ones would never end."""

TAKES: dict[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
    "arm": (("longest_hit",), ("plan",)),
    "speed": (("speed_hz", "ramp_hz_per_s", "at_sample"), ()),
    "hit": (("force", "duration", "at_sample", "angle"), ("solenoid",)),
    "stop": ((), ()),
    "trip": ((), ("text",)),
    "reset": ((), ()),
    "mark": ((), ("text",)),
    "record": ((), ("switch",)),
    "inject": (injection.NUMBERS, injection.TEXTS),
}
"""The commands, each with the numbers and the texts that it takes."""
MOVING = ("arm", "speed", "hit", "reset")
"""The commands that let the rig move, which the end of a run forbids."""


class CommandError(ValueError):
    """A command that is refused; the message is the answer to whoever asked."""


class Situation(NamedTuple):
    """What the rules need to know of the present."""

    sample: int  # index that the device has reached
    first_out: str  # cause of the latched trip, empty when none
    ending: bool
    motion: Motion | None = None  # of the shaft; None when it hardly turns, or that is not known
    overdue: tuple[str, ...] = ()  # channels whose calibration is overdue


class Decision(NamedTuple):
    """What an accepted command makes the acquisition do."""

    text: str
    output: Output | None = None
    at_sample: int | None = None
    lease: str = ""
    fault: Fault | None = None


class Commands:
    """Judges commands and keeps the lease.

    Args:
        rig: its ranges, solenoids and safe state.
        capabilities: of the device: what it performs, and whether a real rig is behind it.
        new_lease: makes an identifier that cannot be guessed by accident.
    """

    def __init__(
        self, rig: Rig, capabilities: Capabilities, new_lease: Callable[[], str] = lambda: uuid4().hex
    ) -> None:
        self.holder = ""
        self._rig = rig
        self._capabilities = capabilities
        self._planned = capabilities.emulated  # whether a plan has been named, which hardware asks for
        self._new_lease = new_lease
        self._lease = ""
        self._silence = 0.0
        self._busy_until = 0
        self._rules = {
            "arm": self._arm,
            "speed": self._speed,
            "hit": self._hit,
            "stop": self._stop,
            "trip": self._trip,
            "reset": self._reset,
            "mark": self._mark,
            "record": self._record,
            "inject": self._inject,
        }

    @property
    def silence(self) -> float:
        """Seconds since the holder's last sign of life, by the daq's own clock."""
        return self._silence

    @property
    def armed(self) -> bool:
        """Whether someone holds the lease."""
        return bool(self._lease)

    def decide(self, command: Command, now: Situation) -> Decision:
        """Judge one command. Raises `CommandError` with the reason when it is refused."""
        if command.name not in TAKES:
            raise CommandError(
                f"no command is called {command.name}{nearest(command.name, TAKES, 'there are')}"
            )
        if not command.who:
            raise CommandError("say who you are: a command without a name is refused")
        numbers, texts = TAKES[command.name]
        for key in (*command.values, *command.texts):
            if key not in (*numbers, *texts):
                takes = nearest(key, (*numbers, *texts), "it takes") or "; it takes no values"
                raise CommandError(f"{command.name} does not take {key}{takes}")
        if now.ending and command.name in MOVING:
            raise CommandError("the run is ending: nothing moves any more")
        return self._rules[command.name](command, now)

    def performed(self, output: Output, sample: int) -> None:
        """Note the sample at which an output takes effect."""
        if isinstance(output, HitOutput):
            self._busy_until = sample + round(output.duration * self._rig.acquisition.rate)
        elif isinstance(output, RestOutput):
            self._busy_until = 0

    def renew(self, lease: str) -> None:
        """Take the holder's sign of life; one with another lease changes nothing."""
        if lease and lease == self._lease:
            self._silence = 0.0

    def elapse(self, seconds: float) -> bool:
        """Let time pass by the daq's own clock; true when the holder has now been silent for too long."""
        if not self._lease:
            return False
        self._silence += min(seconds, COUNTED_PAUSE)
        return self._silence >= self._rig.command.lease

    def disarm(self) -> str:
        """Revoke the lease and return the name of who held it."""
        holder, self.holder, self._lease = self.holder, "", ""
        return holder

    def _arm(self, command: Command, now: Situation) -> Decision:
        if now.first_out:
            raise CommandError(f"the rig is tripped ({now.first_out}): find the cause, then reset")
        if now.overdue and not self._rig.command.allow_overdue:
            raise CommandError(
                f"the calibration of {', '.join(now.overdue)} is overdue: have it renewed, or set "
                "command.allow_overdue = true, which the recording will tell"
            )
        plan = command.texts.get("plan", "")
        if not (self._planned or plan):
            raise CommandError(
                "this rig is hardware, which arms for a named plan: `rigtwin plan run PLAN`, or start the "
                "run with `rigtwin live --plan PLAN`"
            )
        if longest := command.values.get("longest_hit", 0.0):
            self._check_output(HitOutput, "solenoid")
            self._check_pulse(longest)
        if self._lease and command.lease != self._lease:
            raise CommandError(f"{self.holder} holds the rig: one operator at a time, wait or stop it first")
        self._planned = True
        self._lease = self._lease or self._new_lease()
        self._silence = 0.0
        self.holder = command.who
        return Decision(f"armed for {plan}" if plan else "armed", lease=self._lease)

    def _speed(self, command: Command, now: Situation) -> Decision:
        self._check_lease(command, now)
        self._check_output(SpeedOutput, "speed")
        allowed = self._rig.command
        speed = _number(command, "speed_hz", 0.0, allowed.max_speed_hz, "Hz")
        slowest = min(SLOWEST_RAMP, allowed.max_ramp_hz_per_s)
        ramp = _number(
            command,
            "ramp_hz_per_s",
            slowest,
            allowed.max_ramp_hz_per_s,
            "Hz/s",
            allowed.default_ramp_hz_per_s,
        )
        at_sample = self._scheduled(command, now)
        text = f"speed to {speed:g} Hz with {ramp:g} Hz/s"
        return Decision(text, SpeedOutput(speed * tau, ramp * tau), at_sample)

    def _hit(self, command: Command, now: Situation) -> Decision:
        self._check_lease(command, now)
        self._check_output(HitOutput, "solenoid")
        solenoid = self._solenoid(command)
        force = _number(command, "force", 0.0, solenoid.max_force, "N")
        duration = _number(command, "duration", 1e-4, solenoid.max_duration, "s")
        self._check_pulse(duration)
        at_angle = "angle" in command.values
        at_sample = self._passage(command, now) if at_angle else self._scheduled(command, now)
        if max(now.sample, at_sample or 0) < self._busy_until:
            left = (self._busy_until - now.sample) / self._rig.acquisition.rate
            raise CommandError(f"another hit is still to end, in {left:.3f} s: one hit at a time")
        text = f"hit by {solenoid.name} with {force:g} N for {duration:g} s"
        if at_angle:
            text += f" when the shaft is at {degrees(command.values['angle']):.0f} deg"
        return Decision(text, HitOutput(solenoid.name, force, duration), at_sample)

    def _stop(self, _command: Command, _now: Situation) -> Decision:
        safe_state = self._rig.safe_state
        text = f"speed to zero with {safe_state.ramp_hz_per_s:g} Hz/s, disarmed"
        return Decision(text, RestOutput(safe_state.ramp))

    def _trip(self, command: Command, _now: Situation) -> Decision:
        reason = command.texts.get("text", "")[:LONGEST_TEXT]
        return Decision(
            f"manual trip{': ' + reason if reason else ''}", RestOutput(self._rig.safe_state.ramp)
        )

    def _reset(self, _command: Command, now: Situation) -> Decision:
        if not now.first_out:
            raise CommandError("nothing is tripped: there is nothing to reset")
        return Decision("trip reset; arm the rig to move it")

    def _mark(self, command: Command, _now: Situation) -> Decision:
        text = command.texts.get("text", "").strip()
        if not text or len(text) > LONGEST_TEXT:
            raise CommandError(f"mark takes a text of 1 to {LONGEST_TEXT} characters")
        return Decision(text)

    def _record(self, command: Command, now: Situation) -> Decision:
        self._check_lease(command, now)
        switch = command.texts.get("switch", "")
        if switch not in ("on", "off"):
            raise CommandError(f"record takes switch, on or off, not {switch or 'nothing'}")
        return Decision(f"recording {switch}")

    def _inject(self, command: Command, now: Situation) -> Decision:
        if not self._capabilities.emulated:
            raise CommandError("this rig is hardware: faults are injected into emulated ones alone")
        try:
            fault = injection.fault_of(command, now.sample, self._rig.acquisition.rate)
        except RigError as error:
            raise CommandError(str(error)) from error
        of = f" of {fault.channel}" if fault.channel else ""
        return Decision(f"fault {written(FaultKind(fault.kind))}{of} from {fault.at:.3f} s on", fault=fault)

    def _check_lease(self, command: Command, now: Situation) -> None:
        if now.first_out:
            raise CommandError(f"the rig is tripped ({now.first_out}): find the cause, then reset")
        if not self._lease:
            raise CommandError("the rig is not armed: arm it first")
        if command.lease != self._lease:
            raise CommandError(f"{self.holder} holds the rig: only the holder of the lease may move it")

    def _check_output(self, kind: type, what: str) -> None:
        if kind not in self._capabilities.outputs:
            backend = self._rig.acquisition.backend
            raise CommandError(f"the backend {backend} has no {what} output")

    def _check_pulse(self, duration: float) -> None:
        """Refuse a hit that the device would not end by itself."""
        if reason := no_pulse(self._capabilities, duration):
            raise CommandError(reason)

    def _solenoid(self, command: Command) -> Solenoid:
        solenoids = {solenoid.name: solenoid for solenoid in self._rig.solenoids}
        if not solenoids:
            raise CommandError("this rig has no solenoid")
        name = command.texts.get("solenoid", "") or next(iter(solenoids))
        if name not in solenoids:
            raise CommandError(f"no solenoid is called {name}{nearest(name, solenoids, 'there are')}")
        return solenoids[name]

    def _scheduled(self, command: Command, now: Situation) -> int | None:
        if "at_sample" not in command.values:
            return None
        latest = now.sample + LONGEST_SCHEDULE * self._rig.acquisition.rate
        wanted = command.values["at_sample"]
        if not (isfinite(wanted) and now.sample < wanted <= latest):
            raise CommandError(
                f"at_sample must be {now.sample + 1} to {latest:.0f}, not {wanted:.0f}: now to 10 s ahead"
            )
        return round(wanted)

    def _passage(self, command: Command, now: Situation) -> int:
        """Return the sample at which the shaft next comes to the angle of a command."""
        if "at_sample" in command.values:
            raise CommandError("a hit takes angle or at_sample, not both")
        angle = _number(command, "angle", 0.0, tau, "rad")
        if now.motion is None:
            raise CommandError("the shaft hardly turns, or no encoder tells: leave angle out to hit at once")
        return now.motion.passage(angle, now.sample + round(ANGLE_LEAD * self._rig.acquisition.rate))


def _number(
    command: Command, key: str, lowest: float, highest: float, unit: str, default: float | None = None
) -> float:
    """Return a value within its range. Raises `CommandError` that names the range."""
    if key not in command.values and default is not None:
        return default
    if key not in command.values:
        raise CommandError(f"{command.name} needs {key}, {lowest:g} to {highest:g} {unit}")
    value = command.values[key]
    if not (isfinite(value) and lowest <= value <= highest):
        raise CommandError(f"{key} must be {lowest:g} to {highest:g} {unit}, not {value:g}")
    return value
