"""Walls of disks, packings of balls and supports: redundant contacts, whose W is singular."""

from typing import Any

import grains
import numpy as np
import pytest

import bipot_rs as bp
from bipot_rs import fem
from support.conditions import violation
from support.contacts import rigid_rows

TOL = 1e-10


def solved(assembly: grains.Assembly, seconds: float | None = None) -> bp.Solution:
    """The solution, after a check of Coulomb's conditions and the balance of the bodies."""
    W, q = assembly.step()
    problem = bp.ReducedProblem(W, q, assembly.mu)
    solution = problem.solve(tol=TOL, max_seconds=seconds)
    r = solution.reaction
    assert problem.residual(r) == pytest.approx(solution.residual, rel=1e-3, abs=1e-14)
    if solution.converged:
        # M u = f + Bᵀ r gives the displacements of the bodies; B u gives those of the contacts.
        u = (assembly.load + assembly.B.T @ r.ravel()) / assembly.mass
        v = (assembly.B @ u).reshape(r.shape)
        # η is relative to reactions, which are up to a hundred times what displacements need.
        assert violation(r, v, assembly.mu, q) <= 1e3 * TOL
    return solution


@pytest.mark.parametrize("staggered", [False, True])
@pytest.mark.parametrize(
    "seed", [1, *(pytest.param(k, marks=pytest.mark.slow) for k in (0, 2))]
)
@pytest.mark.slow_variants("1-True")
def test_a_wall_of_four_hundred_disks(seed: int, staggered: bool) -> None:
    """Sweeps, Newton's method or proximal points alone need up to 40,000 iterations or stall."""
    rng = np.random.default_rng(seed)
    wall = grains.wall("wall", 20, rng, staggered=staggered, mu=0.4)
    solution = solved(wall)
    assert solution.converged
    assert solution.iterations < 2000


@pytest.mark.parametrize("d", [2, 3])
@pytest.mark.slow_variants("3")
@pytest.mark.slow
def test_a_packing_of_eighty_balls(d: int) -> None:
    packing = grains.packing("packing", d, 80, np.random.default_rng(d), mu=0.4)
    solution = solved(packing)
    assert solution.converged
    assert solution.iterations < 2000


@pytest.mark.slow
@pytest.mark.parametrize("make", [grains.packings, grains.walls])
def test_nine_in_ten_are_solved_within_twenty_seconds(make: Any) -> None:
    solutions = [solved(make(seed), seconds=20.0) for seed in range(50)]
    assert sum(s.converged and s.residual <= TOL for s in solutions) >= 45


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
