"""Problems with several solutions or none, and the verdict on uniqueness."""

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import sparse

import bipot_rs as bp
from bipot_rs.analytic import one_contact_branches
from support import oracle

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


def random_problem(rng: np.random.Generator, rigid: bool) -> bp.ReducedProblem:
    contacts = int(rng.integers(2, 4))
    factor = rng.normal(size=(2 * contacts, 2 * contacts))
    W = factor @ factor.T + 0.02 * np.eye(2 * contacts)
    q = rng.normal(size=(contacts, 2)) - [0.5, 0.0]
    mu = rng.choice([0.3, 3.0, 12.0]) * rng.uniform(0.5, 1.0, contacts)
    if not rigid:
        return bp.ReducedProblem(W, q, mu)
    R = rng.normal(size=(2 * contacts, 1))
    return bp.ReducedProblem(W, q, mu, rigid=(R, rng.normal(size=1)))


@pytest.mark.parametrize(("seed", "problems"), [(7, 8), (8, 400)])
@pytest.mark.parametrize("rigid", [False, True])
@pytest.mark.quick_variants("True-7-*")
def test_answers_are_those_of_the_oracle(rigid: bool, seed: int, problems: int) -> None:
    """The solutions of random problems, and their number."""
    rng = np.random.default_rng(seed)
    counts = []
    for _ in range(problems):
        problem = random_problem(rng, rigid)
        whole = oracle.Problem(problem.W, problem.q, problem.mu, problem.rigid)
        expected = [answer.r for answer in oracle.answers(whole)]
        all_answers = problem.answers()
        assert all_answers.complete
        # The oracle separates solutions that differ by 1e-6 and accepts errors of 1e-10.
        assert alike([s.reaction for s in all_answers], expected, 1e-6)
        counts.append(len(all_answers))
    # Definite problems with several solutions, and floating ones with none.
    assert (0 if rigid else 3) in counts


def test_pivoting_finds_one_of_them_for_any_friction() -> None:
    several = 0
    for seed in range(30):
        rng = np.random.default_rng(seed)
        root = rng.normal(size=(10, 10)) / np.sqrt(10)
        W = root @ root.T + 0.05 * np.eye(10)
        q = rng.normal(size=(5, 2)) - [0.5, 0.0]
        for mu in (0.5, 2.0, 8.0):
            problem = bp.ReducedProblem((W + W.T) / 2, q, mu)
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


def test_twelve_contacts_are_exhausted() -> None:
    rng = np.random.default_rng(1)
    factor = rng.normal(size=(24, 40))
    q = rng.normal(size=(12, 2)) - [0.5, 0.0]
    problem = bp.ReducedProblem(factor @ factor.T / 40, q, 0.4)
    (only,) = all_answers = problem.answers()
    assert all_answers.complete
    solved = problem.solve(tol=1e-12)
    # η = 1e-12 and a condition below 100.
    np.testing.assert_allclose(
        solved.reaction, only.reaction, atol=1e-9 * np.abs(only.reaction).max()
    )


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
