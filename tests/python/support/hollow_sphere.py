"""A hollow sphere of Drucker–Prager soil under internal pressure: closed form, and mesh.

The stresses follow from equilibrium and the criterion alone. The flow enters through the
displacements, which have a closed form because the direction of the flow is constant.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from bipot_rs import fem
from bipot_rs.mesh.elements import make_mesh, second_order

Array = NDArray[np.float64]


@dataclass(frozen=True)
class HollowSphere:
    """Radii A < b, moduli K and G, ``alpha``, ``beta`` and ``apex`` of the soil."""

    inner: float = 1.0
    outer: float = 2.0
    bulk: float = 150.0
    shear: float = 100.0
    alpha: float = 0.6
    beta: float = 0.2
    apex: float = 1.0

    def _mean(self, c: float) -> float:
        """Mean stress of the elastic zone outside the plastic radius ``c``."""
        ratio = (self.outer / c) ** 3
        return self.alpha * self.apex / (math.sqrt(1.5) * ratio + self.alpha)

    @property
    def _exponent(self) -> float:
        # In the plastic zone σ_θ - σ_r = m (a - σ_r).
        return self.alpha / (math.sqrt(2 / 3) + 2 * self.alpha / 3)

    def pressure(self, c: float) -> float:
        """Internal pressure with the plastic zone A <= r <= c."""
        at_c = self._mean(c) * ((self.outer / c) ** 3 - 1)
        grown = (c / self.inner) ** (2 * self._exponent)
        return (self.apex + at_c) * grown - self.apex

    @property
    def limit(self) -> float:
        """Limit pressure: the whole wall is plastic."""
        return self.pressure(self.outer)

    def radius(self, p: float) -> float:
        """Plastic radius at a pressure between that of first yield and the limit."""
        return float(brentq(lambda c: self.pressure(c) - p, self.inner, self.outer))

    def stress(self, p: float, r: Array) -> tuple[Array, Array]:
        """``σ_r`` and ``σ_θ`` at the radii ``r``."""
        c, m = self.radius(p), self._exponent
        k, ratio = self._mean(c), (self.outer / r) ** 3
        depth = (self.apex + p) * (self.inner / r) ** (2 * m)
        radial = np.where(r < c, self.apex - depth, k * (1 - ratio))
        hoop = np.where(r < c, self.apex - (1 - m) * depth, k * (1 + ratio / 2))
        return radial, hoop

    def displacement(self, p: float, r: Array) -> Array:
        """Radial displacement at the radii ``r``."""
        c, m, K, G = self.radius(p), self._exponent, self.bulk, self.shear
        k, b = self._mean(c), self.outer
        elastic = k * r / (3 * K) + k * b**3 / (4 * G * r**2)
        # Flow ε_r = -rho ε_θ, and elastic strains of a stress with Q = σ_θ - σ_r:
        # u' + rho u/r = e_r + rho e_θ = flat - fall r^-2m.
        root = math.sqrt(2 / 3)
        rho = (root - self.beta / 3) / (1 / math.sqrt(6) + self.beta / 3)
        size = (self.apex + p) * self.inner ** (2 * m)
        flat = (1 + rho) * self.apex / (3 * K)
        mean, q = (1 - 2 * m / 3) * size, m * size
        fall = (1 + rho) * mean / (3 * K) + q / (3 * G) - rho * q / (6 * G)

        def whole(at: Any) -> Any:
            """Antiderivative of ``r^rho (flat - fall r^-2m)``."""
            power = rho + 1
            return flat * at**power / power - fall * at ** (power - 2 * m) / (
                power - 2 * m
            )

        at_c = (k * c / (3 * K) + k * b**3 / (4 * G * c**2)) * c**rho
        plastic = (at_c - whole(c) + whole(r)) / r**rho
        return np.where(r < c, plastic, elastic)

    def body(self, n: int) -> fem.Body:
        """An octant: three patches of ``n × n`` hexahedra of 20 nodes, ``2 n`` along the radius."""
        ticks = np.arange(n + 1)
        patch = []
        for axis in range(3):
            i, j = np.meshgrid(ticks, ticks, indexing="ij")
            # Places on a face of the cube [0, n]³, whole numbers.
            place = np.full((*i.shape, 3), n)
            place[..., (axis + 1) % 3], place[..., (axis + 2) % 3] = i, j
            patch.append(place)
        faces = np.stack(patch)
        corners = np.stack(
            [
                faces[:, di : n + di, dj : n + dj]
                for di, dj in ((0, 0), (1, 0), (1, 1), (0, 1))
            ],
            axis=-2,
        ).reshape(-1, 3)
        cube, which = np.unique(corners, axis=0, return_inverse=True)
        quads = which.reshape(-1, 4)
        radii = np.linspace(self.inner, self.outer, 2 * n + 1)
        # First on shells of cubes, where the nodes between corners are in the middle.
        shells = (radii[:, None, None] * (cube / n)).reshape(-1, 3)
        layers = len(cube) * np.arange(2 * n)[:, None, None]
        cells = np.concatenate([layers + quads, layers + len(cube) + quads], axis=2)
        mesh, _ = make_mesh("hexahedron", shells, cells.reshape(-1, 8))
        mid = (self.inner + self.outer) / 2
        outside = mesh.boundary_facets()
        centre = mesh.p[:, mesh.facets[:, outside]].mean(axis=1)
        planes = (np.abs(centre) < 1e-9 * self.outer).any(axis=0)
        inner = ~planes & (centre.max(axis=0) < mid)
        mesh = second_order(
            mesh.with_boundaries({"inner": outside[inner]}), serendipity=True
        )
        # Equal angles between neighbours on an edge.
        radius = mesh.p.max(axis=0)
        way = np.tan(mesh.p / radius * math.pi / 4)
        curved = type(mesh)(
            radius * way / np.linalg.norm(way, axis=0), mesh.t, mesh.boundaries
        )
        young = 9 * self.bulk * self.shear / (3 * self.bulk + self.shear)
        return fem.Body(
            "wall", curved, fem.Material(young, young / (2 * self.shear) - 1)
        )
