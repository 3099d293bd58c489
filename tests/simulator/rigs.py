"""Models of the shipped rigs, and variants of them, for the tests of simulator and physics."""

from functools import cache
from math import tau

import numpy as np

from daq.rig import load_rig
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
