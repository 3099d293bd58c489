"""Motions drawn by seed that may fly, bounce, rub or whirl, the twin's view of them, and what they truly are.

A case has a rig, a speed that is held, and a throw; contact stiffness, damping and friction are up to 20 %
from what the twin is told, and it knows nothing of the unbalance. The motion has `SETTLING` seconds by itself
before the twin joins for `WATCHED` seconds. What it truly is follows from the simulated force, the simulated
path and the largest Lyapunov exponent (`exponent`), none of which the twin or its rules can see.
"""

from collections.abc import Iterator
from math import log, tau
from typing import NamedTuple

import numpy as np
from scipy.cluster.hierarchy import fcluster, linkage

from analysis.regime import Regime
from daq.backends.emulator import Emulator
from daq.rig import Rig, load_rig
from simulator.rig import Model
from simulator.simulation import Simulation, signals_for
from tests.twin.cases import ACTUAL, MISMATCH, OVERSAMPLING
from tests.twin.emulated import EmulatedRun, finer, series_of

RIGS = ("thesis-ball", "thesis-pinned", "thesis-plain")
SETTLING = 5.0  # s
WATCHED = 6.5  # s, of which the truth is judged by the last `JUDGED`
JUDGED = 6.0
NUDGE = 1e-8  # rad
CHAOS = 0.05  # per revolution: the exponent from which a motion is chaotic; e-fold within 20 revolutions
RENEWAL = 0.05  # s after which the distance of two motions is measured and set back to `NUDGE`


class RegimeCase(NamedTuple):
    """A motion: the rig with what is hidden in its emulation, the speed it holds and how it is thrown."""

    rig: Rig
    speed: float  # rad/s
    velocity: tuple[float, float]  # m/s of the shaft's centre at the backup bearing, at the beginning

    @property
    def truth(self) -> Model:
        """The rig as it really is."""
        return self.rig.emulated_model


class Kind(NamedTuple):
    """What the cases of a kind are drawn from."""

    rigs: tuple[str, ...]
    hz: tuple[float, float]
    unbalance: tuple[float, float]  # kg m
    friction: tuple[float, float]
    throw: tuple[float, float]  # m/s, in any direction
    changes: tuple[str, ...] = ()  # of the rig, known to the twin


NO_MAGNET = ("magnetic_bearing.stiffness=1.0",)
KINDS = {
    "any": Kind(RIGS, (9.0, 18.0), (75e-6, 600e-6), (0.1, 0.3), (0.0, 0.5)),
    "calm": Kind(RIGS, (12.5, 18.0), (20e-6, 100e-6), (0.1, 0.4), (0.0, 0.02)),
    "dropped": Kind(RIGS[::2], (4.0, 12.0), (20e-6, 100e-6), (0.1, 0.2), (0.0, 0.02), NO_MAGNET),
    "heavy": Kind(("thesis-ball",), (16.0, 20.0), (800e-6, 1200e-6), (0.1, 0.4), (0.2, 0.4)),
    "rough": Kind(("thesis-plain",), (10.0, 18.0), (75e-6, 300e-6), (0.3, 0.5), (0.3, 0.5)),
}
"""Anything; and kinds that mostly fly, lie in the bearing, rub forward and whirl backward."""


def drawn_case(seed: int, kind: str = "any") -> RegimeCase:
    """Draw a case of a kind."""
    draw, of = np.random.default_rng([131, list(KINDS).index(kind), seed]), KINDS[kind]
    name = str(draw.choice(of.rigs))
    hz, unbalance, friction, throw = (draw.uniform(*each) for each in of[1:5])
    velocity = throw * np.exp(1j * draw.uniform(-np.pi, np.pi))
    off = draw.uniform(1.0 - MISMATCH, 1.0 + MISMATCH, 3)
    told = load_rig(name).emulated_model.backup_bearing
    hidden = {
        "rotor.unbalance": unbalance,
        "rotor.unbalance_angle": draw.uniform(-np.pi, np.pi),
        "backup_bearing.stiffness": off[0] * told.stiffness,
        "backup_bearing.damping_factor": off[1] * told.damping_factor,
        "backup_bearing.friction": off[2] * friction,
    }
    settings = [f"{ACTUAL}.{key}={value}" for key, value in hidden.items()]
    described = ["drive.mode=ideal", f"backup_bearing.friction={friction}", f"emulator.seed={seed}"]
    rig = load_rig(name, [*described, *of.changes, *settings])
    return RegimeCase(rig, tau * hz, (velocity.real, velocity.imag))


def settled(case: RegimeCase) -> np.ndarray:
    """Return the state (12,) that a case has come to when the twin joins."""
    simulation = Simulation(case.truth, OVERSAMPLING * case.rig.acquisition.rate)
    state = simulation.state.copy()
    state[10] = case.speed
    state[2:4] += np.array(case.velocity) / case.truth.rotor.bearing_station
    simulation.go_on_from(0, state, case.speed)
    part = signals_for(round(RENEWAL * simulation.rate))
    for _ in range(round(SETTLING / RENEWAL)):
        simulation.advance(part)
    return simulation.state.copy()


def watched_run(case: RegimeCase, state: np.ndarray, seconds: float = WATCHED) -> EmulatedRun:
    """Return what the sensors say of a case from `state` on, and the truth."""
    rig, fine = case.rig, finer(case.rig, OVERSAMPLING)
    device = Emulator(paced=False)
    device.open(fine)
    device.start()
    device.go_on_from(0, state, case.speed)
    blocks, truth = [], []
    for number in range(round(seconds * rig.acquisition.rate / rig.acquisition.block)):
        values = np.empty((len(rig.channels), fine.acquisition.block))
        device.read(values)
        rig.channels.calibrate(values, values)
        blocks.append(series_of(rig, number * rig.acquisition.block, values[:, ::OVERSAMPLING]))
        truth.append(device.truth()[:, ::OVERSAMPLING].copy())
    return EmulatedRun(rig, blocks, dict(zip(device.truth_names, np.concatenate(truth, axis=1), strict=True)))


def exponent(case: RegimeCase, state: np.ndarray) -> float:
    """Return the largest Lyapunov exponent per revolution over the last `JUDGED` of the watched seconds.

    Two motions `NUDGE` apart are run side by side; their distance is measured and set back each `RENEWAL`
    (Benettin, Galgani, Giorgilli and Strelcyn, Meccanica 15, 1980).
    """
    growth = list(growths(case, state))[-round(JUDGED / RENEWAL) :]
    return float(np.mean(growth)) / RENEWAL * tau / abs(case.speed)


def growths(case: RegimeCase, state: np.ndarray) -> Iterator[float]:
    """Yield the logarithm of the factor by which two motions part in each `RENEWAL`."""
    rate = OVERSAMPLING * case.rig.acquisition.rate
    motion, nudged = Simulation(case.truth, rate), Simulation(case.truth, rate)
    for each in (motion, nudged):
        each.go_on_from(0, state, case.speed)
    nudged.state[0] += NUDGE
    part = signals_for(round(RENEWAL * rate))
    scale = np.array([1.0, 1.0, 1.0 / case.speed, 1.0 / case.speed])
    for _ in range(round(WATCHED / RENEWAL)):
        motion.advance(part)
        nudged.advance(part)
        apart = nudged.state - motion.state
        distance = max(float(np.linalg.norm(scale * apart[:4])), 1e-6 * NUDGE)
        yield log(distance / NUDGE)
        nudged.state[:] = motion.state + apart * (NUDGE / distance)


class Motion(NamedTuple):
    """What a case truly did in the last `JUDGED` seconds, each (n,)."""

    angle: np.ndarray  # rad, of the shaft
    place: np.ndarray  # m, complex, of the shaft's centre in the bearing
    contact: np.ndarray  # N, complex, contact force on the rotor
    normal: np.ndarray  # N


def motion_of(run: EmulatedRun) -> Motion:
    """Return the truth of the last `JUDGED` seconds."""
    truth = {name: row[-round(JUDGED * run.rig.acquisition.rate) :] for name, row in run.truth.items()}
    tilt = truth["tilt_x"] + 1j * truth["tilt_y"]
    place = run.rig.emulated_model.rotor.bearing_station * tilt - (truth["house_x"] + 1j * truth["house_y"])
    contact = truth["contact_force_x"] + 1j * truth["contact_force_y"]
    return Motion(truth["angle"], place, contact, truth["normal_force"])


def true_regime(motion: Motion, lyapunov: float, pins: bool) -> Regime:
    """Name the regime of a motion by the definitions of docs/explanation/observer.md."""
    share = float(np.mean(motion.normal > 0.0))
    if share == 0.0:
        return Regime.CONTACT_FREE
    runs = np.ptp(np.unwrap(np.angle(motion.place))) / np.ptp(motion.angle)
    forward = np.sum((motion.place[:-1].conj() * np.diff(motion.place)).imag) > 0.0  # the orbit's area
    whirl = Regime.FORWARD_WHIRL if forward else Regime.BACKWARD_WHIRL
    if share > 0.95:
        return whirl if runs > 0.5 else Regime.PERMANENT
    if lyapunov > CHAOS:
        return Regime.CHAOTIC
    if share > 0.5 and runs > 0.5:
        return whirl
    return true_places(motion, pins)


def true_places(motion: Motion, pins: bool) -> Regime:
    """Name the kind of bouncing by single-linkage clusters of the impulses' directions, 30 degrees apart."""
    pressed = np.concatenate([[False], motion.normal > 0.5, [False]])
    begins, ends = np.flatnonzero(pressed[1:] & ~pressed[:-1]), np.flatnonzero(pressed[:-1] & ~pressed[1:])
    impulses = [-np.sum(motion.contact[begin:end]) for begin, end in zip(begins, ends, strict=True)]
    directions = np.array(impulses) / np.abs(impulses)
    apart = 2.0 * np.sin(np.radians(15.0))
    joined = fcluster(linkage(np.stack([directions.real, directions.imag], axis=1)), apart, "distance")
    sizes = np.bincount(joined)[1:]
    count = int(np.count_nonzero(sizes >= 0.1 * directions.size))
    middle = motion.place - np.mean(motion.place)
    axes = np.linalg.svd(np.stack([middle.real, middle.imag]), compute_uv=False)
    if pins and count == 1 and axes[1] < 0.4 * axes[0]:
        return Regime.DIAGONAL
    if sizes.size == 1 and np.ptp(np.sort(np.angle(directions))) > 1.8 * np.pi:
        return Regime.BOUNCING  # all round
    return {1: Regime.ONE_PLACE, 2: Regime.TWO_PLACES, 3: Regime.THREE_PLACES}.get(count, Regime.MANY_PLACES)
