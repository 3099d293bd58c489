"""Runs of the emulated rig, with their truth, straight from the unpaced emulator."""

from collections.abc import Iterator
from dataclasses import replace
from math import tau
from typing import NamedTuple

import numpy as np

from daq.backend import HitOutput, SpeedOutput
from daq.backends.emulator import Emulator
from daq.commanding.plan import Plan, plan_from_text
from daq.commanding.plan_runner import PlanRunner
from daq.messages import Series
from daq.rig import Rig


class EmulatedRun(NamedTuple):
    """A run: the calibrated blocks that the twin gets and the truth at every sample."""

    rig: Rig
    blocks: list[Series]
    truth: dict[str, np.ndarray]


def emulate(rig: Rig, plan: Plan | str, seconds: float | None = None, oversampling: int = 1) -> EmulatedRun:
    """Perform a plan (or its TOML text) on the emulated rig, for its whole length or for `seconds`.

    With `oversampling` the rig is simulated at that many times the sensors' rate.
    """
    blocks, truth = zip(*performed(rig, plan, seconds, oversampling), strict=True)
    rows = np.concatenate(truth, axis=1)
    return EmulatedRun(rig, list(blocks), dict(zip(Emulator.truth_names, rows, strict=True)))


def performed(
    rig: Rig, plan: Plan | str, seconds: float | None = None, oversampling: int = 1
) -> Iterator[tuple[Series, np.ndarray]]:
    """Yield block and truth of a plan as it is performed, as `emulate` does; no more is kept."""
    if isinstance(plan, str):
        plan = plan_from_text(plan, rig)
    fine = finer(rig, oversampling)
    device, runner = Emulator(paced=False), PlanRunner(plan, fine)
    rate, block = fine.acquisition.rate, fine.acquisition.block
    device.open(fine)
    device.start()
    count = int((plan.expected_duration(fine) if seconds is None else seconds) * rate) // block
    for _ in range(count):
        perform(device, runner, fine)
        values = np.empty((len(rig.channels), block))
        reading = device.read(values)
        rig.channels.calibrate(values, values)
        first = reading.first_sample // oversampling
        yield series_of(rig, first, values[:, ::oversampling]), device.truth()[:, ::oversampling].copy()


def finer(rig: Rig, times: int) -> Rig:
    """Return the rig sampled so many times as often, in blocks of the same duration."""
    taken = rig.acquisition
    more = {"rate": taken.rate * times, "read": taken.read * times, "block": taken.block * times}
    return replace(rig, acquisition=taken._replace(**more)) if times > 1 else rig


def perform(device: Emulator, runner: PlanRunner, rig: Rig) -> None:
    """Write the outputs of the plan's steps that are due."""
    for action in runner.due(device.clock()):
        values = action.values
        if action.command == "speed":
            ramp = values.get("ramp_hz_per_s", rig.command.default_ramp_hz_per_s)
            device.write(SpeedOutput(tau * values["speed_hz"], tau * ramp))
        elif action.command == "hit":
            device.write(HitOutput(action.texts["solenoid"], values["force"], values["duration"]))


def series_of(rig: Rig, first_sample: int, values: np.ndarray) -> Series:
    """Return calibrated values (n_channels, n) as the block that a subscriber decodes."""
    return Series(
        timestamp=first_sample / rig.acquisition.rate,
        run="test",
        first_sample=first_sample,
        rate=rig.acquisition.rate,
        status=0,
        stride=0,
        names=rig.channels.names,
        units=rig.channels.units,
        samples=values.astype(np.float32),
    )


def run_up(start_hz: float, end_hz: float, ramp_hz_per_s: float, dwell: float = 0.0) -> str:
    """Return the plan of a run-up, quick to `start_hz` and slow from there."""
    return f"""
[plan]
name = "run-up"
description = "run-up"

[[step]]
do = "wait"
duration = 0.2

[[step]]
do = "speed"
speed_hz = {start_hz}
ramp_hz_per_s = 20.0

[[step]]
do = "speed"
speed_hz = {end_hz}
ramp_hz_per_s = {ramp_hz_per_s}

[[step]]
do = "wait"
duration = {dwell}
"""
