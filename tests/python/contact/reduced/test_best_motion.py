"""η of a reaction without its rigid motion is the least over all motions."""

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import linprog

import bipot_rs as bp

Array = NDArray[np.float64]
SIZES = [(1, 150), pytest.param(2, 4000, marks=pytest.mark.slow)]
# 1e-15 of R a and q, which are up to 1e7 times the displacements W r that η measures.
ROUNDING = 1e-8


def random_compliance(rng: np.random.Generator, n: int, d: int) -> Array:
    """Zero (rigid bodies), singular or definite, with contacts of several stiffnesses."""
    size = d * n
    if rng.random() < 0.3:
        return np.zeros((size, size))
    root = rng.normal(size=(size, int(rng.integers(1, size + 1))))
    if rng.random() < 0.3:
        root *= np.repeat(10.0 ** rng.uniform(-1.5, 1.5, n), d)[:, None]
    if rng.random() < 0.2:
        root[np.repeat(rng.random(n) < 0.4, d)] = 0.0
    return np.asarray(root @ root.T / size)


def random_motions(rng: np.random.Generator, size: int) -> Array:
    while True:
        R = rng.normal(size=(size, int(rng.integers(1, min(size, 7) + 1))))
        R *= 10.0 ** rng.uniform(-1, 1, R.shape[1])
        if rng.random() < 0.4:
            R[rng.random(R.shape) < 0.5] = 0.0
        if np.linalg.matrix_rank(R) == R.shape[1]:
            return R


def random_law(rng: np.random.Generator, mu: Array, d: int) -> tuple[Array, Array]:
    """``r`` and ``v`` of contacts that are open, stick, slide or just touch; also on borders."""
    n = len(mu)
    r, v = np.zeros((n, d)), np.zeros((n, d))
    status = rng.choice(4, size=n, p=rng.dirichlet([0.7, 0.7, 0.7, 0.3]))
    for i in range(n):
        t = rng.normal(size=d - 1)
        t /= np.linalg.norm(t)
        force, slip = 10.0 ** rng.uniform(-3, 0.5, 2)
        if status[i] == 0:
            v[i] = rng.normal(size=d)
            v[i, 0] = slip
        elif status[i] == 1:
            r[i, 0] = force
            r[i, 1:] = mu[i] * force * t * rng.choice([rng.random(), 1.0], p=[0.8, 0.2])
            v[i, 1:] = t * slip * (mu[i] == 0)
        elif status[i] == 2:
            r[i] = force * np.r_[1.0, -mu[i] * t]
            v[i, 1:] = t * slip * (rng.random() < 0.9)
        else:
            v[i, 1:] = t * slip
    return r, v * 10.0 ** rng.uniform(-3, 3)


@pytest.mark.parametrize(("seed", "count"), SIZES)
def test_answers_without_their_motion_are_answers(seed: int, count: int) -> None:
    """Of a reaction and a motion, and the problem that they solve, to an error of the reaction."""
    rng = np.random.default_rng(seed)
    for _ in range(count):
        d, n = int(rng.integers(2, 4)), int(rng.integers(1, 13))
        W, R = random_compliance(rng, n, d), random_motions(rng, d * n)
        mu = rng.uniform(0.05, 1.5, n)
        mu[rng.random(n) < 0.15] = 0.0
        if rng.random() < 0.1:
            mu[:] = rng.choice([0.0, 1e-4, 50.0])
        r, v = random_law(rng, mu, d)
        a = rng.normal(size=R.shape[1]) * 10.0 ** rng.uniform(-1, 1)
        q = (v.ravel() - W @ r.ravel() - R @ a).reshape(n, d)
        problem = bp.ReducedProblem(W, q, mu, rigid=(R, -R.T @ r.ravel()))
        # η of r = 0 is zero, or one if a contact that just touches penetrates by rounding.
        if r.any():
            noise = 10.0 ** rng.uniform(-13, -6) * (rng.random() < 0.5)
            r = r + noise * rng.normal(size=r.shape) * np.abs(r).max()
            assert problem.residual(r) <= 10 * problem.residual(r, a) + ROUNDING


@pytest.mark.parametrize(("seed", "count"), SIZES)
def test_no_motion_makes_an_answer_of_what_is_none(seed: int, count: int) -> None:
    """Balanced reactions that differ by a tenth from the only ones of a definite W."""
    rng = np.random.default_rng(seed)
    for _ in range(count):
        d, n = int(rng.integers(2, 4)), int(rng.integers(3, 9))
        root = rng.normal(size=(d * n, d * n))
        W, R = root @ root.T / (d * n) + np.eye(d * n), rng.normal(size=(d * n, d))
        mu = rng.uniform(0.0, 0.2, n)
        r, v = random_law(rng, mu, d)
        r[0, 0] = 1.0 + r[0, 0]
        v[0, 0] = 0.0
        q = (v.ravel() - W @ r.ravel() - R @ rng.normal(size=d)).reshape(n, d)
        problem = bp.ReducedProblem(W, q, mu, rigid=(R, -R.T @ r.ravel()))
        other = rng.normal(size=r.size)
        other -= R @ np.linalg.lstsq(R, other, rcond=None)[0]
        other *= 0.1 * np.linalg.norm(r) / np.linalg.norm(other)
        # r ↦ F is monotone with a constant near the least eigenvalue of W over the largest,
        # some tenth; the loads q may be a thousand times r.
        assert problem.residual(r + other.reshape(r.shape)) >= 1e-6


def test_a_reaction_of_zero_that_contacts_can_leave() -> None:
    rng = np.random.default_rng(5)
    for _ in range(100):
        n, d = int(rng.integers(1, 9)), int(rng.integers(2, 4))
        R, a = random_motions(rng, d * n), rng.normal()
        v = rng.normal(size=(n, d))
        v[:, 0] = rng.uniform(0.1, 1, n)
        motion = np.full(R.shape[1], a)
        q = v - (R @ motion).reshape(n, d)
        W = random_compliance(rng, n, d)
        problem = bp.ReducedProblem(W, q, 0.3, rigid=(R, np.zeros(R.shape[1])))
        assert problem.residual(np.zeros((n, d))) == 0


@pytest.mark.parametrize("d", [2, 3])
def test_bodies_without_loads_are_moved_until_all_contacts_open(d: int) -> None:
    """Nothing presses them, so that ``r = 0`` is an answer wherever some motion leaves no
    penetration. An iteration stalls in one of twenty of these problems."""
    solved = 0
    for seed in range(100):
        rng = np.random.default_rng([d, seed])
        n = int(rng.integers(1, 6))
        R = rng.normal(size=(d * n, int(rng.integers(1, min(d * n, 3 * d - 3) + 1))))
        free = np.eye(d * n) - R @ np.linalg.pinv(R)
        root = free @ rng.normal(size=(d * n, d * n))
        q, mu = rng.normal(size=(n, d)), rng.choice([0.0, 0.1, 0.5, 2.0], n)
        none = np.zeros(R.shape[1])
        if linprog(none, A_ub=-R[::d], b_ub=q[:, 0], bounds=(None, None)).status != 0:
            continue
        answer = bp.ReducedProblem(root @ root.T, q, mu, rigid=(R, none)).solve()
        assert answer.converged, (seed, answer.message)
        v = (R @ answer.rigid_motion).reshape(n, d) + q
        v += (root @ (root.T @ answer.reaction.ravel())).reshape(n, d)
        # Rounding of the motion, whose amounts are some hundred at most.
        assert v[:, 0].min() > -1e-10
        assert abs(np.vdot(answer.reaction[:, 0], v[:, 0])) < 1e-9
        solved += 1
    assert solved > 60
