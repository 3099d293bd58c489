"""Sound runs of many speeds, ramps, dwells and hits, drawn by seed: no fault may be named in them."""

from typing import NamedTuple

import numpy as np

from daq.rig import Rig
from tests.twin.cases import hidden_rig
from tests.twin.emulated import performed
from tests.twin.faults import BEARINGS, named

SPEED = 4.0, 20.0  # Hz that are gone to; the resonance is in their middle
STANDSTILL = 0.1  # share of the steps that go to 0 Hz
RAMP = 0.5, 10.0  # Hz/s, as often below as above the geometric mean
DWELL = 2.0, 40.0  # s
HIT = 0.25  # share of the dwells that begin with a hit
FORCE = 10.0, 60.0  # N
PULSE = 0.010  # s


class Alarm(NamedTuple):
    """A fault that was named where there is none."""

    rig: str
    seed: int
    time: float  # s of the run
    said: str


def drawn_plan(seed: int, seconds: float) -> str:
    """Return the text of a plan of at least so many seconds."""
    draw = np.random.default_rng([77, seed])
    lines = ["[plan]", 'name = "nominal"', f'description = "drawn by seed {seed}"']
    length, before = 0.0, 0.0
    while length < seconds:
        hz = 0.0 if draw.random() < STANDSTILL else draw.uniform(*SPEED)
        ramp, dwell = np.exp(draw.uniform(*np.log(RAMP))), draw.uniform(*DWELL)
        lines += ["[[step]]", 'do = "speed"', f"speed_hz = {hz}", f"ramp_hz_per_s = {ramp}"]
        if draw.random() < HIT:
            lines += ["[[step]]", 'do = "hit"', 'solenoid = "horizontal"']
            lines += [f"force = {draw.uniform(*FORCE)}", f"duration = {PULSE}"]
        lines += ["[[step]]", 'do = "wait"', f"duration = {dwell}"]
        length += abs(hz - before) / ramp + dwell
        before = hz
    return "\n".join(lines)


def sound_rig(seed: int) -> Rig:
    """Return a rig without a fault: the bearings in turn, the rest hidden as in case *mm*."""
    return hidden_rig(BEARINGS[seed % len(BEARINGS)], "mm", seed)


def alarms(seed: int, seconds: float) -> list[Alarm]:
    """Return the faults that are named in a run of so many seconds without any."""
    rig = sound_rig(seed)
    run = performed(rig, drawn_plan(seed, seconds), seconds)
    return [Alarm(rig.name, seed, time, str(fault)) for time, fault in named(rig, run)]
