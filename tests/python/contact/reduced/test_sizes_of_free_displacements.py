"""What is left of a displacement is compared with what reactions must cancel, in any scale.

The motion of a rigid body cancels gaps to rounding, and soft springs along a surface move it far
beside its normals. Neither makes an answer of a contradiction, nor a contradiction of an answer.
"""

import numpy as np
import pytest
from numpy.typing import NDArray

import bipot_rs as bp
from support.contacts import rigid_rows
from support.signorini_coulomb import inequalities, judge

Array = NDArray[np.float64]


def frames(rng: np.random.Generator, d: int) -> Array:
    return np.linalg.qr(rng.standard_normal((d, d)))[0]


def on_gaps(
    rng: np.random.Generator, d: int, far: float, below: float
) -> tuple[Array, Array, Array]:
    """A rigid body on feet, below which there may be gaps, between walls that it does not reach."""
    feet, walls = d, 2
    floor = frames(rng, d)
    axes = [floor] * feet + [frames(rng, d) for _ in range(walls)]
    R = rigid_rows(rng.uniform(-2, 2, (feet + walls, d)), axes)
    v = np.zeros((feet + walls, d))
    v[feet:] = rng.standard_normal((walls, d))
    v[feet:, 0] = rng.uniform(0.1, 2, walls)
    q = far * (v - below * (R @ rng.standard_normal(R.shape[1])).reshape(-1, d))
    r = np.zeros((feet + walls, d))
    r[:feet, 0] = rng.uniform(0.5, 2, feet)
    r[:feet, 1] = 0.3 * 0.5 * r[:feet, 0] * rng.uniform(-1, 1, feet)
    return q, R, -R.T @ r.ravel()


@pytest.mark.parametrize("d", [2, 3])
@pytest.mark.parametrize(
    ("far", "below"), [(1.0, 1.0), (1e-9, 1.0), (1e12, 1.0), (1.0, 0.0)]
)
def test_rigid_bodies_with_gaps(d: int, far: float, below: float) -> None:
    for seed in range(30):
        rng = np.random.default_rng([seed, d])
        q, R, e = on_gaps(rng, d, far, below)
        order = rng.permutation(len(q))
        rows = (order[:, None] * d + np.arange(d)).ravel()
        basis = np.diag(10.0 ** rng.uniform(-2, 2, R.shape[1]))
        for q_, R_, e_ in (
            (q, R, e),
            (q[order], R[rows], e),
            (q, R @ basis, e @ basis),
        ):
            W = np.zeros((R.shape[0], R.shape[0]))
            solution = bp.ReducedProblem(W, q_, 0.5, rigid=(R_, e_)).solve(
                max_iterations=3000
            )
            assert solution.converged, (seed, solution.message)
            # Without compliance, displacements are compared with gaps, and forces with loads.
            free = (q_ + (R_ @ solution.rigid_motion).reshape(-1, d)) / np.abs(q_).max()
            missed = inequalities(
                solution.reaction / np.abs(e).max(), free, 0.5, np.ones(len(q_)), free
            )
            assert missed.worst <= 1e-9, (seed, missed)
            balance = R_.T @ solution.reaction.ravel() + e_
            assert (
                np.abs(balance / np.abs(R_).max(axis=0)).max() <= 1e-9 * np.abs(e).max()
            )


@pytest.mark.parametrize("d", [2, 3])
@pytest.mark.parametrize("soft", [1.0, 2.0**10, 2.0**17, 2.0**30, 2.0**50])
@pytest.mark.parametrize("overlap", [1e-1, 1e-4])
def test_walls_that_overlap(d: int, soft: float, overlap: float) -> None:
    """One body is pressed by two walls that it cannot separate, whatever it does along them."""
    for seed in range(8):
        rng = np.random.default_rng([seed, d, round(np.log2(soft))])
        n = 2 + int(rng.integers(0, 3))
        # Integers, so that reactions of the two walls cancel without rounding.
        A = rng.integers(-3, 4, (n * d, n * d)).astype(float)
        C = np.eye(n * d)
        C[[0, d], :] = 0
        C[:, 0] = 0
        C[0, 0], C[d, 0] = 1, -1
        scale = np.tile(np.r_[1.0, np.full(d - 1, soft)], n)
        W = scale[:, None] * (C @ A @ A.T @ C.T) * scale
        q = (
            rng.standard_normal((n, d))
            * np.r_[1.0, np.full(d - 1, rng.choice([1.0, soft]))]
        )
        q[1, 0] = -q[0, 0] - overlap
        length, force = rng.choice([1.0, 1e-12, 1e9], 2)
        problem = bp.ReducedProblem(
            W * length / force, q * length, rng.choice([0.0, 0.3, 1.0])
        )
        for method in ("auto", "gauss_seidel", "nesterov"):
            for pressure in (0.0, 1.0, 1e6, 1e12):
                start = np.zeros((n, d))
                start[:2, 0] = pressure * force
                solution = problem.solve(method, start=start, max_iterations=300)
                assert not solution.converged, (
                    seed,
                    method,
                    pressure,
                    solution.residual,
                )


@pytest.mark.parametrize("d", [2, 3])
@pytest.mark.parametrize("soft", [1e3, 1e8, 1e15])
@pytest.mark.parametrize("friction", [0.0, 0.3])
def test_soft_springs_along_a_surface(d: int, soft: float, friction: float) -> None:
    """With another unit of v_t, 1/r_t and μ than of v_n and 1/r_n, the problem is the same."""
    for seed in range(8):
        rng = np.random.default_rng([seed, d])
        n = int(rng.integers(1, 5))
        A = rng.standard_normal((n * d, n * d + 2))
        W, q = A @ A.T, rng.standard_normal((n, d))
        q[:, 0] -= 1
        scale = np.r_[1.0, np.full(d - 1, soft)]
        scales = np.tile(scale, n)
        plain = bp.ReducedProblem(W, q, friction).solve()
        scaled = bp.ReducedProblem(
            scales[:, None] * W * scales, q * scale, friction / soft
        ).solve()
        assert plain.converged
        assert scaled.converged, (seed, scaled.message)
        # η bounds the normals in their own scale by ten tolerances, times the condition of W.
        difference = np.abs(scaled.reaction * scale - plain.reaction).max()
        assert difference <= 1e-9 * np.linalg.cond(W) * np.abs(plain.reaction).max()
        missed = judge(W, q, friction, scaled.reaction * scale, None, None)
        assert missed.worst <= 1e-8
