"""Runs of the model that branch off one moment again and again, in memory that is made once."""

from math import tau
from typing import NamedTuple

import numpy as np

from daq.rig.limits import Limits
from simulator.rig import Solenoid
from simulator.simulation import Moment, Simulation
from simulator.state import SIGNALS, STATE
from twin.resume import Resumed

CHUNK = 0.1  # s of a run at a time
ANGLE, SPEED = STATE.index("angle"), STATE.index("speed")
TILT, HOUSE, NORMAL = SIGNALS.index("tilt_x"), SIGNALS.index("house_x"), SIGNALS.index("normal_force")


class Peaks(NamedTuple):
    """What a run came to."""

    radius: float  # m, largest of the shaft's centre at the backup bearing
    contact_force: float  # N, largest normal force
    transducer_force: float  # N, largest resultant
    quiet: float  # s without contact at its end

    def trip(self, limits: Limits) -> bool:
        """Tell whether a run trips the limits of displacement or force."""
        return self.radius > limits.displacement.trip or self.transducer_force > limits.force.trip


class Branch:
    """A rig as it may be, of which runs branch off.

    Args:
        resumed: model, with a prescribed speed, and state to begin with.
        rate: samples a second.

    Raises:
        RigError: the model cannot be simulated.
    """

    def __init__(self, resumed: Resumed, rate: float) -> None:
        self._simulation = Simulation(resumed.model, rate, resumed.state)
        self._station = resumed.model.rotor.bearing_station
        self._stiffness = 2.0 * resumed.model.housing.transducer_stiffness
        self._signals = np.empty(len(SIGNALS) * round(CHUNK * rate))

    def moment(self) -> Moment:
        """Return where the run is."""
        return self._simulation.moment()

    def back_to(self, moment: Moment) -> None:
        """Go on from a moment of this branch, without the hits that came after it."""
        self._simulation.back_to(moment)

    def set_speed(self, speed: float, ramp: float) -> None:
        """Ramp to a speed (rad/s) with a ramp (rad/s2)."""
        self._simulation.set_speed(speed, ramp)

    def hit(self, solenoid: Solenoid, force: float, duration: float) -> None:
        """Begin a half-sine pulse: peak `force` (N), `duration` (s)."""
        self._simulation.hit(solenoid, force, duration)

    def to_angle(self, angle: float) -> None:
        """Run to the next sample at or behind a shaft angle (rad), at constant speed."""
        speed = float(self._simulation.state[SPEED])
        turn = (angle - float(self._simulation.state[ANGLE])) % tau
        self._advance(int(np.ceil(turn / abs(speed) * self._simulation.rate)))

    def run(self, seconds: float) -> Peaks:
        """Run for `seconds`. Raises `SimulationError` when the model diverges."""
        return self._run(seconds, np.inf)

    def run_until_quiet(self, quiet: float, within: float) -> Peaks:
        """Run until there was no contact for `quiet` seconds, or that cannot be `within` seconds any more."""
        return self._run(within, quiet)

    def _run(self, seconds: float, quiet: float) -> Peaks:
        rate = self._simulation.rate
        left, peaks = round(seconds * rate), Peaks(0.0, 0.0, 0.0, 0.0)
        while left > 0 and peaks.quiet < quiet and (quiet == np.inf or peaks.quiet + left / rate >= quiet):
            count = min(left, round(CHUNK * rate))
            peaks = self._joined(peaks, self._advance(count))
            left -= count
        return peaks

    def _advance(self, count: int) -> np.ndarray:
        """Run `count` samples, at most a chunk, and return the true signals (17, count)."""
        signals = self._signals[: len(SIGNALS) * count].reshape(len(SIGNALS), count)
        self._simulation.advance(signals)
        return signals

    def _joined(self, before: Peaks, signals: np.ndarray) -> Peaks:
        """Return the peaks with those of true signals that follow."""
        normal = signals[NORMAL]
        touching = np.flatnonzero(normal)
        quiet = signals.shape[1] - 1 - touching[-1] if touching.size else signals.shape[1]
        length = float(quiet) / self._simulation.rate
        return Peaks(
            max(before.radius, self._station * largest(signals[TILT], signals[TILT + 1])),
            max(before.contact_force, float(normal.max(initial=0.0))),
            max(before.transducer_force, self._stiffness * largest(signals[HOUSE], signals[HOUSE + 1])),
            length if touching.size else before.quiet + length,
        )


def largest(x: np.ndarray, y: np.ndarray) -> float:
    """Return the largest length of vectors given by their components (n,)."""
    return float(np.sqrt((x * x + y * y).max(initial=0.0)))
