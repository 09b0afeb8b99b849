"""Meshes of facets: checks, normals, sizes, and candidates for contact."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from bipot_rs._lib.types import Bools, Floats, Ints
from bipot_rs._lib.validation import integers, vectors
from bipot_rs.contact.law.frames import frames
from bipot_rs.mortar.shape_functions import CORNER_SHAPES, FacetKind, kind_of, skewness
from bipot_rs.mortar.tuning import FACING

# A facet thinner than this fraction of its longest edge is degenerate; a quadrilateral of
# this skewness has a corner of 180°.
_FLAT, _FOLDED = 1e-12, 1 - 1e-9


@dataclass(frozen=True)
class FacetMesh:
    """A checked surface; geometry is that of the polygons of corners."""

    name: str  # name of the argument, for messages
    points: Floats  # (n, d): positions of all nodes [m]
    facets: Ints  # (m, nodes): nodes of each facet, numbered as in `shape_functions`
    kind: FacetKind  # kind of the facets
    # (m, d): outward unit normals; for a quadrilateral that is not plane, of its mean plane.
    normals: Floats
    size: Floats  # (m,): area [m²], in 2D length [m]
    # centre (m, d), radius (m,): mean of the corners, and its distance from the farthest
    # corner.
    centre: Floats
    radius: Floats
    revolved: bool = False  # the half section (r, z) of a surface of revolution

    def some(self, chosen: Bools) -> FacetMesh:
        """Some of the facets."""
        arrays = ("facets", "normals", "size", "centre", "radius")
        return replace(self, **{name: getattr(self, name)[chosen] for name in arrays})

    @property
    def dim(self) -> int:
        """2 or 3."""
        return int(self.points.shape[1])

    @property
    def corners(self) -> Ints:
        """Nodes at the corners, ``(m, c)``."""
        return self.facets[:, : self.kind.corners]

    @cached_property
    def places(self) -> Floats:
        """Corners from the centre of each facet, ``(m, c, d)``."""
        return np.asarray(self.points[self.corners] - self.centre[:, None])

    @cached_property
    def bases(self) -> Floats:
        """Two axes in the plane of each facet, ``(m, d - 1, d)``, about the normal."""
        return bases(self.normals)

    @cached_property
    def flat(self) -> Floats:
        """Corners along these axes, ``(m, c, d - 1)``."""
        return np.asarray(np.einsum("mkd,mcd->mck", self.bases, self.places))

    @cached_property
    def whole(self) -> Floats:
        """∫ N_i over each facet in its plane, ``(m, c)``, with the corner functions N."""
        if self.revolved:
            r = self.points[self.corners, 0]
            weighted = (r + r.sum(axis=1, keepdims=True)) / 6
            return np.asarray(2 * np.pi * self.size[:, None] * weighted)
        if self.dim == 2:
            return np.repeat(self.size[:, None] / 2, 2, axis=1)
        if self.kind.corners == 3:
            return np.repeat(self.size[:, None] / 3, 3, axis=1)
        x = np.array([[-1.0, -1], [1, -1], [1, 1], [-1, 1]]) / np.sqrt(3)
        shapes = CORNER_SHAPES[4](x)
        # N_i and det J are bilinear: four points integrate their product exactly.
        corner = np.array([[-1.0, -1], [1, -1], [1, 1], [-1, 1]])
        slopes = np.stack(
            [
                corner[:, 0] * (1 + x[:, 1:] * corner[:, 1]) / 4,
                corner[:, 1] * (1 + x[:, :1] * corner[:, 0]) / 4,
            ]
        )
        (a, b), (c, d) = np.einsum("kqc,mcd->kdmq", slopes, self.flat)
        return np.asarray((a * d - b * c) @ shapes)

    @cached_property
    def node_areas(self) -> Floats:
        """∫ N_i over all facets at the nodes, ``(n,)``; zero except at corners."""
        whole, nodes = self.whole.ravel(), len(self.points)
        return np.asarray(np.bincount(self.corners.ravel(), whole, minlength=nodes))

    @cached_property
    def node_normals(self) -> Floats:
        """Outward normals times area at the nodes, ``(n, d)``; zero except at corners."""
        total = np.zeros_like(self.points)
        weighted = self.whole[:, :, None] * self.normals[:, None]
        np.add.at(total, self.corners.ravel(), weighted.reshape(-1, self.dim))
        return drop_rounding(total)


def drop_rounding(normals: Floats) -> Floats:
    """Normals ``(n, d)`` with zero for components of rounding size.

    On a coordinate plane they would couple B to displacements that the contact does not feel.
    """
    small = 1e-14 * np.abs(normals).max(axis=1, keepdims=True)
    return np.where(np.abs(normals) <= small, 0.0, normals)


def bases(normals: Floats) -> Floats:
    """Axes orthogonal to unit normals, ``(m, d - 1, d)``, right-handed with them."""
    first = frames(normals)[:, 1]
    if normals.shape[1] == 2:
        # Along the facet: the normal turned by a right angle.
        return np.stack([-normals[:, 1], normals[:, 0]], axis=1)[:, None]
    return np.stack([first, np.cross(normals, first)], axis=1)


def surface(what: str, points: ArrayLike, name: str, facets: ArrayLike) -> FacetMesh:
    """Check the points ``what`` and the facets ``name``, as messages call them.

    Raises `ValueError`: shapes do not fit, nodes are out of range or repeated in a facet,
    facets have no area, are folded, or have normals opposite to those of their neighbours. The
    message gives the index of the facet.
    """
    x = vectors(what, points, rows="n")
    nodes = _facets(name, facets, len(x))
    kind = kind_of(name, x.shape[1], nodes.shape[1])
    corners = nodes[:, : kind.corners]
    centre = x[corners].mean(axis=1)
    places = x[corners] - centre[:, None]
    normals, size = _normals(name, places)
    mesh = FacetMesh(
        name=name,
        points=x,
        facets=nodes,
        kind=kind,
        normals=normals,
        size=size,
        centre=centre,
        radius=np.linalg.norm(places, axis=2).max(axis=1),
    )
    if kind.corners == 4:
        skew = skewness(mesh.flat)
        if (skew >= _FOLDED).any():
            at = int(np.argmax(skew >= _FOLDED))
            raise ValueError(
                f"{name} has a folded facet, {at}, with the nodes "
                f"{corners[at].tolist()}: expected a convex quadrilateral, its corners "
                "in order around it"
            )
    _middles(mesh)
    _check_orientation(name, corners)
    return mesh


def turned_outward(points: Floats, facets: Ints, normals: Floats) -> Ints:
    """Reverse the facets whose normals are opposite to ``normals (m, d)``."""
    kind = kind_of("facets", points.shape[1], facets.shape[1])
    computed, _ = _normals("facets", points[facets[:, : kind.corners]])
    away = np.einsum("md,md->m", computed, normals) < 0
    turned = facets.copy()
    turned[away] = facets[away][:, list(kind.mirror)]
    return turned


def _facets(name: str, facets: ArrayLike, nodes: int) -> Ints:
    numbers = integers(name, facets)
    if numbers.ndim != 2 or not len(numbers):
        raise ValueError(
            f"{name} has shape {numbers.shape}, expected (facets, nodes of a facet)"
        )
    outside = (numbers < 0) | (numbers >= nodes)
    if outside.any():
        m, k = np.argwhere(outside)[0]
        raise ValueError(
            f"{name} has node {numbers[m, k]} in facet {m}, expected 0 to {nodes - 1}"
        )
    ordered = np.sort(numbers, axis=1)
    twice = (ordered[:, 1:] == ordered[:, :-1]).any(axis=1)
    if twice.any():
        m = int(np.argmax(twice))
        raise ValueError(
            f"{name} has a node twice in facet {m}: {numbers[m].tolist()}; write a "
            "quadrilateral with two equal corners as a triangle"
        )
    return np.array(numbers, dtype=np.int64)


def _normals(name: str, places: Floats) -> tuple[Floats, Floats]:
    """Unit normals and sizes of facets, from corners ``(m, c, d)``."""
    if places.shape[2] == 2:
        along = places[:, 1] - places[:, 0]
        area = np.stack([along[:, 1], -along[:, 0]], axis=1)
    elif places.shape[1] == 3:
        first, second = np.moveaxis(places[:, 1:] - places[:, :1], 1, 0)
        area = np.cross(first, second) / 2
    else:
        area = np.cross(places[:, 2] - places[:, 0], places[:, 3] - places[:, 1]) / 2
    size = np.linalg.norm(area, axis=1)
    longest = np.linalg.norm(places - np.roll(places, 1, axis=1), axis=2).max(axis=1)
    flat = size <= _FLAT * longest ** (places.shape[2] - 1)
    if flat.any():
        at = int(np.argmax(flat))
        raise ValueError(
            f"{name} has a degenerate facet, {at}, of size {size[at]:g} with a longest "
            f"edge of {longest[at]:g}: remove it or mesh again there"
        )
    return area / size[:, None], size


def _middles(mesh: FacetMesh) -> None:
    """Refuse nodes on edges that are nearer to an end than to the midpoint."""
    kind, c = mesh.kind, mesh.kind.corners
    edges = min(kind.nodes - c, c if mesh.dim == 3 else 1)
    for k in range(edges):
        a, b = (mesh.points[mesh.facets[:, i]] for i in (k, (k + 1) % c))
        middle = mesh.points[mesh.facets[:, c + k]]
        off = np.linalg.norm(middle - (a + b) / 2, axis=1)
        wrong = off >= np.linalg.norm(b - a, axis=1) / 2
        if wrong.any():
            at = int(np.argmax(wrong))
            raise ValueError(
                f"{mesh.name} has node {mesh.facets[at, c + k]} of facet {at} "
                f"{off[at]:g} from the middle of its edge between the nodes "
                f"{mesh.facets[at, k]} and {mesh.facets[at, (k + 1) % c]}: expected "
                "corners first, then the middles of the edges in turn"
            )


def _check_orientation(name: str, corners: Ints) -> None:
    """Neighbours run along their common edge in opposite directions."""
    c = corners.shape[1]
    if c == 2:
        # In 2D each node ends one facet and starts another.
        ends = [corners[:, 0], corners[:, 1]]
        labels = [np.arange(len(corners))] * 2
    else:
        edges = np.stack([corners, np.roll(corners, -1, axis=1)], axis=2).reshape(-1, 2)
        limit = int(corners.max()) + 1
        ends = [edges[:, 0] * limit + edges[:, 1]]
        labels = [np.repeat(np.arange(len(corners)), c)]
    for key, label in zip(ends, labels, strict=True):
        order = np.argsort(key, kind="stable")
        same = np.flatnonzero(key[order][1:] == key[order][:-1])
        if same.size:
            first_side, other = label[order][same[0]], label[order][same[0] + 1]
            raise ValueError(
                f"{name} has facets {first_side} and {other} with normals on opposite sides: all "
                "normals must point out of the body, which is on the left of a line, and "
                "triangles and quadrilaterals counter-clockwise seen from outside"
            )


def candidates(
    places: Floats,
    radius: Floats,
    normals: Floats,
    other: FacetMesh,
    distance: float = np.inf,
) -> tuple[Ints, Ints]:
    """Facets of ``other`` that may lie opposite to spheres and face them.

    These are all facets that reach into the cylinder swept by a sphere along its normal,
    up to ``distance`` on both sides. Facets are grouped by size, so that a few large ones
    do not make all others candidates.

    ``places, radius, normals``: centres ``(k, d)``, radii ``(k,)`` and normals ``(k, d)`` of
    the spheres.
    Returns ``sphere, facet (pairs,)``: ascending by sphere.
    """
    octave = np.floor(np.log2(other.radius / other.radius.max()))
    sphere, facet = [np.zeros(0, np.int64)], [np.zeros(0, np.int64)]
    for level in np.unique(octave):
        group = np.flatnonzero(octave == level)
        wide = (radius + other.radius[group].max()) * (1 + 1e-9)
        k, g = _along(places, wide, normals, other.centre[group], distance)
        sphere.append(k)
        facet.append(group[g])
    s, m = np.concatenate(sphere), np.concatenate(facet)
    between = other.centre[m] - places[s]
    away = np.einsum("pd,pd->p", normals[s], between)
    aside = np.einsum("pd,pd->p", between, between) - away**2
    reach = (radius[s] + other.radius[m]) * (1 + 1e-9)
    # The difference of squares has the rounding of the larger square.
    rounding = 1e-12 * away**2
    kept = np.einsum("pd,pd->p", normals[s], other.normals[m]) < FACING
    kept &= (aside <= reach**2 + rounding) & (np.abs(away) <= distance + reach)
    s, m = s[kept], m[kept]
    order = np.lexsort([m, s])
    return s[order], m[order]


def _along(
    places: Floats, wide: Floats, normals: Floats, centres: Floats, distance: float
) -> tuple[Ints, Ints]:
    """Pairs of a cylinder along a normal and a centre: all inside it, and a few more.

    The part of the cylinder inside the bounding box of the centres is covered by spheres
    of √2 times its radius at intervals of two radii.
    """
    from scipy.spatial import cKDTree

    low = centres.min(axis=0) - wide[:, None] - places
    high = centres.max(axis=0) + wide[:, None] - places
    with np.errstate(divide="ignore", invalid="ignore"):
        ends = np.stack([low / normals, high / normals])
    flat = normals == 0
    inside = (low <= 0) & (high >= 0)
    start = np.where(flat, np.where(inside, -np.inf, np.inf), ends.min(axis=0))
    end = np.where(flat, np.where(inside, np.inf, -np.inf), ends.max(axis=0))
    first = np.maximum(start.max(axis=1), -distance - wide)
    last = np.minimum(end.min(axis=1), distance + wide)
    met = np.flatnonzero(last >= first)
    count = np.ceil((last - first)[met] / (2 * wide[met])).astype(np.int64)
    count = np.maximum(count, 1)
    if count.sum() > met.size * len(centres):
        every = np.tile(np.arange(len(centres)), met.size)
        return np.repeat(met, len(centres)), every
    ball = np.repeat(met, count)
    step = np.arange(ball.size) - np.repeat(np.cumsum(count) - count, count)
    middle = first[ball] + (2 * step + 1) * wide[ball]
    within_reach = cKDTree(centres).query_ball_point(
        places[ball] + middle[:, None] * normals[ball],
        np.sqrt(2) * wide[ball] * (1 + 1e-9),
    )
    lengths = np.array([len(f) for f in within_reach], dtype=np.int64)
    near = np.concatenate([np.zeros(0, np.int64), *within_reach]).astype(np.int64)
    pairs = np.unique(np.repeat(ball, lengths) * len(centres) + near)
    return pairs // len(centres), pairs % len(centres)
