"""Watches a steady contact-free orbit for changes: of the probes, or of the unbalance."""

from cmath import exp
from math import pi, sqrt

import numpy as np

from analysis.cusum import Cusum
from analysis.orbit_change import Cause, Steady, cause_of, combined, difference, steady_orbit
from daq.rig import Rig
from simulator.rig import Model
from twin.fault import Fault
from twin.windows import Window

QUIET = 1.3  # times the probes' noise that a steady orbit's fit may leave
EVEN = 0.5  # rad/s by which the speed may vary in nine tenths of a window
REFERENCE = 2  # windows whose mean is the orbit that others are compared with, at least
MOST_REFERENCE = 8  # as long as nothing is unusual
USUAL, THRESHOLD, MOST = 1.5, 8.0, 7.0  # of the cumulative sum of mean squares of deviations
LEAST_UNBALANCE = 0.02  # of the described one: near the resonance a speed not quite steady looks like less
SPEED_STEP = 0.5  # rad/s by which speeds are told apart


class ProbeWatch:
    """Compares each steady orbit with the first ones at its speed.

    Args:
        rig: with a model and displacement channels that have a direction.
        noise: m rms of a probe.
    """

    def __init__(self, rig: Rig, noise: float) -> None:
        assert rig.model is not None
        probes = [each for each in rig.channels if each.quantity == "displacement" and each.station]
        self._names = [each.name for each in probes]
        self._directions = [exp(1j * pi / 180.0 * (each.angle_deg or 0.0)) for each in probes]
        self._station = probes[0].station or 0.0
        self._noise = noise
        self._model = rig.model
        self._frequency, self._decay = vibration(rig.model)
        self._references: dict[int, list[Steady]] = {}
        self._sum = Cusum(USUAL, THRESHOLD, MOST)

    def add(self, window: Window) -> list[Fault]:
        """Take in a window and return what it proves."""
        speed = float(np.mean(window.speed))
        if np.ptp(np.quantile(window.speed, (0.05, 0.95))) > EVEN or abs(speed) < EVEN or not window.free:
            return []
        readings = window.probes[:, window.columns]
        orbit = steady_orbit(window.angle, window.time, readings, self._frequency, self._decay)
        if (orbit.residual > QUIET * self._noise).any():
            return []
        number = round(speed / SPEED_STEP)
        orbit = orbit._replace(vector=orbit.vector * self._as_at(number * SPEED_STEP, speed))
        seen = self._references.setdefault(number, [])
        if len(seen) < REFERENCE:
            seen.append(orbit)
            return []
        reference = combined(seen)
        change = difference(reference, orbit)
        if not self._sum.add(float(np.mean(change**2)), window.first_sample):
            if self._sum.onset is None and len(seen) < MOST_REFERENCE:
                seen.append(orbit)
            return []
        onset = self._sum.onset if self._sum.onset is not None else window.first_sample
        self.forget()
        fault = self._fault(cause_of(reference, orbit, self._directions, speed), speed, onset)
        small = LEAST_UNBALANCE * self._model.rotor.unbalance
        return [] if fault.kind == "unbalance" and fault.size < small else [fault]

    def forget(self) -> None:
        """Learn what is usual anew."""
        self._references.clear()
        self._sum.reset()

    def _as_at(self, speed: float, now: float) -> complex:
        """Return by what the orbit's vector at one speed (rad/s) differs from that at the speed now."""
        one, other = (response(self._model, each, self._station) for each in (speed, now))
        return one / other

    def _fault(self, cause: Cause, speed: float, onset: int) -> Fault:
        """Return a cause as a fault, with its size in a unit that says something."""
        channel = self._names[cause.probe] if cause.probe >= 0 else ""
        sizes = {
            "gain": (1.0 + cause.size.real, ""),
            "skew": (cause.size.real, "s"),
            "drift": (cause.size.real, "m"),
            "runout": (abs(cause.size), "m"),
            "unbalance": (abs(cause.size / response(self._model, speed, self._station)), "kg m"),
        }
        return Fault(cause.kind, channel, *sizes[cause.kind], cause.confidence, onset)


def vibration(model: Model) -> tuple[float, float]:
    """Return the rotor's natural frequency (rad/s) and its decay (1/s), without contact."""
    rotor, magnet = model.rotor, model.magnetic_bearing
    arm = rotor.magnet_station**2
    stiffness = magnet.stiffness * arm + rotor.pivot_stiffness
    return sqrt(stiffness / rotor.inertia), 0.5 * magnet.damping * arm / rotor.inertia


def response(model: Model, speed: float, station: float) -> complex:
    """Return the 1X vector at a station (m) by a kg m of unbalance, without contact."""
    rotor, magnet = model.rotor, model.magnetic_bearing
    arm = rotor.magnet_station**2
    impedance = (
        magnet.stiffness * arm
        + rotor.pivot_stiffness
        - (rotor.inertia - rotor.polar_inertia) * speed**2
        + 1j * magnet.damping * arm * speed
    )
    return station * rotor.disk_station * speed**2 / impedance
