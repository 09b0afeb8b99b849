"""A tree of facets in cylinders, which enclose nearly flat groups closer than boxes.

A node has eight children, which follow each other along Morton's curve.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from bipot_rs._lib.types import Bools, Floats, Ints

# Relative rounding error of a bound, from some ten operations.
_ROUNDING = 1e-12
# Children of a node, and pairs compared at once: some ten megabytes.
WIDTH, AT_ONCE = 8, 2**17


def _sort_along_curve(places: Floats) -> Ints:
    """Order of points ``(n, d)`` along Morton's curve, where neighbours are close."""
    low = places.min(axis=0)
    wide = float(np.ptp(places, axis=0).max())
    bits = 60 // places.shape[1]
    cell = (places - low) * ((2**bits - 1) / wide if wide > 0 else 0.0)
    code = np.zeros(len(places), np.int64)
    for k, column in enumerate(cell.astype(np.int64).T):
        for bit in range(bits):
            code |= ((column >> bit) & 1) << (bit * places.shape[1] + k)
    return np.argsort(code, kind="stable")


def _children(node: Ints, count: int) -> tuple[Ints, Ints]:
    """Children of nodes in a level of ``count`` nodes, and the index of their parent."""
    parent = np.repeat(np.arange(len(node)), WIDTH)
    child = (node[:, None] * WIDTH + np.arange(WIDTH)).ravel()
    there = child < count
    return parent[there], child[there]


def _descend(
    sizes: list[int], queries: int, near: Callable[[int, Ints, Ints], Bools]
) -> Iterator[tuple[Ints, Ints]]:
    """Pairs of a query and a leaf that are near each other, in portions.

    Memory does not grow with the number of pairs: portions are completed depth first.

    ``sizes``: number of nodes of each level, from the leaves to the root.
    ``queries``: number of queries.
    ``near``: function of a level, queries and nodes ``(p,)``: whether each pair may be near.
    """
    work: list[tuple[int, Ints, Ints]] = []
    work.append((len(sizes) - 1, np.arange(queries), np.zeros(queries, np.int64)))
    while work:
        level, query, node = work.pop()
        if len(query) > AT_ONCE:
            half = len(query) // 2
            work.append((level, query[half:], node[half:]))
            work.append((level, query[:half], node[:half]))
            continue
        met = near(level, query, node)
        query, node = query[met], node[met]
        if not query.size:
            continue
        if level == 0:
            yield query, node
        else:
            parent, child = _children(node, sizes[level - 1])
            work.append((level - 1, query[parent], child))


class FacetTree:
    """Facets with corners ``(m, c, d)`` and unit normals ``(m, d)``.

    A node is a cylinder about the mean normal of its facets. From the centre of a sphere,
    the distances of all facets differ by their sagitta only; boxes are thicker than that
    and could not exclude any facet.
    """

    def __init__(self, corners: Floats, normals: Floats) -> None:
        self._order = _sort_along_curve(corners.mean(axis=1))
        corners, normals = corners[self._order], normals[self._order]
        self._size = float(np.ptp(corners.reshape(-1, corners.shape[2]), axis=0).max())
        # From the facets to the root: centre, axis, radius, half height of each node.
        self._levels = [_cylinders(corners, normals, np.arange(len(corners)))]
        first = np.arange(len(corners))
        while len(first) > 1:
            first = first[::WIDTH]
            self._levels.append(_cylinders(corners, normals, first))

    def nearer(self, x: Floats, best: Floats) -> Iterator[tuple[Ints, Ints]]:
        """Pairs of a point and a facet that may be nearer than ``best (n,)``.

        In portions, ascending by point, then by facet. The caller lowers ``best`` after
        each portion, which excludes more of the remaining pairs.
        """
        slack = _ROUNDING * self._size

        def within(least: Floats, point: Ints) -> Bools:
            return np.asarray(least <= best[point] * (1 + _ROUNDING) + slack)

        def near(level: int, point: Ints, node: Ints) -> Bools:
            return within(_bounds(x[point], self._levels[level][node]), point)

        sizes = [len(level) for level in self._levels]
        for point, node in _descend(sizes, len(x), near):
            least = _bounds(x[point], self._levels[0][node])
            # The facet with the least bound first: it excludes most others.
            order = np.lexsort([least, point])
            first = order[np.flatnonzero(np.diff(point[order], prepend=-1))]
            yield point[first], self._order[node[first]]
            may = within(least, point)
            may[first] = False
            point, facet = point[may], self._order[node[may]]
            order = np.lexsort([facet, point])
            yield point[order], facet[order]


def _cylinders(corners: Floats, normals: Floats, first: Ints) -> Floats:
    """Centre, axis, radius and half height in a row for the facets from each ``first``."""
    count = np.diff(np.append(first, len(corners)))
    node = np.repeat(np.arange(len(first)), count)
    axis = np.add.reduceat(normals, first)
    length = np.sqrt(np.einsum("nd,nd->n", axis, axis))
    # Where normals cancel, any axis is valid.
    axis[length == 0] = np.eye(axis.shape[1])[0]
    axis /= np.where(length == 0, 1.0, length)[:, None]
    low = np.minimum.reduceat(corners.min(axis=1), first)
    high = np.maximum.reduceat(corners.max(axis=1), first)
    centre = (low + high) / 2
    way = corners - centre[node][:, None]
    along = np.einsum("mcd,md->mc", way, axis[node])
    bottom = np.minimum.reduceat(along.min(axis=1), first)
    top = np.maximum.reduceat(along.max(axis=1), first)
    half, middle = (top - bottom) / 2, (top + bottom) / 2
    # Across the axis the centre stays.
    aside = np.einsum("mcd,mcd->mc", way, way) - along**2
    aside = np.sqrt(np.maximum(np.maximum.reduceat(aside.max(axis=1), first), 0.0))
    centre += middle[:, None] * axis
    # The radius at least half the height: the distance from the axis of a far point is
    # a difference with rounding errors.
    radius = np.maximum(aside, half)
    return np.column_stack([centre, axis, radius, half])


def _bounds(x: Floats, cylinders: Floats) -> Floats:
    """Distances of points ``(p, d)`` to one cylinder each."""
    d = x.shape[1]
    way = x - cylinders[:, :d]
    along = np.abs(np.einsum("pd,pd->p", way, cylinders[:, d : 2 * d]))
    aside = np.sqrt(np.maximum(np.einsum("pd,pd->p", way, way) - along**2, 0.0))
    above = np.maximum(along - cylinders[:, -1], 0.0)
    beside = np.maximum(aside - cylinders[:, -2], 0.0)
    return np.asarray(np.sqrt(above**2 + beside**2))
