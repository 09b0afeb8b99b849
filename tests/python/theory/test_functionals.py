"""The functionals of [dSF91], sections III and VI, on random bodies and solved scenes."""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray

import bipot_rs as bp
from bipot_rs.theory.functionals import Functionals, of_problem

Array = NDArray[np.float64]
SEEDS = range(12)


class Given(NamedTuple):
    """Two bodies in contact with each other and the ground, one prescribed end, two steps."""

    K: Array
    B: Array
    gap: Array
    mu: Array
    fixed: NDArray[np.int64]
    load: Array
    prescribed: Array

    def problem(self) -> bp.ContactProblem:
        return bp.ContactProblem(
            self.K, self.B, gap=self.gap, mu=self.mu, fixed=self.fixed
        )


def given(d: int, seed: int, pairs: bool = False) -> Given:
    """With ``pairs``, friction depends on the direction."""
    rng = np.random.default_rng([d, seed])
    size, contacts = 5 * d, 4
    K = np.zeros((2 * size, 2 * size))
    for k in range(2):
        root = rng.normal(size=(size, size))
        part = slice(k * size, (k + 1) * size)
        K[part, part] = root @ root.T + np.eye(size)
    # Contacts 0 and 1 are between the bodies, 2 and 3 between the first and the ground.
    B = np.zeros((contacts * d, 2 * size))
    for i in range(contacts):
        frame = np.linalg.qr(rng.normal(size=(d, d)))[0]
        B[i * d : (i + 1) * d, i * d : (i + 1) * d] = frame
        if i < 2:
            B[i * d : (i + 1) * d, size + i * d : size + (i + 1) * d] = -frame
    # The last node of each body has no contact and is partly held.
    fixed = np.array([size - 1, 2 * size - 2, 2 * size - 1])
    gap = rng.normal(size=(contacts, d)) * 0.1
    load = rng.normal(size=(2, 2 * size))
    load -= 2.0 * B.reshape(contacts, d, -1)[:, 0].sum(axis=0)
    mu = rng.uniform(0.1, 0.6, contacts)
    if pairs:
        mu = np.random.default_rng(seed).uniform(0.05, 0.8, (contacts, 2))
    return Given(K, B, gap, mu, fixed, load, rng.normal(size=(2, 3)))


def steepness(mu: Array, v: Array) -> Array:
    """``‖D v_t‖``, of one coefficient ``mu ‖v_t‖``."""
    return np.asarray(np.linalg.norm(mu.reshape(len(mu), -1) * v[:, 1:], axis=1))


def kinematic(rng: np.random.Generator, g: Given, f: Functionals) -> Array:
    """A displacement increment with the prescribed values that opens all contacts."""
    u = rng.normal(size=len(g.K))
    u[g.fixed] = f.prescribed
    wanted = np.abs(rng.normal(size=f.offset.shape))
    wanted[:, 1:] = rng.normal(size=wanted[:, 1:].shape)
    free = np.setdiff1d(np.arange(len(u)), g.fixed)
    lack = (wanted - f.offset).ravel() - g.B @ u
    u[free] += np.linalg.lstsq(g.B[:, free], lack, rcond=None)[0]
    return np.asarray(u)


def static(rng: np.random.Generator, mu: Array, d: int) -> Array:
    """Reactions in the cone."""
    r = np.zeros((len(mu), d))
    r[:, 0] = rng.exponential(size=len(mu))
    side = rng.normal(size=(len(mu), d - 1))
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    r[:, 1:] = (rng.random(len(mu)) * r[:, 0])[:, None] * side
    r[:, 1:] *= mu.reshape(len(mu), -1)
    return r


def started(g: Given, seed: int, kind: str) -> tuple[Functionals, Array]:
    """Functionals with a start state, and its ``t0``."""
    rng, problem = np.random.default_rng([7, seed]), g.problem()
    structure = of_problem(problem, g.K)
    if kind == "solved":
        result = problem.solve(g.load, g.prescribed, tol=1e-14)
        return Functionals.of_step(structure, result, 1), result[0].reaction
    t0, u0 = np.zeros_like(g.gap), np.zeros(len(g.K))
    if kind == "any":  # neither complementary nor in equilibrium
        t0, u0 = static(rng, g.mu, g.gap.shape[1]), rng.normal(size=len(g.K))
    step = g.load[1], g.prescribed[1]
    return Functionals(structure, *step, reaction=t0, displacement=u0), t0


FRICTION = [(2, False), (3, False), (3, True)]


@pytest.mark.parametrize("kind", ["unloaded", "solved", "any"])
@pytest.mark.parametrize(("d", "pairs"), FRICTION)
def test_the_bifunctional_is_the_energy_out_of_balance_and_the_gaps(
    d: int, pairs: bool, kind: str
) -> None:
    for seed in SEEDS:
        rng = np.random.default_rng(seed)
        g = given(d, seed, pairs)
        f, t0 = started(g, seed, kind)
        u, r = kinematic(rng, g, f), static(rng, g.mu, d)
        # w by dense algebra, with prescribed values that differ from the given ones.
        ends = f.prescribed + rng.normal(size=3)
        free = np.setdiff1d(np.arange(len(u)), g.fixed)
        w = np.zeros(len(u))
        w[g.fixed] = ends
        force = f.load + g.B.T @ (r - t0).ravel() - g.K @ w
        w[free] = np.linalg.solve(g.K[np.ix_(free, free)], force[free])
        v = f.relative_displacement(u)
        gaps = (r * v).sum(axis=1) + r[:, 0] * steepness(g.mu, v)
        right = 0.5 * (u - w) @ g.K @ (u - w) + gaps.sum() - f.start_work
        left = f.bifunctional(u, r - t0, at_supports=ends)
        # The terms that cancel, rounded as sums of tens of products.
        terms = [f.strain_energy(u), f.complementary_energy(r - t0, ends), right]
        scale = sum(map(abs, terms)) + abs(f.load) @ abs(u) + abs(ends) @ abs(ends)
        assert abs(left - right) <= 1e-13 * scale
        assert f.excess(u, r - t0, at_supports=ends) == pytest.approx(
            right + f.start_work, rel=1e-12
        )
        assert f.excess(u, r - t0, at_supports=ends) > 0


@pytest.mark.parametrize("d", [2, 3])
def test_friction_appears_in_both_principles(d: int) -> None:
    share = []
    for seed in SEEDS:
        rng = np.random.default_rng(seed)
        g = given(d, seed)
        f, t0 = started(g, seed, "solved")
        u, r = kinematic(rng, g, f), static(rng, g.mu, d)
        slip = np.linalg.norm(f.relative_displacement(u)[:, 1:], axis=1)
        twice = f.displacement_functional(u, r - t0) + f.stress_functional(r - t0, u)
        once = f.bifunctional(u, r - t0)
        friction = float(np.sum(g.mu * r[:, 0] * slip))
        # Rounding of energies of this size.
        size = abs(f.potential(u)) + f.strain_energy(u)
        size += f.complementary_energy(r - t0)
        assert twice - once == pytest.approx(friction, abs=1e-13 * size)
        share.append(friction / size)
    assert max(share) > 1e-2


def last_increments(result: Any) -> Any:
    """``du`` and ``dr`` of the second step."""
    first, second = result
    return second.displacement - first.displacement, second.reaction - first.reaction


@pytest.mark.parametrize(("d", "pairs"), FRICTION)
@pytest.mark.slow_variants("3-False")
def test_the_solution_minimises_on_random_bodies(d: int, pairs: bool) -> None:
    for seed in range(4):
        rng = np.random.default_rng([1, seed])
        g = given(d, seed, pairs)
        problem = g.problem()
        result = problem.solve(g.load, g.prescribed, tol=1e-14)
        f = Functionals.of_step(of_problem(problem, g.K), result, 1)
        du, dr = last_increments(result)
        t0 = result[0].reaction
        total = result[1].displacement
        size = total @ g.K @ total + f.strain_energy(du)
        # A difference of two solutions, whose reactions are exact to 1e-14.
        assert abs(f.bifunctional(du, dr)) <= 1e-12 * size
        for _ in range(20):
            u, r = kinematic(rng, g, f), static(rng, g.mu, d)
            part = rng.random() ** 4
            # All fields between an admissible field and the solution are admissible.
            near, held = du + part * (u - du), dr + part * (r - t0 - dr)
            ends = f.prescribed + part * rng.normal(size=3)
            for value in (
                f.bifunctional(near, dr),
                f.bifunctional(du, held),
                f.bifunctional(du, held, at_supports=ends),
                f.bifunctional(near, held, at_supports=ends),
            ):
                assert np.isfinite(value)
                assert value >= -1e-12 * size
            # B has a strictly convex part: a large variation increases it.
            assert f.bifunctional(near, held) >= f.excess(near, held) / 2


def test_what_leaves_the_domain_is_infinite() -> None:
    g = given(2, 1)
    problem = g.problem()
    f = Functionals(of_problem(problem, g.K), g.load[0], g.prescribed[0])
    rng = np.random.default_rng(0)
    u, r = kinematic(rng, g, f), static(rng, g.mu, 2)
    assert np.isfinite(f.bifunctional(u, r))
    pulled = r.copy()
    pulled[1, 0] = -1.0
    assert np.isinf(f.bifunctional(u, pulled))
    assert np.isinf(f.stress_functional(pulled, u))
    dragged = r.copy()
    dragged[2, 1] = 1.01 * g.mu[2] * dragged[2, 0]
    assert np.flatnonzero(np.isinf(f.bipotential(u, dragged))).tolist() == [2]
    deep = u - 100 * g.B[0] / (g.B[0] @ g.B[0])
    assert np.isinf(f.bipotential(deep, r)[0])
    assert np.isinf(f.displacement_functional(deep, r))
    # (68) depends only on the normal part of dr.
    assert np.isfinite(f.displacement_functional(u, dragged))
    assert f.displacement_functional(u, dragged) == f.displacement_functional(u, r)


def test_a_free_body_needs_balance() -> None:
    # A slider on a spring: K = diag(1, 0). Only friction balances F.
    K, B = np.diag([1.0, 0.0]), np.eye(2)
    problem = bp.ContactProblem(K, B, gap=[0.0], mu=0.5)
    f = Functionals(of_problem(problem, K), [-1.0, 0.25])
    assert np.isinf(f.complementary([[1.0, 0.0]]))
    assert np.isinf(f.bifunctional([0.0, 0.0], [[1.0, 0.0]]))
    assert np.isinf(f.excess([0.0, 0.0], [[1.0, 0.0]]))
    # Pressed by r_n = 2 the spring has -1 + 2 = 1, W = ½.
    assert f.complementary([[2.0, -0.25]]) == pytest.approx(0.5, rel=1e-14)
    assert f.bifunctional([0.0, 0.0], [[1.0, -0.25]]) == pytest.approx(0, abs=1e-14)


G = given(2, 2)
OF_G = of_problem(G.problem(), G.K)
IN_STEP = Functionals(OF_G, G.load[0], G.prescribed[0])
MISTAKES: list[tuple[Callable[[], Any], str]] = [
    (lambda: of_problem("problem", G.K), "problem is a str, expected a ContactProblem"),  # type: ignore[arg-type]
    (lambda: Functionals(G.problem()), "structure is a ContactProblem, expected a S"),  # type: ignore[arg-type]
    (lambda: of_problem(G.problem(), np.eye(3)), "fixed holds 9 at position 0, expected 0 to 2"),
    (lambda: IN_STEP.potential(np.zeros(20)), "du is 0.0 at degree of freedom .*, expected the pr"),
    (lambda: IN_STEP.complementary(np.zeros(4)), r"dr has shape \(4,\), expected \(4, 2\)"),
    (lambda: Functionals.of_step(OF_G, G.problem().solve(G.load, G.prescribed), 2),
     "k is 2, expected -2 to 1"),
]  # fmt: skip


@pytest.mark.parametrize(("call", "words"), MISTAKES)
def test_mistakes_are_named(call: Callable[[], Any], words: str) -> None:
    with pytest.raises((TypeError, ValueError), match=words):
        call()


@pytest.mark.parametrize("seed", range(4))
def test_the_print_of_23_lacks_a_sign(seed: int) -> None:
    # With b(u, t) in place of b(-u, t) the tractions act in the wrong direction: the
    # solution is not a minimum, and B decreases along them.
    g = given(2, seed)
    problem = g.problem()
    result = problem.solve(g.load, g.prescribed, tol=1e-14)
    f = Functionals.of_step(of_problem(problem, g.K), result, 1)
    du, dr = last_increments(result)
    t0 = result[0].reaction
    assert (t0[:, 0] > 0).any()

    def total(u: Array, side: float) -> float:
        x = (g.B @ u).reshape(g.gap.shape)
        b = side * (t0 * x).sum() + dr[:, 0] @ f.offset[:, 0]
        b += g.mu * (t0 + dr)[:, 0] @ np.linalg.norm(x[:, 1:], axis=1)
        return f.potential(u) + f.complementary(dr) + float(b)

    way = g.B.T @ t0.ravel()
    way[g.fixed] = 0.0
    way /= np.sqrt(way @ g.K @ way)
    at_end = result[1].displacement
    size = np.sqrt(at_end @ g.K @ at_end)
    to = du + 1e-3 * size * way
    assert total(du, 1) == pytest.approx(f.bifunctional(du, dr), abs=1e-11 * size**2)
    # B increases, as it must: pressed contacts open, or slide against friction.
    assert total(to, 1) > total(du, 1)
    assert total(to, -1) < total(du, -1) - 1e-6 * size**2


@pytest.mark.parametrize("F", [0.75, 1.0, 2.0])
def test_both_principles_may_hold_where_there_is_no_solution(F: float) -> None:
    # A slider on a spring, pulled by F > μ. (65) and (66) hold, B is bounded below and takes
    # its minimum, (28a) and (28b) hold there, but B is not zero.
    mu = 0.5
    K = np.diag([1.0, 0.0])
    problem = bp.ContactProblem(K, np.eye(2), gap=[0.0], mu=mu)
    f = Functionals(of_problem(problem, K), [-1.0, F])
    u, r = np.array([0.0, 3.0]), np.array([[F / mu, -F]])
    least = 0.5 * (F / mu - 1) ** 2
    assert f.bifunctional(u, r) == pytest.approx(least, rel=1e-14)
    for opening in (0.0, 0.1, 0.7, 4.0):
        for slip in (-5.0, -1e-3, 0.0, 1e-3, 3.0, 50.0):
            # (28a), constant for all forward slips: not coercive, contrary to (35).
            value = f.bifunctional([opening, slip], r)
            assert value >= least * (1 - 1e-14)
            if opening == 0 and slip >= 0:
                assert value == pytest.approx(least, rel=1e-14)
        for press in (0.0, F, F / mu, 1.01 * F / mu, 10.0):
            other = np.array([[press, -F]])
            # (28b), and for all pairs: none has B = 0.
            assert f.bifunctional(u, other) >= least * (1 - 1e-14)
            assert f.bifunctional([opening, 3.0], other) >= least * (1 - 1e-14)
            inside = f.bifunctional([opening, 0.0], other)
            assert inside >= least * (1 - 1e-14)
    # Reactions out of balance are not admissible.
    assert np.isinf(f.bifunctional(u, [[F / mu, 0.01 - F]]))
    with pytest.raises(bp.BipotError):
        problem.solve([-1.0, F])
