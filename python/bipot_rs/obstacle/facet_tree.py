"""A tree of facets in cylinders, which lie closer to what is nearly flat than boxes do."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from bipot_rs._lib.types import Bools, Floats, Ints
from bipot_rs.mortar.box_tree import along_curve, descend, starts

# Of distances and sizes: above what rounding makes of a bound, in some ten operations.
_ROUNDING = 1e-12


class FacetTree:
    """Facets with corners ``(m, c, d)`` and unit normals ``(m, d)``.

    A node is a cylinder about the mean normal of its facets. Seen from the centre of a
    sphere all of its facets are equally far but for the sagitta of a facet: boxes around
    them, thicker than that, would tell none of them apart.
    """

    def __init__(self, corners: Floats, normals: Floats) -> None:
        self._order = along_curve(corners.mean(axis=1))
        corners, normals = corners[self._order], normals[self._order]
        self._size = float(np.ptp(corners.reshape(-1, corners.shape[2]), axis=0).max())
        # From the facets up: centre, axis, radius and half the height of each node.
        self._levels = [_cylinders(corners, normals, np.arange(len(corners)))]
        first = np.arange(len(corners))
        while len(first) > 1:
            first = first[starts(len(first))]
            self._levels.append(_cylinders(corners, normals, first))

    def nearer(self, x: Floats, best: Floats) -> Iterator[tuple[Ints, Ints]]:
        """Points and facets that may be nearer to them than ``best (n,)``.

        A portion at a time, ascending by point, then by facet. The caller lowers
        ``best`` meanwhile, which leaves out the more of those to come.
        """
        slack = _ROUNDING * self._size

        def within(least: Floats, point: Ints) -> Bools:
            return np.asarray(least <= best[point] * (1 + _ROUNDING) + slack)

        def near(level: int, point: Ints, node: Ints) -> Bools:
            return within(_bounds(x[point], self._levels[level][node]), point)

        sizes = [len(level) for level in self._levels]
        for point, node in descend(sizes, len(x), near):
            least = _bounds(x[point], self._levels[0][node])
            # The most promising facet of each point first: few others are left then.
            order = np.lexsort([least, point])
            first = order[np.flatnonzero(np.diff(point[order], prepend=-1))]
            yield point[first], self._order[node[first]]
            may = within(least, point)
            may[first] = False
            point, facet = point[may], self._order[node[may]]
            order = np.lexsort([facet, point])
            yield point[order], facet[order]


def _cylinders(corners: Floats, normals: Floats, first: Ints) -> Floats:
    """Rows of centre, axis, radius and half height of facets from each ``first`` on."""
    count = np.diff(np.append(first, len(corners)))
    node = np.repeat(np.arange(len(first)), count)
    axis = np.add.reduceat(normals, first)
    length = np.sqrt(np.einsum("nd,nd->n", axis, axis))
    # Any axis will do where normals cancel.
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
    # At right angles to the axis the centre stays.
    aside = np.einsum("mcd,mcd->mc", way, way) - along**2
    aside = np.sqrt(np.maximum(np.maximum.reduceat(aside.max(axis=1), first), 0.0))
    centre += middle[:, None] * axis
    # No flatter than wide: what is aside of a far place along the axis is rounding.
    radius = np.maximum(aside, half)
    return np.column_stack([centre, axis, radius, half])


def _bounds(x: Floats, cylinders: Floats) -> Floats:
    """Distances of places ``(p, d)`` to cylinders, one each."""
    d = x.shape[1]
    way = x - cylinders[:, :d]
    along = np.abs(np.einsum("pd,pd->p", way, cylinders[:, d : 2 * d]))
    aside = np.sqrt(np.maximum(np.einsum("pd,pd->p", way, way) - along**2, 0.0))
    above = np.maximum(along - cylinders[:, -1], 0.0)
    beside = np.maximum(aside - cylinders[:, -2], 0.0)
    return np.asarray(np.sqrt(above**2 + beside**2))
