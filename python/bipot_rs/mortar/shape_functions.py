"""Kinds of facets: shape functions, and reference coordinates of positions.

A line has the reference coordinate ξ in [0, 1], a triangle (ξ, η) with ξ, η ≥ 0 and
ξ + η ≤ 1, a quadrilateral (ξ, η) in [-1, 1]². Nodes are numbered as in VTK, gmsh and
Abaqus: corners around the facet, then midpoints of edges, edge i between the corners i and
i + 1, then the centre.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from bipot_rs._lib.types import Floats

# Corners of the quadrilateral, and the middles of its edges.
_XI = np.array([-1.0, 1.0, 1.0, -1.0, 0.0, 1.0, 0.0, -1.0])
_ETA = np.array([-1.0, -1.0, 1.0, 1.0, -1.0, 0.0, 1.0, 0.0])


@dataclass(frozen=True)
class FacetKind:
    """One kind of facet."""

    name: str  # name in messages
    # nodes, corners: nodes of a facet, and how many of them are corners, which come first.
    nodes: int
    corners: int
    degree: int  # polynomial degree of the shape functions in the reference coordinates
    # Function of reference coordinates `(..., d - 1)` that returns the shape functions `(...,
    # nodes)`.
    shapes: Callable[[Floats], Floats]
    mirror: tuple[int, ...]  # order of the nodes that reverses the normal


def _line2(x: Floats) -> Floats:
    return np.concatenate([1 - x, x], axis=-1)


def _line3(x: Floats) -> Floats:
    return np.concatenate(
        [(1 - x) * (1 - 2 * x), x * (2 * x - 1), 4 * x * (1 - x)], axis=-1
    )


def _barycentric(x: Floats) -> tuple[Floats, Floats, Floats]:
    return 1 - x[..., 0] - x[..., 1], x[..., 0], x[..., 1]


def _tri3(x: Floats) -> Floats:
    return np.stack(_barycentric(x), axis=-1)


def _tri6(x: Floats) -> Floats:
    a, b, c = _barycentric(x)
    corners = [p * (2 * p - 1) for p in (a, b, c)]
    return np.stack([*corners, 4 * a * b, 4 * b * c, 4 * c * a], axis=-1)


def _quad4(x: Floats) -> Floats:
    p, q = x[..., :1] * _XI[:4], x[..., 1:] * _ETA[:4]
    return np.asarray((1 + p) * (1 + q) / 4)


def _quad8(x: Floats) -> Floats:
    xi, eta = x[..., :1], x[..., 1:]
    p, q = xi * _XI[:4], eta * _ETA[:4]
    corners = (1 + p) * (1 + q) * (p + q - 1) / 4
    along = (1 - xi**2) * (1 + eta * _ETA[[4, 6]]) / 2
    up = (1 - eta**2) * (1 + xi * _XI[[5, 7]]) / 2
    middles = [along[..., :1], up[..., :1], along[..., 1:], up[..., 1:]]
    return np.concatenate([corners, *middles], axis=-1)


def _quad9(x: Floats) -> Floats:
    xi, eta = x[..., 0], x[..., 1]

    def line(t: Floats) -> list[Floats]:
        return [t * (t - 1) / 2, 1 - t * t, t * (t + 1) / 2]

    p, q = line(xi), line(eta)
    return np.stack(
        [
            p[i] * q[j]
            for i, j in zip(
                (0, 2, 2, 0, 1, 2, 1, 0, 1), (0, 0, 2, 2, 0, 1, 2, 1, 1), strict=True
            )
        ],
        axis=-1,
    )


# By dimension of space and nodes of a facet.
KINDS: dict[tuple[int, int], FacetKind] = {
    (2, 2): FacetKind("line", 2, 2, 1, _line2, (1, 0)),
    (2, 3): FacetKind("line of three nodes", 3, 2, 2, _line3, (1, 0, 2)),
    (3, 3): FacetKind("triangle", 3, 3, 1, _tri3, (0, 2, 1)),
    (3, 6): FacetKind("triangle of six nodes", 6, 3, 2, _tri6, (0, 2, 1, 5, 4, 3)),
    (3, 4): FacetKind("quadrilateral", 4, 4, 2, _quad4, (0, 3, 2, 1)),
    (3, 8): FacetKind(
        "quadrilateral of eight nodes", 8, 4, 3, _quad8, (0, 3, 2, 1, 7, 6, 5, 4)
    ),
    (3, 9): FacetKind(
        "quadrilateral of nine nodes", 9, 4, 4, _quad9, (0, 3, 2, 1, 7, 6, 5, 4, 8)
    ),
}
# Shape functions of the corners, by their number: they interpolate positions and
# multipliers.
CORNER_SHAPES: dict[int, Callable[[Floats], Floats]] = {2: _line2, 3: _tri3, 4: _quad4}


def reference(corners: Floats, x: Floats) -> Floats:
    """Reference coordinates ``(m, q, 2)`` of points in plane facets.

    In a quadrilateral, with coordinates (X, Y) of its mean edges, ``ξ + α ξη = X`` and
    ``η + β ξη = Y``: eliminating η leaves the quadratic ``β ξ² + b ξ - X = 0`` with
    ``b = 1 + αY - βX``, whose root that goes on from the parallelogram α = β = 0 is
    2X/(b + √(b² + 4βX)). No iteration, and nothing cancels in a convex one.

    ``corners``: triangles or convex quadrilaterals, ``(m, c, 2)``.
    ``x``: points ``(m, q, 2)``, inside the facets to rounding.
    """
    if corners.shape[1] == 3:
        edges = corners[:, 1:] - corners[:, :1]
        return _components(edges, x - corners[:, :1])
    centre, edges, (alpha, beta) = _bilinear(corners)
    local = _components(edges, x - centre[:, None])
    X, Y = local[..., 0], local[..., 1]
    alpha, beta = alpha[:, None], beta[:, None]
    b = 1 + alpha * Y - beta * X
    # Near a facet that is almost a triangle, rounding may make the radicand negative.
    xi = 2 * X / (b + np.sqrt(np.maximum(b * b + 4 * beta * X, 0.0)))
    return np.stack([xi, Y / (1 + beta * xi)], axis=-1)


def skewness(corners: Floats) -> Floats:
    """|α| + |β| of plane quadrilaterals ``(m, 4, 2)``: 0 for parallelograms, < 1 if convex."""
    _, _, skew = _bilinear(corners)
    return np.asarray(np.abs(skew).sum(axis=0))


def affine(corners: Floats, x: Floats) -> tuple[Floats, Floats, Floats]:
    """Coordinates along the mean edges of quadrilaterals ``(m, 4, 2)``.

    Returns ``size, components, skew``: signed area of the unit cell of these coordinates,
    ``(m,)``; components of vectors ``x (m, q, 2)``; α and β ``(2, m)``.
    """
    _, edges, skew = _bilinear(corners)
    (a, b), (c, d) = np.moveaxis(edges, 0, -1)
    return np.asarray(a * d - b * c), _components(edges, x), skew


def _bilinear(corners: Floats) -> tuple[Floats, Floats, Floats]:
    """Centre, mean half edges ``(m, 2, 2)``, and (α, β) ``(2, m)``."""
    weights = np.stack([_XI[:4], _ETA[:4], _XI[:4] * _ETA[:4]]) / 4
    centre = corners.mean(axis=1)
    terms = np.einsum("kc,mcd->mkd", weights, corners - centre[:, None])
    edges = terms[:, :2]
    skew = _components(edges, terms[:, 2:])[:, 0]
    return centre, edges, np.moveaxis(skew, -1, 0)


def _components(edges: Floats, x: Floats) -> Floats:
    """Components of ``x (m, q, 2)`` along two edges ``(m, 2, 2)``."""
    (a, b), (c, d) = np.moveaxis(edges, 0, -1)
    determinant = (a * d - b * c)[:, None]
    u, v = x[..., 0], x[..., 1]
    first = (u * d[:, None] - v * c[:, None]) / determinant
    second = (v * a[:, None] - u * b[:, None]) / determinant
    return np.stack([first, second], axis=-1)


def kind_of(what: str, dim: int, nodes: int) -> FacetKind:
    """Kind of the facets ``what`` with a number of nodes each."""
    if (dim, nodes) not in KINDS:
        names = [f"{k} ({n.name})" for (d, k), n in KINDS.items() if d == dim]
        raise ValueError(
            f"{what} has {nodes} nodes for each facet, expected {', '.join(names)} in "
            f"{dim} dimensions"
        )
    return KINDS[dim, nodes]
