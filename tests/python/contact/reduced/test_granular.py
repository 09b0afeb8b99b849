"""Walls of rigid disks and packings of balls, with many redundant contacts."""

from typing import Any

import grains
import numpy as np
import pytest

import bipot_rs as bp
from support.conditions import violation

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
