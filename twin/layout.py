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
# Parameters, one each; those of the contact stand together.
STIFFNESS = 15  # ln of the contact's stiffness over the described one
DAMPING = 16  # ln of the contact's damping, likewise
FRICTION = 17  # ln of the contact's friction, likewise
CLEARANCE = 18  # m more than the described clearance
MAGNET_STIFFNESS = 19  # of the magnetic bearing, relative to the described one: 0.02 is 2 % more
MAGNET_DAMPING = 20  # likewise
SIZE = 21
DYNAMIC = 9  # states with equations of motion; those behind them are slow, or parameters
CONTACT_PARAMETERS = 4  # from STIFFNESS on
FREE_INPUTS = 4  # of the dynamic states: moment along x, y (N m), residual force along x, y (N)
INPUTS = FREE_INPUTS + CONTACT_PARAMETERS  # in contact its parameters act as well
LONGEST = 30  # ticks by which a probe's reading may be late
LARGEST_LOG = 1.2  # of a contact parameter: it may be a third or three times the described one
LARGEST_CLEARANCE = 0.5  # of the described clearance: how much it may differ from that
LARGEST_MAGNET = 1.0  # of the magnetic bearing's changes: it may be lost, or twice the described one


class Tuning(NamedTuple):
    """What the filter believes about noise; the values are explained in docs/explanation/observer.md."""

    displacement_noise: float = 1e-6  # m rms of a proximity probe
    force_noise: float = 0.5  # N rms of a force transducer
    moment_noise: float = 5e-6  # N m/sqrt(Hz), on the rotor
    house_noise: float = 3e-4  # N/sqrt(Hz), on the house
    ring_noise: float = 1.0  # rad/s/sqrt(s), on the inner ring
    unbalance_walk: float = 1e-8  # kg m/sqrt(s): how fast the unbalance may change
    moment_walk: float = 1e-5  # N m/sqrt(s): how fast the static moment may change
    residual_time: float = 1.3e-3  # s after which the residual contact force is forgotten
    residual_noise: float = 3.2  # N/sqrt(s): how fast the residual contact force may change
    residual_share: float = 3.2  # of the normal force/sqrt(s), likewise
    contact_doubt: float = 0.2  # of ln stiffness and friction of the contact, at the start
    damping_doubt: float = 0.5  # of ln damping of the contact: its law is known least
    contact_walk: float = 0.003  # 1/sqrt(s) of contact: how fast they may change
    clearance_doubt: float = 20e-6  # m, of the clearance at the start
    clearance_walk: float = 0.03e-6  # m/sqrt(s) of contact
    magnet_stiffness_doubt: float = 0.03  # of K at the start, relative; 0: known
    magnet_stiffness_walk: float = 1e-5  # 1/sqrt(s)
    magnet_damping_doubt: float = 0.2  # of c at the start, relative; 0: known
    magnet_damping_walk: float = 1e-3  # 1/sqrt(s)


class Sensors(NamedTuple):
    """The channels that correct the observer, one entry each; reading = weights @ state[columns] + noise."""

    channel: np.ndarray  # (n,) int, row in the block
    columns: np.ndarray  # (n, 2) int, into the state
    weights: np.ndarray  # (n, 2) unit of the channel per unit of the state
    variance: np.ndarray  # (n,) of the noise
    low: np.ndarray  # (n,) a reading below is not used
    high: np.ndarray  # (n,) a reading above is not used
    late: np.ndarray  # (n,) ticks by which a reading is late


class Feeds(NamedTuple):
    """The channels that drive the observer."""

    angle: int  # row of the encoder's angle in the block
    sense: float  # 1 when that angle grows from x towards y, else -1
    currents: np.ndarray  # (m,) int, rows of the solenoids' currents
    moments: np.ndarray  # (m, 2) N m per A, along x and y
    late: float  # s by which the angle is late


class Memory(NamedTuple):
    """The observer's arrays: what it carries from tick to tick, and scratch. SI units."""

    state: np.ndarray  # (SIZE,)
    covariance: np.ndarray  # (SIZE, SIZE)
    shaft: np.ndarray  # (3,) angle, speed, acceleration of the encoder's loop
    described: np.ndarray  # (8, 6) candidates of the contact as the rig describes them
    candidates: np.ndarray  # (8, 6) the same as estimated, see `simulator.candidates`
    free_flow: np.ndarray  # (DYNAMIC, DYNAMIC + FREE_INPUTS) one tick of free flight
    free_at: np.ndarray  # (3,) speed, changes of K and c for which free_flow holds; NaN: not yet built
    flow: np.ndarray  # (DYNAMIC, DYNAMIC + INPUTS) one tick of contact
    transition: np.ndarray  # (DYNAMIC, SIZE) of small deviations of what moves, this tick
    force: np.ndarray  # (1,) N, normal force of the contact at the tick's middle
    tells: np.ndarray  # (2,) 1 where the contact tells of its damping and of its friction, else 0
    near: np.ndarray  # (2,) m, deviation of the penetration in a tick that may touch, else 0; the gap
    misfit: np.ndarray  # (4,) how far the contact law seems to be off, see `twin.misfit`
    surprise: np.ndarray  # (1,) innovations' squares over their expectation, mean of some ten ticks
    energy: np.ndarray  # (3,) J lost in the contact, its standard deviation, 1 while open
    weight: np.ndarray  # (2,) N m, moment of the rotor's weight along x, y
    ways: np.ndarray  # (LONGEST, 4) way of tilt and house in each of the last ticks, see `twin.lateness`
    latest: np.ndarray  # (1,) int, row of `ways` that the last tick is in
    rates: np.ndarray  # (DYNAMIC, DYNAMIC) scratch
    free_inputs: np.ndarray  # (DYNAMIC, FREE_INPUTS) scratch
    inputs: np.ndarray  # (DYNAMIC, INPUTS) scratch
    slopes: np.ndarray  # (5, 5 + CONTACT_PARAMETERS) scratch
    free_work: np.ndarray  # (2, DYNAMIC, DYNAMIC + FREE_INPUTS) scratch
    flow_work: np.ndarray  # (2, DYNAMIC, DYNAMIC + INPUTS) scratch
    half_work: np.ndarray  # (DYNAMIC, SIZE) scratch
    turned_work: np.ndarray  # (SIZE, DYNAMIC) scratch
    square_work: np.ndarray  # (DYNAMIC, DYNAMIC) scratch
    vector_work: np.ndarray  # (SIZE,) scratch
    varied_work: np.ndarray  # (8, 6) scratch


def new_memory() -> Memory:
    """Return memory that says nothing yet."""
    free, wide = DYNAMIC + FREE_INPUTS, DYNAMIC + INPUTS
    return Memory(
        state=np.zeros(SIZE),
        covariance=np.zeros((SIZE, SIZE)),
        shaft=np.zeros(3),
        described=np.zeros((MOST_PINS, COLUMNS)),
        candidates=np.zeros((MOST_PINS, COLUMNS)),
        free_flow=np.zeros((DYNAMIC, free)),
        free_at=np.full(3, np.nan),
        flow=np.zeros((DYNAMIC, wide)),
        transition=np.zeros((DYNAMIC, SIZE)),
        force=np.zeros(1),
        tells=np.zeros(2),
        near=np.zeros(2),
        misfit=np.zeros(4),
        surprise=np.ones(1),
        energy=np.array([0.0, 0.0, 1.0]),
        weight=np.zeros(2),
        ways=np.zeros((LONGEST, 4)),
        latest=np.zeros(1, dtype=np.int64),
        rates=np.zeros((DYNAMIC, DYNAMIC)),
        free_inputs=np.zeros((DYNAMIC, FREE_INPUTS)),
        inputs=np.zeros((DYNAMIC, INPUTS)),
        slopes=np.zeros((5, 5 + CONTACT_PARAMETERS)),
        free_work=np.zeros((2, DYNAMIC, free)),
        flow_work=np.zeros((2, DYNAMIC, wide)),
        half_work=np.zeros((DYNAMIC, SIZE)),
        turned_work=np.zeros((SIZE, DYNAMIC)),
        square_work=np.zeros((DYNAMIC, DYNAMIC)),
        vector_work=np.zeros(SIZE),
        varied_work=np.zeros((MOST_PINS, COLUMNS)),
    )
