"""A rigid obstacle of facets: triangles in space, segments in the plane.

The closest point of a facet lies within it, on an edge or at a corner. On which side a
point is, the normal there tells: that of the facet, the sum of those that meet at an edge,
and at a corner their sum weighted by angles, which is right for every closed surface
(Bærentzen & Aanæs 2005).
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from bipot_rs._lib.messages import counted, place
from bipot_rs._lib.types import Bools, Floats, Ints
from bipot_rs._lib.validation import floats
from bipot_rs.obstacle.facet_tree import FacetTree
from bipot_rs.obstacle.protocol import Closest, length, taken

# A facet thinner than this share of its longest edge has no normal.
_THIN = 1e-12
# Nearer to an edge or a corner than this share of the surface's size, the way to it is
# rounding, and the normal is the one of the edge.
_ON = 1e-10
# A node of a body is at an edge of what it is pressed on where files, which know places to
# seven digits, do not tell the two apart.
_RIM = 1e-6
# Of the sizes of vectors that are added: opposite ones, but for rounding.
_CANCELS = 1e-9
# Points that are located at once: some ten megabytes.
_AT_ONCE = 2**13


class Surface:
    """A triangulated surface in space, a polyline in the plane.

    Its normals point to where bodies are: of a triangle by the right hand, as STL has
    them, of a segment ``(a, b)`` to the right of the way from a to b, out of a polygon
    that runs counter-clockwise. They are those of the facets: of a smooth surface meshed
    with size h, distances are right to h² and normals to h.

    A surface may have a border. Beyond it there is nothing to be inside of: such points
    are outside, however they lie.

    Distances are those to the nearest place. A punch with sharp edges that moves into a
    body by more than a node is inside its rim has, at that node, the distance of its side:
    round the edges by that much, or move the body and not the punch.

    Parameters
    ----------
    points
        ``(m, d)`` [m].
    facets
        Corners of each, ``(k, d)``: three of a triangle, two of a segment.
    flipped
        Whether the normals are to point the other way.

    Raises
    ------
    TypeError, ValueError
        Shapes or indices that do not fit, a facet without area, neighbours whose normals
        point to different sides; with the place.
    """

    def __init__(
        self, points: ArrayLike, facets: ArrayLike, *, flipped: bool = False
    ) -> None:
        x = floats("points of the surface", points, ndim=2)
        d = x.shape[1]
        if d not in (2, 3):
            raise ValueError(
                f"points of the surface has shape {x.shape}, expected (m, 2) or (m, 3)"
            )
        corners = np.asarray(facets)
        if corners.dtype.kind not in "iu":
            raise TypeError(
                f"facets of the surface has entries of type {corners.dtype}, expected "
                "integers"
            )
        if corners.ndim != 2 or corners.shape[1] != d or not len(corners):
            raise ValueError(
                f"facets of the surface has shape {corners.shape}, expected (k, {d}), one "
                "or more"
            )
        if corners.min() < 0 or corners.max() >= len(x):
            bad = corners.min() if corners.min() < 0 else corners.max()
            raise ValueError(
                f"facets of the surface hold {bad}, expected 0 to {len(x) - 1}"
            )
        corners = corners.astype(np.int64)
        self._x = x
        self._corners = corners[:, ::-1].copy() if flipped else corners
        self._normal = _normals(x[self._corners])
        self._size = float(np.ptp(x[np.unique(corners)], axis=0).max())
        self._neighbours()
        self._levels = _levels(x[self._corners])
        self._tree = FacetTree(x[self._corners], self._normal)

    @classmethod
    def from_file(
        cls, path: str | os.PathLike[str], *, flipped: bool = False
    ) -> Surface:
        """The triangles of a file, such as ``die.stl``, or where it has none its lines.

        Whatever meshio reads. Corners at one place are one corner, of STL those that its
        seven digits do not tell apart, lest there be slits between triangles. Triangles
        that then have none left are gone, and of those that are there twice one counts.
        Lines make a surface in the plane, of x and y.

        Raises
        ------
        ImportError
            meshio is not installed, or scikit-fem.
        OSError
            There is no such file.
        ValueError
            It cannot be read, holds neither, or lies so far from the origin that its
            digits tell no corners apart.
        """
        from bipot_rs.mesh.readers import read_cells

        points, blocks = read_cells(path)
        for kind, d in (("triangle", 3), ("line", 2)):
            cells = [nodes for known, nodes in blocks if known == kind]
            if cells:
                x, number = np.unique(points[:, :d], axis=0, return_inverse=True)
                facets = number.reshape(-1)[np.concatenate(cells)]
                if os.fspath(path).lower().endswith(".stl"):
                    facets = _joined(x)[facets]
                ordered = np.sort(facets, axis=1)
                whole = (np.diff(ordered, axis=1) > 0).all(axis=1)
                if not whole.any():
                    wide, far = np.ptp(x, axis=0).max(), np.abs(x).max()
                    raise ValueError(
                        f"{path} has no {kind} whose corners its digits tell apart: it is "
                        f"{wide:.3g} wide, {far:.3g} from the origin"
                    )
                return cls(x, _once(facets[whole]), flipped=flipped)
        kinds = ", ".join(sorted({known for known, _ in blocks})) or "no cells"
        raise ValueError(
            f"{path} has {kinds}, expected triangles, or lines in the plane"
        )

    def __repr__(self) -> str:
        kind = "triangle" if self.dim == 3 else "segment"
        border = "" if self.closed else ", with a border"
        return f"Surface({counted(len(self._corners), kind)}{border})"

    @property
    def dim(self) -> int:
        """2 or 3."""
        return int(self._x.shape[1])

    @property
    def closed(self) -> bool:
        """Whether it has no border."""
        return not self._border.any()

    def closest(self, points: Floats, /) -> Closest:
        """As `Obstacle`; of two places at one distance either may be taken."""
        x = taken(points, self.dim)
        return self._signed(x, *self._located(x))

    def _located(self, x: Floats) -> tuple[Floats, Ints, Ints]:
        """As `_search`, of any number of points."""
        foot = np.empty_like(x)
        facet = np.empty(len(x), np.int64)
        part = np.empty(len(x), np.int64)
        for at in self._portions(x):
            foot[at], facet[at], part[at] = self._search(x[at])
        return foot, facet, part

    def facing(self, points: Floats, outward: Floats) -> Closest:
        """As `closest`, for nodes of bodies with the directions ``outward (n, d)`` there.

        On an edge or a corner, and on a sheet of two sides, a surface has many normals: a
        node in that very place takes of these the nearest to the opposite of its own, so
        that a flat body on a flat punch is pressed straight at the rim too.
        """
        x = taken(points, self.dim)
        foot, facet, part = self._located(x)
        found = self._signed(x, foot, facet, part)
        on = np.flatnonzero(np.abs(found.distance) <= _RIM * self._size)
        corners = self._x[self._corners[facet[on]]]
        beside = [
            length(foot[on] - _on_segment(foot[on], a, b)[0])
            for a, b in self._edges_of(corners)
        ]
        # Rounding tells which of the facets at an edge is found, and as what part of it.
        rim = np.min(beside, axis=0, initial=np.inf) <= _RIM * self._size
        on = on[rim | self._sheet[facet[on], part[on]]]
        normal = found.normal.copy()
        for at in self._portions(on):
            point, touching = self._touching(found.foot[on[at]])
            ends = np.searchsorted(point, np.arange(len(on[at]) + 1))
            for k, first, last in zip(on[at], ends[:-1], ends[1:], strict=True):
                normals = np.vstack([self._normal[touching[first:last]], normal[k]])
                # Most edges are within something flat.
                if np.abs(normals - normals[-1]).max() > _CANCELS:
                    normal[k] = _nearest_in_cone(normals, -outward[k], normal[k])
        return found._replace(normal=normal)

    def _edges_of(self, corners: Floats) -> Iterator[tuple[Floats, Floats]]:
        """Ends of the edges of facets ``(k, d, d)``; of segments, each end twice."""
        for k in range(self.dim):
            far = (k + 1) % 3 if self.dim == 3 else k
            yield corners[:, k], corners[:, far]

    def _touching(self, places: Floats) -> tuple[Ints, Ints]:
        """Places and facets that they are on, in pairs, ascending by place."""
        slack = _RIM * self._size
        point, facet = [np.zeros(0, np.int64)], [np.zeros(0, np.int64)]
        for members, tree, reach in self._levels if len(places) else []:
            found = tree.query_ball_point(places, reach + slack)
            point.append(np.repeat(np.arange(len(places)), [len(one) for one in found]))
            near = np.concatenate([np.array(one, np.int64) for one in found])
            facet.append(members[near])
        p, f = np.concatenate(point), np.concatenate(facet)
        foot, _ = _closest_on(places[p], self._x[self._corners[f]])
        on = length(foot - places[p]) <= slack
        order = np.argsort(p[on], kind="stable")
        return p[on][order], f[on][order]

    def _signed(self, x: Floats, foot: Floats, facet: Ints, part: Ints) -> Closest:
        """Distances with their sign, and the normals: along the way to the foot."""
        pseudo = self._pseudo[facet, part]
        way = x - foot
        far = length(way)
        across = np.einsum("nd,nd->n", way, pseudo)
        inside = across < 0
        # Of a sheet of two sides, which coincide, that side counts where the point is.
        sheet = self._sheet[facet, part]
        pseudo = np.where((sheet & inside & (part == 0))[:, None], -pseudo, pseudo)
        inside &= ~sheet
        # Past a border the way leads aside; below it, it is a normal of the facet.
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
        """Points in their order, as many as are compared at once."""
        for first in range(0, len(x), _AT_ONCE):
            yield slice(first, first + _AT_ONCE)

    def _search(self, x: Floats) -> tuple[Floats, Ints, Ints]:
        """Closest points, the facets they are on, and which part of them."""
        foot = np.empty_like(x)
        facet = np.zeros(len(x), np.int64)
        part = np.zeros(len(x), np.int64)
        best = np.full(len(x), np.inf)

        def compare(p: Ints, c: Ints) -> None:
            """The best of candidates, which come in the order of their points."""
            y, where = _closest_on(x[p], self._x[self._corners[c]])
            far = length(x[p] - y)
            start = np.flatnonzero(np.diff(p, prepend=-1))
            least = np.minimum.reduceat(far, start)
            # Of equals the first of each point: written last.
            leads = np.flatnonzero(far == np.repeat(least, np.diff([*start, len(p)])))
            leads = leads[far[leads] < best[p[leads]]][::-1]
            to = p[leads]
            foot[to], facet[to], part[to] = y[leads], c[leads], where[leads]
            best[to] = far[leads]

        # The facet whose middle is nearest, of each size: none farther away counts.
        for members, tree, _ in self._levels:
            _, nearest = tree.query(x)
            compare(np.arange(len(x)), members[nearest])
        for point, candidate in self._tree.nearer(x, best):
            if point.size:
                compare(point, candidate)
        return foot, facet, part

    def _neighbours(self) -> None:
        """Normals of all parts of facets, and which parts lie on the border.

        Part 0 is the inside of a facet; then come its edges, of which edge k leads from
        corner k to the next, and its corners.
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
        # Out of the facet, in its plane, at right angles to the edge.
        aside = _units(np.cross(to, normal[:, None]))
        sums, sheet = _sums(edge, normal[owner], aside.reshape(-1, 3), len(pairs))
        self._pseudo[:, 1:4] = sums[edge].reshape(k, 3, 3)
        self._sheet[:, 1:4] = sheet[edge].reshape(k, 3)
        alone = np.bincount(edge, minlength=len(pairs)) == 1
        self._border[:, 1:4] = alone[edge].reshape(k, 3)
        fro = np.roll(x, 1, axis=1) - x
        angle = np.arctan2(length(np.cross(to, fro)), np.einsum("kcd,kcd->kc", to, fro))
        weighted = angle[:, :, None] * normal[:, None]
        # The mean direction over the angle of a corner is that of its bisector.
        middle = _units(_units(to) + _units(fro)) * np.sin(angle / 2)[:, :, None]
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
        """The same in the plane, where segments meet at their ends."""
        corners = self._corners
        count = np.zeros((2, len(self._x)), np.int64)
        for side in (0, 1):
            np.add.at(count[side], corners[:, side], 1)
        if (count > 1).any():
            at = int(np.argmax((count > 1).any(axis=0)))
            raise ValueError(
                f"segments of the surface that meet at {place(self._x[at])} have normals "
                "to different sides: each must go on where the one before ends"
            )
        ends = _units(self._x[corners[:, 1]] - self._x[corners[:, 0]])
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
        """Refuse neighbours whose normals point to different sides."""
        count = np.bincount(edge, minlength=len(pairs))
        balance = np.bincount(edge, along, minlength=len(pairs))
        bad = (count > 1) & (balance != 0)
        if bad.any():
            at = int(np.argmax(bad))
            middle = self._x[pairs[at]].mean(axis=0)
            raise ValueError(
                f"{count[at]} triangles of the surface that share the edge at "
                f"{place(middle)} have normals to different sides: orient them alike, as "
                "meshing programs do"
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
            f"the facet of the surface at {place(at)} has no area, and so no normal"
        )
    return np.asarray(normal / length(normal)[:, None], np.float64)


def _sums(
    to: Ints, values: Floats, outwards: Floats, count: int
) -> tuple[Floats, Bools]:
    """Sums of vectors by where they belong, of length 1, and where they cancel.

    There, at the rim of a sheet of two sides, the sum of ``outwards`` takes their place;
    where that cancels too, between the two sides, zero.
    """

    def summed(vectors: Floats) -> Floats:
        columns = [np.bincount(to, column, minlength=count) for column in vectors.T]
        total = np.stack(columns, axis=1).astype(np.float64)
        size = np.bincount(to, length(vectors), minlength=count)
        # What is left of opposite ones is rounding, which points anywhere.
        total[length(total) <= _CANCELS * size] = 0.0
        return _units(total)

    normals = summed(values)
    sheet = (normals == 0).all(axis=1, keepdims=True)
    return np.where(sheet, summed(outwards), normals), sheet.ravel()


def _units(vectors: Floats) -> Floats:
    """Vectors ``(..., d)`` of length 1, those of length zero as they are."""
    size = length(vectors)[..., None]
    return np.asarray(
        np.divide(vectors, size, out=np.zeros_like(vectors), where=size > 0), np.float64
    )


def _nearest_in_cone(normals: Floats, direction: Floats, otherwise: Floats) -> Floats:
    """The unit vector, nearest to a direction, of those that normals ``(k, d)`` span."""
    from scipy.optimize import nnls

    amounts, _ = nnls(normals.T, direction)
    found = normals.T @ amounts
    size = float(np.linalg.norm(found))
    # Where they all look away there is none.
    if size <= _CANCELS * float(np.linalg.norm(direction)):
        return otherwise
    return np.asarray(found / size, np.float64)


def _joined(x: Floats) -> Ints:
    """For each place the first of those that numbers of 32 bits take for it."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial import cKDTree

    near = 4 * float(np.spacing(np.float32(np.abs(x).max())))
    pairs = cKDTree(x).query_pairs(near, output_type="ndarray")
    graph = coo_array((np.ones(len(pairs)), pairs.T), shape=(len(x), len(x)))
    _, label = connected_components(graph, directed=False)
    _, first = np.unique(label, return_index=True)
    return np.asarray(first[label], np.int64)


def _once(facets: Ints) -> Ints:
    """Facets in their order, one of each that run through the same corners alike."""
    first = np.argmin(facets, axis=1)
    turned = np.take_along_axis(
        facets, (first[:, None] + np.arange(facets.shape[1])) % facets.shape[1], axis=1
    )
    # The ends of a segment tell its side, as the sense of a triangle.
    _, kept = np.unique(
        turned if facets.shape[1] == 3 else facets, axis=0, return_index=True
    )
    return facets[np.sort(kept)]


def _levels(x: Floats) -> list[tuple[Ints, Any, float]]:
    """Facets by size, each factor of two a tree of their middles with their reach.

    With one tree for all a single large facet would have every small one looked at.
    """
    from scipy.spatial import cKDTree

    middle = x.mean(axis=1)
    reach = length(x - middle[:, None]).max(axis=1)
    size = np.floor(np.log2(reach / reach.max())).astype(np.int64)
    levels = []
    for level in np.unique(size):
        members = np.flatnonzero(size == level)
        levels.append((members, cKDTree(middle[members]), float(reach[members].max())))
    return levels


def _closest_on(x: Floats, corners: Floats) -> tuple[Floats, Ints]:
    """Closest points of facets ``(p, d, d)`` to points ``(p, d)``, and their parts."""
    if x.shape[1] == 2:
        y, t = _on_segment(x, corners[:, 0], corners[:, 1])
        return y, np.where(t <= 0, 1, np.where(t >= 1, 2, 0)).astype(np.int64)
    a, b, c = corners.transpose(1, 0, 2)
    first, second = b - a, c - a
    # x - a = s first + t second + normal part, by the normal equations.
    away = x - a
    gram = [_dot(p, q) for p, q in ((first, first), (first, second), (second, second))]
    right = _dot(first, away), _dot(second, away)
    # Of a thin triangle the determinant is its area squared; by a cross product it does
    # not cancel.
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
    """Closest points of segments, and where along them from 0 to 1."""
    way = b - a
    size = _dot(way, way)
    t = np.clip(_dot(x - a, way) / np.where(size > 0, size, 1.0), 0.0, 1.0)
    y = a + t[:, None] * way
    # The corner itself, to the bit: facets that share it agree on it.
    return np.where((t >= 1)[:, None], b, y), t


def _dot(a: Floats, b: Floats) -> Floats:
    return np.asarray(np.einsum("nd,nd->n", a, b), np.float64)
