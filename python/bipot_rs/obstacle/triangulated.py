"""A rigid obstacle of facets: triangles in 3D, segments in 2D.

The closest point of a facet lies inside it, on an edge or at a corner. The side of a point
follows from the normal there: the normal of the facet; on an edge the sum of the normals of
its facets; at a corner their sum weighted by angles. This is correct for every closed
surface (Bærentzen & Aanæs 2005).
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

import bipot_rs._core as _core
from bipot_rs._lib.matrices import direction, length
from bipot_rs._lib.messages import count_noun, place
from bipot_rs._lib.types import Bools, Floats, Integers, Ints
from bipot_rs._lib.validation import integers, vectors
from bipot_rs.obstacle.facet_tree import FacetTree
from bipot_rs.obstacle.protocol import Closest, check_points
from bipot_rs.obstacle.tuning import POINTS_AT_ONCE

# A facet thinner than this fraction of its longest edge has no normal.
_THIN = 1e-12
# Nearer to an edge or a corner than this fraction of the surface's size, the direction to
# it is rounding, and the normal of the edge is used.
_ON = 1e-10
# A node this near to an edge, relative to the size, counts as on it: files give
# coordinates with seven digits.
_RIM = 1e-6
# Sums of vectors below this fraction of their lengths are zero but for rounding.
_CANCELS = 1e-9


class Surface:
    """A triangulated surface in 3D, a polyline in 2D.

    Normals point to the side of the bodies: right-handed for triangles, as in STL; to the
    right of the direction from a to b for a segment ``(a, b)``, which is outwards for a
    counter-clockwise polygon. They are the normals of the facets: if a smooth surface is
    meshed with size h, the error is of order h² in distances and h in normals.

    A surface may have a border. Points beyond the border are outside.

    Distances are to the nearest point. If a punch with sharp edges moves into a body by
    more than the distance of a node from its rim, the nearest point for that node is on
    the side of the punch. Round the edges by that distance, or move the body instead of
    the punch.

    Parameters
    ----------
    points
        ``(m, d)`` [m].
    facets
        Corners of each facet, ``(k, d)``: three for a triangle, two for a segment.
    flipped
        Whether to reverse the normals.

    Raises
    ------
    TypeError, ValueError
        Shapes or indices do not fit, a facet has no area, or neighbours have normals on
        different sides; the message gives the position.
    """

    def __init__(
        self, points: ArrayLike, facets: ArrayLike, *, flipped: bool = False
    ) -> None:
        x = vectors("points of the surface", points, rows="m")
        d = x.shape[1]
        corners = integers("facets of the surface", facets)
        if corners.ndim != 2 or corners.shape[1] != d or not len(corners):
            raise ValueError(
                f"facets of the surface has shape {corners.shape}, expected (k, {d}) "
                "with k > 0"
            )
        if corners.min() < 0 or corners.max() >= len(x):
            bad = corners.min() if corners.min() < 0 else corners.max()
            raise ValueError(
                f"facets of the surface has index {bad}, expected 0 to {len(x) - 1}"
            )
        corners = corners.astype(np.int64)
        self._x = x
        self._corners = corners[:, ::-1].copy() if flipped else corners
        self._normal = _normals(x[self._corners])
        self._size = float(np.ptp(x[np.unique(corners)], axis=0).max())
        self._neighbours()
        self._tree = FacetTree(x[self._corners], self._normal)
        self._levels = _levels(x[self._corners])

    @classmethod
    def from_file(
        cls, path: str | os.PathLike[str], *, flipped: bool = False
    ) -> Surface:
        """Read the triangles of a file, such as ``die.stl``; without triangles, its lines.

        All formats of meshio. Corners at the same point are merged; in STL also corners
        that agree in all seven digits, so that there are no slits between triangles.
        Degenerate triangles are then left out, and duplicates are kept once. Lines make a
        surface in 2D, from x and y.

        Raises
        ------
        ImportError
            meshio or scikit-fem is not installed.
        OSError
            The file does not exist.
        ValueError
            The file cannot be read, has neither triangles nor lines, or lies so far from
            the origin that its digits cannot distinguish the corners.
        """
        from bipot_rs.mesh.readers import read_cells

        points, blocks = read_cells(path)
        for kind, d in (("triangle", 3), ("line", 2)):
            cells = [nodes for kind_of_block, nodes in blocks if kind_of_block == kind]
            if cells:
                x, number = np.unique(points[:, :d], axis=0, return_inverse=True)
                facets = number.reshape(-1)[np.concatenate(cells)]
                if os.fspath(path).lower().endswith(".stl"):
                    facets = _join_points(x)[facets]
                ordered = np.sort(facets, axis=1)
                whole = (np.diff(ordered, axis=1) > 0).all(axis=1)
                if not whole.any():
                    wide, far = np.ptp(x, axis=0).max(), np.abs(x).max()
                    raise ValueError(
                        f"{path} has no {kind} with distinct corners: it is {wide:.3g} wide "
                        f"and {far:.3g} from the origin; move it nearer to the origin"
                    )
                return cls(x, _once(facets[whole]), flipped=flipped)
        kinds = (
            ", ".join(sorted({kind_of_block for kind_of_block, _ in blocks}))
            or "no cells"
        )
        raise ValueError(
            f"{path} has {kinds}, expected triangles, or lines for a 2D surface"
        )

    def __repr__(self) -> str:
        kind = "triangle" if self.dim == 3 else "segment"
        border = "" if self.closed else ", with a border"
        return f"Surface({count_noun(len(self._corners), kind)}{border})"

    @property
    def dim(self) -> int:
        """2 or 3."""
        return int(self._x.shape[1])

    @property
    def closed(self) -> bool:
        """Whether the surface has no border."""
        return not self._border.any()

    def closest(self, points: Floats, /) -> Closest:
        """As `Obstacle`; of two points at the same distance either may be taken."""
        x = check_points(points, self.dim)
        return self._sign_distances(x, *self._locate_feet(x))

    def _locate_feet(self, x: Floats) -> tuple[Floats, Ints, Ints]:
        """As `_search`, in portions that bound the memory."""
        foot = np.empty_like(x)
        facet = np.empty(len(x), np.int64)
        part = np.empty(len(x), np.int64)
        for at in self._portions(x):
            foot[at], facet[at], part[at] = self._search(x[at])
        return foot, facet, part

    def facing(self, points: Floats, outward: Floats) -> Closest:
        """As `closest`, for nodes of a body with the outward directions ``outward (n, d)``.

        A surface has many normals on an edge, at a corner and on a two-sided sheet. A node
        that lies there gets the one nearest to ``-outward``, so that a flat body on a flat
        punch is pressed straight at the rim too.
        """
        x = check_points(points, self.dim)
        foot, facet, part = self._locate_feet(x)
        closest = self._sign_distances(x, foot, facet, part)
        on = np.flatnonzero(np.abs(closest.distance) <= _RIM * self._size)
        corners = self._x[self._corners[facet[on]]]
        beside = [
            length(foot[on] - _on_segment(foot[on], a, b)[0])
            for a, b in self._edges_of(corners)
        ]
        # At an edge, rounding decides which facet and which part of it was found.
        rim = np.min(beside, axis=0, initial=np.inf) <= _RIM * self._size
        on = on[rim | self._sheet[facet[on], part[on]]]
        normal = closest.normal.copy()
        for at in self._portions(on):
            point, touching = self._find_touching(closest.foot[on[at]])
            ends = np.searchsorted(point, np.arange(len(on[at]) + 1))
            for k, first, last in zip(on[at], ends[:-1], ends[1:], strict=True):
                normals = np.vstack([self._normal[touching[first:last]], normal[k]])
                # Most edges lie in a flat region.
                if np.abs(normals - normals[-1]).max() > _CANCELS:
                    normal[k] = _nearest_in_cone(normals, -outward[k], normal[k])
        return closest._replace(normal=normal)

    def _edges_of(self, corners: Floats) -> Iterator[tuple[Floats, Floats]]:
        """Ends of the edges of facets ``(k, d, d)``; for segments, each end twice."""
        for k in range(self.dim):
            far = (k + 1) % 3 if self.dim == 3 else k
            yield corners[:, k], corners[:, far]

    def _find_touching(self, places: Floats) -> tuple[Ints, Ints]:
        """Pairs of a point and a facet that it lies on, ascending by point."""
        slack = _RIM * self._size
        pairs = list(self._tree.nearer(places, np.full(len(places), slack)))
        p, f = np.concatenate([np.zeros((2, 0), np.int64), *pairs], axis=1)
        foot, _ = _closest_on(places[p], self._x[self._corners[f]])
        on = length(foot - places[p]) <= slack
        order = np.lexsort([f[on], p[on]])
        return p[on][order], f[on][order]

    def _sign_distances(
        self, x: Floats, foot: Floats, facet: Ints, part: Ints
    ) -> Closest:
        """Signed distances, and normals along the direction from the foot."""
        pseudo = self._pseudo[facet, part]
        way = x - foot
        far = length(way)
        across = np.einsum("nd,nd->n", way, pseudo)
        inside = across < 0
        # On a two-sided sheet, whose sides coincide, the side of the point counts.
        sheet = self._sheet[facet, part]
        pseudo = np.where((sheet & inside & (part == 0))[:, None], -pseudo, pseudo)
        inside &= ~sheet
        # Beyond a border the direction is oblique; below it, it is the facet's normal.
        border = self._border[facet, part]
        below = far - np.abs(np.einsum("nd,nd->n", way, self._normal[facet]))
        inside &= ~border | (below <= _ON * self._size)
        sign = np.where(inside, -1.0, 1.0)
        on = far <= _ON * self._size
        smooth = (part == 0) | on
        way = np.where(smooth[:, None], 1.0, way)
        normal = sign[:, None] * way / length(way)[:, None]
        normal = np.where(smooth[:, None], pseudo, normal)
        none = (normal == 0).all(axis=1, keepdims=True)
        normal = np.where(none, self._normal[facet], normal)
        return Closest(sign * far, normal, foot)

    def _portions(self, x: Floats | Ints) -> Iterator[slice]:
        """Slices of at most `POINTS_AT_ONCE` points."""
        for first in range(0, len(x), POINTS_AT_ONCE):
            yield slice(first, first + POINTS_AT_ONCE)

    def _search(self, x: Floats) -> tuple[Floats, Ints, Ints]:
        """Closest points, their facets, and the parts of the facets they lie on."""
        foot = np.empty_like(x)
        facet = np.zeros(len(x), np.int64)
        part = np.zeros(len(x), np.int64)
        best = np.full(len(x), np.inf)

        def compare(p: Ints, c: Ints) -> None:
            """Keep the nearest of the candidates, which are ordered by point."""
            y, where = _closest_on(x[p], self._x[self._corners[c]])
            far = length(x[p] - y)
            start = np.flatnonzero(np.diff(p, prepend=-1))
            least = np.minimum.reduceat(far, start)
            # Of equal distances the first counts: it is written last.
            leads = np.flatnonzero(far == np.repeat(least, np.diff([*start, len(p)])))
            leads = leads[far[leads] < best[p[leads]]][::-1]
            to = p[leads]
            foot[to], facet[to], part[to] = y[leads], c[leads], where[leads]
            best[to] = far[leads]

        # The facet with the nearest centre, of each size, gives an upper bound.
        for members, tree in self._levels:
            _, nearest = tree.query(x)
            compare(np.arange(len(x)), members[nearest])
        for point, candidate in self._tree.nearer(x, best):
            if point.size:
                compare(point, candidate)
        return foot, facet, part

    def _neighbours(self) -> None:
        """Compute the normals of all parts of facets, and which parts lie on the border.

        Part 0 is the interior of a facet. Then come its edges, edge k from corner k to
        the next, and then its corners.
        """
        corners, normal = self._corners, self._normal
        k, d = corners.shape
        self._pseudo = np.empty((k, 1 + (d if d == 2 else 2 * d), d))
        self._border = np.zeros(self._pseudo.shape[:2], np.bool_)
        self._sheet = np.zeros_like(self._border)
        _, same, count = np.unique(
            np.sort(corners, axis=1), axis=0, return_inverse=True, return_counts=True
        )
        self._sheet[:, 0] = (count > 1)[same.ravel()]
        self._pseudo[:, 0] = normal
        if d == 2:
            self._at_ends()
            return
        ends = np.stack([corners, np.roll(corners, -1, axis=1)], axis=2).reshape(-1, 2)
        nodes = len(self._x)
        number = ends.min(axis=1) * nodes + ends.max(axis=1)
        listed, edge = np.unique(number, return_inverse=True)
        pairs = np.column_stack([listed // nodes, listed % nodes])
        along = np.where(ends[:, 0] < ends[:, 1], 1, -1)
        self._same_side(edge, along, pairs)
        owner = np.repeat(np.arange(k), 3)
        x = self._x[corners]
        to = np.roll(x, -1, axis=1) - x
        # Outwards in the plane of the facet, orthogonal to the edge.
        aside = direction(np.cross(to, normal[:, None]))
        sums, sheet = _sums(edge, normal[owner], aside.reshape(-1, 3), len(pairs))
        self._pseudo[:, 1:4] = sums[edge].reshape(k, 3, 3)
        self._sheet[:, 1:4] = sheet[edge].reshape(k, 3)
        alone = np.bincount(edge, minlength=len(pairs)) == 1
        self._border[:, 1:4] = alone[edge].reshape(k, 3)
        fro = np.roll(x, 1, axis=1) - x
        angle = np.arctan2(length(np.cross(to, fro)), np.einsum("kcd,kcd->kc", to, fro))
        weighted = angle[:, :, None] * normal[:, None]
        # The mean direction over the angle of a corner is along its bisector.
        middle = (
            direction(direction(to) + direction(fro)) * np.sin(angle / 2)[:, :, None]
        )
        sums, sheet = _sums(
            corners.ravel(),
            weighted.reshape(-1, 3),
            -2 * middle.reshape(-1, 3),
            len(self._x),
        )
        self._pseudo[:, 4:] = sums[corners]
        self._sheet[:, 4:] = sheet[corners]
        ended = np.zeros(len(self._x), np.bool_)
        ended[pairs[alone]] = True
        self._border[:, 4:] = ended[corners]

    def _at_ends(self) -> None:
        """As `_neighbours` in 2D, where segments meet at their ends."""
        corners = self._corners
        count = np.zeros((2, len(self._x)), np.int64)
        for side in (0, 1):
            np.add.at(count[side], corners[:, side], 1)
        if (count > 1).any():
            at = int(np.argmax((count > 1).any(axis=0)))
            raise ValueError(
                f"segments of the surface that meet at {place(self._x[at])} have normals "
                "on different sides: each segment must start where the one before ends"
            )
        ends = direction(self._x[corners[:, 1]] - self._x[corners[:, 0]])
        sums, sheet = _sums(
            corners.ravel(),
            np.repeat(self._normal, 2, axis=0),
            np.stack([-ends, ends], axis=1).reshape(-1, 2),
            len(self._x),
        )
        self._pseudo[:, 1:] = sums[corners]
        self._sheet[:, 1:] = sheet[corners]
        self._border[:, 1:] = (count.sum(axis=0) == 1)[corners]

    def _same_side(self, edge: Ints, along: Ints, pairs: Ints) -> None:
        """Refuse neighbours with normals on different sides."""
        count = np.bincount(edge, minlength=len(pairs))
        balance = np.bincount(edge, along, minlength=len(pairs))
        bad = (count > 1) & (balance != 0)
        if bad.any():
            at = int(np.argmax(bad))
            middle = self._x[pairs[at]].mean(axis=0)
            raise ValueError(
                f"{count[at]} triangles of the surface that share the edge at "
                f"{place(middle)} have normals on different sides: give all triangles the "
                "same orientation"
            )


def _normals(x: Floats) -> Floats:
    """Unit normals of facets with corners ``(k, d, d)``."""
    sides = np.roll(x, -1, axis=1) - x
    longest = length(sides).max(axis=1)
    if x.shape[2] == 2:
        normal = np.column_stack([sides[:, 0, 1], -sides[:, 0, 0]])
        thin = longest == 0
    else:
        normal = np.asarray(np.cross(sides[:, 0], sides[:, 1]), np.float64)
        thin = length(normal) <= _THIN * longest**2
    if thin.any():
        at = x[np.argmax(thin)].mean(axis=0)
        raise ValueError(
            f"the facet of the surface at {place(at)} has no area, and so no normal: "
            "remove it"
        )
    return np.asarray(normal / length(normal)[:, None], np.float64)


def _sums(
    to: Integers, values: Floats, outwards: Floats, count: int
) -> tuple[Floats, Bools]:
    """Sums of vectors by index ``to``, scaled to length 1, and whether they cancel.

    Where they cancel, at the rim of a two-sided sheet, the sum of ``outwards`` is used
    instead; where that cancels too, inside the sheet, zero.
    """

    def sum_by_place(vectors: Floats) -> Floats:
        columns = [np.bincount(to, column, minlength=count) for column in vectors.T]
        total = np.stack(columns, axis=1).astype(np.float64)
        size = np.bincount(to, length(vectors), minlength=count)
        # The sum of opposite vectors is rounding, with an arbitrary direction.
        total[length(total) <= _CANCELS * size] = 0.0
        return direction(total)

    normals = sum_by_place(values)
    sheet = (normals == 0).all(axis=1, keepdims=True)
    return np.where(sheet, sum_by_place(outwards), normals), sheet.ravel()


def _nearest_in_cone(normals: Floats, direction: Floats, otherwise: Floats) -> Floats:
    """The unit vector of the cone of normals ``(k, d)`` nearest to a direction."""
    from scipy.optimize import nnls

    amounts, _ = nnls(normals.T, direction)
    direction_sum = normals.T @ amounts
    size = float(np.linalg.norm(direction_sum))
    # If all normals point away from the direction, the projection is zero.
    if size <= _CANCELS * float(np.linalg.norm(direction)):
        return otherwise
    return np.asarray(direction_sum / size, np.float64)


def _join_points(x: Floats) -> Ints:
    """For each point, the first point equal to it in 32-bit precision."""
    from scipy.spatial import cKDTree

    near = 4 * float(np.spacing(np.float32(np.abs(x).max())))
    pairs = cKDTree(x).query_pairs(near, output_type="ndarray")
    label = _core.connected(len(x), *pairs.T.astype(np.int64, order="C"))
    _, first = np.unique(label, return_index=True)
    return np.asarray(first[label], np.int64)


def _once(facets: Ints) -> Ints:
    """Facets in their order, without duplicates of the same corners and orientation."""
    first = np.argmin(facets, axis=1)
    turned = np.take_along_axis(
        facets, (first[:, None] + np.arange(facets.shape[1])) % facets.shape[1], axis=1
    )
    # The order of its ends gives the side of a segment.
    _, kept = np.unique(
        turned if facets.shape[1] == 3 else facets, axis=0, return_index=True
    )
    return facets[np.sort(kept)]


def _levels(x: Floats) -> list[tuple[Ints, Any]]:
    """Facets grouped by size in factors of two: members, and a ``cKDTree`` of their centres.

    The bound of a single tree would be that of a small facet where a large one is nearer.
    """
    from scipy.spatial import cKDTree

    middle = x.mean(axis=1)
    reach = length(x - middle[:, None]).max(axis=1)
    size = np.floor(np.log2(reach / reach.max())).astype(np.int64)
    groups = (np.flatnonzero(size == level) for level in np.unique(size))
    return [(members, cKDTree(middle[members])) for members in groups]


def _closest_on(x: Floats, corners: Floats) -> tuple[Floats, Ints]:
    """Closest points of facets ``(p, d, d)`` to points ``(p, d)``, and the parts hit."""
    if x.shape[1] == 2:
        y, t = _on_segment(x, corners[:, 0], corners[:, 1])
        return y, np.where(t <= 0, 1, np.where(t >= 1, 2, 0)).astype(np.int64)
    a, b, c = corners.transpose(1, 0, 2)
    first, second = b - a, c - a
    # x - a = s first + t second + normal part, by the normal equations.
    away = x - a
    gram = [_dot(p, q) for p, q in ((first, first), (first, second), (second, second))]
    right = _dot(first, away), _dot(second, away)
    # The determinant is four times the area squared. The cross product gives it without
    # cancellation for thin triangles.
    cross = np.cross(first, second)
    determinant = _dot(cross, cross)
    s = (gram[2] * right[0] - gram[1] * right[1]) / determinant
    t = (gram[0] * right[1] - gram[1] * right[0]) / determinant
    within = (s > 0) & (t > 0) & (s + t < 1)
    normal = cross / np.sqrt(determinant)[:, None]
    y = x - _dot(away, normal)[:, None] * normal
    part = np.zeros(len(x), np.int64)
    best = np.where(within, -1.0, np.inf)
    for k, (p, q) in enumerate(((a, b), (b, c), (c, a))):
        on, along = _on_segment(x, p, q)
        far = length(x - on)
        nearer = far < best
        best = np.where(nearer, far, best)
        y = np.where(nearer[:, None], on, y)
        edge = np.where(along <= 0, 4 + k, np.where(along >= 1, 4 + (k + 1) % 3, 1 + k))
        part = np.where(nearer, edge, part)
    return np.asarray(y, np.float64), part


def _on_segment(x: Floats, a: Floats, b: Floats) -> tuple[Floats, Floats]:
    """Closest points of segments, and their parameter along them from 0 to 1."""
    way = b - a
    size = _dot(way, way)
    t = np.clip(_dot(x - a, way) / np.where(size > 0, size, 1.0), 0.0, 1.0)
    y = a + t[:, None] * way
    # The corner itself, bitwise, so that facets that share it agree.
    return np.where((t >= 1)[:, None], b, y), t


def _dot(a: Floats, b: Floats) -> Floats:
    return np.asarray(np.einsum("nd,nd->n", a, b), np.float64)
