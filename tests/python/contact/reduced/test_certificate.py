"""Converged solutions satisfy the law by a check that shares no code with the residual.

Wrong solutions with typical programming errors are found by this check and by
`ReducedProblem.residual`.
"""

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

import bipot_rs as bp
from support.bodies import block
from support.methods import METHODS, NEED_SUPPORTS
from support.random_problems import KINDS, Given, random_problem
from support.signorini_coulomb import Missed, judge

Array = NDArray[np.float64]

# A converged solution has η below its tolerance. Each inequality is then violated by at
# most a few times that, and (1 + μ) times more where slip adds to penetration in ṽ_n. A
# large μ hides penetration from η, so penetration has its own limit, ten tolerances.
FACTOR = 10.0
# Each planted error is at least one percent.
BROKEN = 1e-3


def judged(given: Given, r: Array, a: Array | None = None) -> Missed:
    return judge(given.W, given.q, given.mu, r, given.rigid, a)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("d", [2, 3])
def test_converged_solutions_satisfy_the_law(kind: str, d: int, method: str) -> None:
    claims = 0
    for seed in range(12):
        problem = random_problem(kind, d, seed)
        if problem.rigid is not None and method in NEED_SUPPORTS:
            with pytest.raises(ValueError, match=f"'{method}' needs supports"):
                problem.problem().solve(method)
            return
        solution = problem.problem().solve(method, max_iterations=3000)
        if not solution.converged:
            continue
        claims += 1
        missed = judged(problem, solution.reaction, solution.rigid_motion)
        allowed = FACTOR * (1 + problem.mu.max()) * solution.tolerance
        assert missed.worst <= allowed, (seed, missed)
    # Newton may stall on a few of them; the default method must not.
    assert claims >= (12 if method == "auto" else 6)


@pytest.mark.slow
def test_converged_from_any_start_to_any_tolerance() -> None:
    for seed in range(200):
        rng = np.random.default_rng(seed)
        kind, d, method = (
            rng.choice(KINDS),
            int(rng.integers(2, 4)),
            rng.choice(METHODS),
        )
        made = random_problem(kind, d, int(rng.integers(10**6)))
        if made.rigid is not None and method in NEED_SUPPORTS:
            continue
        problem = made._replace(mu=made.mu * 10 ** rng.uniform(0, 8))
        start = rng.normal(size=made.q.shape) * 10 ** rng.uniform(-6, 6)
        solution = problem.problem().solve(
            method,
            10 ** -rng.uniform(3, 12),
            max_iterations=400,
            start=start if rng.random() < 0.5 else None,
        )
        if solution.converged:
            missed = judged(problem, solution.reaction, solution.rigid_motion)
            allowed = FACTOR * (1 + problem.mu.max()) * solution.tolerance
            allowed = min(allowed, 30 * FACTOR * solution.tolerance)
            assert missed.worst <= allowed, (seed, missed)


@pytest.mark.parametrize("method", METHODS)
def test_zero_reactions_are_not_accepted(method: str) -> None:
    # If the reactions are zero, η is relative to what remains of the start. That shrinks
    # until its squares are below the range of doubles.
    for seed in (187203, 632323, 746802):
        problem = random_problem("flat", 2, seed)
        problem.q[:] = 0.0
        start = np.random.default_rng(seed).normal(size=problem.q.shape)
        solution = problem.problem().solve(method, start=start)
        if solution.converged:
            np.testing.assert_array_equal(solution.reaction, 0.0)
            assert (solution.status == bp.Status.OPEN).all()
    tiny = np.zeros_like(problem.q)
    tiny[0] = 1e-170
    assert problem.problem().residual(tiny) > 0.1


def all_statuses(d: int) -> Given:
    """Contacts that open, slip and stick, with strongly anisotropic blocks."""
    for seed in range(200):
        rng = np.random.default_rng([d, seed])
        n = 6
        root = rng.normal(size=(n * d, n * d)) / np.sqrt(n * d)
        stretch = np.tile([1.0, 0.4, 2.0][:d], n)
        W = (root @ root.T + 0.2 * np.eye(n * d)) * np.outer(stretch, stretch)
        q = rng.normal(size=(n, d)) - np.eye(1, d)
        problem = Given((W + W.T) / 2, q, np.full(n, 0.4), None)
        solution = problem.problem().solve(tol=1e-13)
        counts = np.bincount(solution.status, minlength=3)
        if solution.converged and counts.min() >= 1 and counts[1] >= 2:
            return problem
    raise AssertionError("no such problem")


def solved(given: Given) -> bp.Solution:
    return given.problem().solve(tol=1e-13)


def radial_return(given: Given) -> Array:
    """Sweeps with one trial step at each contact, then friction cut back to its limit.

    A program does this if it treats W_tt as a multiple of the identity. It then stops.
    """
    n, d = given.q.shape
    r = np.zeros((n, d))
    for _ in range(500):
        for i in range(n):
            rows = slice(i * d, i * d + d)
            W = given.W[rows, rows]
            v = (given.W[rows] @ r.ravel()) + given.q[i] - W @ r[i]
            trial = -np.linalg.solve(W, v)
            limit = given.mu[i] * max(trial[0], 0.0)
            size = np.linalg.norm(trial[1:])
            r[i, 0] = max(trial[0], 0.0)
            r[i, 1:] = trial[1:] * (min(1.0, limit / size) if size > 0 else 1.0)
    return r


def wrong_mu(given: Given) -> Array:
    return solved(given._replace(mu=0.8 * given.mu)).reaction


def one_flipped(given: Given) -> Array:
    solution = solved(given)
    r = solution.reaction.copy()
    r[np.argmax(solution.status == bp.Status.SLIP), 1:] *= -1
    return r


def penetrating(given: Given) -> Array:
    """All open contacts are left out, and one that should be closed."""
    r = solved(given).reaction
    keep = np.flatnonzero(r[:, 0] > 0)
    gone = keep[np.argmin(r[keep, 0])]
    d = given.q.shape[1]
    rows = np.delete(np.arange(r.size).reshape(-1, d), gone, axis=0)
    part = Given(
        given.W[np.ix_(rows.ravel(), rows.ravel())],
        np.delete(given.q, gone, axis=0),
        np.delete(given.mu, gone),
        None,
    )
    return np.insert(solved(part).reaction, gone, 0.0, axis=0)


def stick_outside_the_cone(given: Given) -> Array:
    """Every closed contact sticks, whatever friction force that needs."""
    closed = solved(given).reaction[:, 0] > 0
    rows = np.repeat(closed, given.q.shape[1])
    r = np.zeros(given.q.size)
    r[rows] = -np.linalg.solve(given.W[np.ix_(rows, rows)], given.q.ravel()[rows])
    return r.reshape(given.q.shape)


WRONG = (radial_return, wrong_mu, one_flipped, penetrating, stick_outside_the_cone)
BREAKERS: dict[str, Callable[[Given], Array]] = {f.__name__: f for f in WRONG}


@pytest.mark.parametrize("how", BREAKERS)
@pytest.mark.parametrize("d", [2, 3])
def test_a_planted_error_is_found(how: str, d: int) -> None:
    drawn = all_statuses(d)
    right, wrong = solved(drawn).reaction, BREAKERS[how](drawn)
    # The correct solution violates the law by its tolerance and by rounding.
    assert judged(drawn, right).worst <= FACTOR * 1e-12
    assert judged(drawn, wrong).worst > BROKEN
    assert drawn.problem().residual(wrong) > BROKEN


def test_overlapping_walls_have_no_solution_if_a_body_slides_away() -> None:
    """Three smooth contacts whose normals span a plane press each other and move nothing,
    while a fourth slides off: reactions grow until rounding hides the overlap."""
    rng = np.random.default_rng(2)
    weights = np.array([0.62, 0.44, 0.18])
    slopes = rng.normal(size=(3, 2))
    slopes[2] = -(weights[0] * slopes[0] + weights[1] * slopes[1]) / weights[2]
    G = np.zeros((12, 2))
    G[0] = rng.normal(size=2)
    G[3::3] = slopes
    angle = np.array([0.1, 1.8, 2.5, 3.6])
    R = np.zeros((12, 2))
    R[1::3] = np.c_[np.cos(angle), np.sin(angle)]
    R[2::3] = np.c_[-np.sin(angle), np.cos(angle)]
    q = 0.1 * rng.normal(size=(4, 3))
    q[1:, 0] = -0.1  # # no displacement opens all three: weights · v_n is negative
    problem = bp.ReducedProblem(
        G @ G.T, q, [0.6, 0.0, 0.0, 0.0], rigid=(R / 2, [-0.73, 0.06])
    )
    for method in ("auto", "gauss_seidel", "newton", "nesterov", "uzawa"):
        solution = problem.solve(method, max_iterations=3000)
        assert not solution.converged


@pytest.mark.parametrize("off", [1e-6, 1e-3])
def test_displacements_agree_with_the_relative_displacements(off: float) -> None:
    """If `B u + g` differs from `v`, `displacement` raises `NotConvergedError`."""
    body = block((2, 1), (6, 3), 1.0, 0.3)
    top = np.r_[body.dofs(1, 1.0, 0), body.dofs(1, 1.0, 1)]
    problem = bp.ContactProblem(body.K, body.B, gap=body.gap, mu=0.3, fixed=top)
    moved = np.where(np.arange(len(top)) < len(top) // 2, 0.01, -0.01)
    step = problem.solve(prescribed=moved)[0]
    n = body.K.shape[0]
    state = np.zeros(n), moved, step.reaction, np.empty(0)
    gap, slip = np.zeros_like(step.reaction), np.zeros_like(step.reaction)
    slip[:, 1:] = step.slip
    core, v = problem.stiffness.core, step.relative_displacement
    u = core.displacements([state], [(v, gap, slip)])
    # K u = f + Bᵀ r at the free degrees of freedom, row by row, to a few roundings.
    left = body.K @ u[0] - body.B.T @ step.reaction.ravel()
    terms = abs(body.K) @ abs(u[0]) + abs(body.B.T) @ abs(step.reaction.ravel())
    free = np.setdiff1d(np.arange(n), top)
    assert (abs(left) <= 32 * np.finfo(float).eps * terms)[free].all()
    wrong = v.copy()
    wrong[2, 0] += off * np.abs(v).max()
    with pytest.raises(bp.NotConvergedError, match=r"error of .* at contact 2"):
        core.displacements([state], [(wrong, gap, slip)])
    # Wrong reactions give other displacements, and these give another v.
    other = np.zeros(n), moved, (1 + off) * step.reaction, np.empty(0)
    with pytest.raises(bp.NotConvergedError, match=r"B u \+ gap has an error"):
        core.displacements([other], [(v, gap, slip)])
