"""Each cause is named in a problem made to have it, and in no other."""

import pickle
import re
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import bipot_rs as bp
from bipot_rs.diagnosis import misses
from methods import METHODS

Array = NDArray[np.float64]

CAUSES = {
    "redundant": r"redundant contacts, their \d+ reaction components act in",
    "nearly free": r"a body is nearly free",
    "jam": r"friction that can jam contact",
    "several": r"several answers near by",
    "limit": r"likely cause: the limit",
    "indefinite": r"W is not positive semidefinite",
    "rounding": r"rounding, for the reactions meet the law",
    "range": r"where doubles end",
    "slides": r"seems to slide away",
}


def names(message: str) -> set[str]:
    return {name for name, words in CAUSES.items() if re.search(words, message)}


def held(seed: int = 0, contacts: int = 20, d: int = 3) -> tuple[Array, Array]:
    """W of condition below ten and weak coupling, and a q that closes most contacts."""
    rng = np.random.default_rng(seed)
    m = contacts * d
    root = rng.normal(size=(m, m)) / np.sqrt(m)
    W = 0.3 * (root @ root.T) + np.eye(m)
    return (W + W.T) / 2, rng.normal(size=(contacts, d)) - np.eye(1, d)


def stopped(W: Any, q: Any, mu: Any = 0.3, **options: Any) -> str:
    """The message of a solve that is cut short before it can end."""
    rigid = options.pop("rigid", None)
    given = {"method": "uzawa", "tol": 1e-13, "max_iterations": 8} | options
    solution = bp.ReducedProblem(W, q, mu, rigid=rigid).solve(**given)
    assert not solution.converged
    assert "\n" not in solution.message
    return solution.message


@pytest.mark.parametrize("method", METHODS)
def test_a_limit_and_nothing_else(method: str) -> None:
    W, q = held()
    message = stopped(W, q, method=method, max_iterations=1)
    assert names(message) == {"limit"}
    # What was tried, what was reached, where it is worst, what to do: in that order.
    order = [
        r"not converged: 1 iteration of " + repr(method),
        "reached max_iterations",
        r"residual \d\.\de-\d+, held to 1\.0e-13",
        r"worst at contact \d+, which",
        "likely cause",
        "try a larger max_iterations",
    ]
    assert re.search(".*".join(order), message), message
    assert ("method='auto'" in message) == (method != "auto")


def test_a_time_limit() -> None:
    W, q = held()
    message = stopped(W, q, max_seconds=1e-9, max_iterations=None)
    assert names(message) == {"limit"}
    assert "reached max_seconds = 1e-09" in message
    assert "try a larger max_seconds" in message


def test_redundant_contacts() -> None:
    rng = np.random.default_rng(1)
    columns = rng.normal(size=(60, 10))
    message = stopped(columns @ columns.T, rng.normal(size=(20, 3)))
    assert names(message) == {"redundant"}
    assert "their 60 reaction components act in 10 independent ways only" in message
    assert "try fewer contacts" in message


def test_contacts_that_the_rigid_motions_determine_are_not_redundant() -> None:
    """W of a rigid body on springs has no rank, and the balance of forces gives it."""
    W, q = held(contacts=2, d=2)
    values, vectors = np.linalg.eigh(W)
    values[:2] = 0.0
    soft = (vectors * values) @ vectors.T
    R = np.ascontiguousarray(vectors[:, :2])
    # Whatever is pressed enough: the loads are those of reactions within the cone.
    e = -R.T @ np.array([1.0, 0.05, 1.0, -0.05])
    message = stopped((soft + soft.T) / 2, q, rigid=(R, e), max_iterations=1)
    assert "redundant" not in names(message)
    assert "redundant" in names(stopped((soft + soft.T) / 2, q, max_iterations=1))


def test_a_body_that_is_nearly_free() -> None:
    W, q = held()
    push = np.tile([1.0, 0.0, 0.0], 20)
    message = stopped(W + 1e10 * np.outer(push, push), q - [1e3, 0, 0])
    assert names(message) == {"nearly free"}
    assert "one motion is softer by" in message
    assert "try a support for it" in message
    # A hundred times softer than the rest is how bodies are.
    assert names(stopped(W + 1e2 * np.outer(push, push), q)) == {"limit"}


def test_a_stiffness_that_is_nearly_free() -> None:
    K = np.diag([2.0, 2.0, 2.0, 2.0]) - np.eye(4, k=2) - np.eye(4, k=-2)
    for soft, named in ((1e-10, {"nearly free"}), (0.1, {"limit"})):
        weak = K - np.eye(4) * (1 - soft)
        problem = bp.ContactProblem(weak, np.eye(4), gap=np.zeros(2), mu=0.3)
        with pytest.raises(bp.NotConvergedError) as caught:
            problem.solve([-1.0, 0.1, -1.0, 0.2], method="uzawa", max_iterations=1)
        assert names(str(caught.value)) == named


def test_friction_that_can_jam() -> None:
    W = np.array([[1.0, 0.9], [0.9, 1.0]])
    message = stopped(W, [[-1.0, 2.0]], 3.0)
    assert "jam" in names(message)
    assert "friction that can jam contact 0, mu ‖W_nt‖ ≥ W_nn with mu = 3" in message
    assert "try a smaller mu" in message
    assert "jam" not in names(stopped(W, [[-1.0, 2.0]], 1.0))
    # Of several, the first is named and the others are counted.
    both = np.kron(np.eye(2), W) + 0.01
    assert "contact 0 and 1 more" in stopped(both, [[-1.0, 2.0]] * 2, 3.0)


def test_several_answers() -> None:
    # Above μ = k_t/|k_c| = 1/0.9 some loads have three answers, others one.
    W = np.linalg.inv(np.array([[1.0, -0.9], [-0.9, 1.0]]))
    found = []
    for angle in np.linspace(1.0, 3.0, 60):
        q = [W @ np.array([np.cos(angle), np.sin(angle)])]
        problem = bp.ReducedProblem(W, q, 2.0)
        # From a reaction, for to open is one of the answers and found at once.
        start = np.array([[5.0, 1.0]])
        solution = problem.solve("uzawa", 1e-13, max_iterations=2, start=start)
        if solution.converged:
            continue
        several = len(problem.answers()) > 1
        found.append(several)
        assert ("several" in names(solution.message)) == several
    assert {True, False} == set(found)


def test_a_body_that_slides_away() -> None:
    # A slider pressed by a spring, pulled beyond friction: feasible, and no answer.
    K = np.diag([1.0, 0.0])
    problem = bp.ContactProblem(K, np.eye(2), gap=[0.0], mu=0.5)
    with pytest.raises(bp.BipotError) as caught:
        problem.solve([-1.0, 2.0], method="gauss_seidel", max_iterations=3000)
    message = str(caught.value)
    assert "slide" in message or "nothing stops this motion" in message
    assert "add a support, or lower the loads" in message


def test_contacts_that_contradict_each_other_are_named() -> None:
    B = np.vstack([np.eye(2), -np.eye(2)])
    problem = bp.ContactProblem(np.eye(2), B, gap=[-1.0, -1.0], mu=0.3)
    with pytest.raises(bp.NoEquilibriumError, match="contacts 0 and 1 push against"):
        problem.solve([0.2, 0.1])
    wall = bp.ReducedProblem(np.diag([1.0, 1, 0, 0]), [[1.0, 0], [-0.25, 0]], 0.3)
    message = wall.solve().message
    assert message.endswith("contact 1 penetrates by 0.25")


def test_the_worst_contact_has_its_place() -> None:
    K = np.diag([2.0, 1.0, 2.0, 1.0, 2.0, 1.0]) + 0.01
    points = np.array([[0.0, 0.0], [1.0, 2.5], [-3.0, 1e-3]])
    problem = bp.ContactProblem(K, np.eye(6), gap=np.zeros(3), mu=0.3, points=points)
    path = [[-1.0, 0.1, -1, 0.1, -1, 0.1], [-1.0, 0.1, -1, 0.1, -9, 0.1]]
    with pytest.raises(bp.NotConvergedError) as caught:
        problem.solve(path, method="uzawa", tol=1e-12, max_iterations=2)
    place = re.search(
        r"step (\d): .*worst at contact (\d) at \(([^)]*)\)", str(caught.value)
    )
    assert place is not None
    i = int(place[2])
    assert place[3] == ", ".join(f"{x:.4g}" for x in points[i])


def test_what_each_contact_misses() -> None:
    """By hand, with W_ii = 4: displacements count half, forces twice."""
    r = np.array([[1.0, 0.0], [1.0, 0.0], [1.0, 0.6], [1.0, 0.5], [0.0, 0.0]])
    v = np.array([[-0.2, 0.0], [0.2, 0.0], [0.0, 0.0], [0.0, 0.2], [3.0, 7.0]])
    found = misses(r, v, np.full(5, 0.5), np.full(5, 4.0))
    # The slip of 0.1 sees 2 of 0.1 + 2 + 1 of the force the wrong way.
    expected = np.zeros((4, 5))
    expected[0, 0], expected[1, 1], expected[2, 2] = 0.1, 0.1, 0.2
    expected[3, 3] = 0.1 * 2 / 3.1
    np.testing.assert_allclose(found, expected, atol=1e-15)


def test_a_looser_tolerance_is_offered_where_it_would_do() -> None:
    W, q = held()
    problem = bp.ReducedProblem(W, q, 0.3)
    short = problem.solve("gauss_seidel", 1e-13, max_iterations=6)
    offered = re.search(r"tol=(1e-\d+), which this point meets", short.message)
    assert not short.converged
    assert offered is not None
    again = problem.solve("gauss_seidel", float(offered[1]), max_iterations=6)
    assert again.converged


def test_a_message_outlives_its_problem() -> None:
    W, q = held()
    solution = bp.ReducedProblem(W, q, 0.3).solve("uzawa", max_iterations=2)
    lost = pickle.loads(pickle.dumps(solution))
    assert lost.message.startswith("not converged, max_iterations was reached")
    message = solution.message
    assert pickle.loads(pickle.dumps(solution)).message == message
    # The W of the caller, written to since, is not judged by what it became.
    other = bp.ReducedProblem(W, q, 0.3).solve("uzawa", max_iterations=2)
    W[3, 5] = np.nan
    assert other.message.startswith("not converged: 2 iterations of 'uzawa'")


def test_no_contact_at_all_has_nothing_to_say() -> None:
    solution = bp.ReducedProblem(np.zeros((0, 0)), np.zeros((0, 2)), 0.3).solve()
    assert solution.message.startswith("converged")
