"""Finite elements of each mesh class of scikit-fem: nodes, quadrature, order in VTK.

A mesh of scikit-fem has the corners of cells (``mesh.t``) and the positions of all nodes
(``mesh.p``). In second order, the nodes of a cell are the degrees of freedom of its
element, and the mapping is isoparametric.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

from bipot_rs._lib.messages import place
from bipot_rs._lib.optional import missing
from bipot_rs._lib.types import Floats, Ints

try:
    import skfem
    from skfem.quadrature import get_quadrature
except ModuleNotFoundError as error:
    raise missing(error, "finite elements", "skfem", "fem") from None


@dataclass(repr=False)
class MeshQuadS2(skfem.MeshQuad2):  # type: ignore[misc]
    """Quadrilaterals of 8 nodes."""

    elem: type[Any] = skfem.ElementQuadS2


@dataclass(repr=False)
class MeshHexS2(skfem.MeshHex2):  # type: ignore[misc]
    """Hexahedra of 20 nodes."""

    elem: type[Any] = skfem.ElementHexS2


_RING = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)]
_CORNERS: dict[str, list[tuple[float, ...]]] = {
    "triangle": [(0, 0), (1, 0), (0, 1)],
    "quadrilateral": [*_RING],
    "tetrahedron": [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)],
    "hexahedron": [(x, y, z) for z in (0.0, 1.0) for x, y in _RING],
}
# Edges in the order of their midpoints in VTK.
_EDGES = {
    "triangle": [(0, 1), (1, 2), (2, 0)],
    "quadrilateral": [(0, 1), (1, 2), (2, 3), (3, 0)],
    "tetrahedron": [(0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3)],
    "hexahedron": [
        *[(i, (i + 1) % 4) for i in range(4)],
        *[(4 + i, 4 + (i + 1) % 4) for i in range(4)],
        *[(i, 4 + i) for i in range(4)],
    ],
}
# Further nodes of the elements of full second order.
_CENTRES: dict[str, list[tuple[float, ...]]] = {
    "quad9": [(0.5, 0.5)],
    "hexahedron27": [
        (0, 0.5, 0.5),
        (1, 0.5, 0.5),
        (0.5, 0, 0.5),
        (0.5, 1, 0.5),
        (0.5, 0.5, 0),
        (0.5, 0.5, 1),
        (0.5, 0.5, 0.5),
    ],
}


@dataclass(frozen=True)
class Facet:
    """A facet of a cell.

    Attributes
    ----------
    vtk : str
        Its name in VTK and meshio.
    element : type
        Element of one component.
    order : int
        Order of its quadrature.
    linear : type
        Element of first order on its corners.
    lumps : bool
        Whether a constant pressure gives each node a positive force.
    """

    vtk: str
    element: type
    order: int
    linear: type
    lumps: bool = True


@dataclass(frozen=True)
class Kind:
    """A kind of cell.

    Attributes
    ----------
    vtk : str
        Its name in VTK and meshio.
    shape : str
        ``"triangle"``, ``"quadrilateral"``, ``"tetrahedron"`` or ``"hexahedron"``.
    degree : int
        1 or 2.
    mesh : type
        The mesh class of scikit-fem.
    scalar : type
        Element of one component.
    order : int
        Order of its quadrature. Simplices of first order have constant gradients; 2 and 4
        are full Gauss quadrature with 2 and 3 points in each direction. It is exact on
        straight cells, and on curved cells for constant stresses and pressures. The
        rules for tetrahedra of orders 3 and 4 have negative weights. The rule of order 5
        has points at the corners, where a valid curved cell may fold. The rule of order
        6 has neither fault.
    facet : Facet
        Its facets.
    """

    vtk: str
    shape: str
    degree: int
    mesh: type
    scalar: type
    order: int
    facet: Facet

    @property
    def dim(self) -> int:
        """2 or 3."""
        return len(_CORNERS[self.shape][0])

    @property
    def corners(self) -> int:
        """Number of corners; they are the first nodes of a cell."""
        return len(_CORNERS[self.shape])

    @property
    def places(self) -> Floats:
        """Positions of the nodes of the reference cell in the order of VTK, ``(nodes, d)``."""
        return _places(self.vtk, self.shape, self.degree)

    @property
    def order_of_vtk(self) -> Ints:
        """Index in the element of each node in the order of VTK."""
        return _find(self.places, np.asarray(self.scalar().doflocs, dtype=np.float64))

    @property
    def mirror(self) -> Ints:
        """Order of the nodes of VTK that mirrors the cell."""
        mirrored = self.places.copy()
        if self.shape == "hexahedron":  # upside down
            mirrored[:, 2] = 1 - mirrored[:, 2]
        else:  # two axes swapped
            mirrored[:, [0, 1]] = mirrored[:, [1, 0]]
        return _find(mirrored, self.places)


@cache
def _places(vtk: str, shape: str, degree: int) -> Floats:
    corners = np.array(_CORNERS[shape], dtype=np.float64)
    if degree == 1:
        return corners
    middles = corners[np.array(_EDGES[shape])].mean(axis=1)
    centres = np.array(_CENTRES.get(vtk, []), dtype=np.float64)
    return np.concatenate([corners, middles, centres.reshape(-1, corners.shape[1])])


def _find(wanted: Floats, among: Floats) -> Ints:
    """Index in ``among`` of each point of ``wanted``, to rounding."""
    distance = np.abs(wanted[..., None, :] - among).max(axis=-1)
    return np.asarray(distance.argmin(axis=-1), dtype=np.int64)


_LINE = Facet("line", skfem.ElementLineP1, 2, skfem.ElementLineP1)
_LINE3 = Facet("line3", skfem.ElementLineP2, 4, skfem.ElementLineP1)
_TRI = Facet("triangle", skfem.ElementTriP1, 2, skfem.ElementTriP1)
_TRI6 = Facet("triangle6", skfem.ElementTriP2, 4, skfem.ElementTriP1, lumps=False)
_QUAD = Facet("quad", skfem.ElementQuad1, 2, skfem.ElementQuad1)
_QUAD8 = Facet("quad8", skfem.ElementQuadS2, 4, skfem.ElementQuad1, lumps=False)
_QUAD9 = Facet("quad9", skfem.ElementQuad2, 4, skfem.ElementQuad1)

KINDS: dict[type, Kind] = {
    kind.mesh: kind
    for kind in (
        Kind("triangle", "triangle", 1, skfem.MeshTri1, skfem.ElementTriP1, 1, _LINE),
        Kind("quad", "quadrilateral", 1, skfem.MeshQuad1, skfem.ElementQuad1, 2, _LINE),
        Kind("tetra", "tetrahedron", 1, skfem.MeshTet1, skfem.ElementTetP1, 1, _TRI),
        Kind(
            "hexahedron", "hexahedron", 1, skfem.MeshHex1, skfem.ElementHex1, 2, _QUAD
        ),
        Kind("triangle6", "triangle", 2, skfem.MeshTri2, skfem.ElementTriP2, 4, _LINE3),
        Kind(
            "quad9", "quadrilateral", 2, skfem.MeshQuad2, skfem.ElementQuad2, 4, _LINE3
        ),
        Kind("quad8", "quadrilateral", 2, MeshQuadS2, skfem.ElementQuadS2, 4, _LINE3),
        Kind("tetra10", "tetrahedron", 2, skfem.MeshTet2, skfem.ElementTetP2, 6, _TRI6),
        Kind(
            "hexahedron27",
            "hexahedron",
            2,
            skfem.MeshHex2,
            skfem.ElementHex2,
            4,
            _QUAD9,
        ),
        Kind("hexahedron20", "hexahedron", 2, MeshHexS2, skfem.ElementHexS2, 4, _QUAD8),
    )
}
OF_VTK = {kind.vtk: kind for kind in KINDS.values()}


def kind_of(mesh: Any, what: str = "mesh") -> Kind:
    """The kind of the cells; `TypeError` for a mesh of no known class."""
    kind = KINDS.get(type(mesh))
    if kind is None:
        known = ", ".join(t.__name__ for t in KINDS)
        raise TypeError(f"{what} is a {type(mesh).__name__}, expected {known}")
    return kind


def cell_nodes(mesh: Any) -> Ints:
    """Nodes of the cells in the order of their element, ``(cells, nodes)``."""
    first = KINDS[type(mesh)].degree == 1
    found = mesh.t if first else mesh.dofs.element_dofs
    return np.asarray(found, dtype=np.int64).T


def facet_nodes(mesh: Any, facets: Ints) -> Ints:
    """Nodes of facets in the order of the element there, ``(facets, nodes)``."""
    kind = KINDS[type(mesh)]
    corners = np.asarray(mesh.facets, dtype=np.int64)[:, facets].T
    if kind.degree == 1:
        return corners
    cells = cell_nodes(mesh)[np.asarray(mesh.f2t)[0, facets]]
    local = np.argmax(corners[:, :, None] == cells[:, None, : kind.corners], axis=2)
    at = np.asarray(kind.scalar().doflocs, dtype=np.float64)
    # Position of each node of the facet on the reference cell, whose facets are straight.
    own = np.asarray(kind.facet.element().doflocs, dtype=np.float64)
    linear: Any = kind.facet.linear()
    phi = np.stack([linear.lbasis(own.T, i)[0] for i in range(corners.shape[1])])
    phi = np.broadcast_to(phi, (corners.shape[1], len(own)))
    which = _find(np.einsum("fcd,cn->fnd", at[local], phi), at)
    return np.take_along_axis(cells, which, axis=1)


def make_mesh(vtk: str, points: Floats, cells: Ints) -> tuple[Any, Ints]:
    """A mesh of scikit-fem from cells in the order of VTK.

    Parameters
    ----------
    vtk
        A kind of cell, one of `OF_VTK`.
    points, cells
        Points ``(m, d)`` and indices of them ``(cells, nodes)``. Points of no cell are
        left out.

    Returns
    -------
    mesh, number
        The mesh, and the index in ``points`` of each node. Cells keep their order.

    Raises
    ------
    ValueError
        Two cells of second order share two corners but not the node between them.
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
    bare: Any = kind.mesh(x, t)
    own = cell_nodes(bare)
    number = np.empty(int(bare.dofs.N), dtype=np.int64)
    number[own] = nodes
    wrong = np.argwhere(number[own] != nodes)
    if len(wrong):
        cell, k = wrong[0]
        raise ValueError(
            f"cell {cell} has a node between two corners, at "
            f"{place(points[nodes[cell, k]])}, and another cell with the same corners "
            "has a different node there: merge double nodes, or mesh so that cells conform"
        )
    mesh: Any = kind.mesh(np.ascontiguousarray(points[number].T), t)
    keep_topology(mesh, bare)
    return mesh, number


def keep_topology(mesh: Any, known: Any) -> None:
    """Give a mesh the topology of another: it does not depend on positions and names."""
    vars(mesh).update({k: v for k, v in vars(known).items() if k not in vars(mesh)})


def second_order(mesh: Any, *, serendipity: bool = False) -> Any:
    """Convert a mesh to second order by nodes at midpoints; names are kept.

    With ``serendipity=True`` quadrilaterals get 8 nodes instead of 9, hexahedra 20
    instead of 27.
    """
    kind = _of_order(mesh, 1, "first")
    wanted = [k for k in KINDS.values() if k.shape == kind.shape and k.degree == 2]
    target = wanted[-1] if serendipity else wanted[0]
    bare: Any = target.mesh(mesh.p, mesh.t)
    at = np.asarray(target.scalar().doflocs, dtype=np.float64).T
    linear: Any = kind.scalar()
    phi = np.stack(
        [
            np.broadcast_to(linear.lbasis(at, i)[0], at.shape[1:])
            for i in range(kind.corners)
        ]
    )
    p = np.empty((mesh.p.shape[0], int(bare.dofs.N)))
    p[:, cell_nodes(bare).T] = np.einsum("dct,ck->dkt", mesh.p[:, mesh.t], phi)
    p[:, : mesh.p.shape[1]] = mesh.p
    made: Any = target.mesh(p, mesh.t, mesh.boundaries, mesh.subdomains)
    keep_topology(made, bare)
    return made


def _of_order(mesh: Any, degree: int, order: str) -> Kind:
    kind = KINDS.get(type(mesh))
    if kind is None or kind.degree != degree:
        raise ValueError(
            f"mesh is a {type(mesh).__name__}, expected a mesh of {order} order: "
            + ", ".join(k.mesh.__name__ for k in KINDS.values() if k.degree == degree)
        )
    return kind


def first_order(mesh: Any) -> Any:
    """Convert a mesh to first order: only corners remain; names are kept."""
    kind = _of_order(mesh, 2, "second")
    (target,) = (k for k in KINDS.values() if k.shape == kind.shape and k.degree == 1)
    # Corners come first.
    corners = mesh.p[:, : int(mesh.t.max()) + 1]
    made: Any = target.mesh(corners, mesh.t, mesh.boundaries, mesh.subdomains)
    return made


@cache
def reference(element: type, order: int) -> tuple[Floats, Floats, Floats]:
    """Shape functions of scikit-fem on the reference cell, at Gauss points.

    Returns
    -------
    phi, slopes, weights
        ``(c, q)``, ``∂φ_i/∂ξ_b`` as ``(q, b, c)``, and ``(q,)``; read-only, since they
        are cached.
    """
    own = element()
    points, weights = get_quadrature(own.refdom, order)
    both = [own.lbasis(points, i) for i in range(own.doflocs.shape[0])]
    # Constant functions come without a column for each point.
    phi = np.stack([np.broadcast_to(f, weights.shape) for f, _ in both])
    slopes = np.stack([np.broadcast_to(df, points.shape) for _, df in both], axis=-1)
    found = phi, np.ascontiguousarray(slopes.transpose(1, 0, 2)), np.array(weights)
    for array in found:
        array.flags.writeable = False
    return found


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
