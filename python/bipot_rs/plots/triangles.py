"""Triangles of a contact surface, from its facets or its points, and the skin of bodies."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from bipot_rs._lib.types import Floats, Ints
from bipot_rs.mesh.kinds import FACETS, OF_VTK
from bipot_rs.plots.style import round_number

# Triangles of a facet by its number of nodes: corners, midpoints of edges, centre.
_SPLIT: dict[int, list[tuple[int, int, int]]] = {
    3: [(0, 1, 2)],
    4: [(0, 1, 2), (0, 2, 3)],
    6: [(0, 3, 5), (3, 1, 4), (5, 4, 2), (3, 4, 5)],
    8: [(0, 4, 7), (4, 1, 5), (5, 2, 6), (6, 3, 7), (4, 5, 6), (4, 6, 7)],
    9: [(c, k, 8) for c, k in ((0, 4), (4, 1), (1, 5), (5, 2))]
    + [(c, k, 8) for c, k in ((2, 6), (6, 3), (3, 7), (7, 0))],
}
_CORNERS = {3: 3, 4: 4, 6: 3, 8: 4, 9: 4}
# A triangle above this multiple of the area of the middle one of its nodes lies across a
# hole. It is 1 in a uniform grid of rectangles, at most 1.5 in one whose cells grow by 3
# from one to the next, and at most 1.5 in the corner of a uniform mesh of triangles.
_BRIDGE = 1.6
# Area of a node inside a grid of rectangles, by the area of half a rectangle.
_HALVES = 2.0


def check_facets(facets: object, contacts: int) -> Ints:
    """Facets ``(m, k)`` of contacts; a `ValueError` says what is wrong.

    ``facets``: numbers of contacts, corners first, in the order of VTK; rows of facets with
    fewer nodes end in -1.
    """
    numbers = np.asarray(facets)
    if numbers.dtype.kind not in "iu" or numbers.ndim != 2:
        raise ValueError(
            f"facets of contacts have entries of type {numbers.dtype} and shape "
            f"{numbers.shape}, expected rows of integers"
        )
    numbers = numbers.astype(np.int64)
    if numbers.size and (numbers.min() < -1 or numbers.max() >= contacts):
        raise ValueError(
            f"facets of contacts are from {numbers.min()} to {numbers.max()}, expected "
            f"numbers from 0 to {contacts - 1}, or -1 after the last node"
        )
    count = np.sum(numbers >= 0, axis=1)
    holes = (np.cumsum(numbers < 0, axis=1)[:, :-1] > 0) & (numbers[:, 1:] >= 0)
    wrong = ~np.isin(count, list(_SPLIT)) | holes.any(axis=1)
    if wrong.any():
        k = int(np.argmax(wrong))
        raise ValueError(
            f"facet {k} of contacts is {numbers[k].tolist()}, expected 3, 4, 6, 8 or 9 "
            "nodes, and -1 only after them"
        )
    return numbers


def part(facets: Ints, chosen: NDArray[np.intp], contacts: int) -> Ints:
    """The facets whose nodes are all chosen, in the numbers of the chosen contacts."""
    number = np.full(contacts + 1, -2, np.int64)
    number[chosen] = np.arange(len(chosen))
    # The last entry is that of -1, no node.
    number[-1] = -1
    renumbered: Ints = number[facets]
    return renumbered[(renumbered > -2).all(axis=1)]


def corners(facets: Ints) -> list[Ints]:
    """Corners of each facet, ``(m, 3)`` or ``(m, 4)`` for each kind of facet."""
    count = np.sum(facets >= 0, axis=1)
    return [facets[count == n][:, : _CORNERS[n]] for n in _SPLIT if (count == n).any()]


def cut(
    x: Floats, values: Floats, parts: Sequence[Ints], most: int, *, nearest: bool
) -> tuple[list[Floats], Floats]:
    """Small quadrilaterals of polygons of 3 or 4 corners, and the value of each.

    ``x, values``: of all corners, ``(n, d)`` and ``(n,)``; ``parts``: their numbers.
    ``most``: about the largest number of pieces. ``nearest``: values are those of corners.
    """
    each = [
        zones(x[part], values[part])
        if nearest
        else pieces(x[part], values[part], most // len(parts))
        for part in parts
    ]
    polygons = [polygon for part, _ in each for polygon in part]
    return polygons, np.concatenate([np.empty(0), *(at for _, at in each)])


def zones(x: Floats, values: Floats) -> tuple[Floats, Floats]:
    """The part of a facet that is near each corner, as quadrilaterals, with its value.

    ``x, values``: as in `pieces`. Returns polygons ``(m c, 4, d)`` and values ``(m c,)``.
    """
    middle = (x + np.roll(x, -1, axis=1)) / 2
    centre = np.broadcast_to(x.mean(axis=1, keepdims=True), x.shape)
    near = np.stack([x, middle, centre, np.roll(middle, 1, axis=1)], axis=2)
    return near.reshape(-1, 4, x.shape[2]), values.ravel()


def pieces(
    x: Floats, values: Floats, most: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Quadrilaterals ``(p, 4, d)`` that facets consist of, and the values at their centres.

    ``x, values``: of the 3 or 4 corners of each facet, ``(m, c, d)`` and ``(m, c)``.
    ``most``: about the largest number of pieces.
    """
    m, c = values.shape
    side = int(np.clip(np.sqrt(most / max(m, 1)), 1, 12))

    def shape(a: Floats, b: Floats) -> Floats:
        weights = [(1 - a) * (1 - b), a * (1 - b), a * b, (1 - a) * b]
        if c == 3:
            # The last side of the square is the third corner.
            weights[2:] = [weights[2] + weights[3]]
        return np.stack(weights, axis=-1)

    a, b = (k.ravel() for k in np.meshgrid(*[np.arange(side) / side] * 2))
    along, up = np.array([[0, 1, 1, 0], [0, 0, 1, 1]]) / side
    corners = shape(a[:, None] + along, b[:, None] + up)
    polygons = np.einsum("pqc,mcd->mpqd", corners, x).reshape(-1, 4, x.shape[2])
    return polygons, (values @ shape(a + 0.5 / side, b + 0.5 / side).T).ravel()


def split(facets: Ints) -> Ints:
    """Triangles ``(t, 3)`` of all facets; those of second order use their midpoints."""
    count = np.sum(facets >= 0, axis=1)
    kinds = [n for n in _SPLIT if (count == n).any()]
    triangles = [facets[count == n][:, _SPLIT[n]].reshape(-1, 3) for n in kinds]
    return np.concatenate([np.empty((0, 3), np.int64), *triangles])


def polygons(facets: Ints) -> list[Ints]:
    """Quadrilaterals ``(q, 4)`` of first order, and triangles ``(t, 3)`` of all others."""
    four = np.sum(facets >= 0, axis=1) == 4
    return [facets[four, :4], split(facets[~four])]


def halve(parts: Sequence[Ints]) -> Ints:
    """Triangles ``(t, 3)`` of polygons ``(m, 3)`` and ``(m, 4)``."""
    halves = [part[:, [0, 2, 3]] for part in parts if part.shape[1] == 4]
    return np.concatenate([*(part[:, :3] for part in parts), *halves])


def alone(facets: Ints, contacts: int) -> NDArray[np.intp]:
    """Contacts that are on no facet."""
    free = np.ones(contacts + 1, np.bool_)
    free[facets] = False
    return np.flatnonzero(free[:contacts])


def of_points(uv: Floats, area: Floats | None) -> Ints:
    """Delaunay triangles ``(t, 3)`` of points ``(n, 2)`` without those across a hole.

    The areas of triangles and nodes are compared, not lengths: cells may be as long and as
    graded as they are in the mesh.

    ``uv``: at least three points, not on one line.
    ``area``: tributary areas ``(n,)``. If unknown, they are estimated from the triangles around
    each point, at most half of which may lie across a hole.
    """
    from scipy.spatial import Delaunay

    triangles: Ints = Delaunay(uv).simplices.astype(np.int64)
    (u1, v1), (u2, v2) = (uv[triangles[:, k]].T - uv[triangles[:, 0]].T for k in (1, 2))
    size = 0.5 * np.abs(u1 * v2 - v1 * u2)
    if area is None:
        area = _HALVES * _median(triangles, size, len(uv))
    # The middle one of the three: midpoints and corners of quadratic facets differ.
    near: Ints = triangles[size <= _BRIDGE * np.median(area[triangles], axis=1)]
    return near


def _median(triangles: Ints, size: Floats, points: int) -> Floats:
    """Lower median of the sizes of the triangles around each point, ``(points,)``."""
    node, sizes = triangles.ravel(), np.repeat(size, 3)
    sizes = sizes[np.lexsort((sizes, node))]
    count = np.bincount(node, minlength=points)
    first = np.cumsum(count) - count
    # A duplicate of another point is in no triangle.
    medians = np.zeros(points)
    touched = count > 0
    medians[touched] = sizes[(first + (count - 1) // 2)[touched]]
    return medians


def skin(cells: Sequence[tuple[str, Ints]]) -> list[tuple[Ints, Ints]]:
    """Boundary facets of each body, and the cell of each facet.

    ``cells``: as `fem.Assembly.cells`; numbers of cells continue from body to body.
    Returns ``list of (facets, cell)``: nodes ``(m, corners)`` in order around the facet, and
    cells ``(m,)``.
    """
    facets_of_bodies: list[tuple[Ints, Ints]] = []
    first = 0
    for kind, nodes in cells:
        # Reversed, they are seen from outside.
        sides = FACETS[OF_VTK[kind].shape]
        facets = np.concatenate([nodes[:, list(side[::-1])] for side in sides])
        _, at, count = np.unique(
            np.sort(facets, axis=1), axis=0, return_index=True, return_counts=True
        )
        outside = np.sort(at[count == 1])
        facets_of_bodies.append((facets[outside], first + outside % len(nodes)))
        first += len(nodes)
    return facets_of_bodies


def deform_nodes(
    nodes: Floats, displacement: Floats, scale: float | None, share: float
) -> tuple[Floats, float]:
    """Points ``nodes + scale * u``, and the scale; u may continue with reference points.

    The default scale is a round number, 1 or more, for which the largest displacement is
    about ``share`` of the largest extent of the bodies.
    """
    u = displacement[: nodes.size].reshape(nodes.shape)
    if scale is None:
        largest = float(np.linalg.norm(u, axis=1).max(initial=0.0))
        extent = float(np.ptp(nodes, axis=0).max())
        scale = max(round_number(share * extent / largest), 1.0) if largest else 1.0
    return nodes + scale * u, scale


def sharp_edges(x: Floats, cells: Sequence[tuple[str, Ints]]) -> Ints:
    """Edges ``(m, 2)`` of the boundary at which it turns by 30 degrees or more."""
    sharp_ones = []
    for facets, _ in skin(cells):
        a, b, c = x[facets[:, :3]].swapaxes(0, 1)
        normal = np.cross(b - a, c - a)
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        ends = np.stack([facets, np.roll(facets, -1, axis=1)], axis=-1)
        owner = np.repeat(np.arange(len(facets)), facets.shape[1])
        edges, which, count = np.unique(
            np.sort(ends.reshape(-1, 2), axis=1),
            axis=0,
            return_inverse=True,
            return_counts=True,
        )
        order = np.argsort(which.ravel(), kind="stable")
        first = np.cumsum(count) - count
        # An edge with more than two facets, where parts of a body touch, is sharp.
        sharp = count != 2
        first_owner, other = (
            owner[order[first[~sharp]]],
            owner[order[first[~sharp] + 1]],
        )
        sharp[~sharp] = np.sum(normal[first_owner] * normal[other], axis=1) < np.cos(
            np.pi / 6
        )
        sharp_ones.append(edges[sharp])
    return np.concatenate(sharp_ones)
