"""Integrals of shape functions over polygons in quadrilaterals that are no parallelograms.

There N(ξ(x)) is not a polynomial of places, and rules on triangles converge slowly where
a quadrilateral is nearly a triangle. In reference coordinates it is one, and by Green

    ∫ N dA = ∫∫ N det J dξ dη = -∮ F dξ,    F(ξ, η) = ∫₀^η N det J dη',

F exact by three points of Gauss, and the rest along the edges, which are straight in
space: a smooth function of one variable each.
"""

from __future__ import annotations

import numpy as np

from bipot_rs.check import Array
from bipot_rs.facet_shapes import Kind, reference, skewness, tangents


def polygon_integrals(kind: Kind, corners: Array, polygons: Array) -> Array:
    """∫ φ_j dA over polygons, ``(k, nodes)``.

    Parameters
    ----------
    kind
        Of quadrilaterals.
    corners
        Of the quadrilaterals, ``(k, 4, 2)``, in either sense.
    polygons
        Within them, counter-clockwise ``(k, v, 2)``; corners may repeat.
    """
    found = np.zeros((len(corners), kind.nodes))
    # Nearest singularity as in the order of the rules on triangles.
    rate = np.log(2 / np.clip(skewness(corners), 1e-3, 0.98))
    points = 4 * np.ceil((20 / rate + 4) / 4).astype(np.int64)
    for n in np.unique(points):
        group = np.flatnonzero(points == n)
        # As many points at a time as fit the cache.
        step = max(1, 2**17 // int(n * polygons.shape[1]))
        for first in range(0, len(group), step):
            part = group[first : first + step]
            found[part] = _boundary(kind, corners[part], polygons[part], int(n))
    return found


def _boundary(kind: Kind, corners: Array, polygons: Array, n: int) -> Array:
    t, weight = np.polynomial.legendre.leggauss(n)
    edge = np.roll(polygons, -1, axis=1) - polygons
    places = polygons[:, :, None] + (1 + t)[:, None] / 2 * edge[:, :, None]
    k, v = polygons.shape[:2]
    xi = reference(corners, places.reshape(k, v * n, 2))
    along, up = tangents(corners, xi)
    direction = np.repeat(edge, n, axis=1)
    # dξ = (dx × x_η)/(x_ξ × x_η).
    change = _cross(direction, up) / _cross(along, up) * np.tile(weight / 2, v)
    total = np.zeros((k, kind.nodes))
    for s, w in zip(*np.polynomial.legendre.leggauss(3), strict=True):
        below = np.stack([xi[..., 0], xi[..., 1] * (1 + s) / 2], axis=-1)
        size = _cross(*tangents(corners, below)) * xi[..., 1] * w / 2
        total -= np.einsum("kq,kqj->kj", size * change, kind.shapes(below))
    return total


def _cross(u: Array, v: Array) -> Array:
    return np.asarray(u[..., 0] * v[..., 1] - u[..., 1] * v[..., 0])
