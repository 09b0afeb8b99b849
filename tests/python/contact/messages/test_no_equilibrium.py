"""Loads that contact cannot carry raise an error with a proof, for bodies held by contact."""

import contextlib
import math
import re
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import sparse
from scipy.optimize import linprog

import bipot_rs as bp
from bipot_rs.contact.messages.rigid_motion_names import describe_motion
from support.bodies import Body, block, uniform_shear

Array = NDArray[np.float64]
MU = 0.6


def floor_frame(body: Body) -> Array:
    """Normal up, tangents along the other axes in order, as `block` assumes."""
    d = body.dim
    return np.tile(np.roll(np.eye(d), 1, axis=0), (len(body.area), 1, 1))


def solve(body: Body, load: Array, mu: float = MU, **options: Any) -> Any:
    places = {"points": body.points, "frame": floor_frame(body)}
    return bp.solve(body.K, body.B, load, gap=body.gap, mu=mu, **places, **options)


def refused(body: Body, load: Array, mu: float = MU) -> bp.NoEquilibriumError:
    with pytest.raises(bp.NoEquilibriumError) as caught:
        solve(body, load, mu)
    assert in_dual_cone(caught.value.direction, mu)
    return caught.value


def in_dual_cone(direction: Array | None, mu: Array | float) -> bool:
    """v_n >= mu |v_t|: a proof lies inside by a margin, or within 1e-9 of the edge."""
    assert np.linalg.norm(direction, axis=1).max() == pytest.approx(1, rel=1e-12)
    slip = np.linalg.norm(direction[:, 1:], axis=1)
    return bool((direction[:, 0] - mu * slip >= -1e-8).all())


@pytest.mark.parametrize("shear", [[1.5], [-30.0], [0.8, -0.9]], ids=str)
@pytest.mark.parametrize("press", [2.0, -2.0, 0.0])
def test_the_message_says_which_friction_could_hold(
    shear: list[float], press: float
) -> None:
    """A block on a plane: friction holds from the ratio of the forces, or never."""
    dim = len(shear) + 1
    body = block((3, 2, 1) if dim == 3 else (3, 1), (2, 2, 2)[:dim], 10.0, 0.0)
    told = str(refused(body, uniform_shear(body, press, shear), 0.3))
    assert "with mu = 0.3; " in told
    if press <= 0:
        assert "; no friction could balance the loads; add a support" in told
        return
    found = re.search(r"could balance the loads from mu = ([\d.]+) on; add", told)
    # The search ends within half a per cent above, of which three digits are printed.
    ratio = float(found[1]) / (math.hypot(*shear) / press)
    assert 0.995 < ratio < 1.011


@pytest.mark.parametrize(
    "shear", [[1.0], [-1.0], [1.0, 0.0], [0.0, -1.0], [0.8, -0.6]], ids=str
)
@pytest.mark.slow_variants("[[]1.0, 0.0]")
def test_a1_on_both_sides_of_the_limit(shear: list[float]) -> None:
    dim = len(shear) + 1
    body = block((3, 2, 1) if dim == 3 else (3, 1), (4, 3, 2)[:dim], 10.0, 0.0)
    limit = MU * 2.0 * np.array(shear)
    held = solve(body, uniform_shear(body, 2.0, [*(limit * (1 - 1e-6))]))
    # r_n = p·trib, r_t = −τ·trib; the residual is held to 1e-10 of the total load.
    expected = np.outer(body.area, [2.0, *(-limit * (1 - 1e-6))])
    np.testing.assert_allclose(held.reaction[0], expected, atol=1e-8)
    error = refused(body, uniform_shear(body, 2.0, [*(limit * (1 + 1e-6))]))
    along = ", ".join(f"{x:g}" for x in [*shear, 0.0])
    assert f"translation along ({along}) in ({', '.join('xyz'[:dim])})" in str(error)


@pytest.mark.parametrize("dim", [2, 3])
def test_a_distant_axis_is_described_as_a_translation(dim: int) -> None:
    """A rotation by ω about a centre that moves by 1, over a length of 3."""
    plane = np.array([(x, y) for x in range(4) for y in range(3)], dtype=float)
    points = np.column_stack([plane] + [np.zeros(12)] * (dim - 2))
    frame, mu = np.tile(np.eye(dim), (12, 1, 1)), np.zeros(12)
    for turn, far in ((0.1, True), (0.2, False)):
        moved = np.zeros((12, dim))
        moved[:, 0] = -turn * (points[:, 1] - 1.0)
        moved[:, 1] = 1.0 + turn * (points[:, 0] - 1.5)
        description = describe_motion(moved / 1.5, mu, points=points, frame=frame)
        place = f"({1.5 - 1 / turn:g}, 1{', 0' * (dim - 2)})"
        about = "the point" if dim == 2 else "an axis through"
        assert f"rotation about {about} {place}" in description
        along = f"(0, 1{', 0' * (dim - 2)})"
        first = (
            f"translation along {along} in ({', '.join('xyz'[:dim])}) (nearly: rotat"
        )
        assert description.startswith(first if far else "rotation about")


def test_a_block_that_tips_in_the_plane() -> None:
    body = block((1, 3), (4, 9), 1e3, 0.3)
    top = body.traction(1, 3.0, [1.0, 0.0])  # a force of 1 at height 3
    # Moment 3 about the right corner against weight · ½: tips for a weight below 6.
    weight = body.weight([0.0, -1.0])
    assert solve(body, top + 6.001 * weight, mu=2.0).success
    error = refused(body, top + 5.999 * weight, mu=2.0)
    assert "rotation about the point (1, 0)" in str(error)
    # The left corner lifts by 1, the right one stays.
    np.testing.assert_allclose(
        error.direction,
        np.column_stack([1 - body.points[:, 0], 0 * body.gap]),
        atol=1e-8,
    )


def stacked(mu: tuple[float, float]) -> tuple[bp.ContactProblem, Body, int]:
    """Two free blocks, 3 by 1 each, one on the other; friction on the floor and between."""
    body = block((3, 1), (6, 2), 1e3, 0.3)
    n = body.K.shape[0]
    top = body.nodes_where(1, 1.0)
    columns = body.basis.nodal_dofs[[1, 0]][:, top].T.ravel()
    rows = np.arange(columns.size)
    lower = sparse.csr_array((-np.ones(columns.size), (rows, columns)), body.B.shape)
    B = sparse.block_array([[body.B, None], [lower, body.B]]).tocsr()
    K = sparse.block_diag([body.K, body.K]).tocsr()
    count = len(body.gap)
    frame = floor_frame(body)
    problem = bp.ContactProblem(
        K,
        B,
        gap=np.zeros(2 * count),
        mu=np.repeat(mu, count),
        points=np.vstack([body.points, body.points + np.array([0.0, 1.0])]),
        frame=np.vstack([frame, frame]),
    )
    return problem, body, n


@pytest.mark.parametrize("mu", [(0.6, 0.3), (0.2, 0.9)])
def test_two_free_blocks_stacked(mu: tuple[float, float]) -> None:
    problem, body, n = stacked(mu)
    down = np.tile(body.weight([0.0, -1.0]), 2)
    push = np.concatenate([np.zeros(n), body.weight([1.0, 0.0])])
    # The upper one slides on the lower at mu[1], both on the floor at 2 mu[0].
    limit = min(mu[1], 2 * mu[0])
    assert problem.solve(down + limit * (1 - 1e-4) * push).success
    with pytest.raises(bp.NoEquilibriumError) as caught:
        problem.solve(down + limit * (1 + 1e-6) * push)
    direction = caught.value.direction
    count = len(body.gap)
    assert in_dual_cone(direction, np.repeat(mu, count))
    assert "translation along (1, 0) in (x, y)" in str(caught.value)
    moves = np.linalg.norm(direction, axis=1).reshape(2, count).max(axis=1)
    between, floor = " against " in str(caught.value), mu[0] < mu[1]
    assert between is not floor
    # The message names only the contacts that give way.
    assert moves[int(floor)] <= 1e-6 < moves[int(not floor)]


def test_without_coordinates_contacts_are_named() -> None:
    body = block((1, 3), (2, 6), 1e3, 0.3)
    load = body.traction(1, 3.0, [1.0, 0.0]) + body.weight([0.0, -5.0])
    with pytest.raises(bp.NoEquilibriumError) as caught:
        bp.solve(body.K, body.B, load, gap=body.gap, mu=2.0)
    # The left corner lifts most, the middle less; the right corner stays.
    left, middle = np.argsort(body.points[:, 0])[:2]
    text_of_contacts = f"contact {left} by (1, 0), contact {middle} by (0.5, 0)"
    assert text_of_contacts in str(caught.value)


def test_a_reduced_problem_reports_it() -> None:
    rigid = (np.tile(np.eye(3), (4, 1)), np.array([-4.0, 0.9, 1.2]))
    problem = bp.ReducedProblem(np.eye(12), np.zeros((4, 3)), 0.3, rigid=rigid)
    solution = problem.solve()
    assert str(solution.outcome) == "no_equilibrium"
    assert not solution.converged
    assert solution.residual > 1e-2
    assert rigid[1] @ solution.free_motion > 0
    v = (rigid[0] @ solution.free_motion).reshape(4, 3)
    assert in_dual_cone(v, 0.3)
    assert "every contact along (0, 0.6, 0.8) in (n, t1, t2)" in solution.message
    held = bp.ReducedProblem(
        np.eye(12), np.zeros((4, 3)), 0.3, rigid=(rigid[0], 0.79 * rigid[1])
    )
    # The result depends on the direction of the load, not on its size.
    assert str(held.solve().outcome) == "no_equilibrium"
    light = (rigid[0], rigid[1] * [1.0, 0.79, 0.79])
    held = bp.ReducedProblem(np.eye(12), np.zeros((4, 3)), 0.3, rigid=light)
    assert held.solve().converged
    assert held.solve().free_motion is None


@pytest.mark.parametrize("method", ["auto", "gauss_seidel"])
def test_sliding_away_without_a_proof(method: str) -> None:
    # Thirteen sliders in a chain, each pressed by its own spring with force 1: r_n = 1
    # always, and 0.7 each exceeds the friction limit 0.5. Large enough reactions would
    # balance the push if anything pressed the contacts.
    count = 13
    chain = 2 * np.eye(count) - np.eye(count, k=1) - np.eye(count, k=-1)
    chain[0, 0] = chain[-1, -1] = 1.0
    K = np.kron(np.eye(count), np.diag([1.0, 0.0])) + np.kron(chain, np.diag([0, 1.0]))
    frame = np.tile([[0.0, 1.0], [1.0, 0.0]], (count, 1, 1))
    points = np.column_stack([np.arange(count), np.zeros(count)])
    problem = bp.ContactProblem(
        K, np.eye(2 * count), gap=np.zeros(count), mu=0.5, points=points, frame=frame
    )
    with pytest.raises(bp.NotConvergedError) as caught:
        problem.solve(np.tile([-1.0, 0.7], count), method=method)
    assert "seems to slide away" in str(caught.value)
    assert "translation along (1, 0) in (x, y)" in str(caught.value)
    np.testing.assert_allclose(
        caught.value.direction, np.tile([0.0, 1.0], (count, 1)), atol=1e-9
    )
    held = problem.solve(np.tile([-1.0, 0.4], count), method=method)
    np.testing.assert_allclose(held.reaction[0, :, 0], 1.0, rtol=1e-9)


@pytest.mark.parametrize("nu", [0.3, 0.4999])
def test_loads_in_balance_with_themselves_are_not_refused(nu: float) -> None:
    # A body squeezed from the sides only: the load on its rigid motions is rounding,
    # 1e-11 of the squeeze at nu = 0.4999.
    body = block((3, 1), (8, 6), 1e3, nu)
    squeeze = body.traction(0, 0.0, [1.0, 0.0]) - body.traction(0, 3.0, [1.0, 0.0])
    with contextlib.suppress(bp.NotConvergedError):
        solve(body, squeeze)
    assert solve(body, squeeze + body.weight([0.0, -0.1])).success
    refused(body, squeeze + body.weight([0.0, 1e-3]))


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.slow_variants("3")
def test_against_linear_programming(dim: int) -> None:
    """Cones with flat sides: exact in the plane, inner and outer bounds in space."""
    rng = np.random.default_rng(dim)
    motions, sides = (3, 2) if dim == 2 else (6, 48)
    turn = 2 * np.pi * np.arange(sides) / sides
    circle = (
        np.cos(turn)[:, None]
        if dim == 2
        else np.column_stack([np.cos(turn), np.sin(turn)])
    )
    outside = 1.0 if dim == 2 else 1 / np.cos(np.pi / sides)
    seen = {True: 0, False: 0}
    for _ in range(150):
        contacts = int(rng.integers(1, 7))
        R = rng.standard_normal((contacts, dim, motions))
        if contacts * dim < motions:
            continue  # # too few contacts to block every motion
        mu = rng.choice([0.0, 0.3, 1.0, 3.0], contacts)
        load = rng.standard_normal(motions)
        works = []
        for widened in (1.0, outside):
            rays = np.einsum("s,ik->isk", np.ones(sides), R[:, 0])
            rays = rays + np.einsum("i,st,itk->isk", widened * mu, circle, R[:, 1:])
            A = -rays.reshape(-1, motions)
            # Most work on a motion with components up to 1 that no ray resists.
            optimum = linprog(-load, A, np.zeros(len(A)), bounds=(-1, 1))
            works.append(-optimum.fun)
        solution = bp.ReducedProblem(
            np.eye(dim * contacts),
            np.zeros((contacts, dim)),
            mu,
            rigid=(R.reshape(-1, motions), load),
        ).solve(max_iterations=1)
        impossible = str(solution.outcome) == "no_equilibrium"
        # The linear programme has a tolerance of 1e-7 per constraint.
        if works[1] > 1e-4:
            assert impossible
        if works[0] < 1e-6:
            assert not impossible
        seen[impossible] += 1
    assert min(seen.values()) > 20
