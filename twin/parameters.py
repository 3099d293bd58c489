"""The model with its parameters as estimated, and the bounds within which they are believed."""

from math import exp, sqrt

import numpy as np

from simulator import candidates as place
from simulator.compile import inlined, kernel
from simulator.contact import PINNED, latch
from simulator.law import LATCHED
from simulator.rig import BackupBearing, MagneticBearing, Model
from simulator.state import State
from twin.layout import (
    CLEARANCE,
    DAMPING,
    FRICTION,
    LARGEST_CLEARANCE,
    LARGEST_LOG,
    LARGEST_MAGNET,
    MAGNET_DAMPING,
    MAGNET_STIFFNESS,
    SIZE,
    STIFFNESS,
    Memory,
)

FACTOR, TIP_X, TIP_Y = place.DAMPING_FACTOR, place.TIP_X, place.TIP_Y
STIFF, SLIDING, RESTING = place.STIFFNESS, place.SLIDING, place.RESTING


@kernel
def adjusted(model: Model, memory: Memory) -> Model:
    """Return the described model with the parameters estimated; set the memory's candidates to match."""
    state = memory.state
    damping, clearance = exp(state[DAMPING]), state[CLEARANCE]
    vary_candidates(
        model,
        memory.described,
        exp(state[STIFFNESS]),
        damping,
        exp(state[FRICTION]),
        clearance,
        memory.candidates,
    )
    found = varied(model, damping, clearance)
    magnet = MagneticBearing(
        (1.0 + state[MAGNET_STIFFNESS]) * model.magnetic_bearing.stiffness,
        (1.0 + state[MAGNET_DAMPING]) * model.magnetic_bearing.damping,
    )
    return Model(found.rotor, magnet, found.backup_bearing, found.housing, found.drive)


@kernel
def vary_candidates(
    model: Model,
    source: np.ndarray,
    stiffness: float,
    damping: float,
    friction: float,
    clearance: float,
    target: np.ndarray,
) -> None:
    """Set `target` (8, 6) to the candidates `source` changed by factors, and by m of clearance."""
    pinned = model.backup_bearing.kind == PINNED
    for i in range(source.shape[0]):
        x, y = source[i, TIP_X], source[i, TIP_Y]
        longer = 1.0 + clearance / sqrt(x * x + y * y) if pinned else 1.0
        target[i, TIP_X], target[i, TIP_Y] = longer * x, longer * y
        target[i, STIFF] = stiffness * source[i, STIFF]
        target[i, SLIDING] = friction * source[i, SLIDING]
        target[i, RESTING] = friction * source[i, RESTING]
        target[i, FACTOR] = damping * source[i, FACTOR]


@inlined
def varied(model: Model, damping: float, clearance: float) -> Model:
    """Return the model with what its candidates do not hold changed: damping by a factor, clearance by m."""
    bearing = model.backup_bearing
    return Model(
        model.rotor,
        model.magnetic_bearing,
        BackupBearing(
            bearing.kind,
            bearing.clearance + clearance,
            bearing.stiffness,
            bearing.damping_mode,
            bearing.damping_factor,
            bearing.restitution,
            bearing.friction,
            bearing.slip_speed,
            bearing.ring_inertia,
            bearing.ring_damping,
            bearing.pin_tip_radius,
            bearing.law,
            damping * bearing.damping,
            bearing.static_friction,
            bearing.stribeck_speed,
            bearing.pin_count,
            bearing.pin_angle_deg,
            bearing.pin_length,
            bearing.pins,
        ),
        model.housing,
        model.drive,
    )


@kernel
def latch_adjusted(model: Model, memory: Memory, state: State) -> None:
    """Bring the open candidates' damping factors up to date, as described and as estimated."""
    if model.backup_bearing.damping_mode != LATCHED:
        return
    described, estimated, scale = memory.described, memory.candidates, exp(memory.state[DAMPING])
    for i in range(described.shape[0]):
        estimated[i, FACTOR] = described[i, FACTOR]
    latch(model, state, estimated)
    for i in range(described.shape[0]):
        described[i, FACTOR] = estimated[i, FACTOR]
        estimated[i, FACTOR] *= scale


@kernel
def bound(model: Model, state: np.ndarray) -> None:
    """Keep the parameters in `state` (SIZE,) within what the rig's description leaves believable."""
    for i in range(STIFFNESS, SIZE):
        largest = LARGEST_LOG
        if i == CLEARANCE:
            largest = LARGEST_CLEARANCE * model.backup_bearing.clearance
        elif i in (MAGNET_STIFFNESS, MAGNET_DAMPING):
            largest = LARGEST_MAGNET
        state[i] = min(max(state[i], -largest), largest)
