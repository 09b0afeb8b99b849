"""Boxes of cells of every kind, distorted, curved or moved."""

from dataclasses import replace
from typing import Any

import numpy as np

from bipot_rs import fem

CELLS = {"triangle": 2, "quadrilateral": 2, "tetrahedron": 3, "hexahedron": 3}


def placed(mesh: Any, p: Any) -> Any:
    """The mesh with its nodes at ``p`` ``(d, n)``; surfaces and volumes keep their names."""
    return replace(mesh, doflocs=np.ascontiguousarray(p))


def box(
    cell: str, grid: Any = 3, *, degree: int = 1, bent: float = 0.0, seed: int = 1
) -> Any:
    """A unit box of ``grid`` cells a side, or with this grid on each axis.

    Corners move by up to ``bent``, before nodes of second order are put between them.
    """
    grid = np.linspace(0, 1, grid + 1) if isinstance(grid, int) else grid
    mesh = fem.box([grid] * CELLS[cell], cell)
    moved = bent * np.random.default_rng(seed).uniform(-1, 1, mesh.p.shape)
    mesh = placed(mesh, mesh.p + moved)
    return mesh if degree == 1 else fem.second_order(mesh)
