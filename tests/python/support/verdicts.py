"""Small problems at random, and what the verdicts of the package on one of them must share.

Every function that says something of a problem, that an answer exists or does not, that
it is the only one, how far it is, may say that it does not know. None may say what another
one has proved to be false.
"""

from collections import Counter
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linprog

import bipot_rs as bp
from methods import WITHOUT_SUPPORTS
from random_problems import Given

Array = NDArray[np.float64]

# Beyond these an oracle in doubles does not tell balance from rounding.
CLEAR = 1e-6


def small_problem(seed: int) -> Given:
    """One to three plane contacts, mu from 0.1 to 1e6, most with rigid motions.

    Integers make dependent rows, contacts that just touch and loads on the border of a
    cone; two thirds of the matrices are singular.
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
        # Loads that some reactions inside the cones balance.
        r = np.zeros((n, 2))
        r[:, 0] = rng.integers(0, 3, n)
        r[:, 1] = 0.5 * rng.integers(-2, 3, n) * np.minimum(mu, 1.0) * (r[:, 0] > 0)
        e = -R.T @ r.ravel()
    return Given(W, q, mu, (R, e))


def friction_alone(seed: int) -> Given:
    """A slider that friction alone holds against the loads on it, mu from 10 to 1e12.

    Its contacts press with the loads over mu if at all, and a spring opens them by that.
    """
    rng = np.random.default_rng([21, seed])
    n = int(rng.integers(1, 4))
    W = np.diag(np.ravel([[rng.integers(1, 9), 0.0] for _ in range(n)]))
    # Open, just touching, or pressed on as well.
    opening = rng.integers(-1, 2, n) * rng.random(n)
    q = np.column_stack([opening, rng.normal(size=n)])
    R = np.zeros((2 * n, 1))
    R[1::2, 0] = rng.choice([-2.0, -1.0, 1.0, 2.0], n)
    return Given(W, q, 10 ** rng.uniform(1, 12, n), (R, np.array([rng.normal()])))


def three_contacts(seed: int) -> Given:
    """Three plane contacts of bodies with one to three rigid motions, mu up to 1.

    Loads as they come, or balanced by reactions that nothing presses that way.
    """
    rng = np.random.default_rng([22, seed])
    k = int(rng.integers(1, 4))
    root = rng.normal(size=(6, int(rng.integers(1, 7))))
    mu = rng.uniform(0.0, 1.0, 3) * (rng.random(3) < 0.9)
    R, e = rng.normal(size=(6, k)), rng.normal(size=k)
    if rng.random() < 0.5:
        r = np.zeros((3, 2))
        r[:, 0] = rng.exponential(size=3)
        r[:, 1] = mu * r[:, 0] * rng.uniform(-0.99, 0.99, 3)
        e = -R.T @ r.ravel()
    q = rng.normal(size=(3, 2)) * (rng.random() < 0.7)
    return Given(root @ root.T, q, mu, (R, e))


def out_of_balance(given: Given) -> float:
    """By how much no reactions of the cones balance the loads, relative to them.

    By a linear programme: the motion of the dual cones, of amounts up to 1, on which the
    loads work most.
    """
    assert given.rigid is not None
    R, e = given.rigid
    size = np.abs(e).max(initial=0.0)
    if size == 0:
        return 0.0
    # r_n ≥ 0 and |r_t| ≤ mu r_n, the tangents in units of mu: rows of order one.
    rows = R.reshape(*given.q.shape, -1)
    large = np.maximum(given.mu, 1.0)[:, None]
    edges = [
        (rows[:, 0] + side * given.mu[:, None] * rows[:, 1]) / large for side in (-1, 1)
    ]
    found = linprog(
        -e / size,
        A_ub=-np.vstack(edges),
        b_ub=0.0 * np.hstack(2 * [given.mu]),
        bounds=(-1, 1),
    )
    return float(-found.fun)


def proves_none(direction: Array, given: Given) -> bool:
    """Whether a motion of the contacts lies in the dual cones, is rigid, and loaded."""
    assert given.rigid is not None
    R, e = given.rigid
    a, *_ = np.linalg.lstsq(R, direction.ravel(), rcond=None)
    rigid = np.abs(R @ a - direction.ravel()).max() <= 1e-9
    slack = direction[:, 0] - given.mu * np.abs(direction[:, 1])
    # In units of a reaction of length one: a large mu makes rows large.
    slack /= np.hypot(1.0, given.mu)
    return bool(rigid and slack.min() >= -1e-9 and e @ a > 0)


class Seen(NamedTuple):
    """What was met, by name."""

    counts: Counter[str]

    def add(self, *names: str) -> None:
        """Count each of the names."""
        self.counts.update(names)


def check(given: Given, seen: Seen, methods: tuple[str, ...] = ("auto",)) -> None:
    """Ask everything of a problem; an assertion fails where two verdicts contradict."""
    try:
        problem = given.problem()
    except bp.BipotError:
        seen.add("refused")
        return
    answers = problem.answers()
    none = answers.complete and len(answers) == 0
    verdicts = {problem.existence(exhaust=how).verdict for how in (False, True)}
    assert not {"guaranteed", "none"} <= verdicts
    assert not (none and "guaranteed" in verdicts)
    assert not (len(answers) and "none" in verdicts)
    # What is proved, whoever proves it.
    exists = bool(len(answers)) or "guaranteed" in verdicts
    absent = none or "none" in verdicts
    seen.add("exists" if exists else "absent" if absent else "open")
    for method in methods:
        solution = problem.solve(method, max_iterations=2000)
        outcome = str(solution.outcome)
        seen.add(outcome)
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
    """A motion that is told with the proof proves, and no load is to be lowered."""
    assert "lower the loads" not in solution.message
    if str(solution.outcome) != "no_equilibrium" or given.rigid is None:
        return
    if solution.free_motion is None:
        balanced = "statuses were tried" in solution.message
        assert balanced or "contradict" in solution.message
        return
    direction = (given.rigid[0] @ solution.free_motion).reshape(given.q.shape)
    assert np.linalg.norm(direction, axis=1).max() <= 1 + 1e-9
    assert proves_none(direction, given)


def check_bound(given: Given, r: Array, answers: bp.Answers, seen: Seen) -> None:
    """Answers lie where the bound says, and none where it says that there is no other."""
    bound = given.problem().error_bound(r)
    seen.add(f"bound {bound.kind}")
    if bound.kind == "not available" or not answers.complete:
        return
    assert bound.energy is not None
    assert bound.alone_within is not None
    assert bound.energy <= bound.alone_within
    away = np.array(
        [
            np.sqrt(max(d @ given.W @ d, 0.0))
            for d in (a.reaction - r for a in answers)
            for d in [d.ravel()]
        ]
    )
    size = np.sqrt(np.abs(given.W).max()) * np.abs(r).max(initial=0.0)
    # Answers are known to 1e-12 of the reactions, or to their rounding.
    blur = 1e-11 * size + 1e-300
    assert (away <= bound.energy + blur).any()
    assert (away < bound.alone_within - blur).sum() <= 1
    if bound.kind == "global":
        assert len(answers) == 1


def agree(seeds: range) -> Counter[str]:
    """Every verdict on small problems beside every other."""
    seen = Seen(Counter())
    for seed in seeds:
        check(small_problem(seed), seen)
    return seen.counts


def sliders(seeds: range) -> Counter[str]:
    """The same of bodies that friction alone holds, by every method that takes them."""
    seen = Seen(Counter())
    for seed in seeds:
        check(friction_alone(seed), seen, WITHOUT_SUPPORTS)
    return seen.counts


def proofs(seeds: range) -> Counter[str]:
    """Of three contacts, what is told where there is no answer."""
    counts: Counter[str] = Counter()
    for seed in seeds:
        given = three_contacts(seed)
        solution = given.problem().solve(max_iterations=2000)
        lack = out_of_balance(given)
        check_proof(given, solution)
        none = str(solution.outcome) == "no_equilibrium"
        if lack > CLEAR:
            # A proof exists: it is found.
            assert none
            assert solution.free_motion is not None
            counts["motion"] += 1
        elif none and lack < CLEAR**2:
            assert solution.free_motion is None
            assert "statuses were tried" in solution.message
            counts["statuses"] += 1
    return counts


def locals_of(seeds: range) -> Counter[str]:
    """Local verdicts near answers of one to three contacts, against all answers."""
    seen = Seen(Counter())
    for seed in seeds:
        rng = np.random.default_rng([25, seed])
        n = int(rng.integers(1, 4))
        root = rng.normal(size=(2 * n, 2 * n))
        W = root @ root.T + 0.2 * np.eye(2 * n)
        q, mu = rng.normal(size=(n, 2)), rng.uniform(0.5, 4.0, n)
        # Two contacts that do not touch each other: balls on islands.
        if n == 3:
            W[:2, 2:] = W[2:, :2] = 0.0
        given = Given((W + W.T) / 2, q, mu, None)
        answers = given.problem().answers()
        for answer in answers:
            for size in (0.1, 1e-2, 1e-4):
                r = answer.reaction * (1 + size * rng.normal(size=(n, 2)))
                check_bound(given, r, answers, seen)
    return seen.counts
