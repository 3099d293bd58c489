"""What would have happened: from the twin's estimated state at some time on, in the simulator.

The simulated rig is the described one with the unbalance that the twin found, not the rig that was recorded:
a fork without changes follows the recording as long as estimate and model hold, between impacts for
seconds, in contact until the first impact that comes out otherwise.
"""

import tomllib
from collections.abc import Sequence
from math import atan2, hypot, tau
from pathlib import Path

import numpy as np
import tomli_w

from daq import keys
from daq.backend import HitOutput, RestOutput, SpeedOutput
from daq.describe import run_of_fork
from daq.messages import Series, decode_series
from daq.messages_pb2 import Description
from daq.recording import RecordingWriter, series_end
from daq.recording.certificate import Certificate
from daq.recording.recorded_run import RecordedRun
from daq.rig import Rig, rig_from_text, with_overrides
from daq.shaft import ENCODER, sense_of
from replay.outputs import Written, outputs_of
from replay.resimulation import Progress, Scripted, acquire
from simulator.rig import DriveMode
from twin.estimation import Twin
from twin.observer import EstimateStatus
from twin.resume import resume, values_at

LATEST = 1e6  # s
HIT_DURATION = 0.010  # s
LONGEST_IMPACT = 0.1  # s
HIT, SPEED = "command.hit", "command.speed"
TURNS = "encoder_turns"


class ForkError(ValueError):
    """A fork that cannot be made; the message says why and what to do."""


def fork(
    source: str | Path,
    target: str | Path,
    at: float,
    changes: Sequence[str] = (),
    *,
    seconds: float | None = None,
    progress: Progress = lambda sample: None,
) -> Certificate:
    """Write what the simulated rig does from the estimated state at a time on.

    The recorded commands that follow go on, except that a given speed takes the place of all recorded ones.

    Args:
        source: recording with estimates; its continuations are taken along.
        target: recording to write; an existing file is refused.
        at: s since sample 0; the beginning of the block at that time is taken.
        changes: `table.key=value` of the rig description, `command.hit=N` and `command.speed=Hz`.
        seconds: how long; None: to the end of the recorded blocks.
        progress: called with the sample index after each read.

    Raises:
        ForkError: there is no valid estimate at that time, or a change that is none.
        RecordingError: the source cannot be read or the target cannot be written.
        RigError: a change of the rig description is not allowed.
    """
    if not 0.0 <= at < LATEST:
        raise ForkError(f"--at {at:g}: name a time of the recording, in s from 0 on")
    with RecordedRun(source) as run:
        recorded = rig_from_text(run.description.toml, f"rig description in {run.path}")
        block = recorded.acquisition.block
        first = round(at * recorded.acquisition.rate) // block * block
        estimate = estimate_at(run, first)
        rig = forked_rig(recorded, estimate, [each for each in changes if not _is_command(each)])
        outputs = outputs_of(run.events(), recorded)
        script = script_of(outputs, rig, first, changes)
        set_point, slope = set_point_at(outputs, first, recorded.acquisition.rate)
        state = state_of(run, recorded, estimate, set_point, slope)
        closing = closing_speed(run, first)
        description = Description()
        description.CopyFrom(run.description)
        description.run, description.toml = run_of_fork(run.description.run, first), rig.toml
        description.first_sample, description.mode = first, "EMULATED"
        end = _end(run, first, seconds)
    device = Scripted(script)
    device.open(rig)
    device.begin_at(first, state, set_point, closing)
    with RecordingWriter(target, description) as writer:
        writer.note("fork", {"source": Path(source).name, "sample": str(first), "changes": " ".join(changes)})
        twin = Twin(rig, description.run, description.t0_ns)
        acquire(rig, device, writer, end, twin=twin, progress=progress)
        return writer.close()


def estimate_at(run: RecordedRun, sample: int) -> Series:
    """Return the recorded estimate that begins at a sample. Raises `ForkError` when there is no valid one."""
    found = [piece for file in run.files for piece in file.pieces("estimate", sample, sample)]
    seconds = sample / run.description.rate
    if not found or found[-1].first_sample != sample:
        raise ForkError(
            f"{run.path} holds no estimate at {seconds:.3f} s: name another time, or make estimates with "
            f"`rigtwin twin {run.path} -o OUT`"
        )
    if found[-1].status & (EstimateStatus.SETTLING | EstimateStatus.LOST):
        raise ForkError(
            f"the estimate at {seconds:.3f} s is not valid: the twin had just begun or lost track; "
            "name a later time"
        )
    return found[-1]


def forked_rig(recorded: Rig, estimate: Series, changes: Sequence[str]) -> Rig:
    """Return the described rig with the estimated unbalance and the changes, as far as the twin knows it.

    Raises:
        RigError: a change is not allowed.
    """
    tables = tomllib.loads(recorded.toml)
    tables.pop("unbalance_mass", None)  # the estimated unbalance is the whole of it
    for name in ("actual", "fault"):
        tables.get("emulator", {}).pop(name, None)
    values = values_at(estimate, 0)
    x, y = values["unbalance_x"], values["unbalance_y"]
    found = [f"rotor.unbalance={hypot(x, y):.9g}", f"rotor.unbalance_angle={atan2(y, x):.9g}"]
    return with_overrides(rig_from_text(tomli_w.dumps(tables)), [*found, *changes])


def script_of(recorded: Sequence[Written], rig: Rig, first: int, changes: Sequence[str]) -> list[Written]:
    """Return what is written to the forked rig from sample `first` on.

    Raises:
        ForkError: a hit is under way at that sample, or a command is none or beyond what the rig allows.
    """
    for each in recorded:
        length = each.output.duration if isinstance(each.output, HitOutput) else 0.0
        if each.effect < first < each.effect + length * rig.acquisition.rate:
            raise ForkError(
                f"a hit is under way at {first / rig.acquisition.rate:.3f} s: fork before it or after it"
            )
    moving = [each for each in recorded if isinstance(each.output, SpeedOutput | RestOutput)]
    before = [each._replace(effect=first) for each in moving if each.effect < first][-1:]
    given = [_given(change, rig, first) for change in changes if _is_command(change)]
    after = [each for each in recorded if each.effect >= first]
    if any(isinstance(each.output, SpeedOutput) for each in given):
        before, after = [], [each for each in after if each not in moving]
    return [*before, *given, *after]


def set_point_at(recorded: Sequence[Written], sample: int, rate: float) -> tuple[float, float]:
    """Return the speed's set-point (rad/s) at a sample, and how fast it changes (rad/s2)."""
    now, target, ramp, since = 0.0, 0.0, 1.0, 0
    for each in recorded:
        if each.effect < sample and isinstance(each.output, SpeedOutput | RestOutput):
            now = _moved(now, target, ramp * (each.effect - since) / rate)
            target = each.output.speed if isinstance(each.output, SpeedOutput) else 0.0
            ramp, since = each.output.ramp, each.effect
    now = _moved(now, target, ramp * (sample - since) / rate)
    return now, float(np.sign(target - now)) * ramp


def _moved(now: float, target: float, most: float) -> float:
    """Return a value that has gone towards a target by so much at most."""
    return now + float(np.clip(target - now, -most, most))


def state_of(run: RecordedRun, rig: Rig, estimate: Series, set_point: float, slope: float) -> np.ndarray:
    """Return the simulator's state (12,) at an estimate's first column.

    The speed controller's integral, which no sensor sees, is what holds the shaft on its ramp.
    """
    assert rig.model is not None
    values = values_at(estimate, 0)
    turns = _reading(run, TURNS, estimate.first_sample)
    counted = sense_of(rig) * (_reading(run, ENCODER, estimate.first_sample) + tau * turns)
    values["angle"] += tau * round((counted - values["angle"]) / tau)
    drive = rig.model.drive
    if drive.mode == DriveMode.MOTOR and drive.integral_gain > 0.0:
        error = set_point - values["speed"]
        torque = drive.inertia * slope
        values["speed_error_integral"] = (torque - drive.proportional_gain * error) / drive.integral_gain
    return resume(rig.model, values).state


def closing_speed(run: RecordedRun, sample: int) -> float:
    """Return the speed (m/s) at which the contact that is under way at a sample closed; 0 when there is none.

    It is that of the estimated penetration over its first columns, drawn back to the touch.
    """
    around = round(LONGEST_IMPACT * run.description.rate)
    found = run.series("estimate", ["penetration"], first=max(0, sample - around), last=sample + around)
    depth = found.samples[0].astype(np.float64)
    now = (sample - found.first_sample) // found.stride
    opened = np.flatnonzero(~(depth[: now + 1] > 0.0))
    onset = int(opened[-1]) + 1 if opened.size else 0
    first = depth[onset : onset + 3]
    if onset > now or first.size < 3 or not first[1] > first[0]:
        return 0.0
    rates = np.diff(first) * run.description.rate / found.stride
    since_touch = 0.5 + first[0] / (first[1] - first[0])  # columns, to the middle of the first two
    return float(rates[0] + since_touch * (rates[0] - rates[1]))


def _is_command(change: str) -> bool:
    return change.partition("=")[0].strip() in (HIT, SPEED)


def _given(change: str, rig: Rig, first: int) -> Written:
    """Return the output that a change asks for at the fork."""
    name, _, text = (part.strip() for part in change.partition("="))
    try:
        value = float(text)
    except ValueError:
        raise ForkError(f"--set {change}: {text!r} is no number") from None
    if name == SPEED:
        if not 0.0 <= value <= rig.command.max_speed_hz:
            raise ForkError(f"--set {change}: the rig's speed is 0 to {rig.command.max_speed_hz:g} Hz")
        return Written(first, first, SpeedOutput(value * tau, rig.command.default_ramp_hz_per_s * tau))
    if not rig.solenoids:
        raise ForkError(f"--set {change}: {rig.name} has no solenoid")
    solenoid = rig.solenoids[0]
    if not 0.0 < value <= solenoid.max_force:
        raise ForkError(f"--set {change}: {solenoid.name} hits with up to {solenoid.max_force:g} N")
    return Written(first, first, HitOutput(solenoid.name, value, min(HIT_DURATION, solenoid.max_duration)))


def _reading(run: RecordedRun, channel: str, sample: int) -> float:
    """Return a channel's reading at a sample; 0 where the rig has no such channel."""
    found = [piece for file in run.files for piece in file.pieces("block", sample, sample)]
    if not found or channel not in found[-1].names:
        return 0.0
    piece = found[-1]
    return float(piece.samples[piece.names.index(channel), sample - piece.first_sample])


def _end(run: RecordedRun, first: int, seconds: float | None) -> int:
    """Return the index behind the fork's last sample."""
    rate = run.description.rate
    if seconds is not None:
        if not 0.0 < seconds < LATEST:
            raise ForkError(f"--for {seconds:g}: how long is to be more than 0 s")
        return first + max(1, round(seconds * rate))
    block = keys.block(run.description.rig)
    return series_end(decode_series(run.last(block)[block].payload))
