"""Bodies with their degrees of freedom in different orders."""

import numpy as np
from numpy.typing import NDArray

from bipot_rs import fem
from bipot_rs.contact.stiffness import dof_order

CELLS = [
    (cell, d, order)
    for cell, d in (
        ("triangle", 2),
        ("quadrilateral", 2),
        ("tetrahedron", 3),
        ("hexahedron", 3),
    )
    for order in (1, 2)
]


def body(
    cell: str, d: int, order: int = 1, cells: int = 4, aspect: float = 1.0
) -> fem.Body:
    grid = np.linspace(0, 1, cells + 1)
    mesh = fem.box([aspect * grid] + [grid] * (d - 1), cell)
    mesh = fem.second_order(mesh) if order == 2 else mesh
    return fem.Body("a", mesh, fem.Material(210e3, 0.3))


def by_component(n: int, d: int) -> NDArray[np.int64]:
    """For each degree of freedom with all u_x first, its number in node-by-node order."""
    return (d * dof_order.node_of("component", n, d)) + dof_order.components(
        "component", n, d
    )
