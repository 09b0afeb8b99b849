"""How many cycles a jump may have before pressures oscillate between neighbours."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np
from scipy import sparse
from scipy.sparse import linalg

from bipot_rs._lib.matrices import diagonal_matrix
from bipot_rs._lib.types import CsrMatrix, Floats, Ints
from bipot_rs._lib.validation import Csr, Parts
from bipot_rs.contact import tuning

# A cycle, a part of a load step and a jump may have this rate per cycle. With twice as much wear
# would be stable; with this, not even the predicted pressure overshoots.
STABLE = 1.0


class Stability:
    """Bounds the fastest rate, per cycle, at which wear evens out a pressure (31), (32).

    It needs neither ``W`` nor a factor of ``K``.

    ``stiffness``: row pointers, columns and values of K.
    ``contact``: B, checked.
    ``fixed``: prescribed degrees of freedom.
    ``d``: components of a contact.
    """

    def __init__(self, stiffness: Parts, contact: Csr, fixed: Ints, d: int) -> None:
        n = contact.shape[1]
        K = sparse.csr_array(stiffness[::-1], shape=(n, n))
        B = sparse.csr_array(contact.parts[::-1], shape=contact.shape)
        normal = B[::d]
        diagonal = K.diagonal()
        free = diagonal > 0
        free[fixed] = False
        compliance = np.divide(1.0, diagonal, out=np.zeros_like(diagonal), where=free)
        softened = normal @ diagonal_matrix(compliance)
        meeting = sparse.csr_array(softened @ normal.T)
        # A contact without a free degree of freedom has no determined pressure.
        self._own = np.flatnonzero(meeting.diagonal() > 0)
        self._energy = sparse.csr_array(softened @ K @ softened.T)[self._own]
        self._energy = self._energy[:, self._own]
        self._solve = _factor_meeting(
            sparse.csc_array(meeting[self._own][:, self._own])
        )
        self._whole: Floats | None = None
        count = len(self._own)
        if self._solve is not None and count <= tuning.DENSE_BOUND:
            whole = np.reshape([self._apply(e) for e in np.eye(count)], (count, count))
            self._whole = (whole + whole.T) / 2

    def _apply(self, v: Floats) -> Floats:
        """``X K Xᵀ v``."""
        product: Floats = self._solve(self._energy @ self._solve(v))
        return product

    @cached_property
    def largest(self) -> float:
        """Bound of the rate if a unit force wears off a unit depth at each contact."""
        count = int(self._own.max(initial=-1)) + 1
        # Three digits.
        return 1.01 * self.rate(np.ones(count))

    def rate(self, worn_by_force: Floats) -> float:
        """Largest eigenvalue of ``Σ X K Xᵀ`` (32), without unit, to three digits.

        More digits would depend on the number of threads.

        ``worn_by_force``: diagonal of ``Σ``: ``k slid / area``, the depth that a unit force
        wears off each contact in a cycle, ``(n_c,)`` [length/force].
        """
        root = np.sqrt(worn_by_force[self._own])
        if not root.any():
            return 0.0
        if self._solve is None:
            # Contacts move the same degree of freedom in the same way.
            return np.inf
        if self._whole is not None:
            values = np.linalg.eigvalsh(root[:, None] * self._whole * root)
            return float(f"{values[-1]:.3g}")
        n = len(root)
        operator = linalg.LinearOperator(
            (n, n), matvec=lambda v: root * self._apply(root * v.ravel()), dtype=float
        )
        start = np.random.default_rng(0).standard_normal(n)
        (rate,) = linalg.eigsh(
            operator,
            k=1,
            which="LA",
            v0=start,
            tol=tuning.BOUND_RTOL,
            return_eigenvectors=False,
        )
        # Lanczos approaches the eigenvalue from below.
        return float(f"{rate * (1 + tuning.BOUND_RTOL):.3g}")


def _factor_meeting(meeting: CsrMatrix) -> Any:
    """Function that solves with ``B_n D⁻¹ B_nᵀ``; None if it is singular."""
    if meeting.nnz == meeting.shape[0]:
        # Each degree of freedom meets one contact.
        inverse = 1.0 / meeting.diagonal()
        return lambda v: inverse * v
    try:
        return linalg.splu(meeting).solve
    except RuntimeError:
        return None
