"""Intersections of convex polygons, and points of Gauss on them."""

from __future__ import annotations

import numpy as np

from bipot_rs._lib.types import Floats, Ints

# Of the size of a polygon times the length of an edge: on that edge, but for rounding.
_ON = 1e-14


def clip(subject: Floats, by: Floats) -> Floats:
    """Intersections of convex polygons, one each of two lists.

    Sutherland and Hodgman: one edge of ``by`` after the other cuts off what lies on its
    right. All pairs at once.

    Parameters
    ----------
    subject, by
        Corners ``(m, c, 2)``, counter-clockwise; the last one may be repeated.

    Returns
    -------
    numpy.ndarray (m, v, 2)
        Corners, counter-clockwise, the last one repeated where there are less than v;
        all in one place where nothing is left.
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
        polygon = _half(polygon, height)
    return polygon


def _half(polygon: Floats, height: Floats) -> Floats:
    """Part of each polygon where the height at the corners is not negative."""
    inside = height >= 0
    following = np.roll(height, -1, axis=1)
    crosses = inside != (following >= 0)
    with np.errstate(divide="ignore", invalid="ignore"):
        share = np.where(crosses, height / (height - following), 0.0)[..., None]
    cut = polygon + share * (np.roll(polygon, -1, axis=1) - polygon)
    m, v, _ = polygon.shape
    # Behind each corner that stays the place where its edge leaves or enters.
    both = np.stack([polygon, cut], axis=2).reshape(m, 2 * v, 2)
    kept = np.stack([inside, crosses], axis=2).reshape(m, 2 * v)
    count = kept.sum(axis=1)
    order = np.argsort(~kept, axis=1, kind="stable")
    place = np.minimum(np.arange(max(int(count.max(initial=0)), 3)), count[:, None] - 1)
    place = np.take_along_axis(order, np.maximum(place, 0), axis=1)
    result = np.take_along_axis(both, place[..., None], axis=1)
    result[count == 0] = result[count == 0, :1]
    return np.asarray(result)


def triangles(polygons: Floats) -> tuple[Floats, Ints]:
    """Triangles from the first corner of each polygon, those of no area left out.

    Returns
    -------
    corners, owner
        ``(t, 3, 2)`` and the polygon of each, ascending, ``(t,)``.
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

    Gauss and Jacobi on the square that is folded into the triangle; the weights sum up
    to 1/2.
    """
    from scipy.special import roots_jacobi

    n = degree // 2 + 1
    u, wu = roots_jacobi(n, 1.0, 0.0)
    v, wv = np.polynomial.legendre.leggauss(n)
    u, v = (1 + u) / 2, (1 + v) / 2
    x = np.stack(np.broadcast_arrays(u[:, None], v * (1 - u[:, None])), axis=2)
    return x.reshape(-1, 2), np.outer(wu / 4, wv / 2).ravel()
