"""The smoother is the least-squares solution over a stretch of flight."""

import numpy as np
import pytest

from twin.smoother import MOMENT, MOVING, SIZE, UNBALANCE, Flight, new_tape, smooth, transition

TICKS = 30


def drawn_flight() -> Flight:
    """Return a short flight of a made-up rotor, in units in which all numbers are near one."""
    draw = np.random.default_rng(4)
    flow = np.eye(MOVING, MOVING + 2) + 0.1 * draw.normal(size=(MOVING, MOVING + 2))
    faster, speeds = 0.1 * draw.normal(size=flow.shape), draw.normal(size=TICKS)
    readings = draw.normal(size=(2, TICKS))
    readings[1, 7] = np.nan
    rows = np.array([[1.0, 0.2, -0.1, 0.05], [-0.3, 1.5, 0.0, 0.2]])
    pulls, variance = draw.normal(size=(TICKS, 2)), np.array([0.4, 0.7])
    return Flight(flow, faster, speeds, pulls, 0.05, readings, rows, variance)


def batch(flight: Flight, state: np.ndarray, covariance: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return states (TICKS, SIZE) and covariances of the normal equations over begin and process noise."""
    unknown = SIZE + 2 * (TICKS - 1)  # the state at the begin, and what chance adds to the rates at each tick
    maps = np.zeros((TICKS, SIZE, unknown))
    maps[0, :, :SIZE] = np.eye(SIZE)
    ahead = np.zeros((SIZE, SIZE))
    for k in range(1, TICKS):
        transition(flight, k, ahead)
        maps[k] = ahead @ maps[k - 1]
        maps[k, 2:4, SIZE + 2 * k - 2 : SIZE + 2 * k] += np.eye(2)
    prior = np.full(unknown, flight.noise)
    information = np.diag(1.0 / prior)
    information[:SIZE, :SIZE] = np.linalg.inv(covariance)
    right = np.zeros(unknown)
    right[:SIZE] = information[:SIZE, :SIZE] @ state
    for k in range(1, TICKS):
        for probe in range(2):
            if np.isfinite(flight.readings[probe, k]):
                row = flight.rows[probe] @ maps[k, :MOVING]
                information += np.outer(row, row) / flight.variance[probe]
                right += row * flight.readings[probe, k] / flight.variance[probe]
    solved, spread = np.linalg.solve(information, right), np.linalg.inv(information)
    return maps @ solved, maps @ spread @ maps.transpose(0, 2, 1)


def test_it_is_the_weighted_least_squares_solution():
    flight, tape = drawn_flight(), new_tape(TICKS, 2)
    draw = np.random.default_rng(5)
    root = draw.normal(size=(SIZE, SIZE))
    tape.state[0], tape.covariance[0] = draw.normal(size=SIZE), root @ root.T + np.eye(SIZE)
    states, covariances = batch(flight, tape.state[0].copy(), tape.covariance[0].copy())
    smooth(flight, tape)
    # Both solve the same equations in another order: rounding, times the equations' condition of some 1e5.
    assert tape.state == pytest.approx(states, rel=1e-8, abs=1e-8)
    assert tape.covariance == pytest.approx(covariances, rel=1e-8, abs=1e-8)
    assert MOVING == MOMENT < UNBALANCE
