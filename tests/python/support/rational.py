"""Proofs of statics in rational arithmetic, on the numbers that were given."""

from fractions import Fraction
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.sparse import issparse

Array = NDArray[np.float64]


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
    R = R.toarray() if issparse(R) else R
    R, e, motion = (np.asarray(array, float) for array in (R, e, motion))
    contacts = len(R) // d
    friction = np.broadcast_to(
        np.asarray(mu, float).reshape(-1, 1) if np.ndim(mu) == 1 else np.asarray(mu),
        (contacts, d - 1),
    )
    held = np.broadcast_to(np.asarray(cohesion, float), contacts)
    amounts = [Fraction(float(a)) for a in motion]
    work = sum(
        (Fraction(float(x)) * a for x, a in zip(e, amounts, strict=True)), Fraction(0)
    )
    for i in range(contacts):
        v = []
        for row in R[d * i : d * i + d]:
            (at,) = np.nonzero(row)
            v.append(
                sum((Fraction(float(row[j])) * amounts[j] for j in at), Fraction(0))
            )
        slip = sum(
            (
                (Fraction(float(m)) * x) ** 2
                for m, x in zip(friction[i], v[1:], strict=True)
            ),
            Fraction(0),
        )
        if v[0] < 0 or v[0] ** 2 < slip:
            return False
        if held[i] > 0:
            length = (
                abs(v[1]) if d == 2 else Fraction(float(np.hypot(*map(float, v[1:]))))
            )
            work -= Fraction(float(held[i])) * length
    return work > 0
