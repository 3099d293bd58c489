"""Emulated rigs that differ from what the twin is told, drawn by seed, and their run-ups through impacts.

Two cases. *mm* (parameter mismatch): contact stiffness, damping and friction up to 20 % off, coupling force
up to 10 %, unbalance unknown. *struct* (the model's form is wrong as well): besides, restitution is latched
at each impact, friction is regularised over twice the slip, the clearance is 15 µm wider, the magnet 2 %
stiffer and 15 % less damped, probes read 0.5 % and transducers 2 % too much.

The truth is computed at 100 kHz, four times the sensors' rate, so that the observer's steps are not its own.
"""

from functools import cache

import numpy as np

from daq.rig import Rig, load_rig
from tests.twin.emulated import EmulatedRun, emulate, run_up

ACTUAL = "emulator.actual"
MISMATCH = 0.2  # of contact stiffness, damping and friction
COUPLING_MISMATCH = 0.1
OVERSAMPLING = 4
STRUCT_GAINS = {"displacement": 1.005, "force": 1.02}
SETTLED = 1.5  # s: the run-up has reached 8 Hz, and nothing has touched yet


def hidden_rig(name: str, case: str, seed: int) -> Rig:
    """Return a shipped rig whose emulation differs from its description: case `mm`, `struct` or `exact`.

    In case `exact` only unbalance, its angle and the noise are hidden.
    """
    draw = np.random.default_rng(seed)
    model = load_rig(name).model
    assert model is not None
    rotor, bearing, magnet = model.rotor, model.backup_bearing, model.magnetic_bearing
    changes = {
        "rotor.unbalance": rotor.unbalance * draw.uniform(0.8, 1.2),
        "rotor.unbalance_angle": draw.uniform(-np.pi, np.pi),
    }
    if case != "exact":
        for key in ("stiffness", "damping_factor", "friction"):
            value = getattr(bearing, key) * draw.uniform(1.0 - MISMATCH, 1.0 + MISMATCH)
            changes[f"backup_bearing.{key}"] = value
        coupling = draw.uniform(1.0 - COUPLING_MISMATCH, 1.0 + COUPLING_MISMATCH)
        changes["rotor.coupling_force"] = rotor.coupling_force * coupling
    if case == "struct":
        changes |= {
            "backup_bearing.damping_mode": '"latched"',
            "backup_bearing.slip_speed": 2.0 * bearing.slip_speed,
            "backup_bearing.clearance": bearing.clearance + 15e-6,
            "magnetic_bearing.stiffness": 1.02 * magnet.stiffness,
            "magnetic_bearing.damping": 0.85 * magnet.damping,
        }
    settings = [f"{ACTUAL}.{key}={value}" for key, value in changes.items()]
    return load_rig(name, [*settings, f"emulator.seed={seed}"])


@cache
def case_run(name: str, case: str, seed: int) -> EmulatedRun:
    """Return the run-up from 8 to 17 Hz of a hidden rig; made once."""
    run = emulate(hidden_rig(name, case, seed), run_up(8.0, 17.0, 1.2), oversampling=OVERSAMPLING)
    if case == "struct":
        for row, channel in enumerate(run.rig.channels):
            gain = STRUCT_GAINS.get(channel.quantity, 1.0)
            for block in run.blocks:
                block.samples[row] *= np.float32(gain)
    return run
