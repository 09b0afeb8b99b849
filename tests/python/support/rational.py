"""Proofs of statics in rational arithmetic, on the numbers that were given."""

from fractions import Fraction
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.sparse import csr_array

exact = np.vectorize(Fraction, otypes=[object])


def excludes_balance(
    R: Any,
    e: ArrayLike,
    mu: ArrayLike,
    motion: ArrayLike,
    d: int,
    cohesion: ArrayLike = 0.0,
) -> bool:
    """Whether a motion lies in all dual cones and the loads work more on it than cohesion.

    ``mu`` is a number, ``(n_c,)`` or ``(n_c, d - 1)``. Without rounding, but for the square
    roots of cohesion in space.
    """
    R, mu = csr_array(R), np.asarray(mu, float)
    amounts = exact(np.asarray(motion, float))
    terms = exact(R.data) * amounts[R.indices]
    v = [sum(terms[i:j], Fraction(0)) for i, j in pairwise(R.indptr)]
    v = np.array(v, object).reshape(-1, d)
    friction = np.broadcast_to(mu[:, None] if mu.ndim == 1 else mu, v[:, 1:].shape)
    slip = ((exact(friction) * v[:, 1:]) ** 2).sum(axis=1)
    if (v[:, 0] < 0).any() or (v[:, 0] ** 2 < slip).any():
        return False
    work = sum(exact(np.asarray(e, float)) * amounts, Fraction(0))
    for held, slid in zip(np.broadcast_to(cohesion, len(v)), v[:, 1:], strict=True):
        if held > 0:
            length = abs(slid[0]) if d == 2 else np.hypot(*slid.astype(float))
            work -= Fraction(float(held)) * Fraction(length)
    return bool(work > 0)
