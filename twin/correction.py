"""Measurement update of the observer: one scalar at a time, so that a lost sensor is simply left out."""

import numpy as np

from simulator.compile import kernel


@kernel
def correct(
    state: np.ndarray,
    covariance: np.ndarray,
    row: np.ndarray,
    columns: np.ndarray,
    innovation: float,
    variance: float,
    work: np.ndarray,
) -> float:
    """Correct `state` (n,) and `covariance` (n, n) in place by one scalar measurement.

    The measurement is `row @ state[columns]` plus noise of `variance`; `innovation` is what was read less
    what was expected. `work` (n,) is scratch. Returns the innovation's square over its expected variance,
    which is 1 on average when the filter knows how good it is.
    """
    size = state.size
    for i in range(size):
        work[i] = 0.0
    for k in range(row.size):
        if row[k] != 0.0:
            for i in range(size):
                work[i] += row[k] * covariance[columns[k], i]
    expected = variance
    for k in range(row.size):
        expected += row[k] * work[columns[k]]
    for i in range(size):
        gain = work[i] / expected
        state[i] += gain * innovation
        for j in range(size):
            covariance[i, j] -= gain * work[j]
    return innovation * innovation / expected
