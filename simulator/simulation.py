"""A rig that runs in simulated time: set its speed, hit it, and read the truth sample by sample."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from simulator.candidates import DAMPING_FACTOR, candidates_of
from simulator.checks import check_bearing
from simulator.drive import set_point
from simulator.equilibrium import static_state
from simulator.faults import Fault, damaged_at, edges, schedule, span_of
from simulator.flight_block import end_block
from simulator.flight_map import flight_of
from simulator.law import latched_factor
from simulator.rig import (
    DampingMode,
    Model,
    Solenoid,
)
from simulator.solenoid import PULSE_FIELDS, pulse_row
from simulator.state import SIGNALS, STATE, TRUTH
from simulator.stepping import numbers_of, run
from simulator.tick import tick_of

__all__ = ["SIGNALS", "STATE", "TRUTH", "Moment", "Simulation", "SimulationError", "signals_for"]

WHOLE_NUMBERS = ("kind", "law", "damping_mode", "mode", "pin_count")


class Moment(NamedTuple):
    """All that a run goes on from, but for its set-point and hits."""

    state: np.ndarray  # (12,)
    damping_factors: np.ndarray  # (8,) s/m, of the contact's candidates


class SimulationError(RuntimeError):
    """The state is no number any more, or out of all proportion."""


class Simulation:
    """The rig in simulated time; sample n is the state at n / rate seconds.

    `model` holds the rig's parameters, `rate` the samples a second, `state` (12,) the state at sample 0 in
    the order of `STATE`; without one the shaft hangs still at its static equilibrium. `faults` are those of
    the rig, each of which changes the model while it acts. Equal calls at equal samples give equal bytes,
    however `advance` is divided. Raises `RigError` for a model that cannot be simulated.

    Attributes: `model`, as it is at present, and `whole`, as it is without faults; `sample`, the index of
    the next sample; `state` (12,), the state at that sample; `damping_factors` (8,), s/m, of the contact's
    candidates, and `candidates` (8, 6), of which those are a part, see `simulator.candidates`;
    `beyond_pins`, whether the shaft has been behind the pins, where the model has no wall.
    """

    def __init__(
        self,
        model: Model,
        rate: float = 25000.0,
        state: np.ndarray | None = None,
        faults: Sequence[Fault] = (),
    ):
        self.whole = checked(model)
        self.model = self.whole
        self.rate = positive(rate, "rate", "samples a second")
        self._work_out()
        self.sample = 0
        self.beyond_pins = False
        self.candidates = candidates_of(self.model)
        self.state = static_state(self.model) if state is None else checked_state(state)
        self._ramp = np.array([self.state[10], self.state[10], 1.0, 0.0])
        self._pulses = np.empty((0, PULSE_FIELDS))
        self._faults = schedule(faults, self.rate)
        self._edges = edges(self._faults)

    @property
    def damping_factors(self) -> np.ndarray:
        """A view of the candidates' damping factors."""
        return self.candidates[:, DAMPING_FACTOR]

    def moment(self) -> Moment:
        """Return where the run is; what goes back to it has the same bytes as what goes on here.

        A block of flight that has begun ends here, which changes the run that follows by rounding errors.
        """
        end_block(self._flight)
        return Moment(self.state.copy(), self.damping_factors.copy())

    def back_to(self, moment: Moment) -> None:
        """Go on from a moment of this rig, or of another with the same model, without the hits after it."""
        self.state[:], self.damping_factors[:] = moment
        self.release()
        end_block(self._flight)

    def go_on_from(self, sample: int, state: np.ndarray, set_point: float, closing: float = 0.0) -> None:
        """Go on at another sample from a state (12,), with the speed's set-point held where it is (rad/s).

        `closing` is the speed (m/s) at which a contact that is under way there closed: all that the contact
        remembers, and only where its damping is latched.
        """
        bearing = self.model.backup_bearing
        if bearing.damping_mode == DampingMode.LATCHED:
            self.damping_factors[:] = latched_factor(bearing.law, bearing.restitution, closing)
        self.sample = sample
        self.state = checked_state(state)
        end_block(self._flight)
        self._ramp[:] = set_point, set_point, 1.0, sample
        self._pulses = np.empty((0, PULSE_FIELDS))

    def advance(self, truth: np.ndarray) -> None:
        """Fill `truth` (17, n), float64, C-contiguous, with the next n samples, and step n ticks.

        Its rows are `SIGNALS`: the state without the controller's integral, the contact's force on the rotor
        (N), the normal force (N), the penetration (m, zero when open), the speed's set-point (rad/s) and the
        sum of the solenoids' forces (N). Raises `SimulationError` when the state diverges.
        """
        if truth.ndim != 2 or truth.shape[0] != len(SIGNALS):
            raise ValueError(
                f"truth has shape {truth.shape}, not ({len(SIGNALS)}, n): one row for each of SIGNALS"
            )
        if truth.dtype != np.float64 or not truth.flags.c_contiguous:
            raise ValueError("truth must be a C-contiguous array of float64; copy the part into one")
        column, count = 0, truth.shape[1]
        while column < count:
            self._perform_faults()
            end = count
            if self._edges:
                end = min(end, column + self._edges[0] - self.sample)
            self._run(truth, column, end)
            column = end

    def change(self, model: Model) -> None:
        """Go on with another model of the rig, and its faults, from the next sample on. Raises `RigError`."""
        self.whole = checked(model)
        self._damage()

    def add_fault(self, fault: Fault) -> None:
        """Have one more fault of the rig, from a sample on that is still to come. Raises `RigError`."""
        span = span_of(fault, self.rate)
        faults = sorted([*self._faults, span], key=lambda each: each.begin)
        for edge in edges(faults):
            if edge >= span.begin:
                checked(damaged_at(self.whole, faults, edge))
        self._faults = faults
        self._edges = sorted({*self._edges, *edges([span])})

    def _work_out(self) -> None:
        """Work out the numbers of the model as it is now."""
        self.tick = tick_of(self.model, 1.0 / self.rate)
        self._flight = flight_of(self.model, self.tick)
        self._numbers = numbers_of(self.model, self.tick, self._flight)

    def _damage(self) -> None:
        """Let the model be that of the rig with what acts on it now."""
        self.model = checked(damaged_at(self.whole, self._faults, self.sample))
        self._work_out()
        latched = self.damping_factors.copy()
        self.candidates[:] = candidates_of(self.model)
        if self.model.backup_bearing.damping_mode == DampingMode.LATCHED:
            self.damping_factors[:] = latched

    def set_speed(self, speed: float, ramp: float) -> None:
        """Move the speed's set-point from where it is to `speed` (rad/s) at `ramp` (rad/s2, positive)."""
        if not np.isfinite(speed):
            raise ValueError(f"speed = {speed} rad/s must be a finite number")
        slope = positive(ramp, "ramp", "rad/s2")
        now = set_point(self._ramp, self.sample, self.tick.length)
        self._ramp[:] = now, speed, slope, self.sample

    def hit(self, solenoid: Solenoid, force: float, duration: float) -> None:
        """Begin a half-sine pulse of a solenoid now: peak `force` (N), `duration` (s). Pulses may overlap."""
        if not np.isfinite(force):
            raise ValueError(f"force = {force} N must be a finite number")
        row = pulse_row(solenoid, force, positive(duration, "duration", "s"), self.sample)
        ages = (self.sample - self._pulses[:, 0]) * self.tick.length
        self._pulses = np.concatenate((self._pulses[ages < self._pulses[:, 1]], row))

    def release(self) -> None:
        """Switch all solenoids off now, pulses that have begun included."""
        self._pulses = np.empty((0, PULSE_FIELDS))

    def _perform_faults(self) -> None:
        """Let the faults begin and end whose sample has come."""
        due = sum(edge <= self.sample for edge in self._edges)
        if due:
            del self._edges[:due]
            self._damage()

    def _run(self, truth: np.ndarray, begin: int, end: int) -> None:
        """Fill the columns from `begin` to `end`."""
        done, lost = run(
            self._numbers,
            self._ramp,
            self._pulses,
            self.sample,
            self.state,
            self.candidates,
            truth,
            begin,
            end,
        )
        self.sample += done
        self.beyond_pins = self.beyond_pins or lost
        if done < end - begin:
            raise SimulationError(self._cause())

    def _cause(self) -> str:
        """Describe the divergence."""
        state = ", ".join(f"{name} {value:.3g}" for name, value in zip(STATE, self.state, strict=True))
        return (
            f"the simulation diverged at {self.sample / self.rate:.6f} s (sample {self.sample}): {state}. "
            "Likely cause: a contact far stiffer than the rate can follow, or a value in a wrong unit"
        )


def signals_for(count: int) -> np.ndarray:
    """Return an array (17, count) for `Simulation.advance` to fill."""
    return np.empty((len(SIGNALS), count))


def checked(model: Model) -> Model:
    """Return the model with plain numbers for its enumerations. Raises `RigError`."""
    check_bearing(model.backup_bearing)
    return Model(*(plain(part) for part in model))


def plain(part: Any) -> Any:
    """Return a table of the model with its choices and numbers of things as int and all else as float."""
    pairs = zip(part._fields, part, strict=True)
    return type(part)(*(value if name == "pins" else plain_number(name, value) for name, value in pairs))


def plain_number(name: str, value: Any) -> int | float:
    """Return the number of a field."""
    return int(value) if name in WHOLE_NUMBERS else float(value)


def checked_state(state: np.ndarray) -> np.ndarray:
    """Return a copy of a state (12,) as float64."""
    values = np.array(state, dtype=np.float64)
    if values.shape != (len(STATE),) or not np.isfinite(values).all():
        raise ValueError(f"state must hold {len(STATE)} finite numbers: {', '.join(STATE)}")
    return values


def positive(value: float, name: str, unit: str) -> float:
    """Return a finite number above zero as float. Raises `ValueError`."""
    if not (np.isfinite(value) and value > 0.0):
        raise ValueError(f"{name} = {value} must be a number above 0, in {unit}")
    return float(value)
