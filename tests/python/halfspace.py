"""Bodies so large beside their contact that they pass for half-spaces.

Lengths are in units of the size of the contact, a = 1. Cells of the size h around it
grow outwards by 1 + 2 h each: one number refines the whole mesh.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bipot_rs import fem

Array = NDArray[np.float64]


def grid(h: float, near: float, far: float) -> Array:
    """Points from 0 to `far`: cells of size h up to `near`, growing from there."""
    points = [*np.linspace(0, near, round(near / h) + 1)]
    cell = h
    while points[-1] < far:
        cell *= 1 + 2 * h
        points.append(points[-1] + cell)
    # The last cell is cut, unless little would be left of it.
    if len(points) > 2 and far - points[-2] < 0.5 * (points[-2] - points[-3]):
        del points[-2]
    points[-1] = far
    return np.array(points)


def mirrored(points: Array) -> Array:
    """The grid and its image, -x."""
    return np.unique(np.append(-points, points))


@dataclass(frozen=True)
class Steel:
    """Elastic constants, in units in which E = 1."""

    nu: float

    @property
    def material(self) -> fem.Material:
        return fem.Material(1.0, self.nu)

    @property
    def shear(self) -> float:
        return 1 / (2 * (1 + self.nu))


def boussinesq(x: Array, force: float, nu: float) -> Array:
    """Displacements (n, 3) at x (n, 3), z >= 0, of a point force along +z on z = 0.

    [J85, (3.18)], E = 1.
    """
    rho = np.linalg.norm(x, axis=1)
    z, scale = x[:, 2], force * (1 + nu) / (2 * np.pi)
    radial = z / rho**3 - (1 - 2 * nu) / (rho * (rho + z))
    down = z**2 / rho**3 + 2 * (1 - nu) / rho
    return scale * np.column_stack([x[:, 0] * radial, x[:, 1] * radial, down])


def cerutti(x: Array, force: float, nu: float) -> Array:
    """The same of a point force along +x, [J85, (3.19)]."""
    rho = np.linalg.norm(x, axis=1)
    x1, x2, z = x.T
    scale, soft = force * (1 + nu) / (2 * np.pi), 1 - 2 * nu
    across = 1 / rho**3 - soft / (rho * (rho + z) ** 2)
    return scale * np.column_stack(
        [
            1 / rho + soft / (rho + z) + x1**2 * across,
            x1 * x2 * across,
            x1 * z / rho**3 + soft * x1 / (rho * (rho + z)),
        ]
    )
