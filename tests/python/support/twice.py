"""Linear systems in doubled precision: iterative refinement with exact sums.

A number is the unevaluated sum of two arrays. The condition limits the accuracy of
SuperLU's factors. Residuals in doubled precision remove that error, and the size of the
last correction shows the accuracy reached.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.linalg import splu

Array = NDArray[np.float64]
Pair = tuple[Array, Array]


def two_sum(a: Array, b: Array) -> Pair:
    """``a + b`` and its rounding error (Knuth)."""
    high = a + b
    part = high - a
    return high, (a - (high - part)) + (b - part)


def two_product(a: Array, b: Array) -> Pair:
    """``a b`` and its rounding error (Dekker)."""
    high = a * b
    (a1, a2), (b1, b2) = _split(a), _split(b)
    return high, ((a1 * b1 - high) + a1 * b2 + a2 * b1) + a2 * b2


def _split(a: Array) -> Pair:
    c = 134_217_729.0 * a  # 2²⁷ + 1
    high = c - (c - a)
    return high, a - high


def add(a: Pair, b: Pair) -> Pair:
    """Sum of two pairs, to a few roundings of the lower part."""
    high, low = two_sum(a[0], b[0])
    return two_sum(high, low + a[1] + b[1])


def product(A: Any, x: Pair) -> Pair:
    """``A x`` of a sparse matrix and columns ``(n, m)``, one entry of each row at a time."""
    A = sparse.csr_array(A)
    rows = np.diff(A.indptr)
    shape = (A.shape[0], x[0].shape[1])
    total = np.zeros(shape), np.zeros(shape)
    for k in range(rows.max(initial=0)):
        # Shorter rows repeat an entry, multiplied by zero.
        at = np.minimum(A.indptr[:-1] + k, A.nnz - 1)
        value = np.where(k < rows, A.data[at], 0.0)[:, None]
        column = A.indices[at]
        high, low = two_product(value, x[0][column])
        total = add(total, (high, low + value * x[1][column]))
    return total


def solve(A: Any, b: Pair) -> Pair:
    """``A⁻¹ b`` for columns ``(n, m)``, to 1e-20 of each column's largest entry."""
    factors = splu(sparse.csc_array(A))
    x = factors.solve(b[0]), np.zeros(b[0].shape)
    for _ in range(12):
        Ax = product(A, x)
        residual = add(b, (-Ax[0], -Ax[1]))
        change = factors.solve(residual[0])
        x = add(x, (change, np.zeros(change.shape)))
        size = np.abs(x[0]).max(axis=0)
        if (np.abs(change).max(axis=0) <= 1e-20 * size).all():
            return x
    raise ArithmeticError("refinement does not converge")


def exactly(a: Array) -> Pair:
    """A pair with a zero lower part."""
    return a, np.zeros(a.shape)
