"""Intersections of convex polygons, and Gauss points on them."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from bipot_rs._lib.types import Floats, Ints

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
