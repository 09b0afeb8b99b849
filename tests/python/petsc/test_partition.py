"""Nodes shared among processes."""

import numpy as np
import pytest

from bipot_rs import fem
from bipot_rs.fem.bodies.elasticity import find_neighbours
from bipot_rs.mesh import elements
from bipot_rs.petsc.run.numbering import divide_by_coordinates


@pytest.mark.parametrize("parts", [1, 2, 3, 5, 8])
def test_parts_by_coordinates_are_equal_and_connected(parts: int) -> None:
    points = fem.box([np.linspace(0, 3, 13), np.linspace(0, 1, 5)], "quadrilateral").p.T
    owner = divide_by_coordinates(points, parts)
    counts = np.bincount(owner, minlength=parts)
    assert len(counts) == parts
    # Three cuts at most lead to a part, and each rounds to a whole node.
    assert np.ptp(counts) <= 3
    for part in range(parts):
        # An interval of x, then of y: other nodes of the column at its border may belong
        # to the neighbour.
        x = points[owner == part, 0]
        inside = (points[:, 0] > x.min()) & (points[:, 0] < x.max())
        if parts <= 3:
            assert (owner[inside] == part).all()


def test_parts_do_not_depend_on_the_order_of_equal_places() -> None:
    """Two bodies have nodes in one place: ties are divided by their number."""
    points = np.repeat(np.arange(4.0)[:, None], 4, axis=0)
    owner = divide_by_coordinates(points, 3)
    np.testing.assert_array_equal(owner, divide_by_coordinates(points.copy(), 3))
    assert np.ptp(np.bincount(owner)) <= 1
    # More parts than nodes.
    owner = divide_by_coordinates(np.arange(6.0).reshape(3, 2), 5)
    assert len(set(owner)) == 3


@pytest.mark.parametrize("degree", [1, 2])
def test_graph_is_the_pattern_of_the_stiffness(degree: int) -> None:
    grid = [np.linspace(0, 1, 4)] * 3
    meshes = [fem.box(grid, "hexahedron"), fem.box(grid, "tetrahedron")]
    if degree == 2:
        meshes = [elements.second_order(mesh) for mesh in meshes]
    bodies = [
        fem.Body(name, mesh, fem.Material(1.0, 0.3))
        for name, mesh in zip("ab", meshes, strict=True)
    ]
    pattern = fem.assemble(bodies, []).K[::3, ::3].tocoo()
    off = pattern.row != pattern.col
    wanted = set(zip(pattern.row[off].tolist(), pattern.col[off].tolist(), strict=True))
    nodes = sum(len(body.points) for body in bodies)
    edges: set[tuple[int, int]] = set()
    # The ranges of three processes; the second one has nodes of both bodies.
    for first, last in ((0, 50), (50, 80), (80, nodes)):
        indptr, indices = find_neighbours(bodies, first, last)
        assert len(indptr) == last - first + 1
        rows = np.repeat(np.arange(first, last), np.diff(indptr))
        edges |= set(zip(rows.tolist(), indices.tolist(), strict=True))
    assert edges == wanted
    # A process without nodes.
    indptr, indices = find_neighbours(bodies, nodes, nodes)
    assert (indptr.tolist(), indices.size) == ([0], 0)
