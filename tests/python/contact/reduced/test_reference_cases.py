"""Known solutions by every engine and method; `cases` has more of them, by the default one.

Ids: A have closed forms, P are published problems, H are hard cases.
"""

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import bipot_rs as bp
from support.conditions import violation
from support.contacts import K1, SMALL, TOL, one_node
from support.methods import EVERY_WAY

Array = NDArray[np.float64]
OPEN, SLIP, STICK = bp.Status.OPEN, bp.Status.SLIP, bp.Status.STICK
FREE = np.linalg.solve(K1, [1.0, 1.5])
# It slides back until r_t = μ r_n; with u_n = 0, r_n = 1 + k_c u_t and k_t u_t = r_t.
BACK = 1 + 0.5 * 0.3 / (1 - 0.3 * 0.5)
PLAIN, FLAT = np.eye(2), np.diag([2.0, 1.0])
WEDGE = np.outer(np.linspace(1, 0, 9), [-1, 8])
# Path, μ, gap, K; u, r and status of its last step, by enumeration of all statuses.
BY_HAND: dict[str, tuple[Any, float, float, Array, Any, Any, Any]] = {
    "h1 vertex": ([0, 0.3], 0.5, 0, FLAT, [0, 0.3], [0, 0], None),
    "h2 no slip": ([-1, 0], 0.5, 0, K1, [0, 0], [1, 0], STICK),
    "h3 grazing": ([-1, 1.9], 0.5, 1e-16, K1, [0, 1.12], [1.56, -0.78], SLIP),
    "h4 no friction": ([-1, 1.5], 0, 0, K1, [0, 1.5], [1.75, 0], SLIP),
    "h6 pressed out": ([0, 0], 0.5, -0.1, K1, [0.1, 0], [0.2, 0.05], STICK),
    "h6 pressed aside": (
        [0, 0], 0.1, -0.1, K1, [0.1, -0.6 / 19], [3.5 / 19, 0.35 / 19], SLIP
    ),
    "a4 wedged": ([[-1, 8], [0, 0]], 3, 0, K1, [0, 2], [1, 2], STICK),
    "a4 in steps": (WEDGE, 3, 0, K1, [0, 2], [1, 2], STICK),
    "a5 normal first": ([[-1, 0], [-1, 0.4]], 0.5, 0, PLAIN, [0, 0], [1, -0.4], STICK),
    "a5 in proportion": (
        [[-0.25, 0.1], [-0.5, 0.2], [-1, 0.4]], 0.5, 0, PLAIN, [0, 0], [1, -0.4], STICK
    ),
    "a5 aside first": ([[0, 0.4], [-1, 0.4]], 0.5, 0, PLAIN, [0, 0.4], [1, 0], STICK),
    "h25 released": ([[-1, 1.5], [1, 1.5]], 0.3, 0, K1, FREE, [0, 0], OPEN),
    "h25 back": (
        [[-1, 1.5], [1, 1.5], [-1, 0]], 0.3, 0, K1,
        [0, 0.3 * BACK], [BACK, 0.3 * BACK], SLIP,
    ),
    "h26 a step of nothing": (
        [[-1, 1.5]] * 3, 0.3, 0, K1, [0, 1.2 / 1.15], [1.75 / 1.15, -0.525 / 1.15], None
    ),
}  # fmt: skip


@pytest.mark.parametrize("how", EVERY_WAY, ids=str)
@pytest.mark.parametrize("name", BY_HAND)
def test_one_contact_by_hand(name: str, how: dict[str, str]) -> None:
    if name.startswith("a4") and "method" in how:
        return  # above μ = k_t/k_c there are several answers
    path, mu, gap, K, u, r, status = BY_HAND[name]
    result = one_node(path, mu, gap=gap, stiffness=K, **how)
    np.testing.assert_allclose(result.displacement[-1], u, atol=SMALL)
    np.testing.assert_allclose(result.reaction[-1, 0], r, atol=SMALL)
    if name == "h2 no slip" and "engine" in how:
        # Only K⁻¹ and the solve have rounding errors if the statuses are right.
        np.testing.assert_allclose(result.slip[0, 0], 0, atol=4e-16)
    if name == "h26 a step of nothing":
        np.testing.assert_allclose(result.slip[1:], 0, atol=SMALL)
    assert status is None or result.status[-1, 0] == status


@pytest.mark.parametrize("method", ["auto", "gauss_seidel", "uzawa"])
@pytest.mark.parametrize(
    ("W", "q", "mu", "status"),
    [
        # The second tangent is prescribed: its row and column vanish.
        ([[1, 0.2, 0], [0.2, 2, 0], [0, 0, 0]], [-1, 0.1, 0], 0.5, STICK),
        ([[1, 0.2, 0], [0.2, 2, 0], [0, 0, 0]], [-1, 0.1, 0], 0.01, SLIP),
        ([[1, 0, 0.2], [0, 0, 0], [0.2, 0, 2]], [-1, 0, 0.1], 0.5, STICK),
        # Both tangents are prescribed.
        ([[1, 0, 0], [0, 0, 0], [0, 0, 0]], [-1, 0, 0], 0.5, STICK),
        # A guide at 45 degrees in the contact plane.
        ([[1, 0.5, 0.5], [0.5, 1, 1], [0.5, 1, 1]], [-1, 0.1, 0.1], 0.5, STICK),
    ],
)
def test_tangent_that_cannot_move(
    W: list[list[float]], q: list[float], mu: float, status: bp.Status, method: str
) -> None:
    matrix, free = np.array(W, float), np.array([q], float)
    solution = bp.ReducedProblem(matrix, free, mu).solve(method=method, tol=TOL)
    assert str(solution.outcome) == "converged"
    assert solution.status[0] == status
    # r is undetermined along directions in the null space of W; v is determined.
    v = solution.relative_displacement
    assert violation(solution.reaction, v, mu, free) <= SMALL
