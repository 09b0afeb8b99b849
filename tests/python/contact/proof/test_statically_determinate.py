"""Supports and contacts that are just enough, that are too few, or that allow a mechanism."""

import math
from typing import Any

import numpy as np
import pytest
from scipy import sparse

import bipot_rs as bp
from bipot_rs import fem
from support.determinate import bars, counted, on_two_nodes, sticking
from support.twice import Array


@pytest.mark.slow
def test_statically_determinate_bodies() -> None:
    assert sticking(range(60))["solved"] == 60


@pytest.mark.slow
def test_many_statically_determinate_bodies() -> None:
    assert sticking(range(60, 1260))["solved"] == 1200


@pytest.mark.slow
def test_supports_of_flat_blocks_are_counted() -> None:
    assert sum(counted(range(200)).values()) == 200


@pytest.mark.slow
def test_supports_of_many_flat_blocks_are_counted() -> None:
    assert sum(counted(range(200, 4200)).values()) == 4000


@pytest.mark.needs_extra
@pytest.mark.slow
def test_two_nodes_do_not_hold_a_body_in_space() -> None:
    assert on_two_nodes(range(200))["refused"] == 200


@pytest.mark.slow
def test_two_nodes_never_hold_a_body_in_space() -> None:
    assert on_two_nodes(range(200, 20_200))["refused"] == 20_000


@pytest.mark.parametrize("angle", [0.0, 20.0, 30.0, 77.0])
@pytest.mark.needs_extra
def test_a_block_on_a_corner_and_a_pin(angle: float) -> None:
    """One corner held in one direction, contact at the other: W is only rounding."""
    mesh: Any = fem.box([np.linspace(0, 2, 5), np.linspace(0, 1, 3)], "triangle")
    c, s = np.cos(np.radians(angle)), np.sin(np.radians(angle))
    turned = type(mesh)(np.array([[c, -s], [s, c]]) @ mesh.p, mesh.t)
    body = fem.Body("block", turned, fem.Material(2.1e11, 0.3, plane_stress=True))
    K, n = fem.stiffness(body), 2 * len(body.points)
    near = int(np.argmin(np.linalg.norm(mesh.p.T, axis=1)))
    far = int(np.argmin(np.linalg.norm(mesh.p.T - [2, 0], axis=1)))
    B = sparse.csr_array(([1.0, 1.0], ([0, 1], [2 * near + 1, 2 * near])), shape=(2, n))
    for places in (None, np.repeat(body.points, 2, axis=0)):
        problem = bp.ContactProblem(
            K, B, gap=[0.0], mu=5.0, fixed=[2 * far + 1], coordinates=places
        )
        assert problem.stats["rigid_motions"] == 2
        load = np.zeros((n // 2, 2))
        load[mesh.p[1] == 1, 1] = -1e6 / 5
        result = problem.solve(load.ravel())
        # The contact carries half of the load where the top lies over both corners.
        share = 1 - (body.points[mesh.p[1] == 1, 0].mean() - body.points[near, 0]) / (
            body.points[far, 0] - body.points[near, 0]
        )
        assert result.reaction[0, 0, 0] == pytest.approx(share * 1e6, rel=1e-12)


def rope(n: int, angle: float) -> tuple[Array, Any]:
    """Bars around a drum of radius 1: nodes at `n` corners, and one before and after them."""
    turn = angle / n
    corners = (np.arange(n) + 0.5) * turn
    points = np.c_[np.cos(corners), np.sin(corners)]
    step = 2 * np.sin(turn / 2)
    # The ends continue in the direction that gives equal angles at the first and last corner.
    first = points[0] - step * np.array([-np.sin(0.0), np.cos(0.0)])
    last = points[-1] + step * np.array([-np.sin(angle), np.cos(angle)])
    return np.vstack([first, points, last]), corners


@pytest.mark.parametrize("coordinates", [True, False])
@pytest.mark.parametrize(
    ("n", "ratio"),
    # ((1 + μ t) / (1 − μ t))ⁿ, t = tan(θ / 2n), μ = 0.3, θ = π; e^{0.3 π} = 2.5663.
    [(2, None), (8, 2.601049711447), (40, None)],
)
def test_a_rope_round_a_drum(n: int, ratio: float | None, coordinates: bool) -> None:
    mu, angle = 0.3, math.pi
    points, corners = rope(n, angle)
    pairs = [(i, i + 1) for i in range(n + 1)]
    K = bars(points, pairs, 1e6)
    at = 2 * (1 + np.arange(n))
    rows = np.repeat(np.arange(2 * n), 2)
    columns = np.stack([at, at + 1, at, at + 1], axis=1).ravel()
    c, s = np.cos(corners), np.sin(corners)
    values = np.stack([c, s, -s, c], axis=1).ravel()
    B = sparse.csr_array((values, (rows, columns)), shape=(2 * n, K.shape[0]))
    ends = np.r_[0, 1, K.shape[0] - 2, K.shape[0] - 1]
    problem = bp.ContactProblem(
        K,
        B,
        gap=np.zeros(n),
        mu=mu,
        fixed=ends,
        coordinates=np.repeat(points, 2, axis=0) if coordinates else None,
    )
    # 2 n unknowns, n + 1 bars.
    assert problem.stats["rigid_motions"] == n - 1
    out = 1e-3 * (points[-1] - points[-2]) / np.linalg.norm(points[-1] - points[-2])
    back = 1e-5 * (points[0] - points[1]) / np.linalg.norm(points[0] - points[1])
    result = problem.solve(prescribed=np.r_[back, out])
    assert (result.status[-1] == bp.Status.SLIP).all()
    u = result.displacement[-1].reshape(-1, 2)
    force = []
    for i, j in ((0, 1), (n, n + 1)):
        along = (points[j] - points[i]) / np.linalg.norm(points[j] - points[i])
        force.append(1e6 * along @ (u[j] - u[i]))
    t = math.tan(angle / (2 * n))
    exact = ((1 + mu * t) / (1 - mu * t)) ** n
    assert force[1] / force[0] == pytest.approx(exact, rel=1e-9)
    if ratio is not None:
        assert exact == pytest.approx(ratio, rel=1e-12)


@pytest.mark.parametrize("coordinates", [True, False])
def test_a_truss_that_leans_on_a_wall(coordinates: bool) -> None:
    """A square of four bars sways until the wall stops it: all forces follow from statics."""
    points = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]])
    K = bars(points, [(0, 1), (0, 2), (1, 3), (2, 3)], 1e6)
    # Floor under nodes 0 and 1, a frictionless wall to the left of node 2.
    rows, columns = np.arange(6), np.array([1, 0, 3, 2, 4, 5])
    B = sparse.csr_array((np.ones(6), (rows, columns)), shape=(6, 8))
    problem = bp.ContactProblem(
        K,
        B,
        gap=np.zeros(3),
        mu=[0.5, 0.5, 0.0],
        coordinates=np.repeat(points, 2, axis=0) if coordinates else None,
    )
    assert problem.stats["rigid_motions"] == 4
    load = np.zeros((4, 2))
    load[3], load[2] = [-1.0, -2.0], [0.0, -1.0]
    result = problem.solve(load.ravel())
    expected = [[1.0, 0.0], [2.0, 0.0], [1.0, 0.0]]
    # Forces of order one, rounded a few times.
    np.testing.assert_allclose(result.reaction[-1], expected, atol=1e-12)
    u = result.displacement[-1].reshape(-1, 2)
    exact = [[0, 0], [0, 0], [0, -1e-6], [-1e-6, -2e-6]]
    np.testing.assert_allclose(u, exact, atol=1e-17)
    # Without the wall it sways without limit.
    free = sparse.csr_array(B)[:4]
    with pytest.raises(bp.FloatingBodyError):
        bp.ContactProblem(K, free, gap=np.zeros(2), mu=0.5)


def test_a_belt_round_two_drums() -> None:
    """A closed belt, stretched by moving one drum away without torque: uniform tension."""
    n, apart = 6, 4.0
    half = (np.arange(n) + 0.5) * np.pi / n - np.pi / 2
    right = np.c_[np.cos(half) + apart, np.sin(half)]
    points = np.vstack([right, [apart, 0.0] - right])
    count = len(points)
    pairs = [(i, (i + 1) % count) for i in range(count)]
    lengths = [np.linalg.norm(points[j] - points[i]) for i, j in pairs]
    K = bars(points, pairs, 1e6 / np.array(lengths))
    normals = points - np.where(np.arange(count)[:, None] < n, [apart, 0.0], [0.0, 0.0])
    rows = np.repeat(np.arange(2 * count), 2)
    columns = np.tile(np.arange(2 * count).reshape(-1, 2), 2).ravel()
    values = np.c_[normals, -normals[:, 1], normals[:, 0]].ravel()
    B = sparse.csr_array((values, (rows, columns)), shape=(2 * count, 2 * count))
    # The right drum moves 1 mm to the right: its approach along each normal.
    gap = np.where(np.arange(count) < n, -1e-3 * normals[:, 0], 0.0)
    for mu in (0.0, 1e-6):
        problem = bp.ContactProblem(K, B, gap=gap, mu=mu)
        assert problem.stats["rigid_motions"] == count
        result = problem.solve(np.zeros(2 * count))
        u = result.displacement[-1].reshape(-1, 2)
        force = [
            1e6 / length * (points[j] - points[i]) / length @ (u[j] - u[i])
            for (i, j), length in zip(pairs, lengths, strict=True)
        ]
        # One tension along the whole belt; friction of 1e-6 changes it by π times as much.
        np.testing.assert_allclose(
            force, np.mean(force), rtol=1e-9 if mu == 0 else 1e-5
        )
        # The work of stretching is that of the drum, T ΔL. For the drum of 2 n corners, ΔL is
        # twice the distance, minus the part of the corners at its sides.
        stretch = np.mean(force) / 1e6 * np.sum(lengths)
        assert stretch == pytest.approx(
            2e-3 * np.sin(half[-1] + np.pi / (2 * n)), rel=1e-6
        )
