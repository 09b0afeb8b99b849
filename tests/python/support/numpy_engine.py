"""An engine of `_core.ContactPath` with dense arrays: K is a NumPy array in one process.

It shares no code with the other engines, solves each linear system by elimination, and is
for small problems.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from bipot_rs import _core
from bipot_rs.contact.law.contact_law import ContactLaw

Array = NDArray[np.float64]


class NumpyEngine:
    """``A = Tᵀ K T`` of free degrees of freedom; all of them are places."""

    def __init__(self, K: Array, variables: _core.ContactVariables, fixed: Any) -> None:
        self.variables = variables
        self.calls = 0
        pointer, column, values = variables.transformation()
        self.T = np.zeros(K.shape)
        for i in range(len(K)):
            entries = slice(pointer[i], pointer[i + 1])
            self.T[i, column[entries]] = values[entries]
        self.T[fixed] = 0.0
        self.K = K
        self.A = self.T.T @ K @ self.T

    def may_be_soft(self) -> bool:
        return True

    def product(self, y: Array) -> Array:
        return self.A @ y

    def add(self, y: Array, s: float, x: Array) -> Array:
        return y + s * x

    def at_places(self, y: Array) -> Array:
        return y

    def norm(self, y: Array) -> float:
        return float(np.linalg.norm(y))

    def largest(self, y: Array) -> float:
        return float(np.abs(y).max())

    def imbalance(self, e: Array, forces: Array) -> float:
        return float(np.linalg.norm(e - forces))

    def terms(self, y: Array) -> tuple[float, Array]:
        sizes = np.abs(self.T.T) @ np.abs(self.K) @ np.abs(self.T) @ np.abs(y)
        return float(np.linalg.norm(sizes)), sizes

    def correction(
        self, tangent: _core.ContactTangent, _statuses: Any, e: Array, _tol: float
    ) -> tuple[Array, int, bool] | None:
        self.calls += 1
        return self.estimate(tangent, _statuses, e), 1, True

    def estimate(
        self, tangent: _core.ContactTangent, _statuses: Any, e: Array
    ) -> Array:
        n = len(e)
        J = np.empty((n, n))
        for k in range(n):
            unit = np.zeros(n)
            unit[k] = 1.0
            column = self.A @ unit
            tangent.add_laws(unit, column)
            J[:, k] = column
        free = ~tangent.held
        right = tangent.right_side(e, self.A @ tangent.known)
        dy = tangent.known.copy()
        dy[free] += np.linalg.solve(J[np.ix_(free, free)], right[free])
        return dy

    def agreed(self, decision: bool) -> bool:
        return decision


def variables_of(
    K: Array,
    B: Any,
    gap: Any,
    mu: Any,
    fixed: Any,
    bodies: Any = None,
) -> _core.ContactVariables:
    """The contacts with every degree of freedom as a place."""
    from scipy.sparse import csr_array

    gap, rows = np.asarray(gap, float), csr_array(B)
    d = gap.shape[1]
    nodes = len(K) // d
    position = np.full(len(K), len(fixed))
    position[np.asarray(fixed, int)] = np.arange(len(fixed))
    blocks = [K[d * k : d * k + d, d * k : d * k + d].ravel() for k in range(nodes)]
    body = np.zeros(nodes, np.int64) if bodies is None else np.asarray(bodies)
    held = np.ones(int(body.max()) + 1, np.int64)
    return _core.ContactVariables(
        (rows.indptr, rows.indices, rows.data),
        gap,
        ContactLaw.check(*gap.shape, mu=mu),
        position,
        len(fixed),
        np.array(blocks),
        body,
        held,
    )


def force_of(
    K: Array, variables: _core.ContactVariables, load: Any, fixed: Any, prescribed: Any
) -> Array:
    """``Tᵀ (f - K u_p)`` of the free degrees of freedom."""
    u = np.zeros(len(K))
    u[np.asarray(fixed, int)] = prescribed
    force = np.asarray(load, float) - K @ u
    force[np.asarray(fixed, int)] = 0.0
    variables.forces_to_local(force)
    return force
