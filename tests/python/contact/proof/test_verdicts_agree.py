"""Verdicts of different functions agree, and their proofs hold."""

from collections import Counter
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from numpy.typing import NDArray

import bipot_rs as bp
from support.methods import WITHOUT_SUPPORTS
from support.random_problems import Given

Array = NDArray[np.float64]


def small_problem(seed: int) -> Given:
    """One to three plane contacts, mu from 0.1 to 1e6, most with rigid motions.

    Integers give dependent rows, contacts that just touch, and loads on the boundary of a
    cone. Two thirds of the matrices are singular.
    """
    rng = np.random.default_rng([20, seed])
    n = int(rng.integers(1, 4))
    m = 2 * n
    kind = rng.choice(["integer", "diagonal", "full"])
    if kind == "integer":
        root = rng.integers(-2, 3, size=(m, int(rng.integers(1, m + 1)))).astype(float)
        W = root @ root.T
    elif kind == "diagonal":
        W = np.diag(rng.integers(0, 5, size=m).astype(float))
    else:
        root = rng.normal(size=(m, m))
        W = root @ root.T + 0.1 * np.eye(m)
        W = (W + W.T) / 2
    mu = 10 ** rng.uniform(-1, 6, size=n)
    if rng.random() < 0.3:
        mu[:] = mu[0]
    whole = kind != "full"
    q = rng.integers(-3, 4, (n, 2)) * 1.0 if whole else rng.normal(size=(n, 2))
    if rng.random() < 0.2:
        q[:] = 0.0
    k = int(rng.integers(0, min(3, m) + 1)) if rng.random() < 0.7 else 0
    R = rng.integers(-1, 2, (m, k)) * 1.0 if whole else rng.normal(size=(m, k))
    if np.linalg.matrix_rank(R) < k:
        k, R = 1, np.eye(m)[:, 1:2]
    if not k:
        return Given(W, q, mu, None)
    e = rng.integers(-3, 4, k) * 1.0
    if rng.random() < 0.4:
        # Loads that balance some reactions inside the cones.
        r = np.zeros((n, 2))
        r[:, 0] = rng.integers(0, 3, n)
        r[:, 1] = 0.5 * rng.integers(-2, 3, n) * np.minimum(mu, 1.0) * (r[:, 0] > 0)
        e = -R.T @ r.ravel()
    return Given(W, q, mu, (R, e))


def friction_alone(seed: int) -> Given:
    """A slider held against its loads by friction alone, mu from 10 to 1e12.

    Friction needs a pressure of the loads over mu, which would open the contact's spring.
    """
    rng = np.random.default_rng([21, seed])
    n = int(rng.integers(1, 4))
    W = np.diag(np.ravel([[rng.integers(1, 9), 0.0] for _ in range(n)]))
    # Open, just touching, or also pressed.
    opening = rng.integers(-1, 2, n) * rng.random(n)
    q = np.column_stack([opening, rng.normal(size=n)])
    R = np.zeros((2 * n, 1))
    R[1::2, 0] = rng.choice([-2.0, -1.0, 1.0, 2.0], n)
    return Given(W, q, 10 ** rng.uniform(1, 12, n), (R, np.array([rng.normal()])))


def check(
    given: Given, seen: Counter[str], methods: tuple[str, ...] = ("auto",)
) -> None:
    """Compute all verdicts of a problem; assert that no two contradict each other."""
    try:
        problem = given.problem()
    except bp.BipotError:
        seen["refused"] += 1
        return
    answers = problem.answers()
    none = answers.complete and len(answers) == 0
    verdicts = {problem.existence(exhaust=how).verdict for how in (False, True)}
    assert not {"guaranteed", "none"} <= verdicts
    assert not (none and "guaranteed" in verdicts)
    assert not (len(answers) and "none" in verdicts)
    # Statements proved by any of the functions.
    exists = bool(len(answers)) or "guaranteed" in verdicts
    absent = none or "none" in verdicts
    seen["exists" if exists else "absent" if absent else "open"] += 1
    for method in methods:
        solution = problem.solve(method, max_iterations=2000)
        outcome = str(solution.outcome)
        seen[outcome] += 1
        assert not (solution.converged and absent), method
        assert not (outcome == "no_equilibrium" and exists), method
        check_proof(given, solution)
        if solution.converged:
            unique = solution.unique
            assert not (unique == "proved" and answers.complete and len(answers) != 1)
            assert not (
                unique == "others exist" and answers.complete and len(answers) < 2
            )
            check_bound(given, solution.reaction, answers, seen)
    for answer in answers:
        assert answer.converged
        check_bound(given, 1.01 * answer.reaction, answers, seen)


def check_proof(given: Given, solution: bp.Solution) -> None:
    """The motion given as a proof is one, and no smaller load is advised."""
    assert "lower the loads" not in solution.message
    if str(solution.outcome) != "no_equilibrium" or given.rigid is None:
        return
    if solution.free_motion is None:
        balanced = "statuses were tried" in solution.message
        assert balanced or "contradict" in solution.message
        return
    (R, e), a = given.rigid, solution.free_motion
    direction = (R @ a).reshape(given.q.shape)
    assert np.linalg.norm(direction, axis=1).max() <= 1 + 1e-9
    # It is in the dual cones, in units of a reaction of length one, and does work.
    slack = direction[:, 0] - given.mu * np.abs(direction[:, 1])
    assert (slack / np.hypot(1.0, given.mu)).min() >= -1e-9
    assert e @ a > 0


def check_bound(
    given: Given, r: Array, answers: bp.Answers, seen: Counter[str]
) -> None:
    """Solutions lie inside the bound, and there is no second one where it excludes one."""
    bound = given.problem().error_bound(r)
    seen[f"bound {bound.kind}"] += 1
    if bound.kind == "not available" or not answers.complete:
        return
    assert bound.energy <= bound.alone_within
    away = np.array(
        [
            np.sqrt(max(d @ given.W @ d, 0.0))
            for d in (a.reaction - r for a in answers)
            for d in [d.ravel()]
        ]
    )
    size = np.sqrt(np.abs(given.W).max()) * np.abs(r).max(initial=0.0)
    # Solutions are exact to 1e-12 of the reactions, or to their rounding.
    blur = 1e-11 * size + 1e-300
    assert (away <= bound.energy + blur).any()
    assert (away < bound.alone_within - blur).sum() <= 1
    if bound.kind == "global":
        assert len(answers) == 1


SLOW = pytest.mark.slow


@pytest.mark.parametrize(
    "seeds", [range(45), pytest.param(range(45, 20_500), marks=SLOW)]
)
def test_verdicts_agree(seeds: range) -> None:
    seen: Counter[str] = Counter()
    for seed in seeds:
        check(small_problem(seed), seen)
    assert seen["exists"] > 25
    assert seen["absent"] > 5
    assert seen["bound global"] > 0
    assert seen["bound local"] > 8


@pytest.mark.parametrize(
    "seeds", [range(10), pytest.param(range(10, 1060), marks=SLOW)]
)
def test_verdicts_agree_on_sliders(seeds: range) -> None:
    """The same for bodies that friction alone holds, by every method that accepts them."""
    seen: Counter[str] = Counter()
    for seed in seeds:
        check(friction_alone(seed), seen, WITHOUT_SUPPORTS)
    assert seen["absent"] >= 1


@pytest.mark.parametrize(
    ("seeds", "count"),
    [(range(60), 50), pytest.param(range(60, 12_000), 10_000, marks=SLOW)],
)
def test_local_verdicts_hold(seeds: range, count: int) -> None:
    """Local verdicts near solutions of one to three contacts, compared with all solutions."""
    seen: Counter[str] = Counter()
    for seed in seeds:
        rng = np.random.default_rng([25, seed])
        n = int(rng.integers(1, 4))
        root = rng.normal(size=(2 * n, 2 * n))
        W = root @ root.T + 0.2 * np.eye(2 * n)
        q, mu = rng.normal(size=(n, 2)), rng.uniform(0.5, 4.0, n)
        # Two uncoupled contacts: balls on islands.
        if n == 3:
            W[:2, 2:] = W[2:, :2] = 0.0
        drawn = Given((W + W.T) / 2, q, mu, None)
        answers = drawn.problem().answers()
        for answer in answers:
            for size in (0.1, 1e-2, 1e-4):
                r = answer.reaction * (1 + size * rng.normal(size=(n, 2)))
                check_bound(drawn, r, answers, seen)
    assert seen["bound local"] > count


def held_by_friction(mu: float) -> bp.ReducedProblem:
    """Friction must carry 2, which needs a pressure of 2/mu; a spring then opens by 8/mu."""
    rigid = (np.array([[0.0], [1.0]]), [-2.0])
    return bp.ReducedProblem(np.diag([4.0, 0.0]), [[0.0, -3.0]], mu, rigid=rigid)


@pytest.mark.parametrize("mu", 10.0 ** np.arange(-1, 10))
@pytest.mark.parametrize("method", WITHOUT_SUPPORTS)
def test_a_large_friction_hides_no_opening(mu: float, method: str) -> None:
    problem = held_by_friction(mu)
    assert problem.existence(exhaust=True).verdict == "none"
    assert problem.answers().complete
    for tol in (1e-12, 1e-10, 1e-6):
        assert not problem.solve(method, tol, max_iterations=2000).converged


def test_trying_all_statuses_is_a_proof() -> None:
    solution = held_by_friction(3e5).solve()
    assert str(solution.outcome) == "no_equilibrium"
    assert solution.free_motion is None
    assert "all 4 combinations of statuses were tried" in solution.message
    assert "lower the loads" not in solution.message


def test_diverging_reactions_are_not_a_solution() -> None:
    check(small_problem(18190), Counter())


def test_a_diverging_rigid_motion_does_not_raise_the_tolerance() -> None:
    # Free to slide and pressed by 1: any motion along the floor is a solution.
    rigid = (np.array([[0.0], [1.0]]), [0.0])
    problem = bp.ReducedProblem(np.eye(2), [[-1.0, 0.5]], 0.0, rigid=rigid)
    near = problem.solve()
    for amount in (1e3, 1e6, 1e9):
        far = replace(near, rigid_motion=np.array([amount]))
        solution = problem.solve(start=far, tol=1e-15)
        assert solution.converged
        assert solution.rigid_motion == pytest.approx([amount])
        # 4 ε times 1e4, the lengths that a solution may need.
        assert solution.tolerance <= 1e-10


@pytest.mark.parametrize("exponent", [-170, -90, -1, 60, 150])
def test_a_bound_of_random_problems_at_every_scale(exponent: int) -> None:
    scale = 10.0**exponent
    seen = 0
    for seed in range(40):
        rng = np.random.default_rng([24, seed])
        root = rng.normal(size=(4, 4))
        W = root @ root.T + np.eye(4)
        q, mu = rng.normal(size=(2, 2)), rng.uniform(0.05, 0.4, 2)
        r = np.abs(rng.normal(size=(2, 2))) * [1.0, 0.1]
        plain = bp.ReducedProblem(W, q, mu).error_bound(r)
        bound = bp.ReducedProblem(W, scale * q, mu).error_bound(scale * r)
        assert bound.kind == plain.kind
        if plain.energy is None or bound.energy is None:
            continue
        seen += 1
        # The scale is not a power of two, so it rounds the data; this error is times κ(W).
        assert bound.energy / scale == pytest.approx(plain.energy, rel=1e-11)
        # The point is far smaller or larger than the solution: the error is about r* or the point.
        small = bp.ReducedProblem(W, q, mu)
        answer = small.solve(tol=1e-15)
        far = small.error_bound(scale * r)
        d = (scale * r - answer.reaction).ravel()
        size = float(np.abs(d).max())
        if size:
            true = size * np.sqrt((d / size) @ W @ (d / size))
            assert far.energy >= true * (1 - 1e-9)
    assert seen > 20


def test_the_gap_of_a_contact_that_penetrates_is_negative() -> None:
    """As documented: a sum of such gaps is not a bifunctional."""
    problem = bp.ReducedProblem(np.eye(2), [[-1.0, 0.0]], 0.5)
    bound = problem.error_bound([[0.5, 0.0]])
    assert bound.total == Fraction(-1, 4)


def test_a_bound_reports_overflow() -> None:
    problem = bp.ReducedProblem(4 * np.eye(2), [[3.0, 3.0]], 0.5)
    for size in (5e-324, 1e-300, 1e290):
        bound = problem.error_bound([[size, 0.0]])
        assert bound.energy is None
        assert "range of doubles" in bound.reason
