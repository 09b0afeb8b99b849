"""Integrals of shape functions over polygons in quadrilaterals that are not parallelograms.

There N(ξ(x)) is not a polynomial of the position, and rules on triangles converge slowly if
a quadrilateral is nearly a triangle. In reference coordinates N is a polynomial, and with
coordinates along the mean edges, X = ξ + α ξη and Y = η + β ξη
(`shape_functions.reference`), Green's theorem gives

    ∫ ξᵖ ηᑫ dX dY = ∫∫ ξᵖ ηᑫ (1 + αη + βξ) dξ dη = -∮ F dξ,
    F = ξᵖ [(1 + βξ) ηᑫ⁺¹/(q + 1) + α ηᑫ⁺²/(q + 2)],
    dξ = [(1 + βξ) dX - αξ dY]/(1 + αη + βξ),

along the straight edges: on each a smooth function of one variable.
"""

from __future__ import annotations

import numpy as np

from bipot_rs._lib.types import Floats
from bipot_rs.mortar.shape_functions import FacetKind, affine, reference, skewness


def polygon_integrals(kind: FacetKind, corners: Floats, polygons: Floats) -> Floats:
    """∫ φ_j dA over polygons, ``(k, nodes)``.

    ``kind``: a kind of quadrilaterals.
    ``corners``: corners of the quadrilaterals, ``(k, 4, 2)``, in either orientation.
    ``polygons``: polygons inside them, counter-clockwise ``(k, v, 2)``; corners may repeat.
    """
    integrals = np.zeros((len(corners), kind.nodes))
    # The nearest singularity as in `integrals._beyond`.
    rate = np.log(2 / np.clip(skewness(corners), 1e-3, 0.98))
    points = 4 * np.ceil((26 / rate + 4) / 4).astype(np.int64)
    for n in np.unique(points):
        group = np.flatnonzero(points == n)
        # At a time as many points as fit into the cache.
        step = max(1, 2**17 // int(n * polygons.shape[1]))
        for first in range(0, len(group), step):
            part = group[first : first + step]
            integrals[part] = _boundary(kind, corners[part], polygons[part], int(n))
    return integrals


def _boundary(kind: FacetKind, corners: Floats, polygons: Floats, n: int) -> Floats:
    t, weight = np.polynomial.legendre.leggauss(n)
    edge = np.roll(polygons, -1, axis=1) - polygons
    places = polygons[:, :, None] + (1 + t)[:, None] / 2 * edge[:, :, None]
    k, v = polygons.shape[:2]
    local = reference(corners, places.reshape(k, v * n, 2))
    xi, eta = (np.ascontiguousarray(local[..., i]) for i in (0, 1))
    size, direction, skew = affine(corners, edge)
    dX, dY = (np.repeat(direction[..., i], n, axis=1) for i in (0, 1))
    alpha, beta = skew[:, :, None]
    b = 1 + beta * xi
    change = (b * dX - alpha * xi * dY) / (b + alpha * eta) * np.tile(weight / 2, v)
    # Moments for all powers of η, then of ξ, that occur in the functions.
    most = 1 if kind.nodes == 4 else 2
    moments = np.empty((k, most + 1, most + 1))
    for q in range(most + 1):
        part = change * eta ** (q + 1) * (b / (q + 1) + alpha * eta / (q + 2))
        for p in range(most + 1):
            moments[:, p, q] = -part.sum(axis=1)
            part *= xi
    return np.asarray(
        size[:, None] * (moments.reshape(k, -1) @ _coefficients(kind, most))
    )


def _coefficients(kind: FacetKind, most: int) -> Floats:
    """Shape functions in the monomials ξᵖ ηᑫ, ``((most + 1)², nodes)``."""
    line = np.linspace(-1, 1, most + 1)
    grid = np.stack(np.meshgrid(line, line, indexing="ij"), axis=-1).reshape(-1, 2)
    powers = np.arange(most + 1)
    rows = grid[:, :1, None] ** powers[:, None] * grid[:, 1:, None] ** powers
    coefficients = np.linalg.solve(rows.reshape(len(grid), -1), kind.shapes(grid))
    return np.asarray(coefficients, dtype=np.float64)
