"""Arithmetic in twice the precision of a float64, on arrays.

A number is the unevaluated sum of two floats, high and low. Sums and products of two floats
have an exact rounding error, which is a float (Knuth, Dekker). The results do not depend on
threads, nor on the type ``longdouble`` of the machine.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from bipot_rs._lib.types import Floats

Pair = tuple[Floats, Floats]
# 2²⁷ + 1 splits a float into two halves of 26 bits, whose products are exact.
_SPLIT = 134_217_729.0


def exactly(a: Floats) -> Pair:
    """Pair of an array of floats."""
    return a, np.zeros_like(a)


def two_sum(a: Floats, b: Floats) -> Pair:
    """``a + b`` and its rounding error."""
    high = a + b
    part = high - a
    return high, (a - (high - part)) + (b - part)


def two_product(a: Floats, b: Floats) -> Pair:
    """``a b`` and its rounding error."""
    high = a * b
    (a1, a2), (b1, b2) = _halves(a), _halves(b)
    return high, ((a1 * b1 - high) + a1 * b2 + a2 * b1) + a2 * b2


def _halves(a: Floats) -> Pair:
    c = _SPLIT * a
    high = c - (c - a)
    return high, a - high


def add(a: Pair, b: Pair) -> Pair:
    """Sum of two pairs."""
    high, low = two_sum(a[0], b[0])
    return two_sum(high, low + a[1] + b[1])


def minus(a: Pair) -> Pair:
    """Negative of a pair."""
    return -a[0], -a[1]


def times(a: Pair, b: Pair) -> Pair:
    """Product of two pairs, entry by entry."""
    high, low = two_product(a[0], b[0])
    return two_sum(high, low + a[0] * b[1] + a[1] * b[0])


def product(A: Any, x: Pair) -> Pair:
    """``A x`` of a CSR matrix of floats and a vector, one entry of each row at a time."""
    count = np.diff(A.indptr)
    total = exactly(np.zeros(A.shape[0]))
    # Rows by length, so that each pass takes the first rows of this order alone.
    order = np.argsort(-count, kind="stable")
    start, left = A.indptr[:-1][order], -count[order]
    for k in range(count.max(initial=0)):
        rows = int(np.searchsorted(left, -k))
        at = start[:rows] + k
        value, column = A.data[at], A.indices[at]
        high, low = two_product(value, x[0][column])
        part = total[0][:rows], total[1][:rows]
        new = add(part, (high, low + value * x[1][column]))
        total[0][:rows], total[1][:rows] = new
    back = np.empty_like(order)
    back[order] = np.arange(len(order))
    return total[0][back], total[1][back]
