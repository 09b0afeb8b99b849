"""Kinds of cells and their facets: nodes, quadrature, shape functions, order in VTK.

The tables of first order are written out here. Those of second order, and the mesh classes,
are of scikit-fem, which is imported when one of them is needed: a scene of boxes of first
order starts without it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from math import prod
from types import ModuleType
from typing import Any, Protocol, TypeAlias

import numpy as np

from bipot_rs._lib.optional import missing
from bipot_rs._lib.types import Floats, Integers, Ints

# Shape functions ``(c, q)``, their slopes ``∂φ_i/∂ξ_b`` as ``(q, b, c)``, weights ``(q,)``.
Reference: TypeAlias = tuple[Floats, Floats, Floats]

# Positions of the nodes of cells of first order, in the order of scikit-fem.
_CORNERS: dict[str, list[tuple[int, ...]]] = {
    "line": [(0,), (1,)],
    "triangle": [(0, 0), (1, 0), (0, 1)],
    "quadrilateral": [(0, 0), (1, 0), (1, 1), (0, 1)],
    "tetrahedron": [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)],
    "hexahedron": [
        (1, 1, 1),
        (1, 1, 0),
        (1, 0, 1),
        (0, 1, 1),
        (1, 0, 0),
        (0, 1, 0),
        (0, 0, 1),
        (0, 0, 0),
    ],
}
# Names in scikit-fem of the elements of one component.
_FIRST_ELEMENT = {
    "line": "ElementLineP1",
    "triangle": "ElementTriP1",
    "quadrilateral": "ElementQuad1",
    "tetrahedron": "ElementTetP1",
    "hexahedron": "ElementHex1",
}
# Gauss points of two on a line, symmetric about its middle.
_PAIR = 0.5 + 0.5 * np.sqrt(1 / 3) * np.array([-1.0, 1.0])
# Corners in the order of VTK, which is that of scikit-fem but for hexahedra.
_VTK_CORNERS: dict[str, list[tuple[int, ...]]] = {
    **_CORNERS,
    "hexahedron": [(x, y, z) for z in (0, 1) for x, y in _CORNERS["quadrilateral"]],
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
# Facets in the order of Abaqus; in space seen from inside.
FACETS: dict[str, Sequence[tuple[int, ...]]] = {
    "triangle": _EDGES["triangle"],
    "quadrilateral": _EDGES["quadrilateral"],
    "tetrahedron": [(0, 1, 2), (0, 3, 1), (1, 3, 2), (2, 3, 0)],
    "hexahedron": [
        (0, 1, 2, 3),
        (4, 7, 6, 5),
        *[(i, 4 + i, 4 + (i + 1) % 4, (i + 1) % 4) for i in range(4)],
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


class _Element(Protocol):
    """What this package uses of an element of scikit-fem."""

    refdom: object
    # Positions of the nodes on the reference cell, ``(nodes, d)``.
    doflocs: Floats

    def lbasis(self, points: Floats, i: int) -> tuple[Floats, Floats]: ...


ElementClass: TypeAlias = Callable[[], _Element]


class NodeNumbers(Protocol):
    """Numbers of the nodes: those of each cell ``(nodes, cells)``, and how many there are."""

    element_dofs: Integers
    N: int


class ElementMesh(Protocol):
    """What this package uses of a mesh of scikit-fem, or of a `boxes.BoxMesh`."""

    @property
    def p(self) -> Floats:
        """Positions of the nodes, ``(d, nodes)`` [m]."""

    @property
    def t(self) -> Integers:
        """Nodes at the corners of each cell, ``(c, cells)``."""

    @property
    def facets(self) -> Integers:
        """Nodes at the corners of each facet, ``(c, facets)``."""

    @property
    def t2f(self) -> Integers:
        """Facets of each cell, ``(f, cells)``."""

    @property
    def f2t(self) -> Integers:
        """Cells at each facet ``(2, facets)``; the second is -1 on the boundary."""

    @property
    def boundaries(self) -> Mapping[str, Integers] | None:
        """Facets of each named surface."""

    @property
    def subdomains(self) -> Mapping[str, Integers] | None:
        """Cells of each named volume."""

    @property
    def nelements(self) -> int:
        """Number of cells."""

    @property
    def dofs(self) -> NodeNumbers:
        """Numbers of the nodes of cells of second order, by scikit-fem."""

    def boundary_facets(self) -> Integers:
        """Numbers of the facets with one cell."""

    def with_boundaries(self, named: Mapping[str, Integers]) -> ElementMesh:
        """Copy with further named surfaces."""

    def with_subdomains(self, named: Mapping[str, Integers]) -> ElementMesh:
        """Copy with further named volumes."""


def library() -> ModuleType:
    """The module scikit-fem, imported at the first call.

    Raises `ModuleNotFoundError`: it is not installed; the message names the extra that installs
    it.
    """
    try:
        import skfem
    except ModuleNotFoundError as error:
        raise missing(error, "finite elements", "skfem", "fem") from None
    module: ModuleType = skfem
    return module


@dataclass(frozen=True)
class Facet:
    """A facet of a cell."""

    vtk: str  # its name in VTK and meshio
    shape: str  # `"line"`, `"triangle"` or `"quadrilateral"`
    of_nodes: str  # element of one component, its name in scikit-fem
    order: int  # order of its quadrature
    lumps: bool = True  # whether a constant pressure gives each node a positive force

    @property
    def element(self) -> ElementClass:
        """Element of one component: a class of scikit-fem."""
        made: ElementClass = getattr(library(), self.of_nodes)
        return made

    @property
    def linear(self) -> ElementClass:
        """Element of first order on its corners: a class of scikit-fem."""
        name = _FIRST_ELEMENT[self.shape]
        made: ElementClass = getattr(library(), name)
        return made

    @property
    def corners(self) -> int:
        """Number of corners."""
        return len(_CORNERS[self.shape])

    @property
    def reference(self) -> Reference:
        """As `Kind.reference`."""
        return reference_of(self.shape, self.of_nodes, self.order)


@dataclass(frozen=True)
class Kind:
    """A kind of cell."""

    vtk: str  # its name in VTK and meshio
    shape: str  # `"triangle"`, `"quadrilateral"`, `"tetrahedron"` or `"hexahedron"`
    degree: int  # 1 or 2
    # of_mesh, of_cell: the mesh class, and the element of one component: their names in
    # scikit-fem.
    of_mesh: str
    of_cell: str
    # Order of its quadrature. Simplices of first order have constant gradients; 2 and 4 are
    # full Gauss quadrature with 2 and 3 points in each direction. It is exact on straight
    # cells, and on curved cells for constant stresses and pressures. The rules for tetrahedra
    # of orders 3 and 4 have negative weights. The rule of order 5 has points at the corners,
    # where a valid curved cell may fold. The rule of order 6 has neither fault.
    order: int
    facet: Facet  # its facets

    @property
    def mesh(self) -> Callable[..., ElementMesh]:
        """The mesh class of scikit-fem."""
        made: Callable[..., ElementMesh] = mesh_class(self.of_mesh)
        return made

    @property
    def scalar(self) -> ElementClass:
        """Element of one component: a class of scikit-fem."""
        made: ElementClass = getattr(library(), self.of_cell)
        return made

    @property
    def reference(self) -> Reference:
        """Shape functions on the reference cell, at its Gauss points; read-only."""
        return reference_of(self.shape, self.of_cell, self.order)

    @property
    def dim(self) -> int:
        """2 or 3."""
        return len(_VTK_CORNERS[self.shape][0])

    @property
    def corners(self) -> int:
        """Number of corners; they are the first nodes of a cell."""
        return len(_VTK_CORNERS[self.shape])

    @property
    def nodes(self) -> Floats:
        """Positions of the nodes of the reference cell in the order of the element."""
        if self.degree == 1:
            return np.array(_CORNERS[self.shape], dtype=np.float64)
        return np.asarray(self.scalar().doflocs, dtype=np.float64)

    @property
    def places(self) -> Floats:
        """Positions of the nodes of the reference cell in the order of VTK, ``(nodes, d)``."""
        return _places(self.vtk, self.shape, self.degree)

    @property
    def order_of_vtk(self) -> Ints:
        """Index in the element of each node in the order of VTK."""
        return find(self.places, self.nodes)

    @property
    def mirror(self) -> Ints:
        """Order of the nodes of VTK that mirrors the cell."""
        mirrored = self.places.copy()
        if self.shape == "hexahedron":  # upside down
            mirrored[:, 2] = 1 - mirrored[:, 2]
        else:  # two axes swapped
            mirrored[:, [0, 1]] = mirrored[:, [1, 0]]
        return find(mirrored, self.places)


@cache
def _places(vtk: str, shape: str, degree: int) -> Floats:
    corners = np.array(_VTK_CORNERS[shape], dtype=np.float64)
    if degree == 1:
        return corners
    middles = corners[np.array(_EDGES[shape])].mean(axis=1)
    centres = np.array(_CENTRES.get(vtk, []), dtype=np.float64)
    return np.concatenate([corners, middles, centres.reshape(-1, corners.shape[1])])


def find(wanted: Floats, among: Floats) -> Ints:
    """Index in ``among`` of each point of ``wanted``, to rounding."""
    distance = np.abs(wanted[..., None, :] - among).max(axis=-1)
    return np.asarray(distance.argmin(axis=-1), dtype=np.int64)


@cache
def mesh_class(name: str) -> Any:
    """A mesh class of scikit-fem, or of `serendipity`, by its name."""
    classes = library()
    from bipot_rs.mesh import serendipity

    return getattr(serendipity, name, None) or getattr(classes, name)


@cache
def _reference_of_first_order(shape: str, order: int) -> Reference:
    """Shape functions of first order at the points of the rule of ``order``.

    Nodes, points and weights have the order and the values of scikit-fem.

    Returns ``phi, slopes, weights``: as `Reference`; read-only, since they are cached.
    """
    points, weights = _rule(shape, order)
    simplex = shape in ("triangle", "tetrahedron")
    phi, slopes = (_of_simplex if simplex else _of_product)(shape, points)
    tables = phi, np.ascontiguousarray(slopes.transpose(2, 1, 0)), weights
    for array in tables:
        array.flags.writeable = False
    return tables


def _rule(shape: str, order: int) -> tuple[Floats, Floats]:
    """Points ``(d, q)`` and weights of the orders that first order needs."""
    if shape == "tetrahedron" and order == 1:
        return np.full((3, 1), 0.25), np.full(1, 1 / 6)
    if shape == "triangle" and order <= 2:
        # Three points, as scikit-fem takes for order 1 too.
        return 1 / 6 + 0.5 * np.eye(3)[1:], np.full(3, 1 / 6)
    if shape in ("line", "quadrilateral", "hexahedron") and order == 2:
        d = len(_CORNERS[shape][0])
        grid = np.meshgrid(*[_PAIR] * d, indexing="xy")
        points = np.stack([axis.ravel(order="F") for axis in grid])
        return points, np.full(2**d, 0.5**d)
    raise ValueError(f"there is no rule of order {order} for a {shape}")


def _of_simplex(shape: str, points: Floats) -> tuple[Floats, Floats]:
    """``1 - Σ ξ`` and the coordinates ξ themselves."""
    first = np.ones(points.shape[1])
    for axis in points:
        first = first - axis
    d = len(_CORNERS[shape]) - 1
    slopes = np.concatenate([-np.ones((1, d)), np.eye(d)])
    return np.concatenate([first[None], points]), np.repeat(
        slopes[:, :, None], points.shape[1], axis=2
    )


def _of_product(shape: str, points: Floats) -> tuple[Floats, Floats]:
    """Products of ξ or 1 - ξ over the axes."""
    ones = np.ones(points.shape[1])
    phi, slopes = [], []
    for corner in _CORNERS[shape]:
        factors = [x if on else 1 - x for x, on in zip(points, corner, strict=True)]
        phi.append(prod(factors, start=ones))
        slopes.append(
            [
                (1.0 if on else -1.0) * prod(factors[:b] + factors[b + 1 :], start=ones)
                for b, on in enumerate(corner)
            ]
        )
    return np.array(phi), np.array(slopes)


@cache
def reference(element: type, order: int) -> Reference:
    """Shape functions of scikit-fem on the reference cell, at Gauss points.

    `Kind.reference` and `Facet.reference` have those of a kind of cells.

    Returns ``phi, slopes, weights``: ``(c, q)``, ``∂φ_i/∂ξ_b`` as ``(q, b, c)``, and ``(q,)``;
    read-only, since they are cached.
    """
    from skfem.quadrature import get_quadrature

    basis: _Element = element()
    points, weights = get_quadrature(basis.refdom, order)
    both = [basis.lbasis(points, i) for i in range(basis.doflocs.shape[0])]
    # Constant functions come without a column for each point.
    phi = np.stack([np.broadcast_to(f, weights.shape) for f, _ in both])
    slopes = np.stack([np.broadcast_to(df, points.shape) for _, df in both], axis=-1)
    tables = phi, np.ascontiguousarray(slopes.transpose(1, 0, 2)), np.array(weights)
    for array in tables:
        array.flags.writeable = False
    return tables


@cache
def reference_of(shape: str, element: str, order: int) -> Reference:
    """Shape functions of an element at the points of a rule: `Kind.reference`."""
    if element == _FIRST_ELEMENT[shape]:
        return _reference_of_first_order(shape, order)
    return reference(getattr(library(), element), order)


_LINE = Facet("line", "line", "ElementLineP1", 2)
_LINE3 = Facet("line3", "line", "ElementLineP2", 4)
_TRI = Facet("triangle", "triangle", "ElementTriP1", 2)
_TRI6 = Facet("triangle6", "triangle", "ElementTriP2", 4, lumps=False)
_QUAD = Facet("quad", "quadrilateral", "ElementQuad1", 2)
_QUAD8 = Facet("quad8", "quadrilateral", "ElementQuadS2", 4, lumps=False)
_QUAD9 = Facet("quad9", "quadrilateral", "ElementQuad2", 4)

# Names in VTK, shapes, degrees, classes of scikit-fem, orders of quadrature, facets.
_ALL = (
    Kind("triangle", "triangle", 1, "MeshTri1", "ElementTriP1", 1, _LINE),
    Kind("quad", "quadrilateral", 1, "MeshQuad1", "ElementQuad1", 2, _LINE),
    Kind("tetra", "tetrahedron", 1, "MeshTet1", "ElementTetP1", 1, _TRI),
    Kind("hexahedron", "hexahedron", 1, "MeshHex1", "ElementHex1", 2, _QUAD),
    Kind("triangle6", "triangle", 2, "MeshTri2", "ElementTriP2", 4, _LINE3),
    Kind("quad9", "quadrilateral", 2, "MeshQuad2", "ElementQuad2", 4, _LINE3),
    Kind("quad8", "quadrilateral", 2, "MeshQuadS2", "ElementQuadS2", 4, _LINE3),
    Kind("tetra10", "tetrahedron", 2, "MeshTet2", "ElementTetP2", 6, _TRI6),
    Kind("hexahedron27", "hexahedron", 2, "MeshHex2", "ElementHex2", 4, _QUAD9),
    Kind("hexahedron20", "hexahedron", 2, "MeshHexS2", "ElementHexS2", 4, _QUAD8),
)
OF_VTK = {kind.vtk: kind for kind in _ALL}
# Kinds of first order by their shape.
FIRST = {kind.shape: kind for kind in _ALL if kind.degree == 1}


@cache
def by_class() -> dict[type, Kind]:
    """Kinds by the mesh class of scikit-fem."""
    return {mesh_class(kind.of_mesh): kind for kind in _ALL}
