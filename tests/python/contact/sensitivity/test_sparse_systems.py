"""Derivatives where W and R are sparse: the closed system is factored as a sparse matrix."""

from typing import Any

import grains
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import sparse

import bipot_rs as bp
from support.children import RESET, forked, memory
from support.comparisons import close

pytestmark = pytest.mark.needs_extra

Array = NDArray[np.float64]


def sticking_wall(side: int, rigid: bool) -> tuple[bp.ReducedProblem, Array]:
    """A wall of disks whose contacts all stick, and its reactions."""
    rng = np.random.default_rng(side)
    wall = grains.wall("wall", side, rng, staggered=True, mu=0.7)
    n = wall.B.shape[0] // 2
    r = np.empty((n, 2))
    r[:, 0] = rng.uniform(1, 2, n)
    r[:, 1] = 0.3 * r[:, 0] * rng.uniform(-1, 1, n)
    soft: Any = sparse.diags_array(rng.uniform(0.5, 2, 2 * n))
    W = sparse.csr_array(soft if rigid else soft + wall.step()[0])
    q = -(W @ r.ravel()).reshape(n, 2)
    motions = (wall.B, -wall.B.T @ r.ravel()) if rigid else None
    return bp.ReducedProblem(W, q, wall.mu, rigid=motions), r


@pytest.mark.parametrize("rigid", [False, True])
def test_against_a_dense_system(rigid: bool) -> None:
    problem, r = sticking_wall(16, rigid)
    solution = problem.solve(start=r)
    assert solution.converged
    assert (solution.status == bp.Status.STICK).all()
    rng = np.random.default_rng(0)
    dq, dr = rng.standard_normal((2, *r.shape))
    # W dr + R da = -dq and Rᵀ dr = 0.
    R = np.zeros((r.size, 0)) if problem.rigid is None else problem.rigid[0].toarray()
    k = R.shape[1]
    matrix = np.block([[problem.W.toarray(), R], [R.T, np.zeros((k, k))]])
    right = np.append(-dq.ravel(), np.zeros(k))
    expected = np.linalg.solve(matrix, right)[: r.size].reshape(r.shape)
    tangent = solution.jvp(q=dq)
    # Both lose the condition number of the wall, below 1e4.
    close(tangent.reaction, expected, 1e-11)
    gradient = solution.vjp(reaction=dr)
    pairs = np.sum(gradient.q * dq), np.sum(dr * tangent.reaction)
    assert pairs[0] == pytest.approx(
        pairs[1], rel=1e-10, abs=1e-11 * np.linalg.norm(dq)
    )


def test_five_thousand_contacts_need_no_dense_matrix() -> None:
    problem, r = sticking_wall(42, False)
    solution = problem.solve(start=r)
    assert solution.converged
    assert len(r) > 5000

    def child() -> None:
        RESET.write_text("5")
        before = memory("VmHWM")
        solution.jvp(q=r)
        solution.vjp(reaction=r)
        # A dense matrix has 854 MB.
        assert memory("VmHWM") - before < 85e6

    run = forked(child, seconds=60)
    assert run.returncode == 0, run.stderr
