"""The thesis' experiments on the simulator: each a function of a model that returns plain numbers and traces.

All speeds are prescribed, as in P3. A dwell is one speed held; a stair is a run through several. Runs are
kept as files named after a digest of what they are made of (`benchmarks.thesis_cache`).
"""

from collections.abc import Iterable, Sequence
from math import tau
from typing import NamedTuple

import numpy as np

from analysis.decay import Decay, fit_decay
from analysis.impacts import find_impacts
from analysis.orbit import crossings, largest_radius
from simulator.rig import Model, Solenoid
from simulator.simulation import STATE, Simulation, signals_for

RAMP = tau * 26.7  # rad/s2, P2 table 3
RATE = 25_000
SETTLE = 0.5  # share of a dwell that counts as transient
KEPT_RATE = 1000.0  # Hz of the traces that are kept for figures
KEPT = RATE // int(KEPT_RATE)
START_TIME = 2.0  # s of trace kept at the beginning of each dwell
END_TIME = 4.0  # s of trace kept at its end
DROP_START = 12.0  # s of trace kept at the beginning of a drop
MOST_CROSSINGS = 400
NO_TRACE = np.empty((4, 0), np.float32)


class Dwell(NamedTuple):
    """One speed held: what happened after the transient, unless it says otherwise."""

    hz: float
    touched: bool  # in the settled part
    last_contact: float  # s into the dwell; 0 without any
    radius: float  # m, largest distance of the shaft's centre from the bearing's
    force: float  # N, largest resultant of a direction's two transducers
    width: float  # m, horizontal extent of the orbit
    height: float  # m, vertical extent
    hits: float  # impacts a revolution
    share: float  # of the time in contact
    turns: float  # turns of the orbit round the bearing's centre per revolution
    start: np.ndarray  # trace (4, n) of the first seconds: x, y (m), force (N), angle (rad) at KEPT_RATE
    end: np.ndarray  # trace of the last seconds


def without_drive(model: Model) -> Model:
    """Return the model with its speed prescribed."""
    return model._replace(drive=model.drive._replace(mode=0))


def changed(model: Model, **tables: dict[str, float]) -> Model:
    """Return a model with some numbers of some tables replaced."""
    return model._replace(**{name: getattr(model, name)._replace(**table) for name, table in tables.items()})


def levels(first: float, last: float, step: float = 0.5) -> list[float]:
    """Return speeds from one to another, both included, in Hz."""
    count = round(abs(last - first) / step)
    return [round(float(hz), 6) for hz in np.linspace(first, last, count + 1)]


def offsets(model: Model, truth: np.ndarray) -> np.ndarray:
    """Return the shaft's centre relative to the bearing's (2, n), m."""
    return model.rotor.bearing_station * truth[0:2] - truth[4:6]


def resultant(model: Model, truth: np.ndarray) -> np.ndarray:
    """Return the transducers' resultant (n,), N: two of them in each direction."""
    return np.asarray(2.0 * model.housing.transducer_stiffness * np.hypot(truth[4], truth[5]))


def trace(model: Model, truth: np.ndarray) -> np.ndarray:
    """Return (4, n) at KEPT_RATE: orbit (m), largest resultant of each ms (N), angle in its turn (rad)."""
    truth = truth[:, : truth.shape[1] // KEPT * KEPT]
    orbit = offsets(model, truth)[:, ::KEPT]
    force = extremes(resultant(model, truth)[None], KEPT)
    return np.concatenate([orbit, force, truth[9:10, ::KEPT] % tau]).astype(np.float32)


def dwell(simulation: Simulation, hz: float, seconds: float = 10.0, keep: bool = False) -> Dwell:
    """Go to a speed and hold it; keep the traces on demand."""
    simulation.set_speed(tau * hz, RAMP)
    truth = signals_for(round(seconds * RATE))
    simulation.advance(truth)
    return described(simulation.model, hz, truth, keep)


def described(model: Model, hz: float, truth: np.ndarray, keep: bool) -> Dwell:
    """Condense the signals of a dwell."""
    closed = np.flatnonzero(truth[13])
    settled = truth[:, round(SETTLE * truth.shape[1]) :]
    orbit = offsets(model, settled)
    turned = np.unwrap(np.arctan2(orbit[1], orbit[0]))
    revolutions = max((settled[9, -1] - settled[9, 0]) / tau, 1e-9)
    return Dwell(
        hz=hz,
        touched=bool(settled[13].any()),
        last_contact=float(closed[-1] + 1) / RATE if closed.size else 0.0,
        radius=largest_radius(orbit),
        force=float(resultant(model, settled).max()),
        width=float(np.ptp(orbit[0])),
        height=float(np.ptp(orbit[1])),
        hits=float(find_impacts(settled[13], RATE).peak.size / revolutions),
        share=float(np.mean(settled[13] > 0.0)),
        turns=float(turned[-1] - turned[0]) / tau / revolutions,
        start=trace(model, truth[:, : round(START_TIME * RATE)]) if keep else NO_TRACE,
        end=trace(model, truth[:, -round(END_TIME * RATE) :]) if keep else NO_TRACE,
    )


class Stairs(NamedTuple):
    """A run up and the run down after it."""

    up: list[Dwell]
    down: list[Dwell]


def stairs(
    model: Model,
    up: Iterable[float],
    down: Iterable[float],
    seconds: float = 10.0,
    keep: bool = False,
    hit: Solenoid | None = None,
) -> Stairs:
    """Run up and down; a solenoid hits with 40 N for 10 ms at the beginning of each speed going down."""
    simulation = Simulation(without_drive(model), rate=RATE)
    risen = [dwell(simulation, hz, seconds, keep) for hz in up]
    fallen = []
    for hz in down:
        if hit is not None:
            simulation.hit(hit, 40.0, 0.010)
        fallen.append(dwell(simulation, hz, seconds, keep))
    return Stairs(risen, fallen)


class Drop(NamedTuple):
    """A drop at constant speed, from the bearing's centre with the magnet gone at once."""

    unbalance: float  # kg m
    start: np.ndarray  # (2, n) m at KEPT_RATE, the first seconds of the orbit
    force: np.ndarray  # (2, n) N, of the same: horizontal and vertical, the largest of each ms with its sign
    end: np.ndarray  # (2, n) m at KEPT_RATE, the last seconds of the orbit
    crossings: np.ndarray  # (3, m): y (m), vx, vy (m/s) where the settled orbit crosses x = 0
    turns: float  # of the settled orbit per revolution
    share: float  # of the settled time in contact
    peak: float  # N, largest force of a direction while settled


def drop(model: Model, unbalance: float, hz: float = 10.0, seconds: float = 40.0) -> Drop:
    """Drop the rotor with an unbalance (kg m) at a speed; what is settled begins half-way."""
    held = changed(without_drive(model), rotor={"unbalance": unbalance})
    fallen = changed(held, magnetic_bearing={"stiffness": 0.0, "damping": 0.0})
    state = np.zeros(len(STATE))
    state[STATE.index("speed")] = tau * hz
    simulation = Simulation(fallen, rate=RATE, state=state)
    truth = signals_for(round(seconds * RATE))
    simulation.advance(truth)
    orbit, forces = offsets(fallen, truth), -2.0 * fallen.housing.transducer_stiffness * truth[4:6]
    half, first, last = orbit.shape[1] // 2, round(DROP_START * RATE), round(END_TIME * RATE)
    turned = np.unwrap(np.arctan2(orbit[1, half:], orbit[0, half:]))
    revolutions = (truth[9, -1] - truth[9, half]) / tau
    return Drop(
        unbalance,
        orbit[:, :first:KEPT].astype(np.float32),
        extremes(forces[:, :first], KEPT).astype(np.float32),
        orbit[:, -last::KEPT].astype(np.float32),
        crossings(orbit[:, half:], RATE)[:, -MOST_CROSSINGS:],
        float(turned[-1] - turned[0]) / tau / revolutions,
        float(np.mean(truth[13, half:] > 0.0)),
        float(np.abs(forces[:, half:]).max()),
    )


def extremes(signals: np.ndarray, count: int) -> np.ndarray:
    """Return of each `count` samples of (k, n) signals the one farthest from zero, (k, n // count)."""
    whole = signals[:, : signals.shape[1] // count * count].reshape(signals.shape[0], -1, count)
    index = np.abs(whole).argmax(axis=2)[..., None]
    return np.take_along_axis(whole, index, axis=2)[..., 0]


def touches_in_ramp(model: Model, seconds: float, phase: float, down: bool = False) -> bool:
    """Tell whether a linear ramp between 0 and 20 Hz in `seconds` (or back) has contact within 3 s."""
    turned = changed(without_drive(model), rotor={"unbalance_angle": phase})
    simulation = Simulation(turned, rate=RATE, state=settled_at(turned, 20.0) if down else None)
    simulation.set_speed(0.0 if down else tau * 20.0, tau * 20.0 / seconds)
    truth = signals_for(3 * RATE)
    simulation.advance(truth)
    return bool(truth[13].any())


def settled_at(model: Model, hz: float) -> np.ndarray:
    """Return the state of the contact-free 1X orbit at a speed (12,), unbalance at its angle."""
    rotor, magnet, speed = model.rotor, model.magnetic_bearing, tau * hz
    dynamic = magnet.stiffness * rotor.magnet_station**2 + rotor.pivot_stiffness
    dynamic = dynamic - (rotor.inertia - rotor.polar_inertia) * speed**2
    dynamic = dynamic + 1j * magnet.damping * rotor.magnet_station**2 * speed
    vector = rotor.unbalance * speed**2 * rotor.disk_station / dynamic * np.exp(1j * rotor.unbalance_angle)
    state = Simulation(model).state
    state[0:2] += vector.real, vector.imag
    state[2:4] += (1j * speed * vector).real, (1j * speed * vector).imag
    state[STATE.index("speed")] = speed
    return state


class Hit(NamedTuple):
    """A hit on the settled orbit at a speed."""

    delay: float  # s after an arbitrary moment of that orbit
    freed: bool  # without contact from 4 to 6 s later
    before: np.ndarray  # trace (4, n) of the second before it
    after: np.ndarray  # trace of the six seconds from it on


def hits(model: Model, solenoid: Solenoid, force: float, hz: float, delays: Sequence[float]) -> list[Hit]:
    """Hit the orbit that a run-up has settled to at a speed, once for each delay (s), which is above zero."""
    simulation = Simulation(without_drive(model), rate=RATE)
    for speed in levels(8.0, 14.0):
        dwell(simulation, speed, 5.0)
    dwell(simulation, hz, 8.0)
    state = simulation.state.copy()
    return [hit(simulation.model, state, solenoid, force, delay) for delay in delays]


def hit(model: Model, state: np.ndarray, solenoid: Solenoid, force: float, delay: float) -> Hit:
    """Hit `delay` seconds after a state, with `force` (N) for 10 ms."""
    simulation = Simulation(model, rate=RATE, state=state)
    before = signals_for(round(delay * RATE))
    simulation.advance(before)
    simulation.hit(solenoid, force, 0.010)
    after = signals_for(6 * RATE)
    simulation.advance(after)
    freed = not after[13, 4 * RATE :].any()
    return Hit(delay, freed, trace(model, before), trace(model, after))


class DropTest(NamedTuple):
    """The fall from the top of the bearing to its bottom at standstill, without magnet (P3 section 4.1)."""

    speed: float  # m/s, into the contact
    restitution: float  # 1, speed out of it over speed into it
    peak: float  # N, contact force
    penetration: np.ndarray  # (n,) m, at each sample of the first impact
    force: np.ndarray  # (n,) N


def drop_test(model: Model) -> DropTest:
    """Let the shaft fall once."""
    fallen = changed(without_drive(model), magnetic_bearing={"stiffness": 0.0, "damping": 0.0})
    state = np.zeros(len(STATE))
    state[STATE.index("tilt_y")] = model.backup_bearing.clearance / model.rotor.bearing_station
    simulation = Simulation(fallen, rate=RATE, state=state)
    truth = signals_for(RATE // 4)
    simulation.advance(truth)
    first = find_impacts(truth[13], RATE)
    start, end = int(first.start[0]), int(first.end[0])
    rate = model.rotor.bearing_station * truth[3]
    return DropTest(
        float(-rate[start - 1]),
        float(-rate[end] / rate[start - 1]),
        float(first.peak[0]),
        truth[14, start:end].copy(),
        truth[13, start:end].copy(),
    )


def free_decay(model: Model, solenoid: Solenoid) -> Decay:
    """Return frequency and damping of the decay after a light hit at standstill (P3 figure 9)."""
    simulation = Simulation(without_drive(model), rate=RATE)
    simulation.hit(solenoid, 6.0, 0.010)
    truth = signals_for(4 * RATE)
    simulation.advance(truth)
    settled = model.rotor.disk_station * truth[0:2, RATE // 10 :: KEPT]
    return fit_decay(settled[0] + 1j * settled[1], KEPT_RATE)
