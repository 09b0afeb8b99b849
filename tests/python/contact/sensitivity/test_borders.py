"""Which contacts are on a border between two statuses, where terms cancel to rounding."""

from typing import Any

import numpy as np
import pytest

import bipot_rs as bp
from support.bodies import block

ENGINES = ["direct", "iterative"]


def quick_and_slow(quick: int, slow: int) -> list[Any]:
    """Seeds that run always, and those that run with the slow tests."""
    rest = [pytest.param(k, marks=pytest.mark.slow) for k in range(quick, slow)]
    return [*range(quick), *rest]


@pytest.mark.parametrize("seed", quick_and_slow(40, 1000))
def test_one_contact_of_a_random_stiffness(seed: int) -> None:
    """It touches by its gap, after it has moved along the obstacle: a closed form."""
    rng = np.random.default_rng([seed, 9])
    d, mu = 2 + seed % 2, 0.3
    n = d * int(rng.integers(1, 5))
    root = rng.normal(size=(n, n))
    K = (root @ root.T / n + 0.1 * np.eye(n)) * 10.0 ** rng.uniform(-3, 6)
    B = np.eye(d, n) if seed % 4 < 2 else rng.normal(size=(d, n))
    load = rng.normal(size=n) * 10.0 ** rng.uniform(-3, 6)
    v = B @ np.linalg.solve(K, load)
    W = B @ np.linalg.solve(K, B.T)
    way = v[1:] / np.linalg.norm(v[1:])
    friction = np.concatenate([[1.0], -mu * way])
    if W[0] @ friction <= 0:
        # A reaction would open the contact: there may be several solutions.
        return
    problem = bp.ContactProblem(K, B, gap=[-v[0]], mu=mu)
    # √(w f·u), the largest displacement of a contact by this work.
    most = np.sqrt(W.trace() / d * (load @ np.linalg.solve(K, load)))
    # With a gap that is larger by 1e-6 of it, the contact is open and no border is near.
    for part, near in ((0.0, True), (1e-6, False)):
        gap = -v[0] + part * most
        result = problem.solve(load, gap=[gap])
        change = rng.normal(size=n) * np.abs(load).max()
        tangent = result.jvp(change)
        assert tangent.one_sided.all() == near
        free = B @ np.linalg.solve(K, change)
        closes = near and free[0] < 0
        normal = -free[0] / (W[0] @ friction) if closes else 0.0
        # Conditions up to 1e4, and the direction of a slip that is known to 1e-9 of v.
        np.testing.assert_allclose(
            tangent.reaction[0, 0], normal * friction, rtol=1e-6, atol=1e-6 * normal
        )
        gradient = result.vjp(reaction=np.ones_like(result.reaction))
        assert gradient.one_sided.all() == near


@pytest.mark.parametrize("seed", quick_and_slow(10, 200))
def test_a_reduced_problem_whose_contacts_just_touch(seed: int) -> None:
    """q has the rounding of its slip; contacts that are open far away change nothing."""
    rng = np.random.default_rng([seed, 10])
    d, contacts = 2 + seed % 2, int(rng.integers(2, 6))
    n = d * contacts
    root = rng.normal(size=(n, n))
    W = root @ root.T / n + np.eye(n)
    q = rng.normal(size=(contacts, d))
    q[:, 0] = 1e-16 * rng.normal(size=contacts)
    q[-1, 0] = 1e6
    tangent = bp.ReducedProblem(W, q, 0.2).solve().jvp(q=rng.normal(size=q.shape))
    assert tangent.one_sided.tolist() == [True] * (contacts - 1) + [False]
    # Open by 1e-6 of the slip.
    q[:-1, 0] = 1e-6
    tangent = bp.ReducedProblem(W, q, 0.2).solve().jvp(q=rng.normal(size=q.shape))
    assert not tangent.one_sided.any()


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("mu", [0.3, 1e-2, 1e-3])
@pytest.mark.parametrize("seed", quick_and_slow(2, 12))
def test_friction_limits_of_small_coefficients(
    seed: int, mu: float, engine: str
) -> None:
    """The coefficients of sticking contacts are lowered to what they need."""
    rng = np.random.default_rng([seed, 11])
    d = 2 + seed % 2
    height = rng.uniform(0.5, 2.0)
    body = block([1.0] * (d - 1) + [height], [4] * d, 10.0 ** rng.uniform(0, 6), 0.0)
    fixed = np.concatenate([body.dofs(d - 1, height, k) for k in range(d)])
    m = len(fixed) // d
    moved = np.zeros((d, m))
    moved[-1] = -1e-3 * height * (1 + mu * rng.uniform(-0.1, 0.1, m))
    moved[0] = 1e-3 * mu * height * rng.uniform(0.2, 0.5)
    friction = np.full(len(body.area), mu)
    given = {"gap": body.gap, "fixed": fixed}
    problem = bp.ContactProblem(body.K, body.B, **given, mu=friction)
    first = problem.solve(prescribed=moved.ravel(), tol=1e-13)
    sticks = first.status[0] == bp.Status.STICK
    assert sticks.sum() > 1
    r = first.reaction[0, sticks]
    used = np.linalg.norm(r[:, 1:], axis=1) / r[:, 0]
    # At the limit, and away from it by a hundredth.
    for factor, near in ((1.0, True), (1.01, False)):
        friction[sticks] = factor * used
        problem = bp.ContactProblem(body.K, body.B, **given, mu=friction, engine=engine)
        result = problem.solve(prescribed=moved.ravel())
        tangent = result.jvp(prescribed=moved.ravel())
        gradient = result.vjp(slip=np.ones_like(result.slip))
        for found in (tangent, gradient):
            assert (found.one_sided[0, sticks] == near).all()


def test_friction_that_is_hardly_used_is_not_at_its_limit() -> None:
    """A limit below the tolerance: without tangential reaction nothing is about to slip."""
    problem = bp.ContactProblem(np.eye(2), np.eye(2), gap=[0.0], mu=1e-12)
    assert not problem.solve([-1.0, 0.0]).jvp().one_sided.any()
