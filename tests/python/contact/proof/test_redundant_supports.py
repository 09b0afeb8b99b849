"""Redundant supports: W is singular and reactions are not determined, but solutions exist."""

import numpy as np
import pytest

import bipot_rs as bp
from bipot_rs import fem
from support.contacts import rigid_rows


def test_a_weight_on_sixty_supports_in_a_plane() -> None:
    """Six unknowns carry sixty reactions: only their sum and moment are determined."""
    rng = np.random.default_rng(0)
    x, y = rng.uniform(-1, 1, (2, 60))
    whole = rigid_rows(np.c_[x, y, np.full(60, -0.5)])
    load = np.array([0.1, 0.0, -1.0, 0.0, 0.05, 0.02])
    solution = bp.ReducedProblem(whole @ whole.T, (whole @ load).reshape(60, 3), 0.4)
    answer = solution.solve(tol=1e-13)
    assert answer.converged
    # Nothing slips: the body is at rest and its loads balance.
    balance = whole.T @ answer.reaction.ravel() + load
    np.testing.assert_allclose(balance, 0, atol=1e-12)


@pytest.mark.parametrize("nu", [0.3, 0.4999, 0.499999, 0.4999999])
@pytest.mark.needs_extra
def test_work_does_not_grow_as_a_body_becomes_incompressible(nu: float) -> None:
    """With sweeps alone the number of products grows as 1/(1 - 2ν)."""
    axes = [np.linspace(0, 2, 9), np.linspace(0, 1, 5)]
    body = fem.Body("a", fem.box(axes, "quadrilateral"), fem.Material(1.0, nu))
    plane = fem.Contact("a", "bottom", 0.3, plane=((0, 0), (0, 1)))
    model = fem.assemble([body], [plane], [fem.Support("a", "top", (0, 1))])
    moved = model.prescribed([(0.004, -0.01)])
    step = model.problem().solve(np.zeros(model.n), moved, tol=1e-10)[0]
    # Five sweeps and a few Newton steps at 0.3; at most thirty proximal points.
    assert step.work < 400
