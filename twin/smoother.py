"""Smoothing between impacts: what the readings after a moment tell of it as well.

Out of contact the rotor is linear in its tilt, its rate, the static moment and the unbalance, eight states.
Over a stretch of flight the Kalman filter runs forwards on the probes; the modified Bryson-Frazier recursion
(Bierman 1977, Factorization Methods for Discrete Sequential Estimation, ch. X) then goes back over what it
has kept, without inverting a covariance:

    at a reading    l <- (1 - H'K') l - H' e / s       L <- (1 - KH)' L (1 - KH) + H'H / s
    over a tick     l <- F' l                          L <- F' L F
    smoothed        x - P l                            P - P L P

with the innovation e and its variance s. It is the weighted least-squares solution over the stretch.
"""

from typing import NamedTuple

import numpy as np

from simulator.compile import kernel
from twin.linear import multiply

MOVING = 4  # states with equations of motion: tilt and its rate, x and y
MOMENT = 4  # N m, static, x and y
UNBALANCE = 6  # kg m, along and across the encoder's zero
SIZE = 8


class Flight(NamedTuple):
    """A stretch of contact-free flight of n ticks; the first has been taken in already."""

    flow: np.ndarray  # (MOVING, MOVING + 2) one tick, of motion and of a moment along x, y (N m)
    faster: np.ndarray  # (MOVING, MOVING + 2) how the flow changes with the shaft's speed, per rad/s
    speeds: np.ndarray  # (n,) rad/s from one tick to the next, more than the flow's
    pulls: np.ndarray  # (n, 2) N m per kg m of unbalance from one tick to the next, see `unbalance_pull`
    noise: float  # (rad/s)2 that a tick adds to the variance of each rate
    readings: np.ndarray  # (m, n) of the probes; NaN: none
    rows: np.ndarray  # (m, MOVING) unit of the reading per unit of what moves
    variance: np.ndarray  # (m,) of the readings' noise


class Tape(NamedTuple):
    """What the way forwards keeps for the way back."""

    state: np.ndarray  # (n, SIZE) after each tick's readings
    covariance: np.ndarray  # (n, SIZE, SIZE) likewise
    gain: np.ndarray  # (n, m, SIZE)
    innovation: np.ndarray  # (n, m)
    expected: np.ndarray  # (n, m) variance of the innovation; 0: there was no reading
    work: np.ndarray  # (4, SIZE, SIZE) scratch
    vector: np.ndarray  # (2, SIZE) scratch


def new_tape(ticks: int, probes: int) -> Tape:
    """Return a tape for a stretch of so many ticks."""
    return Tape(
        np.zeros((ticks, SIZE)),
        np.zeros((ticks, SIZE, SIZE)),
        np.zeros((ticks, probes, SIZE)),
        np.zeros((ticks, probes)),
        np.zeros((ticks, probes)),
        np.zeros((4, SIZE, SIZE)),
        np.zeros((2, SIZE)),
    )


@kernel
def smooth(flight: Flight, tape: Tape) -> None:
    """Smooth a stretch in place: `tape.state[0]` and `tape.covariance[0]` are what is known at its begin."""
    for k in range(1, flight.readings.shape[1]):
        predict(flight, tape, k)
        for probe in range(flight.readings.shape[0]):
            correct(flight, tape, k, probe)
    go_back(flight, tape)


@kernel
def transition(flight: Flight, k: int, out: np.ndarray) -> None:
    """Set `out` (SIZE, SIZE) to the transition from tick k - 1 to tick k."""
    pull_x, pull_y = flight.pulls[k - 1, 0], flight.pulls[k - 1, 1]
    for i in range(SIZE):
        for j in range(SIZE):
            out[i, j] = 1.0 if i == j else 0.0
    for i in range(MOVING):
        for j in range(MOVING + 2):
            out[i, j] = flight.flow[i, j] + flight.speeds[k - 1] * flight.faster[i, j]
        out[i, UNBALANCE] = out[i, MOMENT] * pull_x + out[i, MOMENT + 1] * pull_y
        out[i, UNBALANCE + 1] = out[i, MOMENT + 1] * pull_x - out[i, MOMENT] * pull_y


@kernel
def transpose(matrix: np.ndarray, out: np.ndarray) -> None:
    """Set `out` (SIZE, SIZE) to the transpose of `matrix`."""
    for i in range(SIZE):
        for j in range(SIZE):
            out[i, j] = matrix[j, i]


@kernel
def predict(flight: Flight, tape: Tape, k: int) -> None:
    """Carry state and covariance from tick k - 1 to tick k."""
    ahead, turned, half = tape.work[0], tape.work[1], tape.work[2]
    transition(flight, k, ahead)
    transpose(ahead, turned)
    for i in range(SIZE):
        tape.state[k, i] = 0.0
        for j in range(SIZE):
            tape.state[k, i] += ahead[i, j] * tape.state[k - 1, j]
    multiply(ahead, tape.covariance[k - 1], half)
    multiply(half, turned, tape.covariance[k])
    for axis in range(2):
        tape.covariance[k, 2 + axis, 2 + axis] += flight.noise


@kernel
def correct(flight: Flight, tape: Tape, k: int, probe: int) -> None:
    """Correct tick k by one probe's reading, and keep gain and innovation."""
    reading, row = flight.readings[probe, k], flight.rows[probe]
    tape.expected[k, probe] = 0.0
    if not np.isfinite(reading):
        return
    state, covariance, gain = tape.state[k], tape.covariance[k], tape.gain[k, probe]
    expected, innovation = flight.variance[probe], reading
    for i in range(SIZE):
        gain[i] = 0.0
        for j in range(MOVING):
            gain[i] += covariance[i, j] * row[j]
    for j in range(MOVING):
        expected += row[j] * gain[j]
        innovation -= row[j] * state[j]
    for i in range(SIZE):
        gain[i] /= expected
        state[i] += gain[i] * innovation
    for i in range(SIZE):
        for j in range(SIZE):
            covariance[i, j] -= gain[i] * gain[j] * expected
    tape.expected[k, probe], tape.innovation[k, probe] = expected, innovation


@kernel
def go_back(flight: Flight, tape: Tape) -> None:
    """Go from the stretch's end to its begin, and make the tape's states and covariances smoothed ones."""
    turned, half, weight, pull = tape.work[1], tape.work[2], tape.work[3], tape.vector[0]
    pull[:] = 0.0
    weight[:, :] = 0.0
    for k in range(flight.readings.shape[1] - 1, -1, -1):
        for i in range(SIZE):
            for j in range(SIZE):
                tape.state[k, i] -= tape.covariance[k, i, j] * pull[j]
        multiply(tape.covariance[k], weight, half)
        multiply(half, tape.covariance[k], turned)
        for i in range(SIZE):
            for j in range(SIZE):
                tape.covariance[k, i, j] -= turned[i, j]
        if k == 0:
            return
        for probe in range(flight.readings.shape[0] - 1, -1, -1):
            take_back(flight, tape, k, probe)
        carry_back(flight, tape, k)


@kernel
def carry_back(flight: Flight, tape: Tape, k: int) -> None:
    """Go back from tick k to tick k - 1."""
    ahead, turned, half, weight = tape.work[0], tape.work[1], tape.work[2], tape.work[3]
    pull, moved = tape.vector[0], tape.vector[1]
    transition(flight, k, ahead)
    transpose(ahead, turned)
    for i in range(SIZE):
        moved[i] = 0.0
        for j in range(SIZE):
            moved[i] += turned[i, j] * pull[j]
    for i in range(SIZE):
        pull[i] = moved[i]
    multiply(turned, weight, half)
    multiply(half, ahead, weight)


@kernel
def take_back(flight: Flight, tape: Tape, k: int, probe: int) -> None:
    """Go back over one reading."""
    expected, gain, row = tape.expected[k, probe], tape.gain[k, probe], flight.rows[probe]
    if expected == 0.0:
        return
    pull, along, weight = tape.vector[0], tape.vector[1], tape.work[3]
    told, square = tape.innovation[k, probe] / expected, 1.0 / expected
    for i in range(SIZE):
        told += gain[i] * pull[i]
        along[i] = 0.0
        for j in range(SIZE):
            along[i] += weight[i, j] * gain[j]
    for i in range(SIZE):
        square += gain[i] * along[i]
    for i in range(MOVING):
        pull[i] -= row[i] * told
        for j in range(SIZE):
            weight[i, j] -= row[i] * along[j]
            weight[j, i] -= row[i] * along[j]
    for i in range(MOVING):
        for j in range(MOVING):
            weight[i, j] += row[i] * row[j] * square
