"""Models of the shipped rigs, and variants of them, for the tests of simulator and physics."""

from functools import cache
from math import tau

import numpy as np

from daq.rig import load_rig
from simulator.candidates import DAMPING_FACTOR, candidates_of
from simulator.rig import Model
from simulator.simulation import STATE, Simulation, signals_for


@cache
def model_of(name: str) -> Model:
    """Return the model of a shipped rig: ball, pinned or plain."""
    model = load_rig(f"thesis-{name}").model
    assert model is not None
    return model


def ideal(name: str) -> Model:
    """Return the model with its speed prescribed."""
    return changed(model_of(name), drive={"mode": 0})


def changed(model: Model, **tables) -> Model:
    """Return a model with some numbers of some tables replaced."""
    return model._replace(**{name: getattr(model, name)._replace(**table) for name, table in tables.items()})


def candidates(model: Model, damping_factor: float = 0.0) -> np.ndarray:
    """Return the model's candidates (8, 6) with a damping factor, s/m."""
    rows = candidates_of(model)
    rows[:, DAMPING_FACTOR] = damping_factor
    return rows


def state(**fields: float) -> np.ndarray:
    """Return a state (12,) that is zero but for the given fields."""
    return np.array([fields.get(name, 0.0) for name in STATE])


def signals(simulation: Simulation, seconds: float) -> np.ndarray:
    """Run for a while and return the true signals."""
    truth = signals_for(round(seconds * simulation.rate))
    simulation.advance(truth)
    return truth


def hanging(model: Model, hz: float) -> np.ndarray:
    """Return the state at static equilibrium with the shaft turning."""
    values = Simulation(model).state
    values[STATE.index("speed")] = tau * hz
    return values


def rebound(model, speed: float) -> float:
    """Throw the shaft at a rigid wall at `speed` (m/s) and return the coefficient of restitution."""
    rigid = changed(
        model,
        rotor={"gravity": 0.0, "coupling_force": 0.0, "unbalance": 0.0},
        magnetic_bearing={"stiffness": 0.0, "damping": 0.0},
        housing={"inner_mass": 1e6, "outer_mass": 1e6, "transducer_stiffness": 1e12},
        backup_bearing={"friction": 0.0},
    )
    start = state(tilt_x=1.4e-3 / 0.211, tilt_rate_x=speed / 0.211)
    found = signals(Simulation(rigid, state=start), 0.04)
    closed = found[14] > 0.0
    first = np.argmax(closed)
    assert closed[first]
    opened = first + np.argmin(closed[first:])
    assert not closed[opened]
    return -found[2, opened] * 0.211 / speed
