"""Points with a small residual that must not count as solutions."""

import numpy as np
import pytest
from numpy.typing import NDArray

import bipot_rs as bp
from support.methods import METHODS

Array = NDArray[np.float64]


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("method", METHODS)
def test_walls_that_overlap_have_no_answer(dim: int, method: str) -> None:
    # One node between two walls that overlap: the two reactions push against each other
    # and grow, and η, which is relative to them, goes to zero.
    B = np.vstack([np.eye(dim), -np.eye(dim)])
    problem = bp.ContactProblem(np.eye(dim), B, gap=[-1, -1], mu=0.3)
    load = [0.2, *[0.1] * (dim - 1)]
    with pytest.raises(bp.BipotError) as raised:
        problem.solve(load, method=method, max_iterations=20_000)
    if method == "auto":
        assert isinstance(raised.value, bp.NoEquilibriumError)
        assert "contradict each other" in str(raised.value)


@pytest.mark.parametrize("method", METHODS)
def test_walls_with_room_between_them_are_solved(method: str) -> None:
    B = np.vstack([np.eye(2), -np.eye(2)])
    problem = bp.ContactProblem(np.eye(2), B, gap=[0.5, -0.2], mu=0.3)
    result = problem.solve([0.0, 0.0], method=method)
    # The second wall pushes the node by 0.2: r_n = 0.2 with K = 1.
    assert result.reaction[0, 1, 0] == pytest.approx(0.2, rel=1e-9)


@pytest.mark.parametrize("mu", [1e6, 1e9, 1e75])
@pytest.mark.parametrize("method", METHODS)
def test_a_large_mu_hides_no_penetration(mu: float, method: str) -> None:
    rng = np.random.default_rng(5)
    for _ in range(20):
        root = rng.normal(size=(4, 4))
        W, q = root @ root.T + np.eye(4), rng.normal(size=(2, 2))
        problem = bp.ReducedProblem((W + W.T) / 2, q, [0.5, mu])
        start = np.column_stack([np.abs(rng.normal(size=2)), np.zeros(2)])
        solution = problem.solve(method, start=start, max_iterations=2000)
        if solution.converged:
            # The residual allows at most 1e-6, and penetration ten times that; the condition of W
            # is below 100.
            deepest = -solution.relative_displacement[:, 0].min(initial=0.0)
            assert deepest <= 1e-3 * np.abs(q).max()


def test_the_same_problem_solved_again_gives_the_same_bits() -> None:
    rng = np.random.default_rng(4)
    n = 240
    root = rng.normal(size=(n, n))
    K = root @ root.T / n + np.eye(n)
    problem = bp.ContactProblem((K + K.T) / 2, np.eye(n), gap=np.zeros(n // 3), mu=0.4)
    load = rng.normal(size=n)
    load[::3] -= 1.0
    path = np.array([load, 1.1 * load, 0.9 * load])
    # An inverse kept from the first path must not change the second.
    first, second = problem.solve(path), problem.solve(path)
    np.testing.assert_array_equal(first.reaction, second.reaction)
    np.testing.assert_array_equal(first.iterations, second.iterations)


def test_a_time_limit_is_kept_where_statuses_could_be_exhausted() -> None:
    # In the plane, twelve contacts, a slider on a spring: feasible, but without a solution.
    n = 12
    K = np.zeros((2 * n, 2 * n))
    for i in range(n):
        K[2 * i : 2 * i + 2, 2 * i : 2 * i + 2] = [[1, 1], [1, 1]]
    problem = bp.ContactProblem(K, np.eye(2 * n), gap=np.zeros(n), mu=2.0)
    with pytest.raises(bp.BipotError) as raised:
        problem.solve(np.tile([-1.0, -2.5], n), max_seconds=0.5)
    assert raised.value.result is not None
