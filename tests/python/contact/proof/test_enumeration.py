"""Problems with several solutions or none, and the verdict on uniqueness."""

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import sparse

import bipot_rs as bp
from bipot_rs.analytic import one_contact_branches

Array = NDArray[np.float64]
K = np.array([[2.0, 0.5], [0.5, 1.0]])  # one contact is unique below μ = 2


def one_contact(load: list[float], mu: float) -> bp.ReducedProblem:
    W = np.linalg.inv(K)
    return bp.ReducedProblem(W, (W @ load)[None], mu)


def alike(found: list[Array], expected: list[Array], rtol: float) -> bool:
    """Whether both lists have the same reactions, in any order."""
    if len(found) != len(expected):
        return False
    size = max((float(np.abs(r).max()) for r in expected), default=0.0) or 1.0
    gaps = [[np.abs(r - s).max() / size for s in expected] for r in found]
    return all(min(row) <= rtol for row in gaps + list(zip(*gaps, strict=True)))


@pytest.mark.parametrize("mu", [0.0, 0.3, 1.5, 2.1, 3.0, 10.0, 1e3])
@pytest.mark.parametrize("f_t", [-3.5, -2.9, -2.5, -2.05, -1.5, -0.2, 0.0, 0.2, 1.5])
def test_a3_every_branch_is_found(f_t: float, mu: float) -> None:
    problem = one_contact([-1.0, f_t], mu)
    listed = one_contact_branches(K, [-1.0, f_t], mu)
    all_answers = problem.answers()
    assert all_answers.complete
    # Reactions of order 1 and 1e3, condition below 1e4: exact to rounding.
    expected = [np.array(branch.reaction) for branch in listed]
    assert alike([s.reaction[0] for s in all_answers], expected, 1e-11)
    assert len(all_answers) in (1, 3)
    for solution in all_answers:
        assert solution.converged
        assert solution.unique == (
            "proved" if len(all_answers) == 1 else "others exist"
        )


def test_a_slider_pushed_off_its_spring_has_no_answer() -> None:
    # The cone programme Rᵀ r + e = 0 is feasible here: only the statuses prove it.
    stiffness = sparse.csr_array(np.ones((2, 2)))
    problem = bp.ContactProblem(stiffness, sparse.eye_array(2), gap=[0.0], mu=2.0)
    none = problem.reduced([-1.0, -2.5]).answers()
    assert none.complete
    assert len(none) == 0
    assert "all there are" in repr(none)
    # With half the push it holds, or slips back: u_t = r_n - 1 = r_t - 1.2, r_t = 2 r_n.
    two = problem.reduced([-1.0, -1.2]).answers()
    assert two.complete
    expected = [np.array([1.0, 1.2]), np.array([0.2, 0.4])]
    assert alike([s.reaction[0] for s in two], expected, 1e-12)
    assert [s.unique for s in two] == ["others exist"] * 2


@pytest.mark.parametrize(("mu", "softness"), [(5.0, 1e-8), (50.0, 1e-9)])
@pytest.mark.parametrize("far", [0.0, 1 / 3, -8.8])
def test_rounding_of_a_large_motion_is_no_proof(
    mu: float, softness: float, far: float
) -> None:
    """The motion cancels ``q``, and one contact sticks: ``W r`` is rounding of ``q`` then."""
    W = softness * np.array([[1.0, 1.0], [1.0, 2.5]])
    R = np.array([[1.0], [-1.0]])
    problem = bp.ReducedProblem(W, [[far, -far]], mu, rigid=(R, [-1.0]))
    solution, answers = problem.solve(), problem.answers()
    # (W r)_n + (W r)_t = 0 and r_n - r_t = 1. At q = 8.8 no digit of W r is left to judge.
    np.testing.assert_allclose(solution.reaction, [[7 / 11, -4 / 11]], rtol=1e-6)
    assert solution.outcome.value in ("converged", "stalled")
    assert answers or not answers.complete


def test_redundant_contacts_leave_the_answers_incomplete() -> None:
    # The same contact twice: the sum of the two reactions is determined, each one is not.
    W = np.tile([[0.5, 0.1], [0.1, 1.0]], (2, 2))
    problem = bp.ReducedProblem(W, [[-1.0, 0.7], [-1.0, 0.7]], 0.3)
    all_answers = problem.answers()
    assert not all_answers.complete
    for solution in all_answers:
        np.testing.assert_allclose(
            solution.reaction.sum(axis=0), [2.12765957, -0.63829787], rtol=1e-8
        )


def wedge_in_space() -> bp.ReducedProblem:
    # The wedge in the plane, with a second tangent that nothing couples to.
    stiffness = np.eye(3)
    stiffness[:2, :2] = K
    W = np.linalg.inv(stiffness)
    return bp.ReducedProblem(W, (W @ [-1.0, -2.5, 0.1])[None], 3.0)


def test_restarts_find_several_answers_in_space() -> None:
    problem = wedge_in_space()
    all_answers = problem.answers(restarts=20, seed=3)
    assert not all_answers.complete
    assert "there may be others" in repr(all_answers)
    kinds = {bp.Status(s.status[0]) for s in all_answers}
    # Iterations converge to open and to stick; the slip between them may not be found.
    assert {bp.Status.OPEN, bp.Status.STICK} <= kinds
    again = problem.answers(restarts=20, seed=3)
    assert [s.reaction.tobytes() for s in again] == [
        s.reaction.tobytes() for s in all_answers
    ]
    with pytest.raises(ValueError, match="restarts"):
        problem.answers(restarts=0)


def test_a_solution_between_two_others_is_not_unique_in_space() -> None:
    problem = wedge_in_space()
    # The slip branch of the plane problem, changed a little by the second tangent.
    u_t = 0.5 / (1 - 3 * 0.5)
    start = [[0.5 * u_t + 1.0, 3 * (0.5 * u_t + 1.0), -0.1]]
    slip = problem.solve("auto", tol=1e-12, start=start)
    assert slip.status[0] == bp.Status.SLIP
    assert slip.unique == "others exist"


@pytest.mark.parametrize("d", [2, 3])
def test_small_friction_is_proved_unique(d: int) -> None:
    rng = np.random.default_rng(d)
    size = 20 * d
    factor = rng.normal(size=(size, 4 * size))
    W = factor @ factor.T / (4 * size)
    q = rng.normal(size=(20, d))
    for mu, verdict in ((0.0, "proved"), (0.1, "proved"), (5.0, "unknown")):
        solution = bp.ReducedProblem(W, q, mu).solve()
        assert solution.unique == verdict
    # Without a definite W the verdict is unknown: the last contact has no compliance here.
    W[-d:], W[:, -d:] = 0.0, 0.0
    q[-1] = 0.0
    assert bp.ReducedProblem(W, q, 0.1).solve().unique == "unknown"
    # With a gap it is always open.
    q[-1] = 1.0
    assert bp.ReducedProblem(W, q, 0.1).solve().unique == "proved"


def test_a_sticking_solution_is_counted_once() -> None:
    """If all contacts stick, v contains only rounding errors."""
    W = [[2.0, 0.3, 0.1], [0.3, 3.0, 0.2], [0.1, 0.2, 2.5]]
    problem = bp.ReducedProblem(W, [[-1.0, 0.13, 0.07]], 1.0)
    assert problem.solve().unique == "proved"
    assert len(problem.answers()) == 1


def test_a_time_limit_is_kept_where_statuses_could_be_exhausted() -> None:
    """Twelve sliders on springs in the plane: feasible, but without a solution."""
    K = np.kron(np.eye(12), np.ones((2, 2)))
    problem = bp.ContactProblem(K, np.eye(24), gap=np.zeros(12), mu=2.0)
    with pytest.raises(bp.BipotError) as raised:
        problem.solve(np.tile([-1.0, -2.5], 12), max_seconds=0.5)
    assert raised.value.result is not None
