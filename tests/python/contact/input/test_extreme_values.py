"""Extreme inputs give no wrong solution, no NaN and no crash."""

import numpy as np
import pytest

import bipot_rs as bp

METHODS = ["auto", "gauss_seidel", "uzawa"]


def test_a_load_that_the_caller_uses_again() -> None:
    problem = bp.ContactProblem(np.eye(2), np.eye(2), gap=[0.5], mu=0.3)
    load, results = np.zeros(2), []
    for k in range(3):
        load[0] = -(k + 1.0)
        results.append(problem.solve(load, start=results[-1] if results else None))
    # The gap of 0.5 closes in every step, even if the caller changes the array afterwards.
    assert [result.displacement[0, 0] for result in results] == [-0.5, -0.5, -0.5]


def test_a_failed_path_keeps_its_start() -> None:
    problem = bp.ContactProblem(np.eye(2), np.eye(2), gap=[0.0], mu=0.5)
    first = problem.solve([-1.0, 0.9])
    with pytest.raises(bp.NotConvergedError) as caught:
        problem.solve([-1.0, 0.0], start=first, max_seconds=1e-12, tol=1e-300)
    result = caught.value.result
    assert result is not None
    assert len(result) == 0
    straight = problem.solve([-1.0, 0.0], start=first)
    again = problem.solve([-1.0, 0.0], start=result)
    assert np.array_equal(straight.reaction, again.reaction)


@pytest.mark.parametrize("size", [1e300, 1e-300, 1e-310])
def test_units_at_the_ends_of_the_range(size: float) -> None:
    """What is not refused with advice on units is not wrong."""
    for W, q in ((size, 1.0), (1.0, size), (size, 1 / max(size, 1e-300))):
        try:
            solution = bp.ReducedProblem(np.eye(2) * W, [[-q, 0.2 * q]], 0.3).solve()
        except ValueError:
            continue
        assert not np.isnan(solution.residual)
        assert not np.isnan(solution.reaction).any()
        if solution.converged:
            # r_n = q/W; r_t is the smaller of the limit and the sticking force 0.2 q/W.
            exact = [[q / W, -0.2 * q / W]]
            np.testing.assert_allclose(solution.reaction, exact, rtol=1e-9)


def test_reactions_much_larger_than_displacements() -> None:
    """A weightless block between overlapping walls, and two contacts of a rigid body.

    Nothing deforms: reactions that cancel each other may grow until v is lost in rounding.
    """
    walls = bp.ReducedProblem(
        np.zeros((4, 4)),
        [[-1, 0], [-1, 0]],
        0.3,
        rigid=([[1, 0], [0, 1], [-1, 0], [0, 1]], [0, 0]),
    )
    pair = bp.ReducedProblem(
        np.zeros((4, 4)),
        [[1, 1], [-1, 0]],
        [0.1, 100],
        rigid=([[-1], [-1], [1], [1]], [0]),
    )
    for problem in (walls, pair):
        for method in METHODS:
            solution = problem.solve(method, max_iterations=3000)
            v = solution.relative_displacement
            # The residual allows 1e-6 of the free displacement, which is one.
            assert not (solution.converged and v[:, 0].min() < -1e-6), method


def test_loads_of_any_unit_on_rigid_bodies() -> None:
    """No compliance relates forces to displacements, so the unit of e has no effect."""
    R = np.array([[1, 0, -1], [0, 1, 0], [1, 0, 1], [0, 1, 0.0]])
    answers = [
        bp.ReducedProblem(
            np.zeros((4, 4)), np.zeros((2, 2)), 0.5, rigid=(R, [-s, 0.1 * s, 0.0])
        ).solve(tol=1e-12)
        for s in (2.0**-40, 1.0, 2.0**40)
    ]
    assert all(answer.converged for answer in answers)
    for answer, s in zip(answers, (2.0**-40, 1.0, 2.0**40), strict=True):
        assert np.array_equal(answer.reaction, s * answers[1].reaction)
        assert answer.iterations == answers[1].iterations


@pytest.mark.parametrize("load", [1e-8, 1e-9, 1e-12, 1e-30, 0.0])
def test_loads_much_smaller_than_reactions(load: float) -> None:
    """Gaps press two contacts; the load on a free motion is very small."""
    rigid = ([[0], [1], [0], [1]], [load])
    problem = bp.ReducedProblem(np.eye(4), [[-1, 0], [-1, 0]], 0.3, rigid=rigid)
    solution = problem.solve()
    assert solution.converged
    # The balance holds to the rounding of the reactions, which are one.
    assert abs(solution.reaction[:, 1].sum() + load) <= 1e-15
