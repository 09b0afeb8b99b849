"""Rows of K that processes assemble in parts, compared with the whole K."""

from typing import Any

import numpy as np
import pytest
from scipy import sparse
from scipy.spatial.transform import Rotation

from bipot_rs import fem
from support.boxes import CELLS, box, placed
from support.comparisons import refused


def bent(cell: str, degree: int, shift: float) -> Any:
    """A mesh whose cells all differ."""
    grid = np.linspace(shift, 1 + shift, 4)
    return box(cell, grid, degree=degree, bent=0.03)


def parts(nodes: int, count: int) -> list[Any]:
    """Ascending nodes of each of some processes, scattered over the bodies."""
    owner = np.random.default_rng(2).integers(count, size=nodes)
    return [np.flatnonzero(owner == rank) for rank in range(count)]


def same_rows(model: fem.Assembly, count: int) -> None:
    """Each part has the rows of the whole K, bit for bit.

    An entry is a sum over the cells around two nodes: a part has the same cells in the
    same order, so that no tolerance is needed.
    """
    for nodes in parts(len(model.nodes), count):
        dofs = (model.dim * nodes[:, None] + np.arange(model.dim)).ravel()
        own, wanted = model.stiffness_rows(nodes), model.K[dofs]
        assert own.shape == (len(dofs), model.n)
        np.testing.assert_array_equal(own.indptr, wanted.indptr)
        np.testing.assert_array_equal(own.indices, wanted.indices)
        np.testing.assert_array_equal(own.data.view(int), wanted.data.view(int))


@pytest.mark.parametrize("cell", CELLS)
@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("shape", ["bent", "straight"])
def test_rows_of_parts_are_those_of_the_whole(
    cell: str, degree: int, shape: str
) -> None:
    """Two bodies, one with springs on two surfaces; straight cells share their matrices."""
    straight = box(cell, degree=degree)
    upper = straight if shape == "straight" else bent(cell, degree, 2.0)
    bodies = [
        fem.Body("upper", upper, fem.Material(1.0, 0.3)),
        fem.Body("lower", bent(cell, 1, 0.0), fem.Material(7.0, 0.45)),
    ]
    springs = [
        fem.Spring("lower", "bottom", 3.0),
        fem.Spring("lower", "left", normal=2.0, tangential=0.5),
    ]
    same_rows(fem.assemble(bodies, [], springs=springs), 3)


def test_rows_of_volumes_with_materials_of_their_own() -> None:
    mesh = bent("hexahedron", 1, 0.0)
    left = mesh.p[0, mesh.t].mean(axis=0) < 0.5
    parts = {"left": np.flatnonzero(left), "right": np.flatnonzero(~left)}
    wood = fem.Orthotropic((10.0, 1.0, 0.5), (0.3, 0.3, 0.4), (0.6, 0.5, 0.1))
    laws = {"left": wood, "right": fem.Material(2.0, 0.2)}
    model = fem.assemble([fem.Body("it", mesh.with_subdomains(parts), laws)], [])
    same_rows(model, 4)
    none = model.stiffness_rows(np.zeros(0, np.int64))
    assert none.shape == (0, model.n)
    assert sparse.issparse(none)


@pytest.mark.parametrize("degree", [1, 2])
def test_rows_with_inclined_supports(degree: int) -> None:
    """Nodes on one and on two planes that are not normal to an axis."""
    mesh = box("hexahedron", degree=degree)
    turn = Rotation.from_rotvec([0.3, 0.2, 0.5]).as_matrix()
    body = fem.Body("it", placed(mesh, turn @ mesh.p), fem.Material(1.0, 0.3))
    planes = [fem.Symmetry("it", "left"), fem.Symmetry("it", "front")]
    springs = [fem.Spring("it", "top", 2.0)]
    model = fem.assemble([body], [], symmetries=planes, springs=springs)
    assert model.inclined is not None
    for nodes in parts(len(model.nodes), 3):
        dofs = (model.dim * nodes[:, None] + np.arange(model.dim)).ravel()
        rows, wanted = model.stiffness_rows(nodes).toarray(), model.K[dofs].toarray()
        # Products with T sum in another order.
        np.testing.assert_allclose(rows, wanted, rtol=0, atol=1e-14 * model.K.max())


def test_a_folded_cell_has_its_number_in_the_whole_mesh() -> None:
    mesh = fem.box([np.linspace(0, 1, 4)] * 2, "quadrilateral")
    cells = mesh.t.copy()
    cells[[1, 3], 7] = cells[[3, 1], 7]  # mirrored
    cells[[0, 1], 7] = cells[[1, 0], 7]  # and folded
    body = fem.Body(
        "it", type(mesh)(mesh.p, cells, validate=False), fem.Material(1.0, 0.3)
    )
    with refused("cell 7 of body 'it' is folded"):
        fem.assemble([body], [], stiffness=False).stiffness_rows(np.unique(cells[:, 7]))
