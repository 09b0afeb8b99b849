"""Rectangles and boxes in cells of first order, with their faces named.

`BoxMesh` has the arrays of a mesh of scikit-fem, so that a scene of boxes does not import
scikit-fem.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from bipot_rs._lib.types import Floats, Integers
from bipot_rs._lib.validation import floats, show_value
from bipot_rs.mesh.kinds import FIRST, ElementMesh, Kind

# Faces of a box, (axis, end); the last axis points up.
FACES: dict[int, dict[str, tuple[int, int]]] = {
    2: {"left": (0, 0), "right": (0, 1), "bottom": (1, 0), "top": (1, 1)},
    3: {
        "left": (0, 0),
        "right": (0, 1),
        "front": (1, 0),
        "back": (1, 1),
        "bottom": (2, 0),
        "top": (2, 1),
    },
}
# Corners of a cell of the grid: steps along the axes from its lowest corner.
_STEPS: dict[int, list[tuple[int, ...]]] = {
    2: [(0, 0), (0, 1), (1, 1), (1, 0)],
    3: [
        (0, 0, 0),
        (0, 1, 0),
        (1, 0, 0),
        (0, 0, 1),
        (1, 1, 0),
        (0, 1, 1),
        (1, 0, 1),
        (1, 1, 1),
    ],
}
# Cells that a cell of the grid is divided into: numbers of its corners.
_PIECES: dict[str, list[tuple[int, ...]]] = {
    "triangle": [(0, 1, 2), (0, 3, 2)],
    "quadrilateral": [(0, 1, 2, 3)],
    "tetrahedron": [
        (0, 1, 5, 7),
        (0, 1, 4, 7),
        (0, 2, 4, 7),
        (0, 3, 5, 7),
        (0, 2, 6, 7),
        (0, 3, 6, 7),
    ],
    "hexahedron": [tuple(range(8))],
}
# Facets of a cell: numbers of its nodes.
_FACETS: dict[str, list[tuple[int, ...]]] = {
    "triangle": [(0, 1), (1, 2), (0, 2)],
    "quadrilateral": [(0, 1), (1, 2), (2, 3), (0, 3)],
    "tetrahedron": [(0, 1, 2), (0, 1, 3), (0, 2, 3), (1, 2, 3)],
    "hexahedron": [
        (0, 1, 4, 2),
        (0, 2, 6, 3),
        (0, 3, 5, 1),
        (2, 4, 7, 6),
        (1, 5, 7, 4),
        (3, 6, 7, 5),
    ],
}


def find_facets(t: Integers, shape: str) -> tuple[Integers, Integers, Integers]:
    """Facets of cells ``t (nodes, cells)``, those of each cell, and the cells at each facet.

    Returns ``facets (c, facets)``: nodes of each facet; facets ascend by their sorted nodes.
    Returns ``t2f (f, cells)``: facets of each cell.
    Returns ``f2t (2, facets)``: the first and the last cell at each facet; -1 instead of the
    last on the boundary.
    """
    cells = t.shape[1]
    corners = np.hstack(
        [t[list(corners_of_facet)] for corners_of_facet in _FACETS[shape]]
    )
    ascending = np.sort(corners, axis=0)
    # Stable: among equal facets the first cell comes first.
    order = np.lexsort(ascending[::-1])
    facets_in_order = ascending[:, order]
    begins = np.ones(len(order), dtype=np.bool_)
    begins[1:] = (facets_in_order[:, 1:] != facets_in_order[:, :-1]).any(axis=0)
    t2f = np.empty(len(order), dtype=np.int64)
    t2f[order] = np.cumsum(begins) - 1
    first = order[begins]
    last = order[np.append(begins[1:], True)]
    f2t = np.stack([first % cells, last % cells]).astype(np.int32)
    f2t[1, first == last] = -1
    # The nodes of a quadrilateral must stay in their order around it.
    nodes = corners if shape == "hexahedron" else ascending
    return np.ascontiguousarray(nodes[:, first]), t2f.reshape(-1, cells), f2t


@dataclass(frozen=True, eq=False)
class BoxMesh:
    """A rectangle or a box in cells of first order.

    Its arrays are those of the mesh of scikit-fem of `boxes.box`, with the same numbers. All
    other attributes are taken from that mesh, which is made when one is asked for.
    """

    kind: Kind  # kind of the cells
    p: Floats  # (d, nodes): positions of the nodes [m]
    t: Integers  # (c, cells): nodes of each cell
    # As `find_facets` returns them.
    facets: Integers = field(repr=False)
    t2f: Integers = field(repr=False)
    f2t: Integers = field(repr=False)
    # Facets of each named surface.
    boundaries: Mapping[str, Integers] = field(default_factory=dict)

    @property
    def subdomains(self) -> None:
        """A box has no named volumes."""

    @property
    def nelements(self) -> int:
        """Number of cells."""
        return int(self.t.shape[1])

    def boundary_facets(self) -> Integers:
        """Numbers of the facets with one cell, ascending."""
        return np.flatnonzero(self.f2t[1] == -1).astype(np.int32)

    def with_boundaries(self, named: Mapping[str, Integers]) -> BoxMesh:
        """Copy with further named surfaces."""
        return replace(self, boundaries={**self.boundaries, **named})

    @cached_property
    def whole(self) -> ElementMesh:
        """The same mesh of scikit-fem."""
        made = self.kind.mesh(self.p, self.t, dict(self.boundaries))
        # The topology takes longer than assembling K.
        vars(made).update(_facets=self.facets, _t2f=self.t2f, _f2t=self.f2t)
        return made

    def __getattr__(self, name: str) -> Any:
        # Copies and pickles ask for special names before there are fields.
        if name.startswith("_"):
            raise AttributeError(name)
        return getattr(self.whole, name)

    def __repr__(self) -> str:
        cells = f"{self.nelements} cells of the kind {self.kind.vtk}"
        return f"BoxMesh({self.p.shape[1]} nodes, {cells})"


def _divide_grid(grids: Sequence[Floats], shape: str) -> BoxMesh:
    """Cells of one shape on a grid, without named surfaces.

    Nodes and cells are numbered along y first, then x, then z, as by scikit-fem.

    ``grids``: ascending grid points of each axis.
    ``shape``: ``"triangle"``, ``"quadrilateral"``, ``"tetrahedron"`` or ``"hexahedron"``.
    """
    places = np.meshgrid(*grids, indexing="xy")
    p = np.stack([axis.ravel(order="F") for axis in places])
    number = np.arange(p.shape[1], dtype=np.int32).reshape(places[0].shape, order="F")
    # Axes of `number`: y, x, z.
    corners = [
        number[
            tuple(
                slice(step, len(grids[axis]) - 1 + step)
                for axis, step in zip((1, 0, 2), (y, x, *z), strict=False)
            )
        ].ravel(order="F")
        for x, y, *z in _STEPS[len(grids)]
    ]
    pieces = [
        np.stack([corners[k] for k in corners_of_piece])
        for corners_of_piece in _PIECES[shape]
    ]
    t = np.ascontiguousarray(np.hstack(pieces))
    return BoxMesh(FIRST[shape], p, t, *find_facets(t, shape))


def box(axes: Sequence[ArrayLike], cell: str) -> ElementMesh:
    """Tensor-product mesh of a rectangle or a box with named faces.

    Triangles divide each rectangle along the diagonal from its lowest to its highest
    corner. Six tetrahedra divide each box; their edges lead from the lowest to the highest
    corner along the axes, in each of the six orders. Opposite faces are divided equally,
    so that neighbours conform and bodies on the same grid have matching facets. Halving
    the grid divides each simplex into 2^d.

    Parameters
    ----------
    axes
        Grid points of each axis, in any order, at least two different ones [m].
    cell
        ``"triangle"``, ``"quadrilateral"``, ``"tetrahedron"``, ``"hexahedron"``.

    Returns
    -------
    skfem.Mesh
        Mesh with boundaries ``left``/``right`` (x), ``bottom``/``top`` (last axis),
        and in 3D ``front``/``back`` (y).
    """
    return box_mesh(axes, cell).whole


def box_mesh(axes: Sequence[ArrayLike], cell: str) -> BoxMesh:
    """As `box`, without scikit-fem."""
    given: Any = axes
    if not isinstance(given, Iterable) or isinstance(given, str):
        raise TypeError(
            f"axes is {show_value(axes)}, expected grid points of each axis"
        )
    if not isinstance(cell, str):
        raise TypeError(f"cell is {show_value(cell)}, expected a name")
    grids = [
        np.sort(floats(f"axis {k} of axes", axis, ndim=1))
        for k, axis in enumerate(axes)
    ]
    dim = FIRST[cell].dim if cell in FIRST else 0
    if len(grids) != dim or not dim:
        raise ValueError(
            f"cell is {cell!r} with {len(grids)} axes, expected triangle or "
            "quadrilateral with 2, tetrahedron or hexahedron with 3"
        )
    for k, grid in enumerate(grids):
        if grid.size < 2 or not np.all(np.diff(grid) > 0):
            raise ValueError(f"axis {k} needs two or more distinct grid points")
    mesh = _divide_grid(grids, cell)
    facets = mesh.boundary_facets()
    vertices = mesh.p[:, mesh.facets[:, facets]]
    return mesh.with_boundaries(
        {
            name: facets[(vertices[axis] == grids[axis][-end]).all(axis=0)]
            for name, (axis, end) in FACES[dim].items()
        }
    )
