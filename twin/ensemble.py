"""The rig as it may be, within what the twin does not know: models and states drawn about an estimate."""

from collections.abc import Mapping
from math import hypot, sqrt

import numpy as np

from simulator.rig import DriveMode, Model
from simulator.simulation import checked
from twin.resume import PARAMETERS, SIGMA, Resumed, resume

PLACES = {
    "tilt_x": "displacement_x",
    "tilt_y": "displacement_y",
    "tilt_rate_x": "velocity_x",
    "tilt_rate_y": "velocity_y",
}
"""Rows whose deviation is that of another over the backup bearing's station."""
DOUBTS = {
    "magnet_stiffness": 0.002,
    "magnet_damping": 0.1,
    "clearance": 0.003,
    "contact_stiffness": 0.15,
    "contact_damping": 0.15,
    "contact_friction": 0.15,
}
"""Standard deviation, as a share, of what the twin does not say and the description does."""
LEAST = 0.3  # of a parameter's value: a draw does not go below


def drawn(model: Model, values: Mapping[str, float], count: int, seed: int = 0) -> list[Resumed]:
    """Return `count` rigs, each with a model and a state, within the uncertainty of an estimate.

    The first is the estimate itself. Rows are drawn by themselves from normal distributions: their standard
    deviations are the rows `*_sigma`; numbers of the description alone have those of `DOUBTS`. The
    speed is prescribed, which costs a tenth of what a motor does, and changes little in seconds.
    """
    model = checked(model._replace(drive=model.drive._replace(mode=DriveMode.IDEAL)))
    complete = described(model) | dict(values)
    spread = deviations(model, values)
    chance = np.random.default_rng(seed)
    draws = [varied(complete, spread, chance) for _ in range(count - 1)]
    return [resume(model, each) for each in (complete, *draws)]


def described(model: Model) -> dict[str, float]:
    """Return what the description says about the rows that an estimate may have."""
    return {row: getattr(getattr(model, table), field) for row, (table, field) in PARAMETERS.items()}


def deviations(model: Model, values: Mapping[str, float]) -> dict[str, float]:
    """Return the standard deviation of each row that is uncertain, in its unit."""
    known = described(model)
    found = {row: share * known[row] for row, share in DOUBTS.items() if row not in values}
    for row in values:
        if row + SIGMA in values:
            found[row] = values[row + SIGMA]
    for row, place in PLACES.items():
        if place + SIGMA in values:
            found[row] = values[place + SIGMA] / model.rotor.bearing_station
    if "unbalance_sigma" in values:
        across = values["unbalance"] * values["unbalance_phase_sigma"]
        found["unbalance_x"] = found["unbalance_y"] = hypot(values["unbalance_sigma"], across) / sqrt(2.0)
    return found


def varied(
    complete: Mapping[str, float], spread: Mapping[str, float], chance: np.random.Generator
) -> dict[str, float]:
    """Return values with a draw of what is uncertain about them added."""
    found = dict(complete)
    for name, deviation in spread.items():
        found[name] += deviation * chance.standard_normal()
        if name in PARAMETERS:
            found[name] = max(found[name], LEAST * complete[name])
    return found
