"""The diagnosis names a cause for the problems that have it, and for no others."""

import pickle
import re
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import bipot_rs as bp
import bipot_rs._core as _core
from bipot_rs.contact.law.contact_law import ContactLaw
from bipot_rs.contact.messages.diagnosis import (
    FailedSolve,
    diagnose,
    measure_violations,
)
from support.methods import METHODS

Array = NDArray[np.float64]
AUTO = _core.Settings("auto", 1e-10, None, None)

CAUSES = {
    "redundant": r"redundant contacts, their \d+ reaction components act in",
    "nearly free": r"a body is nearly free",
    "jam": r"friction that can jam contact",
    "several": r"several solutions nearby",
    "limit": r"likely cause: the limit",
    "indefinite": r"W is not positive semidefinite",
    "rounding": r"rounding: the reactions satisfy the law",
    "motions": r"doubles keep too few digits of the deformation",
    "range": r"near the end of doubles",
    "slides": r"seems to slide away",
    "friction": r"friction alone stops a body",
}


def names(message: str) -> set[str]:
    return {name for name, words in CAUSES.items() if re.search(words, message)}


def held(contacts: int = 20, d: int = 3) -> tuple[Array, Array]:
    """W with a condition below ten and weak coupling; q closes most contacts."""
    rng = np.random.default_rng(0)
    m = contacts * d
    root = rng.normal(size=(m, m)) / np.sqrt(m)
    W = 0.3 * (root @ root.T) + np.eye(m)
    return (W + W.T) / 2, rng.normal(size=(contacts, d)) - np.eye(1, d)


def stopped(W: Any, q: Any, mu: Any = 0.3, **options: Any) -> str:
    """The message of a solve that a limit stops early."""
    rigid = options.pop("rigid", None)
    keywords = {"method": "uzawa", "tol": 1e-13, "max_iterations": 8} | options
    solution = bp.ReducedProblem(W, q, mu, rigid=rigid).solve(**keywords)
    assert not solution.converged
    assert "\n" not in solution.message
    return solution.message


HELD = held()
COLUMNS = np.random.default_rng(1).normal(size=(60, 10))
# Sixty components that act in ten ways, and q.
REDUNDANT = COLUMNS @ COLUMNS.T, np.random.default_rng(2).normal(size=(20, 3))
ROUNDED = np.round(REDUNDANT[0], 9)
SINGLE = REDUNDANT[0].astype(np.float32).astype(float)
PUSH = np.tile([1.0, 0.0, 0.0], 20)[:, None]
ON_SPRINGS = np.linalg.eigh(held(contacts=2, d=2)[0])
# A rigid body on springs: W is rank deficient along two motions, which balance determines.
SOFT = (ON_SPRINGS[1][:, 2:] * ON_SPRINGS[0][2:]) @ ON_SPRINGS[1][:, 2:].T
SOFT, MOTIONS = (SOFT + SOFT.T) / 2, np.ascontiguousarray(ON_SPRINGS[1][:, :2])
# Enough pressure everywhere: the loads balance reactions inside the cone.
BALANCED = MOTIONS, -MOTIONS.T @ [1.0, 0.05, 1.0, -0.05]
JAMS = np.array([[1.0, 0.9], [0.9, 1.0]])
COUPLED = np.eye(4)
COUPLED[0, 2] = COUPLED[2, 0] = 0.3
COUPLED[0, 1] = COUPLED[1, 0] = 1e-14  # rounding, which does not jam

# W, q, options; the causes named, and words of the message.
SAID: dict[str, tuple[Any, Any, dict[str, Any], set[str], list[str]]] = {
    "little time": (*HELD, {"max_seconds": 1e-9, "max_iterations": None}, {"limit"},
        ["reached max_seconds = 1e-09", "try a larger max_seconds"]),
    # Redundant contacts are no cause while the residual falls.
    "redundant, falling": (
        *REDUNDANT, {"method": "auto", "max_iterations": 3}, {"limit", "redundant"},
        ["also found: redundant contacts, their 60 reaction", "in 10 independent ways only"]),
    "redundant, newton": (
        *REDUNDANT, {"method": "newton", "max_iterations": 300}, {"redundant"},
        ["try method='auto'$"]),
    # A tolerance that no point can reach: η is relative to reactions far larger than their
    # effect, so that no larger one is advised.
    "redundant, auto": (
        *REDUNDANT, {"method": "auto", "tol": 1e-14, "max_iterations": None}, {"redundant"},
        ["stalled", "try fewer contacts$"]),
    "redundant, in single precision": (
        SINGLE, REDUNDANT[1], {"method": "newton", "max_iterations": 1}, {"redundant"},
        ["act in 10 independent ways only"]),
    "redundant, rounded": (
        ROUNDED, REDUNDANT[1], {"max_iterations": 1}, {"limit", "redundant"}, []),
    "determined by balance": (
        SOFT, held(contacts=2, d=2)[1], {"rigid": BALANCED, "max_iterations": 1},
        {"limit", "jam"}, []),
    "not balanced": (
        SOFT, held(contacts=2, d=2)[1], {"max_iterations": 1}, {"limit", "jam", "redundant"}, []),
    # W along the rigid motions has no effect, because R'r is given.
    "negative along a rigid motion": (
        HELD[0] - 3 * PUSH @ PUSH.T, HELD[1],
        {"rigid": (PUSH, [-20.0]), "max_iterations": 1}, {"limit", "jam", "redundant"}, []),
    "nearly free": (
        HELD[0] + 1e10 * PUSH @ PUSH.T, HELD[1] - [1e3, 0, 0], {}, {"limit", "nearly free"},
        ["one motion is softer by"]),
    # A support a hundred times softer than the body is common.
    "soft support": (HELD[0] + 1e2 * PUSH @ PUSH.T, HELD[1], {}, {"limit"}, []),
    "jam": (
        JAMS, [[-0.12, 0.99]], {"mu": 3.0, "method": "newton", "max_iterations": None}, {"jam"},
        ["jam contact 0, mu ‖W_nt‖ ≥ W_nn with mu = 3", "try a smaller mu"]),
    "no jam": (JAMS, [[-1.0, 2.0]], {"mu": 1.0}, {"limit"}, []),
    # The message names the first and counts the others.
    "two jams": (
        np.kron(np.eye(2), JAMS) + 0.01, [[-1.0, 2.0]] * 2, {"mu": 3.0}, {"limit", "jam"},
        ["contact 0 and 1 more"]),
    # After a stall, more iterations of the same method are not advised.
    "rounding of coupling": (
        COUPLED, [[-1.0, 0.3], [-1.0, 0.5]],
        {"mu": 1e15, "method": "nesterov", "max_iterations": 60}, set(), ["try method='auto'$"]),
    "large reactions": (
        HELD[0] * 1e-300, HELD[1] * 1e20, {"method": "auto", "max_iterations": 300}, {"range"},
        [r"reactions \(displacements over W\) are above 1e\+300"]),
    "small W": (
        HELD[0] * 1e-310, HELD[1], {"method": "auto", "max_iterations": 300}, {"range"},
        ["the largest entry of W is below 1e-300", "try other units"]),
    # From zero reaction and zero motion; other methods start from a balanced point.
    "no violation": (
        HELD[0], 0 * HELD[1],
        {"rigid": (PUSH, [-20.0]), "start": 0 * HELD[1], "method": "newton",
         "max_seconds": 1e-12, "max_iterations": None}, {"limit"},
        ["each contact satisfies the law, but forces are not in balance"]),
}  # fmt: skip


@pytest.mark.parametrize("case", SAID)
def test_causes_are_named(case: str) -> None:
    W, q, options, causes, words = SAID[case]
    message = stopped(W, q, **options)
    assert names(message) == causes
    for pattern in words:
        assert re.search(pattern, message), message
    assert case != "no violation" or "violation" not in message


@pytest.mark.parametrize("method", METHODS)
def test_only_the_limit_is_named(method: str) -> None:
    W, q = held()
    message = stopped(W, q, method=method, max_iterations=1)
    assert names(message) == {"limit"}
    # Method, residual, largest violation, cause and advice, in this order.
    order = [
        r"not converged: 1 iteration of " + repr(method),
        "reached max_iterations",
        r"residual \d\.\de[-+]\d+, limit 1\.0e-13",
        r"largest violation at contact \d+, wh(ich|ose)",
        "likely cause",
        "try a larger max_iterations",
    ]
    assert re.search(".*".join(order), message), message
    assert ("method='auto'" in message) == (method != "auto")


def test_rounding_of_the_slip_under_a_huge_friction_coefficient() -> None:
    root = np.random.default_rng(0).normal(size=(12, 12))
    W = root @ root.T + np.eye(12)
    q = np.tile([-1.0, 0.05, -0.1], (4, 1))
    problem = bp.ReducedProblem(W, q, 1e14)
    solution = problem.solve(max_iterations=500)
    assert not solution.converged
    assert names(solution.message) == {"rounding"}
    assert re.search(
        r"mu = 1e\+14 times the rounding error \de-\d+ of", solution.message
    )
    # The message is true: all contacts stick, and elimination solves W r = -q.
    stuck = np.linalg.solve(W, -q.ravel()).reshape(4, 3)
    assert (stuck[:, 0] > 0).all()
    # Rounding times the condition of W, about 1e2, with two digits of margin.
    np.testing.assert_allclose(solution.reaction, stuck, atol=1e-12)
    # The advised mu gives the same solution.
    smaller = bp.ReducedProblem(W, q, 1e3).solve()
    assert smaller.converged
    np.testing.assert_allclose(smaller.reaction, stuck, atol=1e-8)


NEGATIVE = [
    (-np.eye(4), "W_nn = -1 at contact 0", "try -W"),
    (np.diag([1.0, 1, -1, 1]), "W_nn = -1 at contact 1", "try W = B K⁻¹ Bᵀ"),
    (np.diag([1.0, 1, 1, -2]), "W_tt = -2 at contact 1", "try W = B K⁻¹ Bᵀ"),
    (np.diag([1e-9, 1e-9, -1e-9, 1e-9]), "W_nn = -1e-09 at contact 1", "try W ="),
    (
        np.eye(4) + 2 * (np.eye(4, k=2) + np.eye(4, k=-2)),
        "its smallest eigenvalue is -1 and its largest 3",
        "try W = B K⁻¹ Bᵀ",
    ),
]


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(("W", "place", "cure"), NEGATIVE)
def test_not_positive_semidefinite(
    W: Array, place: str, cure: str, method: str
) -> None:
    """The message gives the entry and no other cause."""
    # Some of these have solutions, but none is found before the first iteration.
    q = [[-1.0, 2.0], [-1.0, 0.5]]
    message = stopped(W, q, method=method, max_seconds=1e-12, max_iterations=None)
    assert names(message) == {"indefinite"}
    assert place in message
    assert cure in message
    assert "max_seconds or" not in message
    assert "method=" not in message


def test_a_small_residual_at_a_limit_is_not_enough() -> None:
    B = np.vstack([np.eye(2), -np.eye(2)])
    walls = bp.ReducedProblem(B @ B.T, [[-1.0, 0], [-1.0, 0]], 0.3)
    solution = walls.solve("gauss_seidel", 1e-3, max_iterations=2000)
    assert solution.outcome is bp.Outcome.ITERATION_LIMIT
    assert solution.residual <= solution.tolerance
    assert (
        "reached max_iterations and met the residual, which is not enough here"
        in solution.message
    )
    assert "limit" not in names(solution.message)


@pytest.mark.parametrize("shift", [0.0, 1.0, 1e14])
def test_rounding_of_large_rigid_motions(shift: float) -> None:
    """A stiff body that falls by many times its deformation; the reaction is its weight."""
    W = 1e-12 * np.array([[1.0, 0.2], [0.2, 0.5]])
    R, weight = np.array([[0.6, 0.8], [0.8, -0.6]]), np.array([-0.5, -0.3])
    problem = bp.ReducedProblem(
        W, [R @ [shift / 3, -shift / 7]], 1.0, rigid=(R, weight)
    )
    solution = problem.solve(max_iterations=50)
    assert solution.converged == (shift == 0)
    if shift:
        assert names(solution.message) == {"motions"}
        assert (
            "q or gaps from which this rigid motion is subtracted" in solution.message
        )
        # Forces are not blamed where they balance.
        left = np.abs(R.T @ solution.reaction.ravel() + weight).max()
        assert "forces are not in balance" not in solution.message or left > 1e-10


def test_several_answers() -> None:
    # Above μ = k_t/|k_c| = 1/0.9 some loads have three solutions, others one.
    W = np.linalg.inv(np.array([[1.0, -0.9], [-0.9, 1.0]]))
    messages = []
    for angle in np.linspace(1.0, 3.0, 60):
        q = [W @ np.array([np.cos(angle), np.sin(angle)])]
        problem = bp.ReducedProblem(W, q, 2.0)
        # Starts from a reaction: open is one of the solutions and is found at once from zero.
        start = np.array([[5.0, 1.0]])
        solution = problem.solve("uzawa", 1e-13, max_iterations=2, start=start)
        if solution.converged:
            continue
        several = len(problem.answers()) > 1
        messages.append(several)
        assert ("several" in names(solution.message)) == several
    assert {True, False} == set(messages)


def test_contacts_that_contradict_each_other_are_named() -> None:
    B = np.vstack([np.eye(2), -np.eye(2)])
    problem = bp.ContactProblem(np.eye(2), B, gap=[-1.0, -1.0], mu=0.3)
    with pytest.raises(bp.NoEquilibriumError, match="contacts 0 and 1 push against"):
        problem.solve([0.2, 0.1])
    wall = bp.ReducedProblem(np.diag([1.0, 1, 0, 0]), [[1.0, 0], [-0.25, 0]], 0.3)
    message = wall.solve().message
    assert message.endswith("contact 1 penetrates by 0.25")


def test_a_dilatant_contact_that_opens_too_little_does_not_penetrate() -> None:
    problem = bp.ReducedProblem(np.eye(2), [[0.1, -2.0]], 0.5, dilatancy=0.5)
    solution = problem.solve("uzawa", max_iterations=1)
    opening, slip = solution.relative_displacement[0]
    assert opening > 0
    least = f"{0.5 * abs(slip):.2g}"
    assert (
        f"which opens by {opening:.2g}, less than its dilatancy times its slip, {least}"
        in solution.message
    )


def test_the_contact_with_the_largest_violation_has_coordinates() -> None:
    K = np.diag([2.0, 1.0, 2.0, 1.0, 2.0, 1.0]) + 0.01
    points = np.array([[0.0, 0.0], [1.0, 2.5], [-3.0, 1e-3]])
    problem = bp.ContactProblem(K, np.eye(6), gap=np.zeros(3), mu=0.3, points=points)
    path = [[-1.0, 0.1, -1, 0.1, -1, 0.1], [-1.0, 0.1, -1, 0.1, -9, 0.1]]
    with pytest.raises(bp.NotConvergedError) as caught:
        problem.solve(path, method="uzawa", tol=1e-12, max_iterations=2)
    place = re.search(
        r"step (\d): .*largest violation at contact (\d) at \(([^)]*)\)",
        str(caught.value),
    )
    i = int(place[2])
    assert place[3] == ", ".join(f"{x:.4g}" for x in points[i])


def test_violations_of_each_contact() -> None:
    """By hand, with W_ii = 4: displacements count half, forces count twice."""
    r = np.array([[1.0, 0.0], [1.0, 0.0], [1.0, 0.6], [1.0, 0.5], [0.0, 0.0]])
    v = np.array([[-0.2, 0.0], [0.2, 0.0], [0.0, 0.0], [0.0, 0.2], [3.0, 7.0]])
    violations = measure_violations(r, v, ContactLaw(np.full(5, 0.5)), np.full(5, 4.0))
    # With a slip of 0.1, a share 2 / (0.1 + 2 + 1) of the force has the wrong direction.
    expected = np.zeros((4, 5))
    expected[0, 0], expected[1, 1], expected[2, 2] = 0.1, 0.1, 0.2
    expected[3, 3] = 0.1 * 2 / 3.1
    np.testing.assert_allclose(violations, expected, atol=1e-15)


def test_a_larger_tolerance_is_advised_if_it_would_help() -> None:
    W, q = held()
    problem = bp.ReducedProblem(W, q, 0.3)
    short = problem.solve("gauss_seidel", 1e-13, max_iterations=6)
    offered = re.search(r"tol=(1e-\d+), which this point meets", short.message)
    assert not short.converged
    again = problem.solve("gauss_seidel", float(offered[1]), max_iterations=6)
    assert again.converged


def test_the_message_is_kept_without_the_problem() -> None:
    W, q = held()
    solution = bp.ReducedProblem(W, q, 0.3).solve("uzawa", max_iterations=2)
    lost = pickle.loads(pickle.dumps(solution))
    assert lost.message.startswith("not converged, max_iterations was reached")
    message = solution.message
    assert pickle.loads(pickle.dumps(solution)).message == message
    # If the caller has changed W, there is no diagnosis.
    other = bp.ReducedProblem(W, q, 0.3).solve("uzawa", max_iterations=2)
    W[3, 5] = np.nan
    assert other.message.startswith("not converged: 2 iterations of 'uzawa'")


def test_many_rigid_motions_are_not_made_dense() -> None:
    """Of 15,000 contacts between blocks they would take 10 GB, for a message."""

    def refuse() -> Any:
        raise MemoryError

    n = 600
    solution = bp.ReducedProblem(np.eye(2), [[1.0, 0.0]], 0.3).solve()
    apart = np.tile([1.0, 0.0, 0.0], (n, 1))
    stopped = replace(
        solution, reaction=0 * apart, outcome=bp.Outcome.STALLED, residual=1.0
    )
    tried = FailedSolve(AUTO, ContactLaw(np.full(n, 0.3)), lambda: None, modes=refuse,
        loads=lambda: np.ones(6), several=lambda _: False)  # fmt: skip
    assert "forces are not in balance" in diagnose(tried, stopped, apart)


@pytest.mark.parametrize(("pull", "named"), [(1.0, False), (-1.0, True), (-0.2, False)])
def test_a_body_slides_to_a_stop_or_away_from_it(pull: float, named: bool) -> None:
    """Friction of 0.3 on the floor; an open contact ahead takes what is more."""
    solution = bp.ReducedProblem(np.eye(4), np.ones((2, 2)), 0.3).solve()
    r, v = (
        np.array([[1.0, -0.3 * pull], [0.0, 0.0]]),
        np.array([[0.0, 0.0], [1.0, 0.0]]),
    )
    stalled = replace(solution, reaction=r, outcome=bp.Outcome.STALLED, residual=1.0)
    tried = FailedSolve(
        AUTO,
        ContactLaw(np.full(2, 0.3)),
        lambda: None,
        modes=lambda: np.array([[0.0], [1.0], [-1.0], [0.0]]),
        loads=lambda: np.array([pull]),
        several=lambda _: False,
    )
    assert ("friction" in names(diagnose(tried, stalled, v))) == named
