"""Finite elements of each mesh class of scikit-fem: nodes, quadrature, order in VTK.

A mesh of scikit-fem has the corners of cells (``mesh.t``) and the positions of all nodes
(``mesh.p``). In second order, the nodes of a cell are the degrees of freedom of its
element, and the mapping is isoparametric.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from bipot_rs._lib.messages import place
from bipot_rs._lib.types import Floats, Ints
from bipot_rs.mesh.boxes import BoxMesh
from bipot_rs.mesh.kinds import OF_VTK, ElementMesh, Kind, by_class, find


def __getattr__(name: str) -> dict[type, Kind]:
    """``KINDS``: the kinds by the mesh class of scikit-fem, which it imports."""
    if name == "KINDS":
        return by_class()
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def kind_of(mesh: ElementMesh, what: str = "mesh") -> Kind:
    """The kind of the cells; `TypeError` for a mesh of no known class."""
    if isinstance(mesh, BoxMesh):
        return mesh.kind
    kind = by_class().get(type(mesh))
    if kind is None:
        names = ", ".join(t.__name__ for t in by_class())
        raise TypeError(f"{what} is a {type(mesh).__name__}, expected {names}")
    return kind


def cell_nodes(mesh: ElementMesh) -> Ints:
    """Nodes of the cells in the order of their element, ``(cells, nodes)``."""
    first = kind_of(mesh).degree == 1
    numbers = mesh.t if first else mesh.dofs.element_dofs
    return np.asarray(numbers, dtype=np.int64).T


def facet_nodes(mesh: ElementMesh, facets: Ints) -> Ints:
    """Nodes of facets in the order of the element there, ``(facets, nodes)``."""
    kind = kind_of(mesh)
    corners = np.asarray(mesh.facets, dtype=np.int64)[:, facets].T
    if kind.degree == 1:
        return corners
    cells = cell_nodes(mesh)[np.asarray(mesh.f2t)[0, facets]]
    local = np.argmax(corners[:, :, None] == cells[:, None, : kind.corners], axis=2)
    at = kind.nodes
    # Position of each node of the facet on the reference cell, whose facets are straight.
    places = np.asarray(kind.facet.element().doflocs, dtype=np.float64)
    linear = kind.facet.linear()
    phi = np.stack([linear.lbasis(places.T, i)[0] for i in range(corners.shape[1])])
    phi = np.broadcast_to(phi, (corners.shape[1], len(places)))
    which = find(np.einsum("fcd,cn->fnd", at[local], phi), at)
    return np.take_along_axis(cells, which, axis=1)


def make_mesh(vtk: str, points: Floats, cells: Ints) -> tuple[ElementMesh, Ints]:
    """A mesh of scikit-fem from cells in the order of VTK.

    ``vtk``: a kind of cell, one of `OF_VTK`.
    ``points, cells``: points ``(m, d)`` and indices of them ``(cells, nodes)``. Points of no
    cell are left out.
    Returns ``mesh, number``: the mesh, and the index in ``points`` of each node. Cells keep
    their order.
    Raises `ValueError`: two cells of second order share two corners but not the node between
    them.
    """
    kind = OF_VTK[vtk]
    # Nodes in the order of the element.
    nodes = cells[:, np.argsort(kind.order_of_vtk)]
    vertices, t = np.unique(nodes[:, : kind.corners], return_inverse=True)
    # C order, as scikit-fem expects: otherwise it copies and warns.
    t = np.ascontiguousarray(t.reshape(-1, kind.corners).T)
    x = np.ascontiguousarray(points[vertices].T)
    if kind.degree == 1:
        return kind.mesh(x, t), vertices
    # The corners determine the topology, and so the numbers of all nodes.
    bare = kind.mesh(x, t)
    nodes_of_cells = cell_nodes(bare)
    number = np.empty(int(bare.dofs.N), dtype=np.int64)
    number[nodes_of_cells] = nodes
    wrong = np.argwhere(number[nodes_of_cells] != nodes)
    if len(wrong):
        cell, k = wrong[0]
        raise ValueError(
            f"cell {cell} has a node between two corners, at "
            f"{place(points[nodes[cell, k]])}, and another cell with the same corners "
            "has a different node there: merge double nodes, or mesh so that cells conform"
        )
    mesh = kind.mesh(np.ascontiguousarray(points[number].T), t)
    keep_topology(mesh, bare)
    return mesh, number


def keep_topology(mesh: ElementMesh, source: ElementMesh) -> None:
    """Give a mesh the topology of another: it does not depend on positions and names."""
    vars(mesh).update({k: v for k, v in vars(source).items() if k not in vars(mesh)})


def second_order(mesh: ElementMesh, *, serendipity: bool = False) -> ElementMesh:
    """Convert a mesh to second order by nodes at midpoints; names are kept.

    With ``serendipity=True`` quadrilaterals get 8 nodes instead of 9, hexahedra 20
    instead of 27.
    """
    kind = _of_order(mesh, 1, "first")
    wanted = [k for k in OF_VTK.values() if k.shape == kind.shape and k.degree == 2]
    target = wanted[-1] if serendipity else wanted[0]
    bare = target.mesh(mesh.p, mesh.t)
    at = target.nodes.T
    linear = kind.scalar()
    phi = np.stack(
        [
            np.broadcast_to(linear.lbasis(at, i)[0], at.shape[1:])
            for i in range(kind.corners)
        ]
    )
    p = np.empty((mesh.p.shape[0], int(bare.dofs.N)))
    p[:, cell_nodes(bare).T] = np.einsum("dct,ck->dkt", mesh.p[:, mesh.t], phi)
    p[:, : mesh.p.shape[1]] = mesh.p
    made = target.mesh(p, mesh.t, mesh.boundaries, mesh.subdomains)
    keep_topology(made, bare)
    return made


def _of_order(mesh: ElementMesh, degree: int, order: str) -> Kind:
    kind = mesh.kind if isinstance(mesh, BoxMesh) else by_class().get(type(mesh))
    if kind is None or kind.degree != degree:
        raise ValueError(
            f"mesh is a {type(mesh).__name__}, expected a mesh of {order} order: "
            + ", ".join(k.of_mesh for k in OF_VTK.values() if k.degree == degree)
        )
    return kind


def first_order(mesh: ElementMesh) -> ElementMesh:
    """Convert a mesh to first order: only corners remain; names are kept."""
    kind = _of_order(mesh, 2, "second")
    (target,) = (k for k in OF_VTK.values() if k.shape == kind.shape and k.degree == 1)
    # Corners come first.
    corners = mesh.p[:, : int(mesh.t.max()) + 1]
    return target.mesh(corners, mesh.t, mesh.boundaries, mesh.subdomains)


def jacobian(nodes: Floats, slopes: Floats) -> Floats:
    """``∂x_a/∂ξ_b``, ``(q, b, a, parts)``, for nodes ``(parts, c, a)``."""
    # Relative to the first node: far from the origin x has lost digits.
    offset = np.ascontiguousarray((nodes - nodes[:, :1]).transpose(1, 2, 0))
    return np.asarray(np.einsum("qbi,iac->qbac", slopes, offset), dtype=np.float64)


def inverse(jacobian: Floats) -> tuple[Floats, Floats]:
    """``∂ξ_b/∂x_a``, ``(q, b, a, parts)``, and determinants ``(q, parts)``."""
    tangents = jacobian.swapaxes(0, 1)
    if len(tangents) == 2:
        (x, y), (z, w) = tangents.swapaxes(1, 2)
        determinant = x * w - y * z
        cofactors = np.stack([w, -z, -y, x], axis=1).reshape(jacobian.shape)
    else:
        s, t, r = tangents
        cofactors = np.stack([cross(t, r), cross(r, s), cross(s, t)], axis=1)
        determinant = np.sum(s * cofactors[:, 0], axis=1)
    return cofactors / determinant[:, None, None], determinant


def cross(u: Floats, v: Floats) -> Floats:
    """Vector products of ``(q, 3, parts)``."""
    (u0, u1, u2), (v0, v1, v2) = u.swapaxes(0, 1), v.swapaxes(0, 1)
    return np.stack([u1 * v2 - u2 * v1, u2 * v0 - u0 * v2, u0 * v1 - u1 * v0], axis=1)


@dataclass
class Content:
    """The content of a mesh file: points, cells, and sets of cells, nodes and faces."""

    points: Floats  # (places, 3)
    blocks: list[tuple[str, Ints]]  # kind of cells in VTK's names
    # Name to one array of cells for each block
    sets: dict[str, list[Ints]] = field(default_factory=dict)
    # As `sets`; the set means all boundary facets of these cells
    free: dict[str, list[Ints]] = field(default_factory=dict)
    # Name to indices of points
    node_sets: dict[str, Ints] = field(default_factory=dict)
    # Name to corners of each face
    faces: dict[str, list[tuple[int, ...]]] = field(default_factory=dict)
