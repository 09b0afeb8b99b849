"""How many cycles a jump may have before pressures oscillate between neighbours."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy import sparse
from scipy.sparse import linalg

from bipot_rs._lib.types import Floats, Ints
from bipot_rs._lib.validation import Csr, Parts

# With no more contacts, the eigenvalue is computed from the dense matrix.
_FEW = 64
# Relative error of the eigenvalue: far below that of the estimate.
_RTOL = 0.01


class Stability:
    """Bounds the fastest rate, per cycle, at which wear evens out a pressure (31), (32).

    It needs neither ``W`` nor a factor of ``K``.

    Parameters
    ----------
    stiffness
        Row pointers, columns and values of K.
    contact
        B, checked.
    fixed
        Prescribed degrees of freedom.
    d
        Components of a contact.
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
        softened = normal @ sparse.diags_array(compliance)
        self._meeting = sparse.csc_array(softened @ normal.T)
        self._energy = sparse.csr_array(softened @ K @ softened.T)
        # A contact without a free degree of freedom has no determined pressure.
        self._free = self._meeting.diagonal() > 0
        self._solve = self._inverse()

    def _inverse(self) -> Any:
        own = np.flatnonzero(self._free)
        part = sparse.csc_array(self._meeting[own][:, own])
        if part.nnz == len(own):
            # Each degree of freedom meets one contact.
            inverse = 1.0 / part.diagonal()
            return lambda v: inverse * v
        try:
            return linalg.splu(part).solve
        except RuntimeError:
            return None

    def rate(self, worn_by_force: Floats) -> float:
        """Largest eigenvalue of ``Σ X K Xᵀ`` (32), without unit.

        Parameters
        ----------
        worn_by_force
            Diagonal of ``Σ``: ``k slid / area``, the depth that a unit force wears off each
            contact in a cycle, ``(n_c,)`` [length/force].
        """
        own = np.flatnonzero(self._free)
        root = np.sqrt(worn_by_force[own])
        if not root.any():
            return 0.0
        if self._solve is None:
            # Contacts move the same degree of freedom in the same way.
            return np.inf
        energy = self._energy[own][:, own]

        # The eigenvalue needs numbers of order one for its start vector and tolerance only.
        def apply(v: Floats) -> Floats:
            moved = self._solve(root * v.ravel())
            found: Floats = root * self._solve(energy @ moved)
            return found

        n = len(own)
        if n <= _FEW:
            whole = np.column_stack([apply(e) for e in np.eye(n)])
            return float(np.linalg.eigvalsh((whole + whole.T) / 2)[-1])
        operator = linalg.LinearOperator((n, n), matvec=apply, dtype=np.float64)
        start = np.random.default_rng(0).standard_normal(n)
        (found,) = linalg.eigsh(
            operator, k=1, which="LA", v0=start, tol=_RTOL, return_eigenvectors=False
        )
        # Lanczos approaches the eigenvalue from below.
        return float(found) * (1 + _RTOL)
