"""Known solutions by every engine and method."""

from collections.abc import Callable
from functools import partial

import numpy as np
import pytest

import bipot_rs as bp
from cases import exact, hard
from cases.verification import Row
from support.conditions import violation
from support.contacts import SMALL, TOL, one_node
from support.methods import EVERY_WAY

SLIP, STICK = bp.Status.SLIP, bp.Status.STICK


@pytest.mark.parametrize("how", EVERY_WAY, ids=str)
@pytest.mark.parametrize(
    "case",
    [
        exact.a4,
        exact.a5,
        hard.h1,
        hard.h2,
        hard.h3,
        hard.h4,
        hard.h6,
        hard.h25,
        hard.h26,
    ],
)
def test_cases_of_one_contact(
    case: Callable[[], list[Row]], how: dict[str, str], monkeypatch: pytest.MonkeyPatch
) -> None:
    if case is exact.a4 and "method" in how:
        return  # above μ = k_t/k_c there are several answers
    for module in (exact, hard):
        monkeypatch.setattr(module, "one_node", partial(one_node, **how))
    # Rows of the default method may have fewer rounding errors.
    assert [row for row in case() if not row.difference <= SMALL] == []


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
