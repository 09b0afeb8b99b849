"""Boxes that represent half-spaces: graded meshes, displacements of point forces."""

import numpy as np
from numpy.typing import NDArray

from bipot_rs import fem

Array = NDArray[np.float64]


def grid(h: float, near: float, far: float) -> Array:
    """Points from 0 to `far`: cells of size h up to `near`, then each 1 + 2 h times the last.

    With the size of the contact as the unit, h refines the whole mesh.
    """
    points = [*np.linspace(0, near, round(near / h) + 1)]
    cell = h
    while points[-1] < far:
        cell *= 1 + 2 * h
        points.append(points[-1] + cell)
    # The last cell is cut, unless too little of it would remain.
    if far - points[-2] < 0.5 * (points[-2] - points[-3]):
        del points[-2]
    points[-1] = far
    return np.array(points)


def mirrored(points: Array) -> Array:
    """The grid and its image, -x."""
    return np.unique(np.append(-points, points))


def body(name: str, axes: list[Array], young: float, nu: float) -> fem.Body:
    """A box of quadrilaterals or hexahedra on these grids."""
    cell = "quadrilateral" if len(axes) == 2 else "hexahedron"
    return fem.Body(name, fem.box(axes, cell), fem.Material(young, nu))


def boussinesq(x: Array, force: float, young: float, nu: float) -> Array:
    """Displacements (n, 3) at x (n, 3), z >= 0, of a force at 0 along +z, [J85, ch. 3].

    Zero at the force itself.
    """
    rho, z = _distance(x), x[:, 2]
    radial = z / rho**3 - (1 - 2 * nu) / (rho * (rho + z))
    down = z**2 / rho**3 + 2 * (1 - nu) / rho
    scale = force * (1 + nu) / (2 * np.pi * young)
    return scale * np.column_stack([x[:, 0] * radial, x[:, 1] * radial, down])


def cerutti(x: Array, force: float, young: float, nu: float) -> Array:
    """The same of a force along +x, [J85, ch. 3]."""
    rho, (x1, x2, z) = _distance(x), x.T
    soft = 1 - 2 * nu
    across = 1 / rho**3 - soft / (rho * (rho + z) ** 2)
    along = 1 / rho + soft / (rho + z) + x1**2 * across
    down = x1 * z / rho**3 + soft * x1 / (rho * (rho + z))
    scale = force * (1 + nu) / (2 * np.pi * young)
    return scale * np.column_stack([along, x1 * x2 * across, down])


def _distance(x: Array) -> Array:
    rho = np.linalg.norm(x, axis=1)
    return np.where(rho > 0, rho, np.inf)
