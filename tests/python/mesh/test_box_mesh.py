"""Boxes without scikit-fem have the same arrays, and first order the same shape functions."""

import copy
import pickle

import numpy as np
import pytest
import skfem

from bipot_rs import fem
from bipot_rs.mesh import elements, kinds
from bipot_rs.mesh.boxes import BoxMesh, box_mesh, find_facets
from bipot_rs.mesh.kinds import OF_VTK
from support.comparisons import near, refused

CLASSES = {
    "triangle": skfem.MeshTri1,
    "quadrilateral": skfem.MeshQuad1,
    "tetrahedron": skfem.MeshTet1,
    "hexahedron": skfem.MeshHex1,
}
ARRAYS = ("p", "t", "facets", "t2f", "f2t")


def grids(cell: str) -> list[np.ndarray]:
    """Grids of different lengths, so that two axes cannot be mistaken for each other."""
    rng = np.random.default_rng(3)
    d = 2 if cell in ("triangle", "quadrilateral") else 3
    return [np.sort(rng.uniform(size=n)) for n in (4, 6, 3)[:d]]


@pytest.mark.parametrize("cell", CLASSES)
def test_arrays_are_those_of_scikit_fem(cell: str) -> None:
    """Also the numbers of nodes, cells and facets: results do not depend on the class."""
    theirs = CLASSES[cell].init_tensor(*grids(cell))
    for ours in (box_mesh(grids(cell), cell), fem.box(grids(cell), cell)):
        for name in ARRAYS:
            attribute, wanted = getattr(ours, name), getattr(theirs, name)
            assert attribute.dtype == wanted.dtype
            assert attribute.flags.c_contiguous
            np.testing.assert_array_equal(attribute, wanted)
        np.testing.assert_array_equal(ours.boundary_facets(), theirs.boundary_facets())


@pytest.mark.parametrize("cell", CLASSES)
def test_topology_of_cells_in_any_order(cell: str) -> None:
    """The facets are found from the cells alone, not from their place on the grid."""
    rng = np.random.default_rng(4)
    mesh = CLASSES[cell].init_tensor(*grids(cell))
    number = rng.permutation(mesh.p.shape[1]).astype(np.int32)
    t = np.ascontiguousarray(number[mesh.t][:, rng.permutation(mesh.t.shape[1])])
    t = np.sort(t, axis=0) if cell == "triangle" else t
    moved = np.ascontiguousarray(mesh.p[:, np.argsort(number)])
    theirs = CLASSES[cell](moved, t)
    names = ("facets", "t2f", "f2t")
    for name, ours in zip(names, find_facets(t, cell), strict=True):
        np.testing.assert_array_equal(ours, getattr(theirs, name))


@pytest.mark.parametrize("vtk", OF_VTK)
def test_reference_tables_are_those_of_scikit_fem(vtk: str) -> None:
    kind = OF_VTK[vtk]
    for of_mesh, element in ((kind, kind.scalar), (kind.facet, kind.facet.element)):
        wanted = kinds.reference(element, of_mesh.order)
        for ours, table in zip(of_mesh.reference, wanted, strict=True):
            assert ours.shape == table.shape
            assert not ours.flags.writeable
            # One rounding: scikit-fem finds the Gauss points as eigenvalues.
            near(ours, table, 2e-16)


def test_named_surfaces_and_other_attributes() -> None:
    mesh = box_mesh(grids("hexahedron"), "hexahedron")
    whole = fem.box(grids("hexahedron"), "hexahedron")
    assert type(whole) is skfem.MeshHex1
    assert list(mesh.boundaries) == list(whole.boundaries)
    for name, facets in mesh.boundaries.items():
        np.testing.assert_array_equal(facets, whole.boundaries[name])
    # What a `BoxMesh` does not have itself, it takes from the mesh of scikit-fem.
    assert mesh.refined().nelements == 8 * mesh.nelements
    assert mesh.subdomains is None
    with pytest.raises(AttributeError, match="no_such"):
        mesh.no_such  # noqa: B018
    more = mesh.with_boundaries({"mine": np.array([3])})
    assert list(more.boundaries) == [*mesh.boundaries, "mine"]
    assert "mine" not in mesh.boundaries


def test_copies_and_pickles() -> None:
    mesh = box_mesh(grids("triangle"), "triangle")
    for other in (copy.copy(mesh), pickle.loads(pickle.dumps(mesh))):
        assert isinstance(other, BoxMesh)
        for name in ARRAYS:
            np.testing.assert_array_equal(getattr(other, name), getattr(mesh, name))
    assert repr(mesh) == "BoxMesh(24 nodes, 30 cells of the kind triangle)"


def test_kinds_and_orders_of_a_box() -> None:
    mesh = box_mesh(grids("triangle"), "triangle")
    assert elements.kind_of(mesh) is OF_VTK["triangle"]
    assert type(elements.second_order(mesh)) is skfem.MeshTri2
    with refused("expected a mesh of second order: MeshTri2"):
        elements.first_order(mesh)
