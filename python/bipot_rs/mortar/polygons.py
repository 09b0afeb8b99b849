"""Intersections of convex polygons, Gauss points on them, and integrals over them.

The integrals are those of shape functions in quadrilaterals that are not parallelograms.
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

from collections.abc import Iterator

import numpy as np

from bipot_rs._lib.types import Floats, Ints
from bipot_rs.mortar.shape_functions import FacetKind, affine, reference, skewness

# A corner lies on an edge, to rounding, below this fraction of size times edge length.
_ON = 1e-14


def clip(subject: Floats, by: Floats) -> Floats:
    """Intersections of pairs of convex polygons.

    Algorithm of Sutherland and Hodgman: each edge of ``by`` in turn cuts off the part on
    its right, for all pairs at once.

    ``subject, by``: corners ``(m, c, 2)``, counter-clockwise; the last one may be repeated.
    Returns ``numpy.ndarray (m, v, 2)``: corners, counter-clockwise; the last one is repeated if
    there are fewer than v. All corners are equal if the intersection is empty.
    """
    polygon = subject
    for k in range(by.shape[1]):
        start = by[:, k, None]
        edge = by[:, (k + 1) % by.shape[1], None] - start
        offset = polygon - start
        height = edge[..., 0] * offset[..., 1] - edge[..., 1] * offset[..., 0]
        size = np.abs(offset).sum(axis=2).max(axis=1, keepdims=True)
        # A row of corners on the edge must not cross it back and forth by rounding.
        height[np.abs(height) <= _ON * size * np.abs(edge).sum(axis=2)] = 0.0
        polygon = keep_half(polygon, height)
    return polygon


def keep_half(polygon: Floats, height: Floats) -> Floats:
    """Part of each polygon with non-negative height, which is that of its corners, ``(m, v)``."""
    inside = height >= 0
    following = np.roll(height, -1, axis=1)
    crosses = inside != (following >= 0)
    with np.errstate(divide="ignore", invalid="ignore"):
        share = np.where(crosses, height / (height - following), 0.0)[..., None]
    cut = polygon + share * (np.roll(polygon, -1, axis=1) - polygon)
    m, v, _ = polygon.shape
    # After each corner the point where its edge crosses the line.
    both = np.stack([polygon, cut], axis=2).reshape(m, 2 * v, 2)
    kept = np.stack([inside, crosses], axis=2).reshape(m, 2 * v)
    count = kept.sum(axis=1)
    order = np.argsort(~kept, axis=1, kind="stable")
    place = np.minimum(np.arange(max(int(count.max(initial=0)), 3)), count[:, None] - 1)
    place = np.take_along_axis(order, np.maximum(place, 0), axis=1)
    result = np.take_along_axis(both, place[..., None], axis=1)
    result[count == 0] = result[count == 0, :1]
    return np.asarray(result)


def find_overlapping_boxes(group: Ints, corners: Floats) -> Iterator[tuple[Ints, Ints]]:
    """Pairs ``(one, other)``, other < one, whose boxes overlap, in portions.

    The boxes of a group are sorted along one axis: each is compared with those that begin
    before its end.

    ``group``: group of each box, ``(m,)``; only boxes of one group are compared.
    ``corners``: points that a box contains, ``(m, v, d)``.
    """
    if not len(group):
        return
    low, high = corners.min(axis=1), corners.max(axis=1)
    # The axis along which the fewest boxes overlap.
    axis = int(np.argmax(np.ptp(low, axis=0) / (high - low).sum(axis=0)))
    start, end = low[:, axis], high[:, axis]
    order = np.lexsort([start, group])
    place = np.arange(len(order))
    for step in range(1, len(order)):
        place = place[place + step < len(order)]
        first_box, other = order[place], order[place + step]
        near = (group[first_box] == group[other]) & (start[other] < end[first_box])
        place, first_box, other = place[near], first_box[near], other[near]
        if not place.size:
            return
        over = (high[first_box] > low[other]) & (high[other] > low[first_box])
        first_box, other = first_box[over.all(axis=1)], other[over.all(axis=1)]
        yield np.maximum(first_box, other), np.minimum(first_box, other)


def triangles(polygons: Floats) -> tuple[Floats, Ints]:
    """Triangles from the first corner of each polygon, without those of zero area.

    Returns ``corners, owner``: ``(t, 3, 2)`` and the polygon of each, ascending, ``(t,)``.
    """
    m, v, _ = polygons.shape
    first = np.broadcast_to(polygons[:, :1], (m, v - 2, 2))
    corners = np.stack([first, polygons[:, 1:-1], polygons[:, 2:]], axis=2)
    edges = corners[:, :, 1:] - corners[:, :, :1]
    area = edges[..., 0, 0] * edges[..., 1, 1] - edges[..., 0, 1] * edges[..., 1, 0]
    owner, which = np.nonzero(area > 0)
    return corners[owner, which], owner.astype(np.int64)


def triangle_rule(degree: int) -> tuple[Floats, Floats]:
    """Points ``(q, 2)`` and weights ``(q,)`` on the reference triangle, exact to ``degree``.

    Gauss–Jacobi rules on a square collapsed into the triangle; the sum of the weights is
    1/2.
    """
    from scipy.special import roots_jacobi

    n = degree // 2 + 1
    u, wu = roots_jacobi(n, 1.0, 0.0)
    v, wv = np.polynomial.legendre.leggauss(n)
    u, v = (1 + u) / 2, (1 + v) / 2
    x = np.stack(np.broadcast_arrays(u[:, None], v * (1 - u[:, None])), axis=2)
    return x.reshape(-1, 2), np.outer(wu / 4, wv / 2).ravel()


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
