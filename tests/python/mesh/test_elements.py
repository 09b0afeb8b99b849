"""Elements of both orders: properties that each must have on distorted meshes."""

from itertools import combinations
from pathlib import Path

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

Floats = NDArray[np.float64]
DIM = {"triangle": 2, "quadrilateral": 2, "tetrahedron": 3, "hexahedron": 3}
# VTK cell type and its shape; whether it is the type with fewer nodes.
SECOND = {
    "triangle6": ("triangle", False),
    "quad9": ("quadrilateral", False),
    "quad8": ("quadrilateral", True),
    "tetra10": ("tetrahedron", False),
    "hexahedron27": ("hexahedron", False),
    "hexahedron20": ("hexahedron", True),
}
MATERIAL = fem.Material(2.0, 0.3)


def grid(vtk: str, n: int, bent: float = 0.0) -> skfem.Mesh:
    """A unit box; if ``bent``, its inner nodes are moved, those between corners included."""
    shape, few = SECOND[vtk]
    made = fem.box([np.linspace(0, 1, n + 1)] * DIM[shape], shape)
    made = elements.second_order(made, serendipity=few)
    inner = ((made.p > 1e-9) & (made.p < 1 - 1e-9)).all(axis=0)
    random = np.random.default_rng(11)
    moved = made.p + bent / n * inner * random.uniform(-1, 1, made.p.shape)
    return type(made)(moved, made.t, made.boundaries)


def rigid_motions(points: Floats) -> Floats:
    d = points.shape[1]
    motions = [np.broadcast_to(axis, points.shape) for axis in np.eye(d)]
    for i, j in combinations(range(d), 2):
        turn = np.zeros_like(points)
        turn[:, i], turn[:, j] = -points[:, j], points[:, i]
        motions.append(turn)
    return np.stack([m.ravel() for m in motions], axis=1)


@pytest.mark.parametrize("vtk", SECOND)
def test_the_kernel_of_the_stiffness_has_only_rigid_motions(vtk: str) -> None:
    body = fem.Body("it", grid(vtk, 2, bent=0.1), MATERIAL)
    K, R = fem.stiffness(body), rigid_motions(body.points)
    # Rounding of the sums over the nodes of a row, some 200 entries.
    assert np.abs(K @ R).max() <= 1e-13 * abs(K).max() * 10
    eigen = np.linalg.eigvalsh(K.toarray())
    assert (eigen > 1e-10 * eigen[-1]).sum() == K.shape[0] - R.shape[1]


@pytest.mark.parametrize("vtk", SECOND)
def test_patch(vtk: str) -> None:
    """A linear field prescribed on the boundary is found inside, with its stress."""
    body = fem.Body("it", grid(vtk, 2, bent=0.1), MATERIAL)
    x, d = body.points, body.dim
    gradient = np.random.default_rng(2).uniform(-1, 1, (d, d))
    wanted = (x @ gradient.T).ravel()
    K = fem.stiffness(body).tocsc()
    border = ((x <= 0) | (x >= 1)).any(axis=1)
    held = np.repeat(border, d)
    u = np.where(held, wanted, 0.0)
    u[~held] = spsolve(K[~held][:, ~held], -(K @ u)[~held])
    # Rounding times the condition of a mesh of 2 cells a side, below 1e3.
    np.testing.assert_allclose(u, wanted, atol=1e-12)


@pytest.mark.parametrize("vtk", SECOND)
def test_areas_and_normals(vtk: str) -> None:
    """Divergence theorem: uniform pressure has no resultant, and gives the volume."""
    mesh = grid(vtk, 2)
    # A smooth map of the whole mesh, so that the boundary is curved too.
    x = mesh.p
    bent = x + 0.1 * np.sin(2 * x[::-1] + np.arange(len(x))[:, None])
    mesh = type(mesh)(bent, mesh.t)
    mesh = mesh.with_boundaries({"all": mesh.boundary_facets()})
    body = fem.Body("it", mesh, MATERIAL)
    points = body.surface("all")
    normals = np.asarray(points.normals)
    np.testing.assert_allclose(np.linalg.norm(normals, axis=0), 1.0, rtol=1e-14)
    model = fem.assemble([body], [])
    force = model.pressure("it", "all", -1.0).reshape(-1, body.dim)
    area = points.weights.sum()
    # The mapping is a polynomial that Gauss quadrature integrates exactly.
    np.testing.assert_allclose(force.sum(axis=0), 0.0, atol=1e-14 * area)
    volume = body.volume().weights.sum()
    assert np.sum(force * body.points) / body.dim == pytest.approx(volume, rel=1e-13)
    turn = rigid_motions(body.points)[:, body.dim :]
    np.testing.assert_allclose(force.ravel() @ turn, 0.0, atol=1e-13 * area)


def smooth(x: Floats) -> Floats:
    """A displacement that no element can represent, as a function of points ``(d, ...)``."""
    return np.stack([np.sin(x[k] + 2 * x[k - 1]) for k in range(len(x))])


def energy_error(vtk: str, n: int) -> float:
    """‖u - u_h‖² in the energy norm, with u_h equal to u on the boundary."""
    body = fem.Body("it", grid(vtk, n, bent=0.0), MATERIAL)
    d = body.dim
    lame_lambda, lame_mu = MATERIAL.lame(d)

    def force(x: Floats) -> Floats:
        # -div σ with u_k = sin(s_k), s_k = x_k + 2 x_{k-1}, k cyclic.
        s = np.stack([x[k] + 2 * x[k - 1] for k in range(d)])
        slope = np.eye(d) + 2 * np.roll(np.eye(d), -1, axis=1)  # ∂s_k/∂x_a
        second = -np.sin(s)
        laplace = np.stack([second[k] * (slope[k] @ slope[k]) for k in range(d)])
        divergence = np.stack(
            [
                sum(second[k] * slope[k, k] * slope[k, a] for k in range(d))
                for a in range(d)
            ]
        )
        return -((lame_lambda + lame_mu) * divergence + lame_mu * laplace)

    model = fem.assemble([body], [])
    x = body.points
    held = np.repeat(((x <= 0) | (x >= 1)).any(axis=1), d)
    wanted = smooth(x.T).T.ravel()
    u = np.where(held, wanted, 0.0)
    f = model.body_force("it", force)
    K = model.K.tocsc()
    u[~held] = spsolve(K[~held][:, ~held], (f - K @ u)[~held])
    # At the Gauss points, compared with the smooth field.
    points = body.volume()
    s = np.stack([points.places[k] + 2 * points.places[k - 1] for k in range(d)])
    slope = np.eye(d) + 2 * np.roll(np.eye(d), -1, axis=1)
    gradient = np.cos(s)[:, None] * slope[:, :, None, None]
    strain = 0.5 * (gradient + gradient.swapaxes(0, 1))
    exact = np.einsum("abcd,cdpq->abpq", MATERIAL.tensor(d), strain)
    off = stress_at_points(body, u)[:d, :d] - exact
    return float(np.einsum("abpq,abpq,pq->", off, off, points.weights))


@pytest.mark.parametrize("vtk", SECOND)
def test_energy_converges_as_the_fourth_power(vtk: str) -> None:
    few, many = (3, 6) if DIM[SECOND[vtk][0]] == 3 else (6, 12)
    order = np.log2(energy_error(vtk, few) / energy_error(vtk, many))
    # At the Gauss points some elements have more exact stresses than elsewhere.
    assert order > 3.6


@pytest.mark.parametrize("vtk", SECOND)
def test_vtk_has_the_volume_and_the_places(vtk: str, tmp_path: Path) -> None:
    """The mesh as VTK's order of nodes defines it, by an independent formula."""
    body = fem.Body("it", grid(vtk, 2, bent=0.1), MATERIAL)
    kind, cells = vtk_cells(body)
    assert kind == vtk
    points = np.zeros((len(body.points), 3))
    points[:, : body.dim] = body.points
    cells = [(kind, cells)]
    write_grid(tmp_path / "it.vtu", points, cells, {}, {}, numbers={}, units={})
    read = meshio.read(tmp_path / "it.vtu")
    assert [block.type for block in read.cells] == [vtk]
    nodes = read.points[read.cells[0].data]  # (cells, nodes, 3)
    volume = sum(monomial_volume(vtk, cell[:, : body.dim]) for cell in nodes)
    assert volume == pytest.approx(1.0, rel=1e-12)


def monomial_volume(vtk: str, nodes: Floats) -> float:
    """Volume of one cell by fitting monomials to its nodes, in the order of VTK's manual,
    and integrating the Jacobian with many points; negative if mirrored."""
    corner = {
        "tri": [(0, 0), (1, 0), (0, 1)],
        "qua": [(0, 0), (1, 0), (1, 1), (0, 1)],
        "tet": [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)],
        "hex": [
            (0, 0, 0),
            (1, 0, 0),
            (1, 1, 0),
            (0, 1, 0),
            (0, 0, 1),
            (1, 0, 1),
            (1, 1, 1),
            (0, 1, 1),
        ],
    }[vtk[:3]]
    pairs = {
        "tri": "01 12 20",
        "qua": "01 12 23 30",
        "tet": "01 12 20 03 13 23",
        "hex": "01 12 23 30 45 56 67 74 04 15 26 37",
    }[vtk[:3]]
    at = [np.array(c, float) for c in corner]
    at += [0.5 * (at[int(a)] + at[int(b)]) for a, b in pairs.split()]
    faces = {"hexahedron27": "0473 1265 0154 3762 0321 4567", "quad9": ""}
    if vtk in faces:
        at += [np.mean([at[int(k)] for k in f], axis=0) for f in faces[vtk].split()]
        at.append(np.mean(at[: len(corner)], axis=0))
    xi = np.array(at)
    d = xi.shape[1]
    simplex = vtk[:3] in ("tri", "tet")
    powers = [p for p in np.ndindex(*[3] * d) if (sum(p) <= 2 if simplex else True)]
    if vtk in ("quad8", "hexahedron20"):  # # superlinear degree at most 2
        powers = [p for p in powers if sum(k for k in p if k > 1) <= 2]
    V = np.stack([np.prod(xi**p, axis=1) for p in np.array(powers)], axis=1)
    coefficient = np.linalg.solve(V, nodes)
    g, w = np.polynomial.legendre.leggauss(6)
    g, w = 0.5 * (g + 1), 0.5 * w
    q = np.stack(np.meshgrid(*[g] * d, indexing="ij"), -1).reshape(-1, d)
    weight = np.prod(np.stack(np.meshgrid(*[w] * d, indexing="ij"), -1), -1).ravel()
    if simplex:  # # Duffy's map of the cube onto the simplex
        cube = q.copy()
        for k in range(1, d):
            q[:, k] = cube[:, k] * np.prod(1 - cube[:, :k], axis=1)
            weight = weight * (1 - cube[:, k - 1]) ** (d - k)
    jacobian = np.zeros((len(q), d, d))
    for p, c in zip(powers, coefficient, strict=True):
        for b in range(d):
            if p[b]:
                lower = np.array(p)
                lower[b] -= 1
                jacobian[:, :, b] += p[b] * np.prod(q**lower, axis=1)[:, None] * c
    return float(weight @ np.linalg.det(jacobian))


@pytest.mark.parametrize("vtk", SECOND)
def test_mirrored_meshes_are_written_upright(vtk: str) -> None:
    made = grid(vtk, 1)
    mirrored = type(made)(
        made.p * np.array([-1.0] + [1.0] * (len(made.p) - 1))[:, None], made.t
    )
    body = fem.Body("it", mirrored, MATERIAL)
    _, cells = vtk_cells(body)
    volumes = [monomial_volume(vtk, body.points[cell]) for cell in cells]
    assert min(volumes) > 0
    assert sum(volumes) == pytest.approx(1.0, rel=1e-12)


@pytest.mark.parametrize("vtk", ["tetra10", "hexahedron20"])
def test_contact_at_nodes_refuses_negative_areas(vtk: str) -> None:
    body = fem.Body("it", grid(vtk, 1), MATERIAL)
    contact = fem.Contact("it", "bottom", 0.3, plane=((0, 0, 0), (0, 0, 1)))
    with pytest.raises(ValueError, match=r"'bottom'.*pairing=\"mortar\""):
        fem.assemble([body], [contact])
    # The negative areas.
    points = body.surface("bottom")
    area = points.moment(np.ones(points.weights.shape))[body.nodes("bottom")]
    assert area.min() < 1e-15
    assert area.sum() == pytest.approx(1.0, rel=1e-14)


@pytest.mark.parametrize("vtk", ["triangle6", "quad9", "quad8", "hexahedron27"])
def test_pressed_block_of_second_order(vtk: str) -> None:
    """Uniform pressure on a frictionless plane: the tractions equal that pressure."""
    body = fem.Body("it", grid(vtk, 2), MATERIAL)
    d = body.dim
    point, normal = np.zeros(d), np.eye(d)[-1]
    contact = fem.Contact("it", "bottom", 0.0, plane=(point, normal))
    symmetries = [fem.Symmetry("it", name) for name in ("left", "front")[: d - 1]]
    model = fem.assemble([body], [contact], symmetries=symmetries)
    load = model.pressure("it", "top", 0.01)
    result = model.problem().solve(load, model.prescribed([]))
    np.testing.assert_allclose(result.traction[0, :, 0], 0.01, rtol=1e-9)
    # ε = p/E upwards in 3D, p (1 - ν²)/E in plane strain.
    height = result.displacement[0].reshape(-1, d)[body.nodes("top"), -1]
    share = 1 if d == 3 else 1 - 0.3**2
    np.testing.assert_allclose(height, -0.01 / 2.0 * share, rtol=1e-8)


@pytest.mark.parametrize("vtk", ["triangle6", "quad9", "quad8", "hexahedron27"])
def test_two_blocks_of_second_order(vtk: str) -> None:
    """One block on another with matching nodes: uniaxial stress passes through both."""
    blocks = []
    for name, shift in (("lower", 0.0), ("upper", 1.0)):
        mesh = grid(vtk, 2)
        up = shift * np.eye(len(mesh.p))[:, -1:]
        blocks.append(
            fem.Body(name, type(mesh)(mesh.p + up, mesh.t, mesh.boundaries), MATERIAL)
        )
    d = blocks[0].dim
    contact = fem.Contact("upper", "bottom", 0.3, against=("lower", "top"))
    sides = [
        fem.Symmetry(name, side)
        for name in ("lower", "upper")
        for side in ("left", "front")[: d - 1]
    ]
    sides.append(fem.Symmetry("lower", "bottom"))
    model = fem.assemble(blocks, [contact], symmetries=sides)
    # Simpson's weights per direction: 1, 4, 2, 4, 1 over 12 on two facets.
    line = np.array([1, 4, 2, 4, 1]) / 12
    weights = line if d == 2 else np.outer(line, line).ravel()
    np.testing.assert_allclose(np.sort(model.area), np.sort(weights), rtol=1e-13)
    load = model.pressure("upper", "top", 0.01)
    result = model.problem().solve(load, model.prescribed([]))
    np.testing.assert_allclose(result.traction[0, :, 0], 0.01, rtol=1e-8)
    wanted = np.zeros((d, d))
    wanted[-1, -1] = -0.01
    for body in blocks:
        u = model.displacement_of(body.name, result.displacement[0])
        np.testing.assert_allclose(fem.stress(body, u) - wanted, 0.0, atol=1e-8 * 0.01)


def test_large_meshes_are_made_without_a_warning(
    caplog: pytest.LogCaptureFixture,
) -> None:
    """scikit-fem warns about arrays that it must copy, from a thousand cells on."""
    square = skfem.MeshQuad.init_tensor(*[np.linspace(0, 1, 41)] * 2)
    caplog.clear()
    corners, cells = (np.ascontiguousarray(a.T) for a in (square.p, square.t))
    made, _ = elements.make_mesh("quad", corners, cells)
    assert made.t.shape[1] == 1600
    assert not caplog.records
    # Cells in the wrong memory order give that warning.
    skfem.MeshQuad(made.p, np.asfortranarray(made.t))
    assert [record.levelname for record in caplog.records] == ["WARNING"]
