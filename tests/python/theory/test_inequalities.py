"""The inequalities of [dSF91], section VII, and the explicit scheme of its section I."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import bipot_rs as bp
from bipot_rs.theory.inequalities import (
    Response,
    alternated,
    coupled,
    displacements,
    inequality_74,
    inequality_75,
    inequality_78,
)
from bipot_rs.theory.law import explicit_path
from support.law_pairs import on_the_law
from support.random_problems import random_problem

Array = NDArray[np.float64]
FORMS = (coupled, displacements, alternated)


def inside(rng: np.random.Generator, mu: Array, d: int, size: float, many: int) -> Any:
    """Test tractions of the truncated cone, ``(many, n_c, d)``, its edges included."""
    n = len(mu)
    side = rng.normal(size=(many, n, d - 1))
    side /= np.linalg.norm(side, axis=2, keepdims=True)
    press = size * rng.choice([0.0, 1.0, rng.random()], size=(many, n))
    share = rng.choice([1.0, rng.random()], size=(many, n))
    return np.concatenate(
        [press[..., None], (share * mu * press)[..., None] * side], axis=2
    )


@pytest.mark.parametrize("d", [2, 3])
def test_no_test_field_is_worse_than_the_worst(d: int) -> None:
    rng = np.random.default_rng(5)
    gaps = []
    for _ in range(40):
        mu = rng.uniform(0.05, 1.0, 3)
        size = 4.0
        t = bp.project(rng.normal(size=(3, d)) + np.eye(1, d), mu)[0]
        v = rng.normal(size=(3, d))
        v_t = np.linalg.norm(v[:, 1:], axis=1)
        # (74): all of ṽ·(t* - t).
        bound = coupled(t, v, mu, size)
        corrected = v.copy()
        corrected[:, 0] += mu * v_t
        trials = inside(rng, mu, d, size, 4000)
        values = np.sum(corrected * (trials - t), axis=2)
        # Sums of a few products of numbers of order one to ten.
        assert (values >= -bound.residual - 1e-13).all()
        assert np.sum(corrected * (bound.worst - t), axis=1) == pytest.approx(
            -bound.residual, abs=1e-13
        )
        gaps.append((values.min(axis=0) + bound.residual).max())
        # (76)-(78): any t_n*, and any t_t* of the disc of t.
        bound = alternated(t, v, mu, size)
        disc = trials[..., 1:] / np.maximum(trials[..., :1], 1e-300) * t[:, :1]
        values = v[:, 0] * (trials[..., 0] - t[:, 0])
        values += np.sum(v[:, 1:] * (disc - t[:, 1:]), axis=2)
        assert (values >= -bound.residual - 1e-13).all()
        # (75): displacements that do not penetrate, for tractions of any sign.
        pulls = rng.normal(size=(3, d))
        opened = v.copy()
        opened[:, 0] = np.abs(opened[:, 0])
        bound = displacements(pulls, opened, mu, size)
        moves = rng.normal(size=(4000, 3, d))
        moves *= size / np.linalg.norm(moves[..., 1:], axis=2, keepdims=True)
        moves[..., 0] = size * rng.choice([0.0, 1.0, rng.random()], size=(4000, 3))
        moves[..., 1:] *= rng.choice([0.0, 1.0, rng.random()], size=(4000, 3, 1))
        values = np.sum(pulls * (moves - opened), axis=2)
        values += (
            mu
            * pulls[:, 0]
            * (
                np.linalg.norm(moves[..., 1:], axis=2)
                - np.linalg.norm(opened[:, 1:], axis=1)
            )
        )
        assert (values >= -bound.residual - 1e-13).all()
    # 4000 directions miss the worst one by their spacing, in space by its square.
    assert max(gaps) < (1e-13 if d == 2 else 1e-2)


@pytest.mark.parametrize("d", [2, 3])
@pytest.mark.slow_variants("3")
def test_the_three_agree_on_pairs(d: int) -> None:
    rng = np.random.default_rng(6)
    for _ in range(100):
        t, v, mu, _ = on_the_law(rng, 6, d)
        size = 2 + max(t.max(), np.abs(v).max())
        for form in FORMS:
            # Products of numbers of order one.
            assert form(t, v, mu, size).total <= 1e-14 * size
        # Off the law, with one violation at a time: t stays in the cone, v does not penetrate.
        pressed = t[:, 0] > 0
        wrong_t = t + np.eye(1, d)
        away = v + 0.5 * np.eye(1, d)
        turned = v.copy()
        turned[:, 1:] *= -1
        slid = pressed & (mu > 0) & (np.linalg.norm(v[:, 1:], axis=1) > 1e-3)
        for tractions, moved, off in (
            (wrong_t, away, np.ones(6, bool)),
            (t, away, pressed),
            (t, turned, slid),
        ):
            by_tractions = coupled(tractions, moved, mu, size)
            two = displacements(tractions, moved, mu, size)
            other = alternated(tractions, moved, mu, size)
            # In the cone and without penetration, all three equal the bipotential gap.
            gap = np.sum(tractions * moved, axis=1)
            gap += mu * tractions[:, 0] * np.linalg.norm(moved[:, 1:], axis=1)
            for worst in (by_tractions, two, other):
                assert worst.residual == pytest.approx(gap, abs=1e-13)
                assert (worst.residual[off] > 1e-6).all()
        # (74) and (78) are one residual, with or without penetration.
        deep = v - 0.7 * np.eye(1, d)
        by_tractions, other = coupled(t, deep, mu, size), alternated(t, deep, mu, size)
        assert by_tractions.residual == pytest.approx(other.residual, abs=1e-13)
        assert (by_tractions.residual[deep[:, 0] < 0] > 0).all()
        # Outside the cone only (75) is violated.
        out = t.copy()
        out[:, 1] += 2 * mu * t[:, 0] + 0.1
        excess = np.linalg.norm(out[:, 1:], axis=1) - mu * t[:, 0]
        excess_of_form = displacements(out, v, mu, size).residual
        assert (excess_of_form[excess > 1e-3] > 0).all()
        for form in (coupled, alternated):
            with pytest.raises(ValueError, match="is outside the friction cone by"):
                form(out, v, mu, size)


KINDS = ["held", "graded", "frictionless", "flat", "open"]


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("d", [2, 3])
def test_they_hold_at_solutions_only(kind: str, d: int) -> None:
    for seed in range(15):
        rng = np.random.default_rng(seed)
        random_data = random_problem(kind, d, seed)
        solution = random_data.problem().solve(tol=1e-14)
        t, v = solution.reaction, solution.relative_displacement
        # Any start state: increments are differences to the totals.
        t0, offset = rng.normal(size=t.shape), rng.normal(size=t.shape)
        offset[:, 1:] = 0.0
        response = Response(random_data.problem(), reaction=t0, offset=offset)
        force, length = response.sizes()
        if not length:
            continue  # # no load, so nothing moves
        force, length = 2 * max(force, t.max()), 2 * max(length, np.abs(v).max())
        form_74 = inequality_74(response, t - t0, force)
        held = v.copy()
        held[:, 0] = np.maximum(v[:, 0], 0.0)  # # removes rounding of closed contacts
        two = inequality_75(response, held - offset, length)
        three = inequality_78(response, t - t0, force)
        # In the work units of the bounds; E and E⁻¹ lose digits by the condition of W.
        digits = 1e-12 * (1e4 if kind == "graded" else 1.0)
        extent = force * length * len(t)
        assert form_74.total <= digits * extent
        assert three.total <= digits * extent
        assert two.total <= 100 * digits * extent
        # Another admissible traction.
        other, _ = bp.project(
            t + 0.1 * force * rng.normal(size=t.shape), random_data.mu
        )
        if np.abs(other - t).max() > 1e-3 * force and kind != "graded":
            first = inequality_74(response, other - t0, 2 * force)
            assert first.total > 1e-9 * extent
            last = inequality_78(response, other - t0, 2 * force)
            assert last.residual == pytest.approx(first.residual, abs=1e-12 * extent)
            # The worst field found belongs to the set.
            bp.project(first.worst, random_data.mu, base=t0)
            total = first.worst + t0
            kept, _ = bp.project(total, random_data.mu)
            assert np.abs(kept - total).max() <= 1e-13 * force


def test_operators_are_inverse_and_monotone() -> None:
    rng = np.random.default_rng(8)
    for kind in ("held", "floating"):
        for seed in range(10):
            random_data = random_problem(kind, 3, seed)
            response = Response(
                random_data.problem(), offset=rng.normal(size=random_data.q.shape)
            )
            a = rng.normal(
                size=0 if random_data.rigid is None else len(random_data.rigid[1])
            )
            r = rng.normal(size=random_data.q.shape)
            if random_data.rigid is not None:
                R, e = random_data.rigid
                r -= (R @ np.linalg.solve(R.T @ R, R.T @ r.ravel() + e)).reshape(
                    r.shape
                )
            du = response.displacement(r, a if len(a) else None)
            # Condition numbers of some hundred.
            assert response.traction(du) == pytest.approx(r, abs=1e-11)
            other = rng.normal(size=r.shape)
            back = response.traction(du + other) - response.traction(du)
            gain, size = np.sum(back * other), np.sum(other**2)
            assert gain >= (response.inverse_monotonicity - 1e-12) * size
            values, vectors = np.linalg.eigh(random_data.W)
            assert response.monotonicity == pytest.approx(values[0], rel=1e-10)
            if kind == "floating":
                assert response.inverse_monotonicity == 0
                rigid = (random_data.rigid[0] @ np.ones(3)).reshape(r.shape)  # type: ignore[index]
                still = response.traction(du + rigid)
                assert still == pytest.approx(r, abs=1e-11)
                with pytest.raises(ValueError, match="rigid is missing"):
                    response.displacement(r)
            else:
                assert response.inverse_monotonicity == pytest.approx(
                    1 / values[-1], rel=1e-10
                )
                # Sharp: along the softest direction the bound is reached.
                way = vectors[:, 0].reshape(r.shape)
                gain = np.sum(
                    (response.displacement(way) - response.displacement(0 * way)) * way
                )
                assert gain == pytest.approx(response.monotonicity, rel=1e-9)
    singular = Response(random_problem("redundant", 3, 3).problem())
    assert singular.inverse_monotonicity is None
    with pytest.raises(ValueError, match="the compliance W of problem is singular"):
        singular.traction(np.zeros_like(singular.offset))


def test_prints_of_74_and_78_fail_at_solutions() -> None:
    wrong_74 = wrong_78 = 0
    for seed in range(20):
        rng = np.random.default_rng(seed)
        random_data = random_problem("held", 3, seed)
        solution = random_data.problem().solve(tol=1e-14)
        t, v = solution.reaction, solution.relative_displacement
        # A start on the law: h0 differs from u_n0, and t0 is inside the cone.
        t0 = 0.5 * t
        offset = np.zeros_like(t)
        du, dt = v - offset, t - t0
        trial = inside(rng, random_data.mu, 3, 2 * t.max() + 1, 500) - t0
        first = (v[:, 0] + random_data.mu * np.linalg.norm(v[:, 1:], axis=1)) * (
            trial[..., 0] - dt[:, 0]
        )
        right = first + np.sum(du[:, 1:] * (trial - dt)[..., 1:], axis=2)
        printed = first + np.sum(dt[:, 1:] * (trial - dt)[..., 1:], axis=2)
        assert right.sum(axis=1).min() >= -1e-12
        wrong_74 += printed.sum(axis=1).min() < -1e-3
        # (78): û_n + u_n0 + h0 (Δt_n* - Δt_n), with h0 = 0.3 and the corresponding u_n0.
        h0 = 0.3
        u_n0 = offset[:, 0] - h0
        bracket = (v[:, 0] - offset[:, 0]) + u_n0 + h0 * (trial - dt)[..., 0]
        assert ((v[:, 0]) * (trial - dt)[..., 0]).sum(axis=1).min() >= -1e-12
        wrong_78 += bracket.sum(axis=1).min() < -1e-3
    assert wrong_74 >= 10
    assert wrong_78 >= 10


T, V = np.array([[1.0, 0.2]]), np.array([[0.0, 0.0]])
MISTAKES: list[tuple[Callable[[], Any], str]] = [
    (lambda: coupled(T, V, 0.5, 0.5), r"size is 0\.5, expected a positive number of at least 1\.0"),
    (lambda: displacements(T, V - [1.0, 0.0], 0.5, 2.0), r"v of contact 0 penetrates by 1\.0"),
    (lambda: alternated(T, np.zeros((2, 2)), 0.5, 2.0), r"v has shape \(2, 2\), expected \(1, 2\)"),
    (lambda: Response(None), "problem is a NoneType"),  # type: ignore[arg-type]
]  # fmt: skip


@pytest.mark.parametrize(("call", "words"), MISTAKES)
def test_mistakes_are_named(call: Callable[[], Any], words: str) -> None:
    with pytest.raises((TypeError, ValueError), match=words):
        call()


def dragged(steps: int) -> tuple[bp.ContactProblem, Array]:
    """One contact on springs: pressed, dragged until it slides, then moved in a circle."""
    problem = bp.ContactProblem(np.diag([2.0, 1.0, 1.0]), np.eye(3), gap=[0.0], mu=0.4)
    angle = np.linspace(0, np.pi, steps + 1)[1:]
    # Slides from t = -0.4: in the first step by hand, to the edge of the cone and beyond.
    pull = np.column_stack([np.cos(angle), np.sin(angle)]) * 2.0
    way = np.vstack([[[0.4, 0.0]], [[2.0, 0.0]], pull])
    return problem, np.column_stack([np.full(len(way), -1.0), way])


def drag_explicitly(steps: int) -> Array:
    problem, load = dragged(steps)
    free = [problem.reduced(force).q[0] for force in load]
    return explicit_path(problem.compliance, np.vstack([np.zeros(3), free]), 0.4)


def measure_excess(t: Array) -> Array:
    return np.asarray(np.linalg.norm(t - bp.project(t, 0.4)[0], axis=1))


@pytest.mark.slow
def test_explicit_scheme_drifts_and_implicit_does_not() -> None:
    drift, sizes = [], (50, 100, 200, 400)
    for steps in sizes:
        path = drag_explicitly(steps)
        assert path[:2] == pytest.approx(
            np.array([[1.0, -0.4, 0.0], [1.0, -0.4, 0.0]]), abs=1e-14
        )
        excess = measure_excess(path)
        drift.append(excess[-1])
        # It drifts only outwards, further with each step.
        assert (np.diff(excess[2:]) > 0).all()
        problem, load = dragged(steps)
        result = problem.solve(load, tol=1e-14)
        # In the cone, to rounding.
        assert measure_excess(result.reaction[:, 0]).max() <= 1e-15
    orders = np.log2(np.array(drift[:-1]) / drift[1:])
    # First order; the next term of the error halves with the step.
    assert (np.abs(orders - 1) <= 4 / np.array(sizes[:-1])).all()
    # At constant pressure, a traction that turns by θ in a step follows the tangent and grows
    # by sec θ. The first step of the circle differs, because it first sticks.
    across = path[2:, 1:]
    turned = np.diff(np.unwrap(np.arctan2(across[:, 1], across[:, 0])))
    growth = -np.log(np.cos(turned)).sum()
    size = np.linalg.norm(across, axis=1)
    # 400 steps of rounding.
    assert np.log(size[-1] / size[0]) == pytest.approx(growth, rel=1e-11)
    size = size[-1] / 0.4
    assert excess[-1] == pytest.approx(0.4 * (size - 1) / np.hypot(1, 0.4), rel=1e-9)


def test_explicit_and_implicit_go_to_one_path() -> None:
    problem, load = dragged(200)
    explicit = drag_explicitly(200)[-1]
    implicit = problem.solve(load).reaction[-1, 0]
    # Both are of first order in the step of π/200, over a turn of 4.5.
    assert np.abs(explicit - implicit).max() < 4.5 * np.pi / 200


def test_explicit_scheme_lets_go_and_closes() -> None:
    # Pressed, lifted, pressed again, always along the normal: exact, but one step late.
    free = np.array([0.1, 0.1, -0.1, -0.1, 0.6, 0.6])
    q = np.column_stack([free, np.zeros(6)])
    path = explicit_path(np.eye(2), q, 0.3)
    assert path[:, 0] == pytest.approx([0.0, 0.0, 0.1, -0.6, 0.0], abs=1e-15)
    assert path[:, 0] + free[1:] == pytest.approx([0.1, -0.1, 0.0, 0.0, 0.6], abs=1e-15)
