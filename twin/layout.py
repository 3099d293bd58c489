"""What the observer's kernels share: the order of its state, its tuning and its working memory."""

from typing import NamedTuple

import numpy as np

from simulator.candidates import COLUMNS
from simulator.rig import MOST_PINS

# Indices into the state vector; each but RING is the first of a pair along x and y.
TILT = 0  # rad
TILT_RATE = 2  # rad/s
HOUSE = 4  # m
HOUSE_RATE = 6  # m/s
RING = 8  # rad/s
UNBALANCE = 9  # kg m, turns with the shaft: along and across the encoder's zero
MOMENT = 11  # N m, static: weight, coupling
RESIDUAL = 13  # N, contact force that the contact law does not explain
SIZE = 15
DYNAMIC = 9  # states with equations of motion; those behind them are parameters
INPUTS = 4  # of the dynamic states: moment along x, y (N m), residual force along x, y (N)


class Tuning(NamedTuple):
    """What the filter believes about noise; the values are explained in docs/explanation/observer.md."""

    displacement_noise: float = 1e-6  # m rms of a proximity probe
    force_noise: float = 0.7  # N rms of a force transducer, on purpose above the 0.5 N of a good one
    moment_noise: float = 2e-5  # N m/sqrt(Hz), on the rotor
    house_noise: float = 3e-4  # N/sqrt(Hz), on the house
    ring_noise: float = 1.0  # rad/s/sqrt(s), on the inner ring
    unbalance_walk: float = 1e-8  # kg m/sqrt(s): how fast the unbalance may change
    moment_walk: float = 1e-5  # N m/sqrt(s): how fast the static moment may change
    residual_time: float = 0.04  # s after which the residual contact force is forgotten
    residual_noise: float = 24.0  # N/sqrt(s): how fast the residual contact force may change
    residual_share: float = 1.6  # of the normal force/sqrt(s), likewise


class Memory(NamedTuple):
    """The observer's arrays: what it carries from tick to tick, and scratch. SI units."""

    state: np.ndarray  # (SIZE,)
    covariance: np.ndarray  # (SIZE, SIZE)
    shaft: np.ndarray  # (3,) angle, speed, acceleration of the encoder's loop
    candidates: np.ndarray  # (8, 6) of the contact, see `simulator.candidates`
    free_flow: np.ndarray  # (DYNAMIC, DYNAMIC + INPUTS) one tick of free flight
    free_speed: np.ndarray  # (1,) rad/s for which free_flow holds; NaN: not yet built
    flow: np.ndarray  # (DYNAMIC, DYNAMIC + INPUTS) this tick
    transition: np.ndarray  # (SIZE, SIZE) of small deviations, this tick
    force: np.ndarray  # (2,) N, the contact's normal force and penetration (m) at the tick's middle
    rates: np.ndarray  # (DYNAMIC, DYNAMIC) scratch
    inputs: np.ndarray  # (DYNAMIC, INPUTS) scratch
    slopes: np.ndarray  # (5, 5) scratch
    flow_work: np.ndarray  # (2, DYNAMIC, DYNAMIC + INPUTS) scratch
    square_work: np.ndarray  # (2, SIZE, SIZE) scratch
    vector_work: np.ndarray  # (SIZE,) scratch


def new_memory() -> Memory:
    """Return memory that says nothing yet."""
    wide = DYNAMIC + INPUTS
    return Memory(
        state=np.zeros(SIZE),
        covariance=np.zeros((SIZE, SIZE)),
        shaft=np.zeros(3),
        candidates=np.zeros((MOST_PINS, COLUMNS)),
        free_flow=np.zeros((DYNAMIC, wide)),
        free_speed=np.full(1, np.nan),
        flow=np.zeros((DYNAMIC, wide)),
        transition=np.zeros((SIZE, SIZE)),
        force=np.zeros(2),
        rates=np.zeros((DYNAMIC, DYNAMIC)),
        inputs=np.zeros((DYNAMIC, INPUTS)),
        slopes=np.zeros((5, 5)),
        flow_work=np.zeros((2, DYNAMIC, wide)),
        square_work=np.zeros((2, SIZE, SIZE)),
        vector_work=np.zeros(SIZE),
    )
