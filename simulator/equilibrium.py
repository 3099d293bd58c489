"""Where the shaft hangs when nothing moves."""

from math import sqrt

import numpy as np

from simulator.candidates import DAMPING_FACTOR, candidates_of, for_kernels
from simulator.compile import kernel
from simulator.contact import PINNED, contact_force
from simulator.dynamics import static_moment
from simulator.rig import Model, RigError
from simulator.state import STATE, State

BISECTIONS = 200


def static_state(model: Model) -> np.ndarray:
    """Return the state (12,) at rest under weight, coupling force, magnet and, where it is reached, bearing.

    The shaft hangs in the vertical plane. Raises `RigError` when nothing carries it.
    """
    candidates, bare = candidates_of(model), for_kernels(model)
    candidates[:, DAMPING_FACTOR] = 0.0
    offset, house = bisected(bare, candidates, *bracket(bare, candidates))
    values = np.zeros(len(STATE))
    values[STATE.index("tilt_y")] = (offset + house) / model.rotor.bearing_station
    values[STATE.index("house_y")] = house
    return values


@kernel
def bisected(model: Model, candidates: np.ndarray, low: float, high: float) -> tuple[float, float]:
    """Return the offset (m) between two at which no moment is left, and the house's (m)."""
    for _ in range(BISECTIONS):
        middle = 0.5 * (low + high)
        if excess(model, candidates, middle)[0] > 0.0:
            low = middle
        else:
            high = middle
    offset = 0.5 * (low + high)
    return offset, excess(model, candidates, offset)[1]


def bracket(model: Model, candidates: np.ndarray) -> tuple[float, float]:
    """Return offsets (m) below and above the one at rest. Raises `RigError` when nothing carries the shaft.

    Pins do not carry a shaft pressed as far between them as their tips' centres: nearer ones are tried too.
    """
    reach = deepest(model)
    for share in (1.0, 0.5, 0.25):
        lifted, pressed = (excess(model, candidates, side * share * reach)[0] for side in (-1.0, 1.0))
        if lifted >= 0.0 >= pressed:
            return -share * reach, share * reach
    raise RigError(
        "neither [magnetic_bearing] stiffness nor [backup_bearing] stiffness carries the weight of "
        "[rotor]; check their units"
    )


def deepest(model: Model) -> float:
    """Return an offset between shaft and house, m, that the bearing will not be pressed to."""
    bearing, radius = model.backup_bearing, model.rotor.shaft_radius
    if bearing.kind == PINNED:
        return (radius + bearing.pin_tip_radius + bearing.clearance) * sqrt(0.5)
    return bearing.clearance + radius


@kernel
def excess(model: Model, candidates: np.ndarray, offset: float) -> tuple[float, float]:
    """Return the moment (N m, up positive) left on a shaft held `offset` (m) above the house's centre.

    And where the contact's reaction has pushed the inner house, m.
    """
    rotor = model.rotor
    held = State(0.0, offset / rotor.bearing_station, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    lift = contact_force(model, candidates, held).force_y
    house = -lift / (2.0 * model.housing.transducer_stiffness)
    arm = rotor.magnet_station * rotor.magnet_station
    stiffness = model.magnetic_bearing.stiffness * arm + rotor.pivot_stiffness
    tilt = (offset + house) / rotor.bearing_station
    return static_moment(rotor) + rotor.bearing_station * lift - stiffness * tilt, house
