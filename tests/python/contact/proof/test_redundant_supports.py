"""Redundant supports: W is singular and reactions are not determined, but solutions exist."""

import numpy as np
import problems
import pytest

import bipot_rs as bp
from bipot_rs import fem
from support.conditions import violation
from support.contacts import rigid_rows

TOL = 1e-10


# From the first 150 seeds: those that neither sweeps nor Newton's method solve within
# 20,000 products with W, and some that they do solve.
SEEDS = (0, 8, 10, 22, 26, 50, 55, 82, 93, 103, 137)


@pytest.mark.parametrize(
    "seeds", [SEEDS[::3], pytest.param(SEEDS, marks=pytest.mark.slow)]
)
@pytest.mark.slow
def test_assemblies_of_rigid_bodies(seeds: tuple[int, ...]) -> None:
    """All but one converge: near a stall the last bit of W, which depends on the BLAS,
    decides which one does not. An unsolved problem must not be reported as solved."""
    solved = 0
    for seed in seeds:
        assembly = problems.rigid(seed)
        assert np.linalg.matrix_rank(assembly.W) < len(assembly.W)
        solution = bp.ReducedProblem(assembly.W, assembly.q, assembly.mu).solve(tol=TOL)
        r = solution.reaction
        v = (assembly.W @ r.ravel()).reshape(r.shape) + assembly.q
        # η bounds the violation of each condition in scaled variables; in one assembly masses,
        # and so W, differ by a factor of a hundred.
        missed = violation(r, v, assembly.mu, assembly.q)
        assert solution.converged == (missed <= 1e3 * TOL)
        solved += solution.converged and solution.work < 20_000
    assert solved >= len(seeds) - 1


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
    step = model.problem().solve(np.zeros(model.n), moved, tol=TOL)[0]
    # Five sweeps and a few Newton steps at 0.3; at most thirty proximal points.
    assert step.work < 400
