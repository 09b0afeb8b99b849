"""Mistakes in meshes: each is found, and a correct mesh passes."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import skfem

from bipot_rs import fem
from bipot_rs.mesh import elements
from support import places
from support.boxes import CELLS, box
from support.comparisons import refused

DATA = places.DATA / "meshes"
SCALE = [1.0, 1e-9, 1e6]  # # no check may depend on the unit of length


def grid(cell: str, scale: float = 1.0, n: int = 3) -> Any:
    return box(cell, scale * np.linspace(1, 2, n + 1))


@pytest.mark.parametrize("scale", SCALE)
@pytest.mark.parametrize("cell", CELLS)
@pytest.mark.parametrize("degree", [1, 2])
def test_good_meshes_pass(cell: str, degree: int, scale: float) -> None:
    mesh = box(cell, scale * np.linspace(1, 2, 4), degree=degree, bent=0.05 * scale)
    fem.check_mesh(mesh)
    mesh.p[0] *= -1
    fem.check_mesh(type(mesh)(mesh.p, mesh.t))


@pytest.mark.parametrize("scale", SCALE)
@pytest.mark.parametrize("cell", CELLS)
def test_a_node_moved_through_its_cells(cell: str, scale: float) -> None:
    mesh = grid(cell, scale)
    inner = ((mesh.p > scale) & (mesh.p < 2 * scale)).all(axis=0)
    mesh.p[:, np.flatnonzero(inner)[0]] += 0.7 * scale
    with refused(r"^mesh has .*(inverted|folded) .* at \(.*\)"):
        fem.check_mesh(mesh)


@pytest.mark.parametrize("scale", SCALE)
@pytest.mark.parametrize("cell", CELLS)
def test_a_cell_that_is_flat(cell: str, scale: float) -> None:
    mesh = grid(cell, scale, 1)
    mesh.p[-1] = 0.0
    with refused(r"flat cells?, the first is cell 0 at .*is 0,"):
        fem.check_mesh(mesh, "mesh")


def test_middles_out_of_place_fold_a_cell() -> None:
    mesh = elements.second_order(grid("triangle"))
    # Beyond a quarter of the side the mapping folds at the corner.
    one, other = mesh.p[:, mesh.facets[:, 0]].T
    node = elements.facet_nodes(mesh, np.array([0]))[0, 2]
    mesh.p[:, node] = 0.02 * one + 0.98 * other
    with refused("folded cell"):
        fem.check_mesh(mesh)
    with refused(r"cell .* of body 'it' is folded or flat, at"):
        fem.stiffness(fem.Body("it", mesh, fem.Material(1.0, 0.3)))


@pytest.mark.parametrize("cell", CELLS)
def test_pieces(cell: str) -> None:
    mesh = grid(cell)
    cells = np.hstack([mesh.t, mesh.t + mesh.p.shape[1]])
    unnamed = type(mesh)(np.hstack([mesh.p, mesh.p + 5.0]), cells)
    second = np.arange(mesh.t.shape[1], cells.shape[1])
    with refused(r"consists of 2 pieces .* group="):
        fem.check_mesh(unnamed.with_subdomains({"second": second}))
    with refused(r"name the volumes in the mesh, and .* group="):
        fem.check_mesh(unnamed)
    up = np.eye(len(mesh.p))[:, -1:]
    with refused(r"2 pieces .*from the rest is 0, .*merge double nodes"):
        fem.check_mesh(type(mesh)(np.hstack([mesh.p, mesh.p + up]), cells))


@pytest.mark.parametrize("scale", SCALE)
@pytest.mark.parametrize("shift", [0.0, 1e-9])
def test_a_mesh_cut_open(scale: float, shift: float) -> None:
    """A square whose middle line has duplicate nodes, except at its ends."""
    mesh = grid("quadrilateral", scale, n=4)
    x, y = mesh.p / scale
    line = np.flatnonzero((np.abs(y - 1.5) < 0.1) & (x > 1.1) & (x < 1.9))
    number = np.arange(mesh.p.shape[1])
    number[line] = len(number) + np.arange(len(line))
    t = np.where(y[mesh.t].mean(axis=0) > 1.5, number[mesh.t], mesh.t)
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
    mesh.p[0, 3] = np.nan
    with refused(r"^upper has node 3 at \(nan, "):
        fem.check_mesh(mesh, "upper")
    with pytest.raises(TypeError, match="is a MeshLine1, expected MeshTri1"):
        fem.check_mesh(skfem.MeshLine1())
    with refused("mesh has no cells"):
        fem.check_mesh(skfem.MeshTri1(np.zeros((2, 0)), np.zeros((3, 0), int)))


def test_files_are_checked_by_default(tmp_path: Path) -> None:
    text, path = (DATA / "tetra.inp").read_text(), tmp_path / "bad.inp"
    assert text.count("\n18, 1, 0.5, 1\n") == 1
    path.write_text(text.replace("\n18, 1, 0.5, 1\n", "\n18, 1, 0.5, -3\n"))
    with refused(r"bad\.inp has an inverted cell: cells"):
        fem.read_mesh(path)
    assert fem.read_mesh(path, check=False).t.shape[1] == 200
