"""The methods of the package agree with the oracle, which shares no algorithm with them."""

import numpy as np
import pytest
from numpy.typing import NDArray

import bipot_rs as bp
from support.conditions import violation
from support.oracle import Problem, follow

Array = NDArray[np.float64]
MU = 0.25
TOL = 1e-12
SOME = ("auto", "gauss_seidel", "uzawa")


def compliance(rng: np.random.Generator, size: int) -> Array:
    """Positive definite, condition about 10, coupling weak enough for a unique solution."""
    root = rng.normal(size=(size, size)) / np.sqrt(size)
    return np.asarray(root @ root.T + 0.5 * np.eye(size))


def pressed(rng: np.random.Generator, contacts: int, dim: int) -> Array:
    q = rng.normal(size=(contacts, dim))
    q[:, 0] -= 0.7
    q[::2, 1:] *= 0.2  # # small tangential load: some contacts stick
    return q


@pytest.mark.parametrize("dim", [2, 3])
def test_definite_compliance(dim: int) -> None:
    seen: set[int] = set()
    for seed in range(2):
        rng = np.random.default_rng([seed, 12, dim])
        W, q = compliance(rng, 12 * dim), pressed(rng, 12, dim)
        expected = follow(Problem(W, q, MU))
        reduced = bp.ReducedProblem(W, q, MU)
        for method in SOME:
            solution = reduced.solve(method=method, tol=TOL)
            assert solution.converged
            # η computed again, as a user would.
            assert reduced.residual(solution.reaction) == solution.residual
            # η of both, times the condition of W and the factor that friction adds.
            size = np.abs(expected.r).max()
            np.testing.assert_allclose(solution.reaction, expected.r, atol=1e-9 * size)
            assert tuple(solution.status) == expected.status
            v = solution.relative_displacement
            assert violation(solution.reaction, v, MU, q) <= 1e-9
        seen.update(expected.status)
    assert seen == {0, 1, 2}


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.slow_variants("3")
def test_held_by_contact_alone(dim: int) -> None:
    for seed in range(2):
        rng = np.random.default_rng([seed, dim])
        contacts = 6
        W = 0.2 * compliance(rng, contacts * dim)
        at = rng.uniform(-1, 1, size=(contacts, dim - 1))
        # Motions: along the normal, along the tangents, tilts about the tangents.
        R = np.zeros((contacts, dim, 2 * dim - 1))
        R[:, 0, 0] = 1
        R[:, 0, dim:] = at
        R[:, 1:, 1:dim] = np.eye(dim - 1)
        flat = R.reshape(contacts * dim, -1)
        # Loads that balance a set of varied reactions inside the cone.
        inside = np.ones((contacts, dim))
        inside[:, 1:] = rng.uniform(-1, 1, dim - 1) * 0.5 * MU
        e = -flat.T @ inside.ravel()
        q = 0.1 * rng.normal(size=(contacts, dim))
        expected = follow(Problem(W, q, MU, (flat, e)))
        for method in SOME:
            solution = bp.ReducedProblem(W, q, MU, rigid=(flat, e)).solve(method, TOL)
            assert solution.converged
            size = np.abs(expected.r).max()
            np.testing.assert_allclose(solution.reaction, expected.r, atol=1e-8 * size)
            balance = flat.T @ solution.reaction.ravel() + e
            # One term of η, in another orthonormal basis.
            assert np.abs(balance).max() <= 1e-10 * np.abs(e).max()
            r, v = solution.reaction, solution.relative_displacement
            rebuilt = W @ r.ravel() + flat @ solution.rigid_motion
            rebuilt = rebuilt.reshape(contacts, dim) + q
            np.testing.assert_allclose(v, rebuilt, atol=1e-12 * np.abs(rebuilt).max())
            assert violation(r, v, MU, q) <= 1e-8


def test_each_violation_is_found() -> None:
    r, v = np.array([[1.0, -0.5]]), np.array([[0.0, 2.0]])
    assert violation(r, v, 0.5) == 0
    for wrong_r, wrong_v in [
        (-r, v),  # tension
        (r, np.array([[-1.0, 2.0]])),  # penetration
        (r, np.array([[1.0, 2.0]])),  # force at a distance
        (np.array([[1.0, -0.6]]), v),  # outside the cone
        (np.array([[1.0, -0.4]]), v),  # slip below the limit
        (np.array([[1.0, 0.5]]), v),  # slip along the force
        # Slip not opposite to the reaction.
        (np.array([[1.0, -0.5, 0.0]]), np.array([[0.0, 1.0, 1.0]])),
    ]:
        assert violation(wrong_r, wrong_v, 0.5) > 0.04
