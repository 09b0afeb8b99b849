"""One linear system for both forms of FCLIB.

    u = W r + E y + q,      Eᵀ r + s = M y

Local form: y are the amplitudes of rigid motions, E = V and M = 0. Global form: y are the
displacements of all degrees of freedom, W = 0 and E = Hᵀ.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import sparse

from bipot_rs._lib.types import Floats
from bipot_rs.contact.global_problem import GlobalProblem
from bipot_rs.contact.reduced import ReducedProblem
from collection.doubled import Pair, add, exactly, minus, product


@dataclass(frozen=True)
class System:
    """A problem of a file.

    Attributes
    ----------
    W, E, M
        CSR, ``(d n_c, d n_c)``, ``(d n_c, k)``, ``(k, k)``.
    q, s
        ``(d n_c,)`` and ``(k,)``.
    mu
        Friction coefficients ``(n_c,)``.
    d
        Dimension.
    """

    W: Any
    E: Any
    M: Any
    q: Floats
    s: Floats
    mu: Floats
    d: int

    def displacement(self, r: Pair, y: Pair) -> Pair:
        """``u = W r + E y + q``, in twice the precision."""
        u = add(product(self.W, r), product(self.E, y))
        return add(u, exactly(self.q))

    def imbalance(self, r: Pair, y: Pair) -> Pair:
        """``Eᵀ r + s − M y``, in twice the precision."""
        force = add(product(self.E.T.tocsr(), r), minus(product(self.M, y)))
        return add(force, exactly(self.s))

    def length(self, r: Floats, y: Floats, u: Floats) -> float:
        """Size of displacements: the largest of u, q, W r and E y, or 1 if all are zero."""
        parts = (u, self.q, self.W @ r, self.E @ y)
        return max(float(np.abs(part).max(initial=0.0)) for part in parts) or 1.0


def system(problem: ReducedProblem | GlobalProblem) -> System:
    """Arrays of a problem as one system."""
    if isinstance(problem, GlobalProblem):
        size = problem.w.size
        return System(
            sparse.csr_array((size, size)),
            _rows(problem.H.T),
            _rows(problem.M),
            problem.w.ravel(),
            problem.f,
            problem.mu,
            problem.w.shape[1],
        )
    size = problem.q.size
    V, s = problem.rigid or (np.zeros((size, 0)), np.zeros(0))
    return System(
        _rows(problem.W),
        _rows(V),
        sparse.csr_array((len(s), len(s))),
        problem.q.ravel(),
        np.asarray(s, np.float64),
        problem.mu,
        problem.q.shape[1],
    )


def _rows(matrix: Any) -> Any:
    matrix_copy = sparse.csr_array(matrix)
    matrix_copy.sum_duplicates()
    return matrix_copy
