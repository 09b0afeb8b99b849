"""Ranges of reactions against closed forms, enumeration and polyhedral cones."""

from collections.abc import Callable
from contextlib import suppress
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import linprog

import bipot_rs as bp
from support.contacts import rigid_rows
from support.whole_numbers import find_end, make_contacts

Array = NDArray[np.float64]
# What is promised in space.
SPACE = 1e-9


def plane_body(x: Array, angles: Array) -> Array:
    normal = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    tangent = np.stack([-normal[:, 1], normal[:, 0]], axis=1)
    return rigid_rows(x, np.stack([normal, tangent], axis=1))


def rigid(H: Array, load: Array, mu: float | Array, d: int) -> bp.ReducedProblem:
    """A body with unit masses that the load pushes for a unit of time."""
    return bp.ReducedProblem(H @ H.T, (H @ load).reshape(-1, d), mu)


def table(mu: float | Array, load: Array) -> tuple[bp.ReducedProblem, Array]:
    """Four legs at (±1, ±1) on a floor through the centre of mass."""
    x = np.array([[1.0, 1, 0], [-1, 1, 0], [-1, -1, 0], [1, -1, 0]])
    H = rigid_rows(x)
    return rigid(H, load, mu, 3), H


def passes(problem: bp.ReducedProblem, one: bp.ReactionRange, v: Array) -> None:
    """Attained bounds are answers with the same v; directions can be added."""
    ends = [
        (one.least, one.reaction_at_least, one.direction_to_least),
        (one.largest, one.reaction_at_largest, one.direction_to_largest),
    ]
    size = np.abs(one.reaction_at_least).max()
    for value, reaction, direction in ends:
        if direction is not None:
            assert not np.isfinite(value)
            assert direction[one.contact, one.component] * np.sign(value) > 0
            reaction = reaction + 3 * size * direction
        else:
            assert reaction[one.contact, one.component] == value
        assert problem.residual(reaction) <= 1e-10
        moved = (problem.W @ reaction.ravel()).reshape(v.shape) + problem.q
        # Sums of terms of the size of W r.
        reach = np.abs(problem.W).max() * max(np.abs(reaction).max(), size)
        np.testing.assert_allclose(moved, v, atol=1e-10 * reach)
    assert one.least - one.gap <= one.found <= one.largest + one.gap


def test_a_table_on_four_legs() -> None:
    """N_1 = N_3 and N_2 = N_4 up to moments: one number is free, until a leg lifts."""
    weight, across, along = 4.0, 0.4, 0.2
    for mu in (0.0, 0.3):
        problem, _ = table(mu, np.array([0, 0, -weight, across, along, 0]))
        intervals = problem.reaction_ranges()
        # Σ N = w, Σ y N = -across, Σ -x N = -along: N_k = mean_k ± t.
        y, x = np.array([1, 1, -1, -1]), np.array([1, -1, -1, 1])
        mean = weight / 4 - across * y / 4 + along * x / 4
        side = x * y
        low, high = -mean[side > 0].min(), mean[side < 0].min()
        least = mean + np.where(side > 0, low, -high)
        largest = mean + np.where(side > 0, high, -low)
        tolerance = SPACE * weight
        np.testing.assert_allclose([r.least for r in intervals], least, atol=tolerance)
        np.testing.assert_allclose(
            [r.largest for r in intervals], largest, atol=tolerance
        )
        v = problem.solve().relative_displacement
        for interval in intervals:
            assert interval.gap <= SPACE * weight
            passes(problem, interval, v)


def wedge(angle: float, mu: float) -> bp.ReducedProblem:
    """A point between walls that lean out by an angle, pushed down by 1."""
    c, s = np.cos(angle), np.sin(angle)
    H = np.array([[c, s], [-s, c], [-c, s], [s, c]])
    return rigid(H, np.array([0.0, -1.0]), mu, 2)


@pytest.mark.parametrize("mu", [0.0, 0.05, 0.15, 0.199, 0.21, 0.5, 3.0])
def test_a_wedge(mu: float) -> None:
    """Reactions at elevations e_1, e_2 have r_1 = cos e_2 / sin(e_1 + e_2).

    Extremes are at the limits of friction, angle ± atan μ. If both elevations may be zero,
    the walls clamp the point with any force.
    """
    angle, phi = np.arctan(0.2), np.arctan(mu)
    problem = wedge(angle, mu)
    interval = problem.reaction_range(0)
    limits = [angle - phi, angle + phi]
    exact_ends = [
        np.cos(second) / np.sin(first + second) * np.cos(first - angle)
        for first in limits
        for second in limits
        if first + second > 1e-9
    ]
    # 0.199 leaves a digit and a half of the difference to 0.2.
    np.testing.assert_allclose(interval.least, min(exact_ends), rtol=1e-11)
    largest = max(exact_ends) if mu < 0.2 else np.inf
    np.testing.assert_allclose(interval.largest, largest, rtol=1e-11)
    passes(problem, interval, problem.solve().relative_displacement)
    assert interval.determined == (mu == 0)


def polyhedral(r: Array, H: Array, cost: int, rays: Array) -> Array:
    """Extremes over balanced reactions in cones of these rays ``(m, d)``."""
    contacts, (m, d) = len(r), rays.shape
    whole = np.zeros((contacts, d, contacts * m))
    for i in range(contacts):
        whole[i, :, i * m : (i + 1) * m] = rays.T
    whole = whole.reshape(-1, contacts * m)
    balance = {"A_eq": H.T @ whole, "b_eq": H.T @ r.ravel()}
    return np.array([s * linprog(s * whole[cost], **balance).fun for s in (1, -1)])


@pytest.mark.parametrize("seed", range(6))
def test_random_bodies_in_the_plane(seed: int) -> None:
    """Three contacts on the lower half of a body: bounded, because they all push up."""
    rng = np.random.default_rng(seed)
    angles = np.pi / 2 + rng.uniform(-0.3, 0.3, 3)
    x = np.stack(
        [np.array([-1, 0, 1]) + rng.uniform(-0.3, 0.3, 3), rng.uniform(-0.1, 0.1, 3)], 1
    )
    H = plane_body(x, angles)
    mu = 0.4
    problem = rigid(H, np.array([0.05, -1.0, 0.1]), mu, 2)
    solution = problem.solve(tol=1e-13)
    v = solution.relative_displacement
    assert np.abs(v).max() <= 1e-12  # all stick
    for component in (0, 1):
        for interval in problem.reaction_ranges(component, solution=solution):
            cost = 2 * interval.contact + component
            ends = polyhedral(solution.reaction, H, cost, np.array([[1, mu], [1, -mu]]))
            # The tolerance of HiGHS.
            np.testing.assert_allclose(
                [interval.least, interval.largest], ends, atol=1e-8
            )
            assert interval.gap <= 1e-12
            passes(problem, interval, v)


@pytest.mark.parametrize("seed", range(3))
def test_between_polyhedral_cones_in_space(seed: int) -> None:
    rng = np.random.default_rng(seed)
    contacts, mu = 4, 0.3
    x = np.c_[rng.uniform(-1, 1, (contacts, 2)), rng.uniform(-0.2, 0.0, contacts)]
    x[:3, :2] = [[1, 0], [-1, 1], [-1, -1]]
    axes = np.array(
        [
            np.linalg.qr(np.c_[n, np.eye(3)[:, :2]])[0].T
            for n in rng.normal([0, 0, 1], 0.1, (contacts, 3))
        ]
    )
    axes *= np.sign(axes[:, :1, 2:])
    H = rigid_rows(x, axes)
    problem = rigid(H, np.array([0.05, 0.02, -1, 0.02, 0.01, 0.01]), mu, 3)
    solution = problem.solve(tol=1e-13)
    v = solution.relative_displacement
    assert np.abs(v).max() <= 1e-12  # all stick
    turn = 2 * np.pi * np.arange(128) / 128
    circle = np.column_stack([np.ones(128), np.cos(turn), np.sin(turn)])
    for component in (0, 1):
        interval = problem.reaction_range(1, component, solution=solution)
        assert interval.gap <= SPACE * np.abs(solution.reaction).max()
        passes(problem, interval, v)
        cost = 3 + component
        inner, outer = (
            polyhedral(solution.reaction, H, cost, circle * [1, wide, wide])
            for wide in (mu, mu / np.cos(np.pi / 128))
        )
        # The tolerance of HiGHS, and nothing of ours.
        slack = 1e-8
        assert outer[0] - slack <= interval.least <= inner[0] + slack
        assert inner[1] - slack <= interval.largest <= outer[1] + slack


def test_a_table_that_slides() -> None:
    """Friction opposes the slip at every leg: only normal reactions are exchanged."""
    mu, push = 0.2, np.array([3.0, 4.0]) / 5
    problem, _ = table(mu, np.array([2 * push[0], 2 * push[1], -4, 0, 0, 0]))
    v = problem.solve().relative_displacement
    np.testing.assert_allclose(v[:, 1:], np.tile(1.2 * push, (4, 1)), atol=1e-10)
    for component, factor in enumerate([1, *(-mu * push)]):
        for interval in problem.reaction_ranges(component):
            ends = sorted([0, 2 * factor])
            np.testing.assert_allclose(
                [interval.least, interval.largest], ends, atol=SPACE
            )
            passes(problem, interval, v)


def test_an_open_leg_carries_nothing() -> None:
    """With one leg raised, three legs are statically determinate without friction."""
    problem, _ = table(0.0, np.array([0, 0, -4.0, 0.1, 0, 0]))
    q = problem.q.copy()
    q[0, 0] += 1.0
    raised = bp.ReducedProblem(problem.W, q, 0.0)
    solution = raised.solve()
    assert solution.status[0] == bp.Status.OPEN
    for interval, r in zip(raised.reaction_ranges(), solution.reaction, strict=True):
        assert interval.determined
        assert interval.least == interval.largest == r[0]
        assert interval.gap == 0


def elliptic_table() -> tuple[bp.ReducedProblem, Array]:
    mu = np.array([[0.4, 0.1], [0.2, 0.2], [0.3, 0.15], [0.1, 0.3]])
    return table(mu, np.array([0.05, 0.02, -4, 0.4, 0.2, 0]))


def test_two_friction_coefficients() -> None:
    """With equal pairs as with one; each answer with the work of the scaled law."""
    load = np.array([0.1, 0.05, -4, 0.4, 0.2, 0.02])
    pairs, _ = table(np.full((4, 2), 0.3), load)
    single, _ = table(0.3, load)
    for component in (0, 2):
        interval = pairs.reaction_range(0, component)
        other = single.reaction_range(0, component)
        ends = [other.least, other.largest]
        np.testing.assert_allclose(
            [interval.least, interval.largest], ends, atol=4 * SPACE
        )
    problem, _ = elliptic_table()
    v = problem.solve(tol=1e-13).relative_displacement  # far below SPACE
    for component in range(3):
        for interval in problem.reaction_ranges(component):
            assert 0 < interval.gap <= 4 * SPACE
            passes(problem, interval, v)
            for r in (interval.reaction_at_least, interval.reaction_at_largest):
                used = np.linalg.norm(r[:, 1:] / problem.mu, axis=1)
                assert (used <= r[:, 0] + 4 * SPACE).all()


@pytest.mark.parametrize("elliptic", [False, True])
def test_units_and_numbering(elliptic: bool) -> None:
    """Forces in other units; contacts in other order; to the accuracy in space."""
    problem = elliptic_table()[0]
    mu = problem.mu if elliptic else np.array([0.4, 0.2, 0.3, 0.1])
    problem = bp.ReducedProblem(problem.W, problem.q, mu)
    intervals = problem.reaction_ranges(1)
    order = np.array([2, 0, 3, 1])
    rows = (3 * order[:, None] + np.arange(3)).ravel()
    for force, length in ((1e-9, 1e6), (1e12, 1e-7)):
        W = problem.W[np.ix_(rows, rows)] * length / force
        other = bp.ReducedProblem(W, problem.q[order] * length, mu[order])
        for i, interval in zip(order, other.reaction_ranges(1), strict=True):
            ends = [intervals[i].least, intervals[i].largest]
            scaled_ends = np.array([interval.least, interval.largest]) / force
            np.testing.assert_allclose(scaled_ends, ends, atol=4 * SPACE)


def test_a_body_that_turns_easily() -> None:
    """W of the middle contact is a millionth of that of the others."""
    x = np.array([[-1.0, 0], [0, 0], [0.5, 0], [1, 0]])
    H = plane_body(x, np.full(4, np.pi / 2))
    W = H @ np.diag([1.0, 1.0, 1e6]) @ H.T
    problem = bp.ReducedProblem(W, (H @ [0.0, -1.0, 0.0]).reshape(-1, 2), 0.0)
    exact_ends = [(0, 1 / 2), (0, 1), (0, 2 / 3), (0, 1 / 2)]
    for interval, ends in zip(problem.reaction_ranges(), exact_ends, strict=True):
        # Rounding of W times its condition number.
        np.testing.assert_allclose([interval.least, interval.largest], ends, atol=1e-9)


@pytest.mark.parametrize(
    "seeds", [range(60), pytest.param(range(60, 4000), marks=pytest.mark.slow)]
)
def test_contacts_that_hold_each_other(seeds: range) -> None:
    for seed in seeds:
        R, e, mu = make_contacts(seed)
        size, n = 1 + np.abs(e).max(), len(mu)
        if not np.abs(R).sum(axis=0).all():
            continue
        nothing = np.zeros((2 * n, 2 * n))
        problem = bp.ReducedProblem(nothing, np.zeros((n, 2)), mu, rigid=(R, e))
        for interval in problem.reaction_ranges():
            cost = np.eye(2 * n + 1)[2 * interval.contact]
            held = np.zeros_like(e)
            least, largest = (s * find_end(s * cost, R, e, held, mu) for s in (1, -1))
            found = [interval.least, interval.largest]
            # The tolerance of HiGHS.
            np.testing.assert_allclose(found, [least, largest], atol=1e-7 * size)


WEDGE = wedge(0.3, 0.1)
MISTAKES: list[tuple[Callable[[], Any], Any, str]] = [
    (lambda: WEDGE.reaction_range(2), ValueError, "contact is 2, expected 0 to 1"),
    (lambda: WEDGE.reaction_range(0, 2), ValueError, "component is 2, expected 0 to 1"),
    (lambda: WEDGE.reaction_ranges("normal"), TypeError, "component is 'normal', expected an int"),  # type: ignore[arg-type]
    (lambda: WEDGE.reaction_ranges(solution=[1]), TypeError, "solution is a list, expected a Sol"),  # type: ignore[arg-type]
    (lambda: WEDGE.reaction_ranges(solution=wedge(0.2, 0.1).solve()), ValueError,
     "pass a solution of this problem"),
    (lambda: WEDGE.reaction_ranges(solution=WEDGE.solve(max_iterations=1, tol=1e-300)), ValueError,
     "solution did not converge"),
    (bp.ReducedProblem(np.zeros((2, 2)), [[-1.0, 0.0]], 0.0).reaction_ranges,
     bp.NoEquilibriumError, "no solution exists|contact 0 pen"),
]  # fmt: skip


@pytest.mark.parametrize(("call", "kind", "words"), MISTAKES)
def test_wrong_arguments(call: Callable[[], Any], kind: Any, words: str) -> None:
    with pytest.raises(kind, match=words):
        call()


def test_a_range_with_a_wide_gap_is_refused() -> None:
    """Three bodies whose reactions have almost no room: the least margin is rounding."""
    twice = """
        0 2 0 0 0 0 0 0 0  -2 0 -1 0 0 0 0 0 0  -1 2 1 0 0 0 0 0 0  -2 -1 0 0 0 0 0 0 0
        -1 2 0 0 0 0 0 0 0  -2 -1 -2 0 0 0 0 0 0  1 2 1 0 0 0 0 0 0  -2 1 0 0 0 0 0 0 0
        0 2 0 0 0 0 0 0 0  -2 0 0 0 0 0 0 0 0  1 2 0 0 0 0 0 0 0  -2 1 0 0 0 0 0 0 0
        -1 -2 1 1 2 1 0 0 0  2 -1 -2 -2 1 1 0 0 0  0 0 0 0 2 1 0 0 0  0 0 0 -2 0 -2 0 0 0
        0 -2 1 0 2 1 0 0 0  2 0 -1 -2 0 -2 0 0 0  0 0 0 1 2 1 0 0 0  0 0 0 -2 1 1 0 0 0
        0 0 0 0 -2 2 0 2 0  0 0 0 2 0 -2 -2 0 0  0 0 0 -1 -2 1 1 2 1  0 0 0 2 -1 -2 -2 1 0
    """
    R, e = np.array(twice.split(), float).reshape(24, 9) / 2, np.zeros(9)
    e[1::3] = -1.761758647942574, -1.4571848348330367, -1.974249277335478
    problem = bp.ReducedProblem(
        np.zeros((24, 24)), np.zeros((12, 2)), 1.5, rigid=(R, e)
    )
    assert problem.equilibrium().verdict == "balanced"
    # Whether rounding lets the programme end well depends on the machine.
    with suppress(bp.NotConvergedError):
        assert problem.reaction_range(0).gap <= 1e-3 * np.abs(e).max()
