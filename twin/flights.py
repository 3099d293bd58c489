"""Stretches of flight in some blocks in a row: handed to the smoother, and put back among what was told.

A stretch begins with the observer's estimate at its first column. Static moment and unbalance begin as it
knows them in that block, and are smoothed too. The magnetic bearing is the observer's at the stretch's end.
"""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from simulator.candidates import for_kernels
from simulator.rig import MagneticBearing
from twin import layout
from twin.estimate import Estimated
from twin.layout import DYNAMIC, FREE_INPUTS
from twin.linear import discretise
from twin.observer import Observer
from twin.prediction import FREE_DOUBLINGS
from twin.slopes import free_rates, input_rates
from twin.smoother import MOMENT, MOVING, Flight, Tape, new_tape, smooth

SHORTEST = 10  # columns of a stretch; a shorter one hardly says more than the observer has taken in
SPEED_STEP = 1.0  # rad/s, of the difference that tells how the flow changes with the speed
STATES = ("tilt_x", "tilt_y", "tilt_rate_x", "tilt_rate_y")
BANDS = ("displacement_x_sigma", "displacement_y_sigma", "velocity_x_sigma", "velocity_y_sigma")
SLOW = [layout.MOMENT, layout.MOMENT + 1, layout.UNBALANCE, layout.UNBALANCE + 1]
"""Indices in the observer's state of the smoother's slow states, in the smoother's order."""


class Held(NamedTuple):
    """A block that waits for what follows."""

    estimated: Estimated
    readings: np.ndarray  # (n_probes, n_samples) of the probes; NaN: not taken
    flies: np.ndarray  # (n_columns,) whether it may be smoothed
    state: np.ndarray  # (layout.SIZE,) of the observer at the block's end
    covariance: np.ndarray  # (layout.SIZE, layout.SIZE) likewise


class Window:
    """Some blocks in a row, none missing between them.

    Args:
        observer: that saw them.
        probes: indices of its sensors that see the rotor, in the order of the readings.
        blocks: one or more.
    """

    def __init__(self, observer: Observer, probes: np.ndarray, blocks: Sequence[Held]) -> None:
        self._observer, self._blocks = observer, blocks
        self._step = 1.0 / observer.rig.acquisition.rate
        parts = [held.estimated for held in blocks]
        first = parts[0].first_sample
        self._at = np.concatenate(
            [part.first_sample - first + part.stride * np.arange(part.samples.shape[1]) for part in parts]
        )
        self._block = np.repeat(np.arange(len(parts)), [part.samples.shape[1] for part in parts])
        self._angle = np.concatenate([part.shaft_angle for part in parts])
        self._speed = self._row("speed")
        self._readings = np.concatenate([held.readings for held in blocks], axis=1)
        sensors = observer.sensors
        late, weights = sensors.late[probes], sensors.weights[probes]
        self._late = np.rint(late).astype(int)
        rest = (late - self._late) * self._step
        self._rows = np.hstack([weights, -rest[:, np.newaxis] * weights])
        self._variance = sensors.variance[probes]

    def told(self, names: Sequence[str]) -> list[np.ndarray]:
        """Return for each block the rows `names`, motion and bands, and one that is 1 where it is smoothed.

        Each is (len(names) + 1, n_columns), SI.
        """
        told = np.stack([*(self._row(name) for name in names), np.zeros(self._at.size)])
        station = self._observer.model.rotor.bearing_station
        for begin, end in self._stretches():
            flight = self._flight(begin, end)
            tape = self._begun(begin, flight)
            smooth(flight, tape)
            ticks = self._at[begin:end] - self._at[begin]
            squares = tape.covariance[ticks, :MOVING, :MOVING].diagonal(axis1=1, axis2=2)
            if not (squares > 0.0).all():  # rounding has spoilt it, or the observer's state was no number
                continue
            told[:MOVING, begin:end] = station * tape.state[ticks, :MOVING].T
            told[MOVING:-1, begin:end] = station * np.sqrt(squares.T)
            told[-1, begin:end] = 1.0
        return np.split(told, np.flatnonzero(np.diff(self._block)) + 1, axis=1)

    def _row(self, name: str) -> np.ndarray:
        """Return one output of the observer (n_columns,)."""
        return np.concatenate([held.estimated.row(name) for held in self._blocks])

    def _stretches(self) -> Iterator[tuple[int, int]]:
        """Yield first column and the one behind the last of each stretch that is worth smoothing."""
        flies = np.concatenate([[False], *(held.flies for held in self._blocks), [False]])
        for begin, end in np.flatnonzero(np.diff(flies)).reshape(-1, 2):
            if end - begin >= SHORTEST:
                yield begin, end

    def _flight(self, begin: int, end: int) -> Flight:
        """Return what the smoother is to know of a stretch."""
        first, count = self._at[begin], self._at[end - 1] - self._at[begin] + 1
        readings = np.full((self._late.size, count), np.nan)
        for probe, late in enumerate(self._late):
            seen = self._readings[probe, first + late : first + late + count]
            readings[probe, : seen.size] = seen
        noise = self._observer.tuning.moment_noise / self._observer.model.rotor.inertia
        at, mean = self._at[begin:end], float(np.mean(self._speed[begin:end]))
        middle = np.arange(at[0], at[-1] + 1) + 0.5
        angles, speeds = (
            np.interp(middle, at, self._angle[begin:end]),
            np.interp(middle, at, self._speed[begin:end]),
        )
        state = self._blocks[self._block[end - 1]].state
        flow = self._flow(state, mean)
        return Flight(
            flow,
            (self._flow(state, mean + SPEED_STEP) - flow) / SPEED_STEP,
            speeds - mean,
            self._pulls(angles, speeds),
            noise * noise * self._step,
            readings,
            self._rows,
            self._variance,
        )

    def _flow(self, state: np.ndarray, speed: float) -> np.ndarray:
        """Return a tick's flow (MOVING, MOVING + 2) at a speed, with the magnetic bearing of `state`."""
        model = self._observer.model
        magnet = MagneticBearing(
            (1.0 + state[layout.MAGNET_STIFFNESS]) * model.magnetic_bearing.stiffness,
            (1.0 + state[layout.MAGNET_DAMPING]) * model.magnetic_bearing.damping,
        )
        flying = for_kernels(model._replace(magnetic_bearing=magnet))
        rates, inputs = np.zeros((DYNAMIC, DYNAMIC)), np.zeros((DYNAMIC, FREE_INPUTS))
        flow = np.zeros((DYNAMIC, DYNAMIC + FREE_INPUTS))
        free_rates(flying, speed, rates)
        input_rates(flying, inputs)
        discretise(rates, inputs, self._step, FREE_DOUBLINGS, flow, np.zeros((2, *flow.shape)))
        return np.hstack([flow[:MOVING, :MOVING], flow[:MOVING, DYNAMIC : DYNAMIC + 2]])

    def _pulls(self, angles: np.ndarray, speeds: np.ndarray) -> np.ndarray:
        """Return (n, 2) what a unit of unbalance does, N m per kg m, as `twin.prediction.unbalance_pull`."""
        slope = np.polyfit(np.arange(speeds.size) * self._step, speeds, 1)[0]
        pull = self._observer.model.rotor.disk_station * (speeds**2 - 1j * slope) * np.exp(1j * angles)
        return np.stack([pull.real, pull.imag], axis=1)

    def _begun(self, begin: int, flight: Flight) -> Tape:
        """Return a tape that holds what the observer knew at a stretch's first column."""
        held = self._blocks[self._block[begin]]
        station = self._observer.model.rotor.bearing_station
        tape = new_tape(flight.readings.shape[1], flight.readings.shape[0])
        tape.state[0, :MOVING] = [self._row(name)[begin] for name in STATES]
        tape.state[0, MOMENT:] = held.state[SLOW]
        bands = np.array([self._row(name)[begin] for name in BANDS]) / station
        tape.covariance[0, range(MOVING), range(MOVING)] = bands**2
        tape.covariance[0, MOMENT:, MOMENT:] = held.covariance[np.ix_(SLOW, SLOW)]
        return tape
