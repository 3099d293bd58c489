"""Small dense algebra for the observer's kernels: no BLAS, no allocation, the same sums in the same order.

Plain loops instead of slices: numba takes several seconds longer to compile assignments to slices.
"""

import numpy as np

from simulator.compile import inlined, kernel
from twin.layout import DYNAMIC, SIZE


@kernel
def clear(matrix: np.ndarray) -> None:
    """Set all of `matrix` (n, m) to zero."""
    for i in range(matrix.shape[0]):
        for j in range(matrix.shape[1]):
            matrix[i, j] = 0.0


@kernel
def copy(source: np.ndarray, target: np.ndarray) -> None:
    """Set `target` (n, m) to `source`."""
    for i in range(source.shape[0]):
        for j in range(source.shape[1]):
            target[i, j] = source[i, j]


@kernel
def multiply(left: np.ndarray, right: np.ndarray, out: np.ndarray) -> None:
    """Set `out` (n, m) = `left` (n, k) @ `right` (k, m), skipping zeros of `left`.

    Of `left` only the first k columns are used, where it has more.
    """
    for i in range(left.shape[0]):
        for j in range(right.shape[1]):
            out[i, j] = 0.0
        for k in range(right.shape[0]):
            factor = left[i, k]
            if factor != 0.0:
                for j in range(right.shape[1]):
                    out[i, j] += factor * right[k, j]


@kernel
def carry(
    transition: np.ndarray,
    covariance: np.ndarray,
    half: np.ndarray,
    turned: np.ndarray,
    square: np.ndarray,
) -> None:
    """Set `covariance` (SIZE, SIZE) = F `covariance` F^T, exactly symmetric.

    F is `transition` (DYNAMIC, SIZE) in its first rows and the unit matrix in the others. `half`
    (DYNAMIC, SIZE), `turned` (SIZE, DYNAMIC) and `square` (DYNAMIC, DYNAMIC) are scratch. Here and in what
    it calls the loops' lengths are constants: it takes three fifths of the time.
    """
    carry_rows(transition, covariance, half)
    for i in range(DYNAMIC):
        for j in range(SIZE):
            turned[j, i] = half[i, j]
    carry_columns(transition, turned, square)
    for i in range(DYNAMIC):
        for j in range(i + 1):
            mean = 0.5 * (square[i, j] + square[j, i])
            covariance[i, j] = mean
            covariance[j, i] = mean
        for j in range(DYNAMIC, SIZE):
            covariance[i, j] = half[i, j]
            covariance[j, i] = half[i, j]
    for i in range(DYNAMIC, SIZE):
        for j in range(DYNAMIC, i):
            mean = 0.5 * (covariance[i, j] + covariance[j, i])
            covariance[i, j] = mean
            covariance[j, i] = mean


@inlined
def carry_rows(transition: np.ndarray, covariance: np.ndarray, half: np.ndarray) -> None:
    """Set `half` (DYNAMIC, SIZE) = `transition` (DYNAMIC, SIZE) @ `covariance`, skipping zeros."""
    for i in range(DYNAMIC):
        for j in range(SIZE):
            half[i, j] = 0.0
        for k in range(SIZE):
            factor = transition[i, k]
            if factor != 0.0:
                for j in range(SIZE):
                    half[i, j] += factor * covariance[k, j]


@inlined
def carry_columns(transition: np.ndarray, turned: np.ndarray, square: np.ndarray) -> None:
    """Set `square` (DYNAMIC, DYNAMIC) = `transition` @ `turned` (SIZE, DYNAMIC), skipping zeros."""
    for i in range(DYNAMIC):
        for j in range(DYNAMIC):
            square[i, j] = 0.0
        for k in range(SIZE):
            factor = transition[i, k]
            if factor != 0.0:
                for j in range(DYNAMIC):
                    square[i, j] += factor * turned[k, j]


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
    short = step / 2.0**doublings
    term, following = work[0], work[1]
    for i in range(size):
        for j in range(flow.shape[1]):
            term[i, j] = short * (rates[i, j] if j < size else inputs[i, j - size])
            flow[i, j] = term[i, j] + (1.0 if i == j else 0.0)
    for order in range(2, 5):
        multiply(rates, term, following)
        add_term(following, short / order, term, flow)
    for _ in range(doublings):
        double(flow, following)


@kernel
def double(flow: np.ndarray, work: np.ndarray) -> None:
    """Set `flow` (n, n + m) to that of twice the time; `work` (n, n + m) is scratch."""
    size = flow.shape[0]
    multiply(flow, flow, work)
    for i in range(size):
        for j in range(flow.shape[1]):
            flow[i, j] = work[i, j] + (flow[i, j] if j >= size else 0.0)


@kernel
def add_term(following: np.ndarray, factor: float, term: np.ndarray, total: np.ndarray) -> None:
    """Set `term` = `factor` * `following` and add it to `total`, all of one shape."""
    for i in range(term.shape[0]):
        for j in range(term.shape[1]):
            term[i, j] = factor * following[i, j]
            total[i, j] += term[i, j]
