"""Elements of both orders: properties that each must have on distorted meshes."""

from itertools import combinations
from pathlib import Path
from typing import Any

import meshio
import numpy as np
import pytest
import skfem
from numpy.typing import NDArray
from scipy.sparse.linalg import spsolve

from bipot_rs import fem
from bipot_rs.fem.bodies.elasticity import vtk_cells
from bipot_rs.fem.bodies.stress_recovery import stress_at_points
from bipot_rs.files.series import write_grid
from bipot_rs.mesh import elements
from support.boxes import placed
from support.comparisons import near

Floats = NDArray[np.float64]
KINDS = {kind.vtk: kind for kind in elements.KINDS.values()}
SECOND = [vtk for vtk, kind in KINDS.items() if kind.degree == 2]
MATERIAL = fem.Material(2.0, 0.3)


def grid(vtk: str, n: int, bent: float = 0.0) -> skfem.Mesh:
    """A unit box; if ``bent``, its inner nodes are moved, those between corners included."""
    kind = KINDS[vtk]
    made = fem.box([np.linspace(0, 1, n + 1)] * kind.dim, kind.shape)
    if kind.degree == 2:
        made = fem.second_order(made, serendipity=vtk in ("quad8", "hexahedron20"))
    inner = ((made.p > 1e-9) & (made.p < 1 - 1e-9)).all(axis=0)
    random = np.random.default_rng(11)
    return placed(made, made.p + bent / n * inner * random.uniform(-1, 1, made.p.shape))


def rigid_motions(points: Floats) -> Floats:
    d = points.shape[1]
    motions = [np.broadcast_to(axis, points.shape) for axis in np.eye(d)]
    for i, j in combinations(range(d), 2):
        turn = np.zeros_like(points)
        turn[:, i], turn[:, j] = -points[:, j], points[:, i]
        motions.append(turn)
    return np.stack([m.ravel() for m in motions], axis=1)


def solve(K: Any, f: Floats, held: Any, wanted: Floats) -> Floats:
    """Displacements that are given where they are held."""
    K, u = K.tocsc(), np.where(held, wanted, 0.0)
    u[~held] = spsolve(K[~held][:, ~held], (f - K @ u)[~held])
    return u


@pytest.mark.parametrize("vtk", KINDS)
def test_the_kernel_of_the_stiffness_has_only_rigid_motions(vtk: str) -> None:
    mesh = grid(vtk, 3 - KINDS[vtk].degree, bent=0.1)
    body = fem.Body("it", mesh, MATERIAL)
    K, R = fem.stiffness(body), rigid_motions(body.points)
    # Each term of a row is rounded, and the sum of up to 400 terms after it.
    assert (abs(K @ R) <= 1e-14 * (abs(K) @ abs(R))).all()
    eigen = np.linalg.eigvalsh(K.toarray())
    assert (eigen > 1e-10 * eigen[-1]).sum() == K.shape[0] - R.shape[1]


@pytest.mark.parametrize("vtk", KINDS)
def test_patch(vtk: str) -> None:
    """A linear field prescribed on the boundary is found inside distorted cells."""
    body = fem.Body("it", grid(vtk, 4 - KINDS[vtk].degree, bent=0.1), MATERIAL)
    x, d = body.points, body.dim
    gradient = np.random.default_rng(2).uniform(-1, 1, (d, d))
    wanted = (x @ gradient.T).ravel()
    held = np.repeat(((x <= 0) | (x >= 1)).any(axis=1), d)
    # Rounding times the condition of a mesh of 2 cells a side, below 1e3.
    near(solve(fem.stiffness(body), 0 * wanted, held, wanted), wanted, 1e-12)


@pytest.mark.parametrize("vtk", SECOND)
def test_areas_and_normals(vtk: str) -> None:
    """Divergence theorem: uniform pressure has no resultant, and gives the volume."""
    mesh = grid(vtk, 2)
    # A smooth map of the whole mesh, so that the boundary is curved too.
    mesh.p[:] += 0.1 * np.sin(2 * mesh.p[::-1] + np.arange(len(mesh.p))[:, None])
    mesh = mesh.with_boundaries({"all": mesh.boundary_facets()})
    body = fem.Body("it", mesh, MATERIAL)
    points = body.surface("all")
    normals = np.asarray(points.normals)
    np.testing.assert_allclose(np.linalg.norm(normals, axis=0), 1.0, rtol=1e-14)
    model = fem.assemble([body], [])
    force = model.pressure("it", "all", -1.0).reshape(-1, body.dim)
    area = points.weights.sum()
    # The mapping is a polynomial that Gauss quadrature integrates exactly.
    near(force.sum(axis=0), 0, 1e-14 * area)
    volume = body.volume().weights.sum()
    assert np.sum(force * body.points) / body.dim == pytest.approx(volume, rel=1e-13)
    turn = rigid_motions(body.points)[:, body.dim :]
    near(force.ravel() @ turn, 0, 1e-13 * area)


def energy_error(vtk: str, n: int) -> float:
    """‖u - u_h‖² in the energy norm, with u_h equal to u on the boundary."""
    body = fem.Body("it", grid(vtk, n, bent=0.0), MATERIAL)
    d = body.dim
    lame_lambda, lame_mu = MATERIAL.lame(d)
    slope = np.eye(d) + 2 * np.roll(np.eye(d), -1, axis=1)  # ∂s_k/∂x_a

    def phase(x: Floats) -> Floats:
        return np.stack([x[k] + 2 * x[k - 1] for k in range(d)])

    def force(x: Floats) -> Floats:
        # -div σ with u_k = sin(s_k), s_k = x_k + 2 x_{k-1}, k cyclic.
        second = -np.sin(phase(x))
        laplace = 5 * second  # |∂s_k|² = 1 + 2²
        # ∂_a div u, where div u = Σ ∂s_k/∂x_k cos s_k, of slope 1.
        divergence = np.tensordot(slope.T, second, 1)
        return -((lame_lambda + lame_mu) * divergence + lame_mu * laplace)

    model = fem.assemble([body], [])
    x = body.points
    held = np.repeat(((x <= 0) | (x >= 1)).any(axis=1), d)
    wanted = np.sin(phase(x.T)).T.ravel()
    u = solve(model.K, model.body_force("it", force), held, wanted)
    # At the Gauss points, compared with the smooth field.
    points = body.volume()
    gradient = np.cos(phase(points.places))[:, None] * slope[:, :, None, None]
    strain = 0.5 * (gradient + gradient.swapaxes(0, 1))
    exact = np.einsum("abcd,cdpq->abpq", MATERIAL.tensor(d), strain)
    off = stress_at_points(body, u)[:d, :d] - exact
    return float(np.einsum("abpq,abpq,pq->", off, off, points.weights))


@pytest.mark.parametrize("vtk", SECOND)
def test_energy_converges_as_the_fourth_power(vtk: str) -> None:
    few, many = (3, 6) if KINDS[vtk].dim == 3 else (6, 12)
    order = np.log2(energy_error(vtk, few) / energy_error(vtk, many))
    # At the Gauss points some elements have more exact stresses than elsewhere.
    assert order > 3.6


@pytest.mark.parametrize("mirrored", [False, True])
@pytest.mark.parametrize("vtk", KINDS)
def test_vtk_has_the_volume_and_the_places(
    vtk: str, mirrored: bool, tmp_path: Path
) -> None:
    """The mesh as VTK's order of nodes defines it, by an independent formula."""
    made = grid(vtk, 2, bent=0.1)
    made.p[0] *= -1 if mirrored else 1
    body = fem.Body("it", type(made)(made.p, made.t), MATERIAL)
    kind, cells = vtk_cells(body)
    points = np.zeros((len(body.points), 3))
    points[:, : body.dim] = body.points
    blocks = [(kind, cells)]
    write_grid(tmp_path / "it.vtu", points, blocks, {}, {}, numbers={}, units={})
    read = meshio.read(tmp_path / "it.vtu")
    assert [block.type for block in read.cells] == [kind] == [vtk]
    nodes = read.points[read.cells[0].data]  # (cells, nodes, 3)
    volumes = [monomial_volume(vtk, cell[:, : body.dim]) for cell in nodes]
    assert min(volumes) > 0
    assert sum(volumes) == pytest.approx(1.0, rel=1e-12)


def monomial_volume(vtk: str, nodes: Floats) -> float:
    """Volume of one cell by fitting monomials to its nodes, in the order of VTK's manual,
    and integrating the Jacobian with many points; negative if mirrored."""
    square = [(0, 0), (1, 0), (1, 1), (0, 1)]
    corner, edges = {
        "tri": ([(0, 0), (1, 0), (0, 1)], "01 12 20"),
        "qua": (square, "01 12 23 30"),
        "tet": ([(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)], "01 12 20 03 13 23"),
        "hex": (
            [(*xy, z) for z in (0, 1) for xy in square],
            "01 12 23 30 45 56 67 74 04 15 26 37",
        ),
    }[vtk[:3]]
    degree, at = KINDS[vtk].degree, [np.array(c, float) for c in corner]
    if degree == 2:
        at += [0.5 * (at[int(a)] + at[int(b)]) for a, b in edges.split()]
    faces = {"hexahedron27": "0473 1265 0154 3762 0321 4567", "quad9": ""}
    if vtk in faces:
        at += [np.mean([at[int(k)] for k in f], axis=0) for f in faces[vtk].split()]
        at.append(np.mean(at[: len(corner)], axis=0))
    xi = np.array(at)
    d = xi.shape[1]
    simplex = vtk[:3] in ("tri", "tet")
    powers = [
        p for p in np.ndindex(*[degree + 1] * d) if not simplex or sum(p) <= degree
    ]
    if vtk in ("quad8", "hexahedron20"):  # superlinear degree at most 2
        powers = [p for p in powers if sum(k for k in p if k > 1) <= 2]
    V = np.stack([np.prod(xi**p, axis=1) for p in np.array(powers)], axis=1)
    coefficient = np.linalg.solve(V, nodes)
    g, w = np.polynomial.legendre.leggauss(6)
    g, w = 0.5 * (g + 1), 0.5 * w
    q = np.stack(np.meshgrid(*[g] * d, indexing="ij"), -1).reshape(-1, d)
    weight = np.prod(np.stack(np.meshgrid(*[w] * d, indexing="ij"), -1), -1).ravel()
    if simplex:  # Duffy's map of the cube onto the simplex
        cube = q.copy()
        for k in range(1, d):
            q[:, k] = cube[:, k] * np.prod(1 - cube[:, :k], axis=1)
            weight = weight * (1 - cube[:, k - 1]) ** (d - k)
    jacobian = np.zeros((len(q), d, d))
    for p, c in zip(powers, coefficient, strict=True):
        for b in np.flatnonzero(p):
            lower = np.array(p) - np.eye(d, dtype=int)[b]
            jacobian[:, :, b] += p[b] * np.prod(q**lower, axis=1)[:, None] * c
    return float(weight @ np.linalg.det(jacobian))


@pytest.mark.parametrize("vtk", ["triangle6", "quad9", "quad8", "hexahedron27"])
def test_two_blocks_of_second_order(vtk: str) -> None:
    """One on another with matching nodes, on a plane: uniaxial stress passes through both."""
    mesh, d, p = grid(vtk, 2), KINDS[vtk].dim, 0.01
    up = np.eye(d)[-1]
    lifted = placed(mesh, mesh.p + up[:, None])
    blocks = [fem.Body("lower", mesh, MATERIAL), fem.Body("upper", lifted, MATERIAL)]
    contacts = [
        fem.Contact("upper", "bottom", 0.3, against=("lower", "top")),
        fem.Contact("lower", "bottom", 0.0, plane=(0 * up, up)),
    ]
    sides = [
        fem.Symmetry(body.name, side)
        for body in blocks
        for side in ("left", "front")[: d - 1]
    ]
    model = fem.assemble(blocks, contacts, symmetries=sides)
    # Simpson's weights per direction: 1, 4, 2, 4, 1 over 12 on two facets.
    line = np.array([1, 4, 2, 4, 1]) / 12
    weights = line if d == 2 else np.outer(line, line).ravel()
    areas = np.repeat(np.sort(weights), 2)
    np.testing.assert_allclose(np.sort(model.area), areas, rtol=1e-13)
    load = model.pressure("upper", "top", p)
    result = model.problem().solve(load, model.prescribed([]))
    np.testing.assert_allclose(result.traction[0, :, 0], p, rtol=1e-8)
    for body in blocks:
        u = model.displacement_of(body.name, result.displacement[0])
        near(fem.stress(body, u) + p * np.outer(up, up), 0, 1e-8 * p)
    # ε = p/E upwards in 3D, p (1 - ν²)/E in plane strain.
    down = -2 * p / 2.0 * (1 if d == 3 else 1 - 0.3**2)
    np.testing.assert_allclose(u[blocks[1].nodes("top"), -1], down, rtol=1e-8)
