"""Supports and contacts that are just enough, that are too few, or that allow a mechanism."""

import math
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import sparse

import bipot_rs as bp
from bipot_rs import fem
from support.contacts import rigid_rows
from support.sheets import rotation

Array = NDArray[np.float64]

CELLS = {2: ("triangle", "quadrilateral"), 3: ("tetrahedron", "hexahedron")}


def block(rng: np.random.Generator, dim: int) -> fem.Body:
    """A rotated block of random cells, with sides of random sizes."""
    cells = rng.integers(1, 5 if dim == 2 else 3, dim)
    axes = [np.linspace(0, rng.uniform(0.5, 3.0), int(count) + 1) for count in cells]
    mesh: Any = fem.box(axes, str(rng.choice(CELLS[dim])))
    turned = type(mesh)(rotation(int(rng.integers(1 << 30)), dim) @ mesh.p, mesh.t)
    return fem.Body("block", turned, fem.Material(2.1e11, 0.3))


def _motions(nodes: Array) -> Array:
    """Rigid motions of all degrees of freedom, as columns."""
    return rigid_rows(
        (nodes - nodes.mean(axis=0)) / np.ptp(nodes), np.eye(nodes.shape[1])
    )


def _held(
    rng: np.random.Generator, nodes: Array, lowest: int
) -> NDArray[np.int64] | None:
    """Degrees of freedom that, with the contact, hold all motions well enough."""
    count, dim = nodes.shape
    others = np.setdiff1d(np.arange(dim * count), np.arange(dim) + dim * lowest)
    missing = dim * (dim + 1) // 2 - dim
    fixed = np.sort(rng.choice(others, missing, replace=False))
    pinned = np.r_[dim * lowest + np.arange(dim), fixed]
    least = np.linalg.svd(_motions(nodes)[pinned])[1].min()
    return fixed if least > 0.05 else None


@pytest.mark.slow
def test_statically_determinate_bodies() -> None:
    """A rotated block of steel on one contact node, held in a few directions.

    Its load presses the contact and pulls along it by less than friction can hold. Reactions
    follow from statics.
    """
    for seed in range(1260):
        rng, dim = np.random.default_rng(seed), 2 + seed % 2
        body = block(rng, dim)
        K, nodes = fem.stiffness(body), body.points
        n, lowest = K.shape[0], int(np.argmin(nodes[:, -1]))
        rows = [dim * lowest + dim - 1, *range(dim * lowest, dim * lowest + dim - 1)]
        B = sparse.csr_array((np.ones(dim), (np.arange(dim), rows)), shape=(dim, n))
        reaction = np.zeros(1)
        # It must be well inside the cone.
        while reaction[0] <= np.linalg.norm(reaction[1:dim]):
            fixed = _held(rng, nodes, lowest)
            if fixed is not None:
                load, Z = np.zeros(nodes.shape), _motions(nodes)
                some = rng.choice(len(nodes), 3, replace=False)
                load[some] = rng.uniform(-1e6, 1e6, (3, dim))
                load = load.ravel()
                reaction = np.linalg.solve(Z[np.r_[rows, fixed]].T, -Z.T @ load)
        problem = bp.ContactProblem(
            K,
            B,
            gap=np.zeros(1),
            mu=5.0,
            fixed=fixed,
            coordinates=np.repeat(nodes, dim, axis=0) if seed % 4 < 2 else None,
        )
        step = problem.solve(load)[0]
        # The lever arms of the supports are at least 0.05 of the block.
        size = np.abs(reaction).max()
        assert np.abs(step.reaction[0] - reaction[:dim]).max() <= 1e-11 * size, seed
        assert step.status[0] == bp.Status.STICK, seed
        # W has the size of the compliances of K: it is not a quotient of rounding errors.
        u, r = step.displacement, step.reaction.ravel()
        far = np.abs(step.relative_displacement).max()
        assert far <= 1e-11 * np.abs(u).max(), seed
        rest = np.delete(K @ u - load - B.T @ r, fixed)
        # Rounding of the terms.
        assert np.abs(rest).max() <= 1e-14 * (abs(K) @ np.abs(u)).max(), seed


def bars(points: Array, pairs: Any, stiffness: Any) -> Any:
    """Stiffness of pin-jointed bars with EA / length = `stiffness` each."""
    n, dim = points.size, points.shape[1]
    K = np.zeros((n, n))
    for (i, j), k in zip(pairs, np.broadcast_to(stiffness, len(pairs)), strict=True):
        along = (points[j] - points[i]) / np.linalg.norm(points[j] - points[i])
        b = np.zeros(n)
        b[dim * i : dim * i + dim], b[dim * j : dim * j + dim] = -along, along
        K += k * np.outer(b, b)
    return sparse.csr_array(K)


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
