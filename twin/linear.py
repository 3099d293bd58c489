"""Small dense algebra for the observer's kernels: no BLAS, no allocation, the same sums in the same order."""

import numpy as np

from simulator.compile import kernel


@kernel
def multiply(left: np.ndarray, right: np.ndarray, out: np.ndarray) -> None:
    """Set `out` (n, m) = `left` (n, k) @ `right` (k, m), skipping zeros of `left`."""
    for i in range(left.shape[0]):
        for j in range(right.shape[1]):
            out[i, j] = 0.0
        for k in range(left.shape[1]):
            factor = left[i, k]
            if factor != 0.0:
                for j in range(right.shape[1]):
                    out[i, j] += factor * right[k, j]


@kernel
def congruence(transition: np.ndarray, covariance: np.ndarray, work: np.ndarray) -> None:
    """Set `covariance` = `transition` @ `covariance` @ `transition`^T, all (n, n); exactly symmetric.

    `work` (2, n, n) is scratch.
    """
    half, turned = work[0], work[1]
    multiply(transition, covariance, half)
    size = covariance.shape[0]
    for i in range(size):
        for j in range(size):
            turned[i, j] = half[j, i]
    multiply(transition, turned, covariance)
    for i in range(size):
        for j in range(i):
            mean = 0.5 * (covariance[i, j] + covariance[j, i])
            covariance[i, j] = mean
            covariance[j, i] = mean


@kernel
def discretise(
    rates: np.ndarray, inputs: np.ndarray, step: float, doublings: int, flow: np.ndarray, work: np.ndarray
) -> None:
    """Integrate z' = `rates` z + `inputs` w over `step` seconds with w constant.

    `rates` (n, n), `inputs` (n, m). Sets `flow` (n, n + m) so that z(step) = flow[:, :n] z + flow[:, n:] w.
    A Taylor series to fourth order over `step` / 2**`doublings`, then doubled: the largest rate times that
    shorter step should be below one. `work` (2, n, n + m) is scratch.
    """
    size = flow.shape[0]
    term, following = work[0], work[1]
    term[:, :size] = rates
    term[:, size:] = inputs
    term *= step / 2.0**doublings
    flow[:] = term
    for i in range(size):
        flow[i, i] += 1.0
    for order in range(2, 5):
        multiply(rates, term, following)
        add_term(following, step / 2.0**doublings / order, term, flow)
    for _ in range(doublings):
        multiply(flow[:, :size], flow, following)
        following[:, size:] += flow[:, size:]
        flow[:] = following


@kernel
def add_term(following: np.ndarray, factor: float, term: np.ndarray, total: np.ndarray) -> None:
    """Set `term` = `factor` * `following` and add it to `total`, all of one shape."""
    for i in range(term.shape[0]):
        for j in range(term.shape[1]):
            term[i, j] = factor * following[i, j]
            total[i, j] += term[i, j]
