"""The guided installation of a rig: what its description must say, found on the device itself.

First the device only reads, at rest and while the shaft is pushed round the bearing's wall. Then, with the
offsets that this gave, the rig runs under the daq's own protection, commands and envelope: a slow roll, and
a small hit of each solenoid.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from datetime import date
from math import atan2, cos, degrees, radians, sin
from typing import Any

import numpy as np
from numpy.typing import NDArray

from daq import keys
from daq.acquisition import Acquisition
from daq.backend import Backend
from daq.guard import displacement_planes
from daq.installation import Roll, Values, Wall, answers, roll_of, wall_of
from daq.messages import decode_series
from daq.messages_pb2 import Command
from daq.rig import Rig, RigError, rig_from_text, toml_source
from daq.rig.channels import Channel
from daq.shaft import ENCODER

REST = 1.0  # s of readings at rest
PUSH = 8.0  # s that the shaft is pushed round
TOUCH = (1.0, 5.0)  # N between which the shaft is taken to just touch the wall
ROLL_HZ, ROLL = 1.0, 6.0  # Hz and s of the slow roll, after it has come to its speed
HIT_FORCE, HIT_DURATION, HIT_WATCHED = 3.0, 0.01, 0.03  # N, s, s
TARED = ("force", "current", "speed")
WHO = "rig setup"


@dataclass
class Findings:
    """What was found, in the order in which it is."""

    rest: dict[str, tuple[float, float]] = field(default_factory=dict)  # raw mean and rms noise, by channel
    wall: Wall | None = None
    roll: Roll | None = None
    hits: dict[str, float] = field(default_factory=dict)  # m along the solenoid's direction, by name


class Setup:
    """Sets up one rig.

    Args:
        rig: its description so far.
        connect: opens the device for a description and returns it; called for each phase.
        push: called with the device when the shaft is to be pushed round; returns when it may be read.
    """

    def __init__(
        self, rig: Rig, connect: Callable[[Rig], Backend], push: Callable[[Backend], object]
    ) -> None:
        self.findings = Findings()
        self._rig = rig
        self._tables = toml_source.parse(rig.toml, rig.name)
        self._connect = connect
        self._push = push

    def read(self) -> None:
        """Tare the channels at rest and find the wall's centre. Raises `RigError` or `BackendError`."""
        device = self._connect(self._rig)
        try:
            device.start()
            rest = collect(device, self._rig, REST)
            self._tare(rest)
            probes, planes = self._probes()
            if planes:
                self._push(device)
                self._centre(collect(device, self._rig, PUSH), rest, probes)
        finally:
            device.close()

    def turn(self) -> None:
        """Roll slowly and hit softly, under protection. Raises `RigError` or `BackendError`."""
        rig = self.rig()
        device = self._connect(rig)
        try:
            run = Run(rig, device)
            run.ask("arm", plan=WHO)
            if ENCODER in rig.channels:
                run.ask("speed", speed_hz=ROLL_HZ)
                run.go(1.0 + ROLL_HZ / rig.command.default_ramp_hz_per_s)
                self._roll(run.go(ROLL), rig)
                run.ask("speed", speed_hz=0.0)
                run.go(2.0)
            times_hits = (device.capabilities.longest_pulse_s or 0.0) >= HIT_DURATION
            for solenoid in rig.solenoids if times_hits else ():
                before = run.go(0.2)
                run.ask(
                    "hit",
                    solenoid=solenoid.name,
                    force=min(HIT_FORCE, solenoid.max_force),
                    duration=HIT_DURATION,
                )
                self._answer(solenoid.name, before, run.go(HIT_WATCHED), rig)
                run.go(2.0)
            run.ask("stop")
        finally:
            device.close()

    def rig(self, name: str = "", day: date | None = None) -> Rig:
        """Return the rig as found so far, under another name. Raises `RigError`."""
        head = self._tables["rig"]
        if name:
            head = head | {"name": name}
        if day:
            head = head | {"description": f"{self._rig.description}; set up on {day}"}
        return rig_from_text(toml_source.dump(self._tables | {"rig": head}), "the rig as set up")

    def _tare(self, raw: Values) -> None:
        """Take the readings at rest, and let what is zero there read zero."""
        for row, channel in zip(self._rows(), self._rig.channels, strict=True):
            values = raw[self._rig.channels.index(channel.name)]
            self.findings.rest[channel.name] = float(values.mean()), float(values.std())
            if channel.quantity in TARED and not channel.name.endswith("_command"):
                row["offset"] = round(float(values.mean()), 6)

    def _probes(self) -> tuple[list[Channel], bool]:
        """Return the displacement probes, and whether they show both directions."""
        probes = [
            each for each in self._rig.channels.of_quantity("displacement") if each.angle_deg is not None
        ]
        planes = displacement_planes(tuple(self._rig.channels), None)
        return probes, len(planes) == 1 and bool(np.all(np.abs(planes[0].weights).sum(axis=1) > 0.0))

    def _centre(self, raw: Values, rest: Values, probes: list[Channel]) -> None:
        """Find the wall's circle and let the probes read zero in its centre."""
        wall = self.findings.wall = wall_of(touching(raw, rest, self._rig))
        for row in self._rows():
            for probe in probes:
                if row["name"] == probe.name:
                    assert probe.angle_deg is not None
                    angle = radians(probe.angle_deg)
                    along = wall.centre @ np.array([cos(angle), sin(angle)])
                    row["offset"] = round(probe.offset + probe.sensitivity * float(along), 6)

    def _roll(self, values: Values, rig: Rig) -> None:
        """Find the encoder's sense and each probe's runout."""
        probes = rig.channels.of_quantity("displacement")
        signals = values[[rig.channels.index(each.name) for each in probes]]
        angle = values[rig.channels.index(ENCODER)]
        roll = self.findings.roll = roll_of(angle, signals, rig.acquisition.rate)
        if rig.encoder:
            counts = rig.channels[ENCODER].sensitivity
            direction = 1 if roll.counts_up == (counts > 0.0) else -1
            index = -direction * degrees(self.findings.rest[ENCODER][0] / abs(counts))
            self._tables["encoder"] |= {"direction": direction, "index_angle_deg": round(wrapped(index), 3)}
        for probe, vector in zip(probes, roll.runout, strict=True):
            for row in self._rows():
                if row["name"] == probe.name:
                    row["runout"] = round(float(abs(vector)), 9)
                    row["runout_deg"] = round(degrees(atan2(vector.imag, vector.real)), 2)

    def _answer(self, name: str, before: Values, after: Values, rig: Rig) -> None:
        """Find which way a solenoid pushes; turn its direction round where that is the other one."""
        (plane,) = displacement_planes(tuple(rig.channels), None)[:1]
        weights = plane.weights.astype(float)
        angle = radians(rig.solenoid(name).angle_deg)
        direction = np.array([cos(angle), sin(angle)])
        way = answers(weights @ before[plane.rows], weights @ after[plane.rows], direction)
        self.findings.hits[name] = way
        if way < 0.0:
            for row in self._tables["solenoid"]:
                if row["name"] == name:
                    row["angle_deg"] = (row["angle_deg"] + 180.0) % 360.0

    def _rows(self) -> list[dict[str, Any]]:
        rows: list[dict[str, Any]] = self._tables["channel"]
        return rows


class Run:
    """A short run of the rig with all that protects it; gives the samples in the channels' units."""

    def __init__(self, rig: Rig, device: Backend) -> None:
        self._rig = rig
        self._block = keys.block(rig.name)
        self._blocks: list[NDArray[np.float32]] = []
        self._lease = ""
        self._daq = Acquisition(rig, device, self._hear, run="setup")
        self._daq.begin()

    def ask(self, name: str, **given: float | str) -> None:
        """Send a command. Raises `RigError` when it is refused."""
        texts = {key: value for key, value in given.items() if isinstance(value, str)}
        values = {key: value for key, value in given.items() if not isinstance(value, str)}
        answer = self._daq.serve(Command(name=name, who=WHO, lease=self._lease, values=values, texts=texts))
        if not answer.accepted:
            raise RigError(f"{name} was refused: {answer.text}")
        self._lease = answer.lease or self._lease

    def go(self, seconds: float) -> Values:
        """Run on and return the samples (n_channels, n) of that time. Raises `RigError` when it trips."""
        self._blocks.clear()
        end = self._daq.sample + round(seconds * self._rig.acquisition.rate)
        while self._daq.sample < end:
            time.sleep(self._daq.due())
            self._daq.step()
            self._daq.renew(self._lease)
            if self._daq.first_out:
                raise RigError(f"the rig tripped during its setup: {self._daq.first_out}; it is at rest now")
        return np.concatenate(self._blocks, axis=1).astype(float) if self._blocks else np.empty((0, 0))

    def _hear(self, key: str, payload: bytes) -> None:
        if key == self._block:
            self._blocks.append(decode_series(payload).samples)


def collect(device: Backend, rig: Rig, seconds: float) -> Values:
    """Return raw readings (n_channels, n) of so many seconds from now on."""
    raw = np.empty((len(rig.channels), rig.acquisition.read))
    parts: list[Values] = []
    missing = round(seconds * rig.acquisition.rate)
    while missing > 0:
        count = device.read(raw).n_samples
        if not count:
            time.sleep(rig.acquisition.read / rig.acquisition.rate)
            continue
        parts.append(raw[:, :count].copy())
        missing -= count
    return np.concatenate(parts, axis=1)


def touching(raw: Values, rest: Values, rig: Rig) -> Values:
    """Return the shaft's centres (2, n) in the probes' plane, m, where it just touches the wall.

    That is where the resultant force on the bearing is small but not zero; a rig without transducers takes
    the places farthest from the middle.
    """
    width = rig.acquisition.read
    count = raw.shape[1] // width
    means = raw[:, : count * width].reshape(len(raw), count, width).mean(axis=2)
    values = rig.channels.calibrate(means, np.empty_like(means))
    (plane,) = displacement_planes(tuple(rig.channels), None)
    points: Values = plane.weights.astype(float) @ values[plane.rows]
    forces = [each for each in rig.channels.of_quantity("force") if each.angle_deg is not None]
    if forces:
        rows = [rig.channels.index(each.name) for each in forces]
        gains = np.array([[each.sensitivity] for each in forces])
        pressed = (means[rows] - rest[rows].mean(axis=1, keepdims=True)) / gains
        angles = np.radians([each.angle_deg for each in forces if each.angle_deg is not None])
        force = np.hypot(np.cos(angles) @ pressed, np.sin(angles) @ pressed)
        return points[:, (force > TOUCH[0]) & (force < TOUCH[1])]
    away = np.hypot(*(points - points.mean(axis=1, keepdims=True)))
    return points[:, away > np.quantile(away, 0.9)]


def wrapped(angle: float) -> float:
    """Return an angle in degrees within -180 to 180."""
    return (angle + 180.0) % 360.0 - 180.0
