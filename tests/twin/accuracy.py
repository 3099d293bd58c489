"""How near an account of a run is to its truth: motion, impacts pin by pin, and whether doubts are fair."""

from collections.abc import Sequence
from math import pi, sqrt
from typing import NamedTuple

import numpy as np

from analysis.impacts import Comparison, Impacts, compare_impacts, correlation, find_impacts
from simulator.law import latched_factor
from simulator.rig import BearingKind, DampingMode, Model
from simulator.simulation import checked
from tests.twin.cases import SETTLED
from tests.twin.emulated import EmulatedRun
from twin.estimate import STRIDE, Estimated, EstimateStatus
from twin.observer import Observer
from twin.smoothing import MOTION, NAMES, Smoothed, Smoothing

LEAST = 5.0  # N, peak from which an impact must be met
TOLERANCE = 25  # samples by which impacts may be apart
CLEARLY = 1.2  # times another pin's force from which the pin that is hit can be named
ROTOR = ("tilt_x", "tilt_y", "tilt_rate_x", "tilt_rate_y")


class Trace(NamedTuple):
    """One method's account of a run, each `STRIDE`-th sample: (n,) or (2, n)."""

    forces: np.ndarray  # (n_pins or 1, n) N, normal force at each pin, or in all
    place: np.ndarray  # (2, n) m, shaft centre at the bearing's plane
    velocity: np.ndarray  # (2, n) m/s
    threshold: float = 0.1  # N from which it is an impact


class Errors(NamedTuple):
    """One method's errors over the runs of a case."""

    correlation: float  # of the normal force
    peak_errors: np.ndarray  # relative, one for each impact that was met
    impulse_errors: np.ndarray
    impacts: int  # that had to be met
    missed: int
    false_alarms: int
    position: float  # m rms
    velocity: float  # m/s rms
    right_pin: float  # share of the impacts at whose peak the estimate presses hardest on the same pin

    def within(self, errors: np.ndarray, bound: float) -> float:
        """Return the share of all impacts whose relative error is within a bound."""
        return np.count_nonzero(np.abs(errors) < bound) / max(self.impacts, 1)


class Calibration(NamedTuple):
    """Whether the observer's doubts are fair, over the runs of a case."""

    error: float  # normalised estimation error squared of the rotor's motion, per degree of freedom
    innovations: np.ndarray  # (n_sensors,) normalised, squared, mean
    one_sigma: float  # share of positions and velocities within one standard deviation
    two_sigma: float
    force_one_sigma: float  # the same of the normal force, where it is above `LEAST`
    force_two_sigma: float


class Hindsight(NamedTuple):
    """What smoothing makes better, over the columns that are smoothed."""

    share: float  # of the contact-free columns, once settled, that are smoothed
    filter_position: float  # m rms, along an axis
    filter_velocity: float  # m/s rms
    position: float
    velocity: float
    one_sigma: float  # share of smoothed positions and velocities within one standard deviation
    two_sigma: float


class Observation(NamedTuple):
    """An observer's estimates of a whole run."""

    run: EmulatedRun
    parts: list[Estimated]
    errors_squared: np.ndarray  # normalised, of the rotor's motion at each block's end, once settled
    observer: Observer
    smoothed: list[Smoothed]  # empty unless it was asked for

    def row(self, name: str) -> np.ndarray:
        """Return one output over the run."""
        return np.concatenate([part.row(name) for part in self.parts])

    @property
    def lost(self) -> int:
        """Blocks in which the observer lost the state."""
        return sum(bool(part.status & EstimateStatus.LOST) for part in self.parts)


def observe(
    run: EmulatedRun, observer: Observer | None = None, without: Sequence[str] = (), smooth: bool = False
) -> Observation:
    """Let an observer see a run, `without` the channels whose names begin so, and `smooth` its motion."""
    observer = observer or Observer(run.rig)
    smoothing, smoothed = Smoothing(observer), []
    deaf = [row for row, name in enumerate(run.rig.channels.names) if name.startswith(tuple(without))]
    parts, squared = [], []
    for block in run.blocks:
        samples = block.samples.copy()
        if without:
            samples[deaf] = np.nan
        block = block._replace(samples=samples)
        parts.append(observer.update(block))
        if smooth:
            smoothed += smoothing.add(block, parts[-1])
        last = block.first_sample + samples.shape[1] - 1
        if last > SETTLED * run.rig.acquisition.rate:
            truth = np.array([run.truth[name][last] for name in ROTOR])
            squared.append(normalised(observer.memory.state[:4] - truth, observer.memory.covariance[:4, :4]))
    return Observation(run, parts, np.array(squared), observer, smoothed + smoothing.finish())


def normalised(error: np.ndarray, covariance: np.ndarray) -> float:
    """Return an error's (n,) square over its covariance (n, n), per degree of freedom."""
    return float(error @ np.linalg.solve(covariance, error)) / error.size


def trace_of(seen: Observation) -> Trace:
    """Return the observer's account."""
    pins = [name for name in seen.observer.names if name.startswith("pin_") and name.endswith("_force")]
    return Trace(
        np.stack([seen.row(name) for name in pins or ["normal_force"]]),
        np.stack([seen.row("displacement_x"), seen.row("displacement_y")]),
        np.stack([seen.row("velocity_x"), seen.row("velocity_y")]),
    )


def errors_of(runs: Sequence[EmulatedRun], traces: Sequence[Trace]) -> Errors:
    """Compare accounts with the truth of their runs."""
    peaks, impulses, places, velocities, correlations, pins = [], [], [], [], [], []
    impacts = missed = alarms = 0
    for run, trace in zip(runs, traces, strict=True):
        model = run.rig.emulated_model
        truth = pin_forces(run, checked(model))
        rate, station = run.rig.acquisition.rate, model.rotor.bearing_station
        if len(trace.forces) < len(truth):
            truth = truth.sum(axis=0, keepdims=True)
        for index, (true_force, force) in enumerate(zip(truth, trace.forces, strict=True)):
            reference = find_impacts(true_force, rate)
            found = compared(reference, force, rate, trace.threshold)
            peaks.append(found.peak_error)
            impulses.append(found.impulse_error)
            impacts += int(np.count_nonzero(reference.peak > LEAST))
            missed += found.missed.size
            alarms += found.false_alarms.size
            columns = peak_columns(reference, true_force)
            columns = columns[is_alone(truth[:, ::STRIDE][:, columns], index)]
            pins.append(np.argmax(trace.forces[:, columns], axis=0) == index)
        correlations.append(correlation(truth.sum(axis=0)[::STRIDE], trace.forces.sum(axis=0)))
        places.append(rms(run, trace.place, station, "tilt"))
        velocities.append(rms(run, trace.velocity, station, "tilt_rate"))
    return Errors(
        float(np.mean(correlations)),
        np.concatenate(peaks),
        np.concatenate(impulses),
        impacts,
        missed,
        alarms,
        float(np.mean(places)),
        float(np.mean(velocities)),
        float(np.mean(np.concatenate(pins))),
    )


def compared(reference: Impacts, force: np.ndarray, rate: float, threshold: float) -> Comparison:
    """Compare a trace of force at each `STRIDE`-th sample with the impacts of the truth."""
    seen = find_impacts(force, rate / STRIDE, threshold)
    seen = seen._replace(start=seen.start * STRIDE, end=seen.end * STRIDE)
    return compare_impacts(reference, seen, TOLERANCE, LEAST)


def peak_columns(impacts: Impacts, force: np.ndarray) -> np.ndarray:
    """Return the column of each impact's peak in an account, of the impacts that must be met."""
    chosen = impacts.select(impacts.peak > LEAST)
    spans = zip(chosen.start, chosen.end, strict=True)
    return np.array([(start + np.argmax(force[start:end])) // STRIDE for start, end in spans], dtype=int)


def is_alone(forces: np.ndarray, pin: int) -> np.ndarray:
    """Tell for each column of (n_pins, n) whether a pin's force is clearly above that of all others."""
    others = np.delete(forces, pin, axis=0).max(axis=0, initial=0.0)
    return forces[pin] > CLEARLY * others


def rms(run: EmulatedRun, seen: np.ndarray, station: float, name: str) -> float:
    """Return the rms error along one axis of (2, n) at the bearing's plane, once settled."""
    start = int(SETTLED * run.rig.acquisition.rate) // STRIDE
    truth = station * np.stack([run.truth[f"{name}_{axis}"] for axis in "xy"])[:, ::STRIDE]
    return sqrt(float(np.mean((seen - truth)[:, start:] ** 2)))


def calibration_of(observations: Sequence[Observation]) -> Calibration:
    """Judge the observer's doubts over the runs of a case."""
    motion, force, innovations = [], [], []
    for seen in observations:
        run = seen.run
        station = run.rig.emulated_model.rotor.bearing_station
        start = int(SETTLED * run.rig.acquisition.rate) // STRIDE
        for name, true, scale in (("displacement", "tilt", station), ("velocity", "tilt_rate", station)):
            for axis in "xy":
                error = seen.row(f"{name}_{axis}") - scale * run.truth[f"{true}_{axis}"][::STRIDE]
                motion.append((error / seen.row(f"{name}_{axis}_sigma"))[start:])
        truth = run.truth["normal_force"][::STRIDE]
        pressed = truth > LEAST
        error = seen.row("normal_force") - truth
        force.append(error[pressed] / seen.row("normal_force_sigma")[pressed])
        innovations += [part.ratios for part in seen.parts[start * STRIDE // 250 :]]
    moved, pushed = np.abs(np.concatenate(motion)), np.abs(np.concatenate(force))
    return Calibration(
        float(np.mean(np.concatenate([seen.errors_squared for seen in observations]))),
        np.nanmean(innovations, axis=0),
        float(np.mean(moved < 1.0)),
        float(np.mean(moved < 2.0)),
        float(np.mean(pushed < 1.0)),
        float(np.mean(pushed < 2.0)),
    )


def hindsight_of(observations: Sequence[Observation]) -> Hindsight:
    """Compare smoothed motion with the filter's, where it is smoothed and the run has settled."""
    errors, before, normal, flown = [], [], [], 0
    for seen in observations:
        start = int(SETTLED * seen.run.rig.acquisition.rate) // STRIDE
        smoothed = np.concatenate([each.samples for each in seen.smoothed], axis=1)
        chosen = smoothed[NAMES.index("smoothed")] == 1.0
        chosen[:start] = False
        flown += np.count_nonzero(seen.run.truth["normal_force"][::STRIDE][start:] == 0.0)
        truth = seen.run.rig.emulated_model.rotor.bearing_station * np.stack(
            [seen.run.truth[name][::STRIDE] for name in ROTOR]
        )
        error = (smoothed[:4] - truth)[:, chosen]
        errors.append(error)
        before.append((np.stack([seen.row(name) for name in MOTION]) - truth)[:, chosen])
        normal.append(np.abs(error / smoothed[4:8, chosen]))
    after, filtered, ratio = (np.concatenate(each, axis=1) for each in (errors, before, normal))
    return Hindsight(
        after.shape[1] / float(flown),
        *(sqrt(float(np.mean(each**2))) for each in (filtered[:2], filtered[2:], after[:2], after[2:])),
        float(np.mean(ratio < 1.0)),
        float(np.mean(ratio < 2.0)),
    )


def pin_forces(run: EmulatedRun, model: Model) -> np.ndarray:
    """Return the true normal force at each pin, (n_pins, n), or in all, (1, n).

    The simulator tells their sum; each pin's share follows from its penetration and the law.
    """
    total = run.truth["normal_force"]
    bearing = model.backup_bearing
    if bearing.kind != BearingKind.PINNED:
        return total[np.newaxis]
    place, rate = relative(run, model)
    reach = model.rotor.shaft_radius + bearing.pin_tip_radius
    shares = []
    for pin in range(bearing.pin_count):
        angle = np.radians(bearing.pin_angle_deg) + 2.0 * pi * pin / bearing.pin_count
        to = (reach + bearing.clearance) * np.exp(1j * angle) - place
        depth = np.maximum(reach - np.abs(to), 0.0)
        closing = (rate * to.conj()).real / np.abs(to)
        factor = damping_factors(model, depth, closing)
        shares.append(np.maximum(depth**1.5 * (1.0 + 1.5 * factor * closing), 0.0))
    whole = np.sum(shares, axis=0)
    return np.array(shares) * np.divide(total, whole, out=np.zeros_like(total), where=whole > 0.0)


def relative(run: EmulatedRun, model: Model) -> tuple[np.ndarray, np.ndarray]:
    """Return place (n,) and velocity of the shaft's centre in the house, x + iy, m and m/s."""
    truth, station = run.truth, model.rotor.bearing_station
    place = station * (truth["tilt_x"] + 1j * truth["tilt_y"])
    rate = station * (truth["tilt_rate_x"] + 1j * truth["tilt_rate_y"])
    house = truth["house_x"] + 1j * truth["house_y"]
    return place - house, rate - (truth["house_rate_x"] + 1j * truth["house_rate_y"])


def damping_factors(model: Model, depth: np.ndarray, closing: np.ndarray) -> np.ndarray:
    """Return the damping factor (s/m) of one candidate at each sample, (n,)."""
    bearing = model.backup_bearing
    factors = np.full(depth.size, bearing.damping_factor)
    if bearing.damping_mode == DampingMode.LATCHED:
        begins = np.flatnonzero((depth[1:] > 0.0) & (depth[:-1] <= 0.0))
        for begin in begins:
            factors[begin + 1 :] = latched_factor(bearing.law, bearing.restitution, closing[begin])
    return factors
