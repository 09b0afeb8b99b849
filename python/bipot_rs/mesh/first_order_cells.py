"""Shape functions of first order and their quadrature, for lines to hexahedra.

Nodes, points and weights have the order and the values of scikit-fem.
"""

from __future__ import annotations

from functools import cache
from math import prod
from typing import TypeAlias

import numpy as np

from bipot_rs._lib.types import Floats

# Shape functions ``(c, q)``, their slopes ``∂φ_i/∂ξ_b`` as ``(q, b, c)``, weights ``(q,)``.
Reference: TypeAlias = tuple[Floats, Floats, Floats]

# Positions of the nodes.
CORNERS: dict[str, list[tuple[int, ...]]] = {
    "line": [(0,), (1,)],
    "triangle": [(0, 0), (1, 0), (0, 1)],
    "quadrilateral": [(0, 0), (1, 0), (1, 1), (0, 1)],
    "tetrahedron": [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)],
    "hexahedron": [
        (1, 1, 1),
        (1, 1, 0),
        (1, 0, 1),
        (0, 1, 1),
        (1, 0, 0),
        (0, 1, 0),
        (0, 0, 1),
        (0, 0, 0),
    ],
}
# Names in scikit-fem of the elements of one component.
ELEMENT = {
    "line": "ElementLineP1",
    "triangle": "ElementTriP1",
    "quadrilateral": "ElementQuad1",
    "tetrahedron": "ElementTetP1",
    "hexahedron": "ElementHex1",
}
# Gauss points of two on a line, symmetric about its middle.
_PAIR = 0.5 + 0.5 * np.sqrt(1 / 3) * np.array([-1.0, 1.0])


@cache
def reference(shape: str, order: int) -> Reference:
    """Shape functions on the reference cell at the points of the rule of ``order``.

    Returns ``phi, slopes, weights``: as `Reference`; read-only, since they are cached.
    """
    points, weights = _rule(shape, order)
    simplex = shape in ("triangle", "tetrahedron")
    phi, slopes = (_of_simplex if simplex else _of_product)(shape, points)
    tables = phi, np.ascontiguousarray(slopes.transpose(2, 1, 0)), weights
    for array in tables:
        array.flags.writeable = False
    return tables


def _rule(shape: str, order: int) -> tuple[Floats, Floats]:
    """Points ``(d, q)`` and weights of the orders that first order needs."""
    if shape == "tetrahedron" and order == 1:
        return np.full((3, 1), 0.25), np.full(1, 1 / 6)
    if shape == "triangle" and order <= 2:
        # Three points, as scikit-fem takes for order 1 too.
        return 1 / 6 + 0.5 * np.eye(3)[1:], np.full(3, 1 / 6)
    if shape in ("line", "quadrilateral", "hexahedron") and order == 2:
        d = len(CORNERS[shape][0])
        grid = np.meshgrid(*[_PAIR] * d, indexing="xy")
        points = np.stack([axis.ravel(order="F") for axis in grid])
        return points, np.full(2**d, 0.5**d)
    raise ValueError(f"there is no rule of order {order} for a {shape}")


def _of_simplex(shape: str, points: Floats) -> tuple[Floats, Floats]:
    """``1 - Σ ξ`` and the coordinates ξ themselves."""
    first = np.ones(points.shape[1])
    for axis in points:
        first = first - axis
    d = len(CORNERS[shape]) - 1
    slopes = np.concatenate([-np.ones((1, d)), np.eye(d)])
    return np.concatenate([first[None], points]), np.repeat(
        slopes[:, :, None], points.shape[1], axis=2
    )


def _of_product(shape: str, points: Floats) -> tuple[Floats, Floats]:
    """Products of ξ or 1 - ξ over the axes."""
    ones = np.ones(points.shape[1])
    phi, slopes = [], []
    for corner in CORNERS[shape]:
        factors = [x if on else 1 - x for x, on in zip(points, corner, strict=True)]
        phi.append(prod(factors, start=ones))
        slopes.append(
            [
                (1.0 if on else -1.0) * prod(factors[:b] + factors[b + 1 :], start=ones)
                for b, on in enumerate(corner)
            ]
        )
    return np.array(phi), np.array(slopes)
