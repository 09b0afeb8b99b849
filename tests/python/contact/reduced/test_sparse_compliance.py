"""A sparse W is never made dense, and gives the same solutions."""

import resource

import grains
import numpy as np
import pytest
from scipy import sparse

import bipot_rs as bp

TOL = 1e-10


WALL = grains.wall("", 9, np.random.default_rng(0), staggered=False, mu=0.4)
W, Q = WALL.step()
THIN = bp.ReducedProblem(W, Q, 0.4)


def test_the_residual_of_the_dense_problem_is_the_same() -> None:
    assert W.shape[0] > len(WALL.mass), "reactions are to be undetermined"
    solution = THIN.solve(tol=TOL)
    assert solution.converged
    thick = bp.ReducedProblem(W.toarray(), Q, 0.4)
    # Two sums of the same products in another order.
    assert thick.residual(solution.reaction) <= 1.01 * TOL
    assert solution.stats["bytes_beside_W"] == 0


def test_bodies_with_few_contacts_each_condense_to_a_sparse_compliance() -> None:
    M, B = sparse.diags_array(WALL.mass).tocsr(), WALL.B
    problem = bp.ContactProblem(M, B, gap=np.zeros(len(Q)), mu=0.4)
    expected = W.toarray()
    # Sums of four products of numbers of order one.
    np.testing.assert_allclose(problem.compliance, expected, rtol=0, atol=1e-14)
    assert problem.stats["bytes_compliance"] < expected.nbytes / 6
    load = WALL.load
    result = problem.solve(load, tol=TOL)
    assert THIN.residual(result.reaction[0]) <= 1.01 * TOL
    left = M @ result.displacement[0] - load - B.T @ result.reaction[0].ravel()
    np.testing.assert_allclose(left, 0, atol=1e-12 * np.abs(load).max())


@pytest.mark.parametrize("method", ["auto", "gauss_seidel", "nesterov"])
def test_same_bits_for_any_number_of_threads(method: str) -> None:
    on_one_thread, two = (
        THIN.solve(method, tol=1e-6, num_threads=n, max_iterations=300) for n in (1, 2)
    )
    assert np.array_equal(on_one_thread.reaction, two.reaction)
    assert on_one_thread.work == two.work


@pytest.mark.parametrize("method", ["auto", "newton", "uzawa"])
def test_several_islands_and_a_matrix_that_is_not_symmetric(method: str) -> None:
    rng = np.random.default_rng(1)
    # Chains of ten contacts, coupled by a tenth, more strongly in one direction.
    n = 120
    blocks = rng.uniform(-0.05, 0.05, (n, n, 3, 3))
    i, j = np.indices((n, n))
    blocks[(abs(i - j) > 1) | (i // 10 != j // 10)] = 0
    blocks[range(n), range(n)] += np.eye(3) + 0.1 * np.diag([0, 1, 2])
    W = blocks.transpose(0, 2, 1, 3).reshape(3 * n, 3 * n)
    q = rng.normal(size=(n, 3))
    thin, thick = (bp.ReducedProblem(A, q, 0.3) for A in (sparse.coo_array(W), W))
    assert thin.asymmetry == pytest.approx(thick.asymmetry, rel=1e-15)
    assert thin.asymmetry > 0.01
    solutions = [p.solve(method, tol=1e-12) for p in (thin, thick)]
    assert all(s.converged for s in solutions)
    # The condition of W is below two.
    first, second = (s.reaction for s in solutions)
    np.testing.assert_allclose(first, second, rtol=0, atol=1e-11 * abs(second).max())
    assert np.array_equal(solutions[0].status, solutions[1].status)


def test_twenty_thousand_contacts_take_megabytes() -> None:
    n = 20_000
    couple = sparse.diags_array(
        [np.full(3 * n - 3, 0.2), np.full(3 * n, 1.0), np.full(3 * n - 3, 0.2)],
        offsets=[-3, 0, 3],
    )
    q = np.random.default_rng(2).normal(size=(n, 3))
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    problem = bp.ReducedProblem(couple.tocsr(), q, 0.5)
    solution = problem.solve(tol=TOL)
    assert solution.converged
    v = (couple @ solution.reaction.ravel()).reshape(n, 3) + q
    np.testing.assert_allclose(v, solution.relative_displacement, atol=1e-13)
    grown = 1024 * (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before)
    # A dense W takes 29 GB; three blocks per row and some vectors take tens of megabytes.
    assert grown < 1e9


def test_the_message_locates_a_wrong_entry() -> None:
    W = sparse.diags_array(np.ones(300)).tolil()
    W[7, 4] = np.inf
    with pytest.raises(ValueError, match="W is not finite at row 7, column 4: inf"):
        bp.ReducedProblem(W.tocsr(), np.zeros((100, 3)), 0.3)
