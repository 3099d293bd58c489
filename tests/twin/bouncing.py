"""An emulated rig, unlike its description, that has run up into impacts, with the observer beside it."""

from collections.abc import Sequence
from copy import deepcopy
from math import tau

import numpy as np

from daq.backend import HitOutput, SpeedOutput
from daq.backends.emulator import Emulator
from daq.messages_pb2 import Parameter
from daq.rig import Rig, load_rig
from daq.shaft import Motion
from simulator.rig import Solenoid
from tests.twin.emulated import series_of
from twin.advisor import Hit
from twin.observer import Observer
from twin.resume import rows_of

LOWEST, HIGHEST = 14.0, 15.5  # Hz at which impacts go on although the rotor could run free


class BouncingRig:
    """Runs up slowly through the resonance to a speed (Hz) at which it stays in impacts."""

    def __init__(self, rig: Rig, hz: float) -> None:
        self.rig = rig
        self.observer = Observer(rig)
        self.device = Emulator(paced=False)
        self.device.open(rig)
        self.device.start()
        self.values: dict[str, float] = {}
        self.device.write(SpeedOutput(8.0 * tau, 20.0 * tau))
        self.go(0.5)
        self.device.write(SpeedOutput(hz * tau, 1.5 * tau))
        self.go((hz - 8.0) / 1.5 + 1.0)

    def go(self, seconds: float) -> dict[str, np.ndarray]:
        """Run on; keep the newest estimate and return the truth of the stretch."""
        truth = []
        for _ in range(round(seconds * self.rig.acquisition.rate / self.rig.acquisition.block)):
            values = np.empty((len(self.rig.channels), self.rig.acquisition.block))
            reading = self.device.read(values)
            truth.append(self.device.truth().copy())
            self.rig.channels.calibrate(values, values)
            estimated = self.observer.update(series_of(self.rig, reading.first_sample, values))
            self.values = dict(zip(estimated.names, estimated.samples[:, -1].tolist(), strict=True))
        self.values |= rows_of(Parameter(**each._asdict()) for each in self.observer.identified()[0])
        return dict(zip(self.device.truth_names, np.concatenate(truth, axis=1), strict=True))

    def is_bouncing(self) -> bool:
        """Run on for a second and tell whether there was contact in its last half."""
        return bool(self.go(1.0)["normal_force"][-12500:].any())

    def freed_by(self, hit: Hit) -> bool:
        """Tell whether a hit would free the rotor, without doing it."""
        copy = deepcopy(self)
        motion = Motion(copy.device.clock(), self.values["angle"], self.values["speed"] / 25000.0)
        sample = motion.passage(hit.angle, copy.device.clock() + 50)
        copy.device.write(HitOutput(hit.solenoid, hit.force, hit.duration), sample)
        copy.go(1.2)
        return not copy.is_bouncing()


def drawn_rig(name: str, seed: int) -> BouncingRig:
    """Return a rig of which contact and coupling are 10 to 20 and 5 % off, and the unbalance is not told."""
    draw = np.random.default_rng(seed)
    model = load_rig(name).model
    assert model is not None
    bearing, actual = model.backup_bearing, "emulator.actual"
    off = {
        key: getattr(bearing, key) * (1.0 + draw.choice([-1, 1]) * draw.uniform(0.1, 0.2))
        for key in ("stiffness", "damping_factor", "friction")
    }
    settings = [f"{actual}.backup_bearing.{key}={value}" for key, value in off.items()]
    settings += [
        f"emulator.seed={seed}",
        f"{actual}.rotor.unbalance={model.rotor.unbalance * draw.uniform(0.9, 1.1)}",
        f"{actual}.rotor.unbalance_angle={draw.uniform(-np.pi, np.pi)}",
        f"{actual}.rotor.coupling_force={model.rotor.coupling_force * draw.uniform(0.95, 1.05)}",
    ]
    return BouncingRig(load_rig(name, settings), draw.uniform(LOWEST, HIGHEST))


def drawn_hit(solenoids: Sequence[Solenoid], chance: np.random.Generator) -> Hit:
    """Return a hit at random within the solenoids' limits."""
    solenoid = solenoids[chance.integers(len(solenoids))]
    share, length, turn = chance.uniform(0.05, 1.0, size=3)
    return Hit(solenoid.name, share * solenoid.max_force, length * solenoid.max_duration, turn * tau)
