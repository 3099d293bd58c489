"""Where the simulator goes on from an estimate: the model with what the twin has found, and its state."""

from collections.abc import Iterable, Mapping
from math import atan2, hypot
from typing import NamedTuple

import numpy as np

from daq.messages import Series
from daq.messages_pb2 import Parameter
from simulator.rig import Model, Rotor
from simulator.state import STATE

INTEGRAL = "speed_error_integral"  # the one state that no estimate has
SIGMA = "_sigma"  # ends the name of a row that holds another's standard deviation
PARAMETERS = {
    "magnet_stiffness": ("magnetic_bearing", "stiffness"),
    "magnet_damping": ("magnetic_bearing", "damping"),
    "clearance": ("backup_bearing", "clearance"),
    "contact_stiffness": ("backup_bearing", "stiffness"),
    "contact_damping": ("backup_bearing", "damping_factor"),
    "contact_friction": ("backup_bearing", "friction"),
}
"""The twin's parameters by name, and the table and key of the number that each stands for."""


class Resumed(NamedTuple):
    """What `simulator.simulation.Simulation` needs to go on from an estimate.

    The speed controller's integral is 0 unless it was given.
    """

    model: Model
    state: np.ndarray  # (12,) in the order of `simulator.state.STATE`


def values_at(estimate: Series, column: int = -1) -> dict[str, float]:
    """Return one column of an estimate, by default its last: value by name of the row."""
    values = estimate.samples[:, column].astype(np.float64).tolist()
    return dict(zip(estimate.names, values, strict=True))


def rows_of(parameters: Iterable[Parameter]) -> dict[str, float]:
    """Return those of the parameters that are `PARAMETERS`, as rows with deviations."""
    rows = {}
    for each in parameters:
        if PARAMETERS.get(each.name) == tuple(each.key.split(".")):
            rows[each.name], rows[each.name + SIGMA] = each.value, each.sigma
    return rows


def resume(model: Model, values: Mapping[str, float]) -> Resumed:
    """Return the model and the state that an estimate amounts to.

    Args:
        model: as the rig's description has it; what the estimate does not say stays so.
        values: one column of an estimate by row name, SI units: tilt and its rate, house, ring, angle and
            speed, and as far as they are known unbalance, coupling force and `PARAMETERS`.

    Raises:
        KeyError: the estimate lacks a row of the state.
    """
    for row, (table, field) in PARAMETERS.items():
        if row in values:
            changed = getattr(model, table)._replace(**{field: values[row]})
            model = model._replace(**{table: changed})
    state = np.array([values.get(name, 0.0) if name == INTEGRAL else values[name] for name in STATE])
    return Resumed(model._replace(rotor=loaded(model.rotor, values)), state)


def loaded(rotor: Rotor, values: Mapping[str, float]) -> Rotor:
    """Return the rotor with the estimated unbalance and coupling; what pulls it along x fits no model."""
    if "unbalance_x" in values:
        x, y = values["unbalance_x"], values["unbalance_y"]
        rotor = rotor._replace(unbalance=hypot(x, y), unbalance_angle=atan2(y, x))
    if "coupling_force_y" in values:
        rotor = rotor._replace(coupling_force=values["coupling_force_y"])
    return rotor
