"""Directional derivatives on borders between statuses, and which contacts are there."""

from typing import Any

import numpy as np
import pytest
from scipy import sparse

import bipot_rs as bp
from support.bodies import block

pytestmark = pytest.mark.needs_extra

P, MU, STIFF = 10.0, 0.3, 1e3


def point(d: int = 2, mu: Any = MU) -> bp.ContactProblem:
    """A point on springs, one for each direction, that touches a wall."""
    return bp.ContactProblem(STIFF * np.eye(d), np.eye(d), gap=[0.0], mu=mu)


def test_a_contact_that_just_touches() -> None:
    result = point().solve([0.0, 0.0])
    pressed, pulled = result.jvp([-1.0, 0.0]), result.jvp([1.0, 0.0])
    assert pressed.one_sided.all()
    # The wall or the spring takes the whole change.
    np.testing.assert_array_equal(pressed.reaction, [[[1.0, 0.0]]])
    np.testing.assert_array_equal(pulled.reaction, [[[0.0, 0.0]]])
    np.testing.assert_allclose(pulled.relative_displacement, [[[1 / STIFF, 0.0]]])


def test_a_contact_at_its_friction_limit() -> None:
    result = point().solve([-P, MU * P])
    assert result.jvp().one_sided.all()
    more, less = result.jvp([0.0, 1.0]), result.jvp([0.0, -1.0])
    np.testing.assert_allclose(more.slip, [[[1 / STIFF]]])
    np.testing.assert_allclose(more.reaction, [[[0.0, 0.0]]], atol=1e-15)
    np.testing.assert_array_equal(less.slip, [[[0.0]]])
    np.testing.assert_allclose(less.reaction, [[[0.0, 1.0]]])
    # More friction holds it; less lets it slip by the force that is lost.
    np.testing.assert_array_equal(result.jvp(mu=1.0).slip, [[[0.0]]])
    np.testing.assert_allclose(result.jvp(mu=-1.0).slip, [[[P / STIFF]]])


def test_two_coefficients_at_the_friction_limit() -> None:
    """r_t = - r_n D p, and the slip begins along D⁻¹ p."""
    D, p = np.array([0.4, 0.2]), np.array([0.6, 0.8])
    result = point(3, [D]).solve([-P, *(P * D * p)])
    tangent = result.jvp([0.0, *(D * p)])
    assert tangent.one_sided.all()
    # K ds = df - dr_t with ds = β D⁻¹ p and p·D⁻¹ dr_t = 0.
    beta = 1.0 / ((p / D) @ (p / D) * STIFF)
    np.testing.assert_allclose(tangent.slip[0, 0], beta * p / D, rtol=1e-12)


@pytest.mark.parametrize("d", [2, 3])
@pytest.mark.parametrize("seed", range(4))
def test_bodies_at_rest(d: int, seed: int) -> None:
    """Without loads and gaps all statuses meet. The problem is homogeneous of degree one: its
    directional derivative is its solution."""
    rng = np.random.default_rng([d, seed])
    contacts = int(rng.integers(1, 4))
    n = d * contacts
    root = rng.normal(size=(n, n)) / np.sqrt(n)
    K = sparse.csr_array(root @ root.T + np.eye(n))
    problem = bp.ContactProblem(K, np.eye(n), gap=np.zeros(contacts), mu=0.3)
    load = rng.normal(size=(2, n))
    load[:, ::d] -= 0.5
    solved = problem.solve(load, tol=1e-13)
    tangent = problem.solve(np.zeros((2, n))).jvp(load)
    assert tangent.one_sided.all()
    # A path through a kink: the derivative of the first step is history in the second.
    for name in ("reaction", "relative_displacement", "slip", "displacement"):
        np.testing.assert_allclose(
            getattr(tangent, name), getattr(solved, name), atol=1e-9, err_msg=name
        )


@pytest.mark.parametrize("seed", range(8))
def test_one_sided_differences(seed: int) -> None:
    """Contacts moved onto borders by their gap or friction, against differences on one side."""
    rng = np.random.default_rng(seed)
    d, contacts = 2 + seed % 2, 4
    n = d * contacts
    root = rng.normal(size=(n, n)) / np.sqrt(n)
    K = root @ root.T + np.eye(n)
    load = rng.normal(size=n)
    load[::d] -= 1.0
    gap = np.zeros(contacts)
    mu = np.full(contacts, 0.4)
    first = bp.ContactProblem(K, np.eye(n), gap=gap, mu=mu).solve(load, tol=1e-13)[-1]
    opened = first.status == bp.Status.OPEN
    gap[opened] = -(first.relative_displacement[opened, 0] - gap[opened])
    held = first.status == bp.Status.STICK
    r = first.reaction
    mu[held] = np.linalg.norm(r[held, 1:], axis=1) / r[held, 0]
    problem = bp.ContactProblem(K, np.eye(n), gap=gap, mu=mu)
    result = problem.solve(load, tol=1e-13)
    change = rng.normal(size=n)
    tangent = result.jvp(change)
    assert tangent.one_sided[0, opened | held].all()
    h = 1e-6
    ahead = [problem.solve(load + t * h * change, tol=1e-13) for t in (1, 2)]
    for name in ("reaction", "relative_displacement", "slip"):
        here, one_step_on, two = (getattr(x, name) for x in (result, *ahead))
        # Of the second order: h² times a third derivative, and rounding of 1e-15 over h.
        slope = (-3 * here + 4 * one_step_on - two) / (2 * h)
        np.testing.assert_allclose(getattr(tangent, name), slope, atol=1e-7)


def test_a_gradient_on_a_border_is_of_the_reported_side() -> None:
    result = point().solve([-P, MU * P])
    gradient = result.vjp(slip=[[[1.0]]])
    assert gradient.one_sided.all()
    stick, slip = 0.0, 1 / STIFF
    expected = stick if result.status[0, 0] == bp.Status.STICK else slip
    np.testing.assert_allclose(gradient.load[0, 1], expected, atol=1e-18)


def test_reactions_that_are_not_determined() -> None:
    """Two contacts hold one degree of freedom: any split of the force is an answer."""
    B = np.array([[1.0, 0, 0], [0, 1, 0], [1, 0, 0], [0, 0, 1]])
    problem = bp.ContactProblem(np.eye(3), B, gap=[0.0, 0.0], mu=0.0)
    result = problem.solve([-1.0, 0.0, 0.0])
    with pytest.raises(bp.NotDifferentiableError, match="not determined"):
        result.jvp(load=[-1.0, 0.0, 0.0])
    with pytest.raises(bp.NotDifferentiableError, match="not determined"):
        result.vjp(reaction=np.ones((2, 2)))


@pytest.mark.parametrize("seed", [46, 49, 56])
def test_a_border_contact_at_a_node_that_another_one_holds(seed: int) -> None:
    """Two contacts of one node: gaps that change in different ways contradict each other. The
    equation of the second is 0 = 1 but for rounding, of which a derivative of 1e16 was made."""
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(3, 3))
    B = np.vstack([np.linalg.qr(rng.normal(size=(3, 3)))[0] for _ in range(2)])
    problem = bp.ContactProblem(
        root @ root.T + np.eye(3), B, gap=np.zeros(2), mu=[1.0, 0.3]
    )
    pressed, along = -4 * (B[0] + B[3]), np.cross(B[0], B[3])
    result = problem.solve([pressed + 3 * along, pressed + 2.9 * along])
    gap = rng.normal(size=(2, 2, 3))
    gap[0] = 0.0
    with pytest.raises(bp.NotDifferentiableError, match="on a border"):
        result.jvp(gap=gap)


def test_friction_that_begins() -> None:
    """From μ = 0 the friction force opposes the slip; without slip its direction is unknown."""
    slides = point(mu=0.0).solve([-P, 5.0])
    np.testing.assert_allclose(slides.jvp(mu=1.0).reaction, [[[0.0, -P]]])
    with pytest.raises(ValueError, match=r"mu of contact 0 is zero.*negative"):
        slides.jvp(mu=-1.0)
    rests = point(mu=0.0).solve([-P, 0.0])
    np.testing.assert_array_equal(rests.jvp([-1.0, 0.0]).reaction, [[[1.0, 0.0]]])
    with pytest.raises(bp.NotDifferentiableError, match="does not slip"):
        rests.jvp(mu=1.0)
    # A node that is held along the wall does not slip, whatever its friction.
    held = bp.ContactProblem(np.eye(2), np.eye(2), gap=[0.0], mu=0.0, fixed=[1])
    tangent = held.solve([-P, 0.0]).jvp(mu=1.0)
    np.testing.assert_array_equal(tangent.reaction, [[[0.0, 0.0]]])


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
