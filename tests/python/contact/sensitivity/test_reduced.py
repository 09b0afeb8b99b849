"""Derivatives of the solutions of reduced problems."""

import numpy as np
import pytest
from scipy import sparse

import bipot_rs as bp
from support.random_paths import differences
from support.random_problems import KINDS, random_problem

TOL = 1e-13


@pytest.mark.parametrize("d", [2, 3])
@pytest.mark.parametrize("kind", [k for k in KINDS if k not in ("redundant", "flat")])
def test_random_problems(kind: str, d: int) -> None:
    """Against differences of the fourth order, and jvp against vjp."""
    assert sum(_compared(kind, d, seed) for seed in range(8)) >= 3


def _compared(kind: str, d: int, seed: int) -> bool:
    random_data = random_problem(kind, d, seed)
    rng = np.random.default_rng(seed)
    # A measured W is not symmetric.
    W = random_data.W * (1 + 0.02 * rng.normal(size=random_data.W.shape))
    size = np.abs(random_data.q).mean(axis=1)
    dq = 0.1 * rng.normal(size=random_data.q.shape) * size[:, None]
    dW = 0.1 * W * rng.normal(size=W.shape)
    dmu = 0.1 * rng.normal(size=random_data.mu.shape) * (random_data.mu > 0)

    def solve(t: float) -> bp.Solution:
        problem = bp.ReducedProblem(
            W + t * dW,
            random_data.q + t * dq,
            random_data.mu + t * dmu,
            rigid=random_data.rigid,
        )
        return problem.solve(tol=TOL)

    at = solve(0.0)
    if not at.converged:
        return False
    tangent = at.jvp(dW, dq, dmu)
    bars = rng.normal(size=at.reaction.shape), rng.normal(size=at.reaction.shape)
    gradient = at.vjp(*bars)
    pairs = (gradient.W, dW), (gradient.q, dq), (gradient.mu, dmu)
    left = sum(np.sum(by * change) for by, change in pairs)
    terms = bars[0] * tangent.reaction, bars[1] * tangent.relative_displacement
    # Rounding times the condition of the tangent system; dv is the rest of dq, or zero.
    allowed = 1e-10 * sum(np.abs(t).sum() for t in (*terms, bars[1] * dq))
    assert abs(left - sum(map(np.sum, terms))) <= allowed
    names = ("reaction", "relative_displacement")
    slopes = differences(solve, 1e-3, names)
    if slopes is None or not solve(2e-3).converged:
        return False
    for name, slope in slopes.items():
        scale = np.abs(slope).max(axis=1, keepdims=True)
        # A reaction that loads alone determine does not change: its slope is rounding.
        # And so does the displacement of contacts that all stick.
        least = 1e-3 * scale.max(initial=0.0) + 1e-5 * (
            np.abs(getattr(at, name)).max() + np.abs(random_data.q).max()
        )
        off = np.abs(getattr(tangent, name) - slope) / np.maximum(scale, least)
        # As in the tests of paths.
        assert off.max(initial=0.0) <= 1e-7, (kind, d, seed, name)
    return True


def test_a_sparse_compliance() -> None:
    """The gradient has the pattern of a sparse W, and the values of a dense one."""
    rng = np.random.default_rng(0)
    blocks = [random_problem("held", 3, seed) for seed in (1, 2, 3)]
    W = sparse.block_diag([b.W for b in blocks], format="csr")
    q = np.concatenate([b.q for b in blocks])
    mu = np.concatenate([b.mu for b in blocks])
    bar = rng.normal(size=q.shape)
    sparsely = bp.ReducedProblem(W, q, mu).solve(tol=TOL).vjp(bar, bar)
    densely = bp.ReducedProblem(W.toarray(), q, mu).solve(tol=TOL).vjp(bar, bar)
    assert sparsely.W.nnz == W.nnz
    kept = W.toarray() != 0
    np.testing.assert_allclose(sparsely.W.toarray(), densely.W * kept, atol=1e-10)
    np.testing.assert_allclose(sparsely.q, densely.q, atol=1e-10)


def test_a_solution_that_did_not_converge_has_none() -> None:
    stopped = bp.ReducedProblem(np.eye(2), [[-1.0, 0.5]], 0.3).solve(
        "uzawa", tol=1e-14, max_iterations=1
    )
    with pytest.raises(ValueError, match="did not converge"):
        stopped.jvp(q=[[1.0, 0.0]])
