"""Complementary pivoting, and the methods that accept bodies without supports."""

import numpy as np
import pytest

import bipot_rs as bp
from support.methods import METHODS, NEED_SUPPORTS


def strong(seed: int, contacts: int, mu: float) -> bp.ReducedProblem:
    """Plane contacts with random coupling and friction too large to prove uniqueness."""
    rng = np.random.default_rng(seed)
    n = 2 * contacts
    root = rng.normal(size=(n, n)) / np.sqrt(n)
    W = root @ root.T + 0.05 * np.eye(n)
    q = rng.normal(size=(contacts, 2)) - [0.5, 0.0]
    return bp.ReducedProblem((W + W.T) / 2, q, mu)


def test_a_solution_for_any_friction() -> None:
    several = 0
    for seed in range(30):
        for mu in (0.5, 2.0, 8.0):
            problem = strong(seed, 5, mu)
            solution = problem.solve("pivoting")
            assert solution.converged
            answers = problem.answers()
            several += len(answers) > 1
            size = np.abs(solution.reaction).max()
            apart = [np.abs(a.reaction - solution.reaction).max() for a in answers]
            # η of at most 1e-10, the condition of W, some hundreds, and the factor that friction
            # adds.
            assert min(apart) <= 1e-7 * max(size, 1e-30)
    assert several >= 3  # # of 90; a unique solution tests no choice


@pytest.mark.parametrize("method", METHODS)
def test_a_free_body(method: str) -> None:
    """Two nodes tied to each other only, pressed on a wall."""
    K = np.kron([[1.0, -1.0], [-1.0, 1.0]], np.eye(2))
    problem = bp.ContactProblem(K, np.eye(4), gap=[0.0, 0.0], mu=0.5)
    load = [-1.0, 0.2, -1.0, 0.1]
    if method in NEED_SUPPORTS:
        with pytest.raises(ValueError, match=f"'{method}' needs supports that hold"):
            problem.solve(load, method=method)
        return
    result = problem.solve(load, method=method)
    # By balance alone the reaction of the wall equals the loads.
    np.testing.assert_allclose(result.reaction[0].sum(axis=0), [2.0, -0.3], atol=1e-8)
