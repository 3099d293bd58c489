"""The rig as it may be, within what the twin does not know: models and states drawn about an estimate."""

from collections.abc import Mapping

import numpy as np

from simulator.rig import DriveMode, Model
from simulator.simulation import checked
from twin.resume import PARAMETERS, Resumed, resume

SIGMA = "sigma_"  # begins the name of a row that holds another's standard deviation
DOUBTS = {
    "magnet_stiffness": 0.002,
    "magnet_damping": 0.1,
    "clearance": 0.003,
    "contact_stiffness": 0.15,
    "contact_damping": 0.15,
    "friction": 0.15,
}
"""Standard deviation, as a share, of what an estimate does not say and the description does."""
LEAST = 0.3  # of a parameter's value: a draw does not go below


def drawn(model: Model, values: Mapping[str, float], count: int, seed: int = 0) -> list[Resumed]:
    """Return `count` rigs, each with a model and a state, within the uncertainty of an estimate.

    The first is the estimate itself. Rows are drawn by themselves from normal distributions: their standard
    deviations are the estimate's rows `sigma_*`; the description's numbers have those of `DOUBTS`. The
    speed is prescribed, which costs a tenth of what a motor does, and changes little in seconds.
    """
    model = checked(model._replace(drive=model.drive._replace(mode=DriveMode.IDEAL)))
    complete = described(model) | dict(values)
    chance = np.random.default_rng(seed)
    draws = [varied(complete, values, chance) for _ in range(count - 1)]
    return [resume(model, each) for each in (complete, *draws)]


def described(model: Model) -> dict[str, float]:
    """Return what the description says about the rows that an estimate may have."""
    return {row: getattr(getattr(model, table), field) for row, (table, field) in PARAMETERS.items()}


def varied(
    complete: Mapping[str, float], estimated: Mapping[str, float], chance: np.random.Generator
) -> dict[str, float]:
    """Return values with a draw of what is uncertain about them added."""
    found = {}
    for name, value in complete.items():
        share = 0.0 if name in estimated else DOUBTS.get(name, 0.0)
        sigma = complete.get(SIGMA + name, share * abs(value))
        moved = value + sigma * chance.standard_normal()
        found[name] = max(moved, LEAST * value) if name in PARAMETERS else moved
    return found
