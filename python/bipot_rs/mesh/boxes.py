"""Grids of rectangles and boxes with their faces named."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from bipot_rs._lib.validation import floats
from bipot_rs.mesh.box_mesh import BoxMesh, tensor_mesh
from bipot_rs.mesh.kinds import FIRST

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


def box(axes: Sequence[ArrayLike], cell: str) -> Any:
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
    grids = [
        np.sort(floats(f"axis {k} of axes", axis, ndim=1))
        for k, axis in enumerate(axes)
    ]
    dim = 2 if cell in ("triangle", "quadrilateral") else 3
    if cell not in FIRST or len(grids) != dim:
        raise ValueError(
            f"cell is {cell!r} with {len(grids)} axes, expected triangle or "
            "quadrilateral with 2, tetrahedron or hexahedron with 3"
        )
    for k, grid in enumerate(grids):
        if grid.size < 2 or not np.all(np.diff(grid) > 0):
            raise ValueError(f"axis {k} needs two or more distinct grid points")
    mesh = tensor_mesh(grids, cell)
    facets = mesh.boundary_facets()
    vertices = mesh.p[:, mesh.facets[:, facets]]
    return mesh.with_boundaries(
        {
            name: facets[(vertices[axis] == grids[axis][-end]).all(axis=0)]
            for name, (axis, end) in FACES[dim].items()
        }
    )
