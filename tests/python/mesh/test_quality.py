"""Mistakes in meshes: each is found, and a correct mesh passes."""

from pathlib import Path

import numpy as np
import pytest
import skfem

from bipot_rs import fem
from bipot_rs.mesh import elements
from support import places
from support.comparisons import refused

SHAPES = {"triangle": 2, "quadrilateral": 2, "tetrahedron": 3, "hexahedron": 3}
DATA = places.DATA / "meshes"
SCALE = [1.0, 1e-9, 1e6]  # # no check may depend on the unit of length


def grid(shape: str, scale: float = 1.0, n: int = 3) -> skfem.Mesh:
    return fem.box([scale * np.linspace(1, 2, n + 1)] * SHAPES[shape], shape)


def inner_node(mesh: skfem.Mesh) -> int:
    low, high = mesh.p.min(axis=1)[:, None], mesh.p.max(axis=1)[:, None]
    return int(np.flatnonzero(((mesh.p > low) & (mesh.p < high)).all(axis=0))[0])


@pytest.mark.parametrize("scale", SCALE)
@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("degree", [1, 2])
def test_good_meshes_pass(shape: str, degree: int, scale: float) -> None:
    mesh = grid(shape, scale)
    random = np.random.default_rng(0)
    moved = mesh.p + 0.05 * scale * random.uniform(-1, 1, mesh.p.shape)
    mesh = type(mesh)(moved, mesh.t)
    fem.check_mesh(mesh if degree == 1 else elements.second_order(mesh))
    mirrored = np.concatenate([-moved[:1], moved[1:]])
    fem.check_mesh(type(mesh)(mirrored, mesh.t))


@pytest.mark.parametrize("scale", SCALE)
@pytest.mark.parametrize("shape", SHAPES)
def test_a_node_moved_through_its_cells(shape: str, scale: float) -> None:
    mesh = grid(shape, scale)
    p = mesh.p.copy()
    p[:, inner_node(mesh)] += 0.7 * scale
    with refused(r"^mesh has .*(inverted|folded) .* at \(.*\)"):
        fem.check_mesh(type(mesh)(p, mesh.t))


@pytest.mark.parametrize("scale", SCALE)
@pytest.mark.parametrize("shape", SHAPES)
def test_a_cell_that_is_flat(shape: str, scale: float) -> None:
    dim = SHAPES[shape]
    mesh = fem.box([scale * np.linspace(0, 1, 2)] * dim, shape)
    p = mesh.p.copy()
    p[-1] = 0.0
    with refused(r"flat cells?, the first is cell 0 at .*is 0,"):
        fem.check_mesh(type(mesh)(p, mesh.t), "mesh")


def test_middles_out_of_place_fold_a_cell() -> None:
    mesh = elements.second_order(grid("triangle"))
    p = mesh.p.copy()
    # Beyond a quarter of the side the mapping folds at the corner.
    edge = mesh.facets[:, 0]
    node = elements.facet_nodes(mesh, np.array([0]))[0, 2]
    p[:, node] = 0.02 * mesh.p[:, edge[0]] + 0.98 * mesh.p[:, edge[1]]
    with refused("folded cell"):
        fem.check_mesh(type(mesh)(p, mesh.t))
    body = fem.Body("it", type(mesh)(p, mesh.t), fem.Material(1.0, 0.3))
    with refused(r"cell .* of body 'it' is folded or flat, at"):
        fem.stiffness(body)


@pytest.mark.parametrize("shape", SHAPES)
def test_pieces(shape: str) -> None:
    mesh = grid(shape)
    cells = mesh.t.shape[1]
    apart = type(mesh)(
        np.hstack([mesh.p, mesh.p + 5.0]), np.hstack([mesh.t, mesh.t + mesh.p.shape[1]])
    ).with_subdomains({"second": np.arange(cells, 2 * cells)})
    with refused(r"consists of 2 pieces .* group="):
        fem.check_mesh(apart)
    unnamed = type(mesh)(apart.p, apart.t)
    with refused(r"name the volumes in the mesh, and .* group="):
        fem.check_mesh(unnamed)
    up = np.zeros((len(mesh.p), 1))
    up[-1] = 1.0
    touching = type(mesh)(np.hstack([mesh.p, mesh.p + up]), apart.t)
    with refused(r"2 pieces .*from the rest is 0, .*merge double nodes"):
        fem.check_mesh(touching)


@pytest.mark.parametrize("scale", SCALE)
def test_a_mesh_cut_open(scale: float) -> None:
    """A square whose middle line has duplicate nodes, except at its ends."""
    mesh = grid("quadrilateral", scale, n=4)
    y = mesh.p[1] / scale
    x = mesh.p[0] / scale
    line = np.flatnonzero((np.abs(y - 1.5) < 0.1) & (x > 1.1) & (x < 1.9))
    twin = {node: mesh.p.shape[1] + k for k, node in enumerate(line.tolist())}
    t = mesh.t.copy()
    above = mesh.p[1][t].mean(axis=0) > 1.5 * scale
    for node, other in twin.items():
        t[:, above] = np.where(t[:, above] == node, other, t[:, above])
    for shift in (0.0, 1e-9):
        p = np.hstack([mesh.p, mesh.p[:, line] + shift * scale])
        with refused(r"6 nodes on its boundary .* merge them"):
            fem.check_mesh(type(mesh)(p, t))


def test_overlapping_cells() -> None:
    mesh = grid("triangle", n=1)
    t = np.hstack([mesh.t, mesh.t[:, :1], mesh.t[:, :1]])
    with refused(r"mesh has 4 cells at one facet"):
        fem.check_mesh(type(mesh)(mesh.p, t))


def test_no_cells_and_no_numbers() -> None:
    mesh = grid("triangle")
    p = mesh.p.copy()
    p[0, 3] = np.nan
    with refused(r"^upper has node 3 at \(nan, "):
        fem.check_mesh(type(mesh)(p, mesh.t), "upper")
    with pytest.raises(TypeError, match="is a MeshLine1, expected MeshTri1"):
        fem.check_mesh(skfem.MeshLine1())
    empty = skfem.MeshTri1(np.zeros((2, 0)), np.zeros((3, 0), int))
    with refused("mesh has no cells"):
        fem.check_mesh(empty)


def test_files_are_checked_by_default(tmp_path: Path) -> None:
    text = (DATA / "tetra.inp").read_text()
    lines = text.splitlines()
    at = next(i for i, line in enumerate(lines) if line.startswith("18, "))
    assert lines[at] == "18, 1, 0.5, 1"
    lines[at] = "18, 1, 0.5, -3"
    path = tmp_path / "bad.inp"
    path.write_text("\n".join(lines))
    with refused(r"bad\.inp has an inverted cell: cells"):
        fem.read_mesh(path)
    assert fem.read_mesh(path, check=False).t.shape[1] == 200
