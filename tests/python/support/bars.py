"""The elastic bar on a frictional foundation (A11), and the work of its friction."""

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

import bipot_rs as bp

Array = NDArray[np.float64]

BAR = {"stiffness": 1000.0, "limit": 50.0}


def bar_problem(nodes: int = 20, mu: float = 0.4) -> tuple[Any, Array]:
    """Chain clamped at x = 0 with (u_n, u_t) at each node, and the load of the foundation."""
    h = 1.0 / nodes
    chain = np.diag(np.full(nodes, 2.0)) - np.eye(nodes, k=1) - np.eye(nodes, k=-1)
    chain[-1, -1] = 1.0
    K = sparse.kron(chain * BAR["stiffness"] / h, np.diag([0.0, 1.0]))
    K = sparse.csr_array(K + sparse.kron(np.eye(nodes), np.diag([700.0, 0.0])))
    limit = np.full(nodes, BAR["limit"] * h)
    limit[-1] /= 2
    load = np.column_stack([-limit / mu, np.zeros(nodes)]).ravel()
    B = sparse.eye_array(2 * nodes, format="csr")
    return bp.ContactProblem(K, B, gap=np.zeros(nodes), mu=mu), load


def pulled(load: Array, ends: NDArray[Any]) -> Array:
    """The load path that pulls the end of the bar by `ends`, one value per step."""
    path = np.tile(load, (len(ends), 1))
    path[:, -1] += ends
    return path


def lost(result: Any) -> Array:
    """Work dissipated by friction, -r_t·slip summed over the nodes, in each step."""
    return np.asarray(-np.einsum("kij,kij->k", result.reaction[:, :, 1:], result.slip))
