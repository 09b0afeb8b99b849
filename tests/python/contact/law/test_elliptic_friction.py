"""Friction with two coefficients: closed forms, an independent solver, symmetry."""

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import bipot_rs as bp
from support.methods import METHODS

Array = NDArray[np.float64]
OPEN, SLIP, STICK = bp.Status.OPEN, bp.Status.SLIP, bp.Status.STICK


def friction(r_n: float, mu: Array, v_t: Array) -> Array:
    """Reaction of a slipping contact by the law (8e)."""
    return -r_n * mu**2 * v_t / np.linalg.norm(mu * v_t)


def random_problem(
    n: int, seed: int, ratio: float = 10.0
) -> tuple[Array, Array, Array]:
    """Definite W, q, and (n, 2) coefficients small enough for a unique solution."""
    rng = np.random.default_rng([n, seed])
    root_of = rng.normal(size=(3 * n, 3 * n)) / np.sqrt(3 * n)
    q = rng.normal(size=(n, 3))
    q[:, 0] -= 0.7
    mu = rng.uniform(0.1, 0.3, (n, 1)) * [1.0, 1.0]
    mu[np.arange(n), rng.integers(0, 2, n)] *= ratio ** -rng.random(n)
    return root_of @ root_of.T + np.eye(3 * n), q, mu


@pytest.mark.parametrize("method", METHODS)
def test_every_method_finds_a_constructed_solution(method: str) -> None:
    """r on the cone and v by the law are chosen; q = v - W r makes them the solution."""
    rng = np.random.default_rng(5)
    W, _, mu = random_problem(6, 1)
    r, v = np.zeros((2, 6, 3))
    r[:4, 0] = rng.uniform(0.5, 2, 4)
    v[:2, 1:] = rng.normal(size=(2, 2))
    for i in range(2):  # sliding
        r[i, 1:] = friction(r[i, 0], mu[i], v[i, 1:])
    r[2:4, 1:] = 0.6 * r[2:4, :1] * mu[2:4] * [0.6, -0.8]  # sticking
    v[4:] = rng.uniform(0.1, 1, (2, 3))  # open
    q = v - (W @ r.ravel()).reshape(6, 3)
    problem = bp.ReducedProblem(W, q, mu)
    solution = problem.solve(method, tol=1e-12)
    assert solution.converged
    np.testing.assert_array_equal(
        solution.status, [SLIP, SLIP, STICK, STICK, OPEN, OPEN]
    )
    # η = 1e-12 in scaled variables, whose condition is that of W, below 10; slip along the
    # weaker tangent is ṽ_t divided by a ratio of up to 10.
    np.testing.assert_allclose(solution.reaction, r, atol=1e-10)
    np.testing.assert_allclose(solution.relative_displacement, v, atol=1e-9)
    assert problem.residual(r) <= 1e-14
    assert problem.residual(solution.reaction) == pytest.approx(
        solution.residual, rel=0.1, abs=1e-15
    )


@pytest.mark.parametrize("seed", range(20))
def test_answers_fulfil_the_law_in_the_callers_variables(seed: int) -> None:
    """The fixed point (11) with the Euclidean projection, which no solver uses."""
    W, q, mu = random_problem(5, seed, ratio=100.0)
    solution = bp.ReducedProblem(W, q, mu).solve(tol=1e-12)
    assert solution.converged
    r, v = solution.reaction, solution.relative_displacement
    drag = np.linalg.norm(mu * v[:, 1:], axis=1)
    corrected = v + np.outer(drag, [1.0, 0.0, 0.0])
    again, _ = bp.project(r - corrected, mu)
    # η of 1e-12 for r̃, and for ṽ divided by ratios of up to 100.
    np.testing.assert_allclose(again, r, atol=1e-9 * np.abs(r).max())
    # The gap of the bipotential (10e) equals its definition and is never negative.
    work = (r * v).sum(axis=1) + r[:, 0] * drag
    size = (np.abs(r) * np.abs(v)).sum(axis=1).max()
    np.testing.assert_allclose(solution.bipotential_gap, work, atol=1e-14 * size)
    assert np.abs(work).max() <= 1e-10 * size
    assert max(solution.error_estimate) < 1e-9


@pytest.mark.parametrize("seed", range(5))
class TestSymmetries:
    def test_tangents_exchanged_or_turned(self, seed: int) -> None:
        W, q, mu = random_problem(4, seed)
        reference = bp.ReducedProblem(W, q, mu).solve(tol=1e-13)
        exchanged = np.array([[1.0, 0, 0], [0, 0, 1], [0, 1, 0]])
        quarter = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])
        for turn in (exchanged, quarter):
            whole = np.kron(np.eye(4), turn)
            turned = bp.ReducedProblem(whole @ W @ whole.T, q @ turn.T, mu[:, ::-1])
            solution = turned.solve(tol=1e-13)
            # Two solves to η = 1e-13, condition below 10.
            np.testing.assert_allclose(
                solution.reaction @ turn, reference.reaction, atol=1e-11
            )
            np.testing.assert_array_equal(solution.status, reference.status)

    def test_equal_coefficients_are_coulombs_law_to_the_bit(self, seed: int) -> None:
        W, q, mu = random_problem(4, seed)
        mu[:, 1] = mu[:, 0]
        mu[0] = 0.0
        two = bp.ReducedProblem(W, q, mu).solve()
        scalar = bp.ReducedProblem(W, q, mu[:, 0]).solve()
        np.testing.assert_array_equal(two.reaction, scalar.reaction)
        np.testing.assert_array_equal(
            two.relative_displacement, scalar.relative_displacement
        )
        assert (two.residual, two.work) == (scalar.residual, scalar.work)


def test_a_definite_problem_has_one_solution() -> None:
    W, q, mu = random_problem(3, 2)
    assert len(bp.ReducedProblem(W, q, mu).answers(restarts=8)) == 1


def test_projection_of_many_is_that_of_each() -> None:
    rng = np.random.default_rng(0)
    tau, mu = rng.normal(size=(5000, 3)), 10 ** rng.uniform(-4, 4, (5000, 2))
    mu[::7] = 0.0
    whole, status = bp.project(tau, mu)
    alone, kind = bp.project(tau[4321:4322], mu[4321:4322])
    np.testing.assert_array_equal(whole[4321:4322], alone)
    assert status[4321] == kind[0]
    # Moreau: τ = r + rest, rest·r = 0 and rest is in the polar cone. Products have four
    # roundings each, relative to the length of the rays of the cone.
    rest = tau - whole
    np.testing.assert_allclose((rest * whole).sum(axis=1), 0.0, atol=1e-14)
    height = rest[:, 0] + np.linalg.norm(mu * rest[:, 1:], axis=1)
    assert (height <= 1e-14 * np.hypot(1, mu.max(axis=1))).all()
    base = rng.normal(size=tau.shape)
    np.testing.assert_array_equal(
        bp.project(tau, mu, base)[1], bp.project(tau + base, mu)[1]
    )


WRONG: list[tuple[Any, str]] = [
    ([[0.3, 0.0]], r"mu of contact 0 is \[0.3, 0.0\], expected two positive"),
    ([[0.3, -0.1]], "mu of contact 0 along tangent 2 is -0.1, expected zero"),
    ([[0.3, 2e-7]], "within a factor of 1e\\+06 of each other"),
    ([[0.3, np.nan]], r"mu is nan at \(0, 1\), expected finite"),
    ([[0.3, 0.1, 0.2]], r"mu has shape \(1, 3\), expected a number or \(1,\) or"),
    ([[0.3, 0.1]] * 2, r"mu has shape \(2, 2\), expected a number or \(1,\) or"),
]  # fmt: skip


@pytest.mark.parametrize(("mu", "said"), WRONG)
def test_wrong_coefficients(mu: Any, said: str) -> None:
    with pytest.raises(ValueError, match=said):
        bp.ReducedProblem(np.eye(3), [[-1.0, 0, 0]], mu)
    with pytest.raises(ValueError, match=said):
        bp.ContactProblem(np.eye(3), np.eye(3), gap=[0.0], mu=mu)


def test_wrong_coefficients_in_the_plane_and_of_a_projection() -> None:
    with pytest.raises(ValueError, match=r"expected a number or \(1,\)$"):
        bp.ReducedProblem(np.eye(2), [[-1.0, 0.0]], [[0.3, 0.1]])
    with pytest.raises(ValueError, match=r"expected a number or \(1,\)$"):
        bp.project([[1.0, 0.0]], [[0.3, 0.1]])
    bp.project([[1.0, 1.0, 0.0]], [[1e-9, 1e9]])
    with pytest.raises(ValueError, match="from 1e-75 to 1e\\+75 if they differ"):
        bp.project([[1.0, 1.0, 0.0]], [[1e-80, 1.0]])
