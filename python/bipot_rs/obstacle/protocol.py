"""The interface of rigid obstacles: closest points."""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np

from bipot_rs._lib.types import Floats
from bipot_rs._lib.validation import floats, vectors


class Closest(NamedTuple):
    """The closest points of an obstacle to ``(n, d)`` points.

    Attributes
    ----------
    distance
        ``(n,)`` [m]: positive outside the obstacle, zero on it, negative inside.
    normal
        Unit normals towards the side of the bodies, ``(n, d)``.
    foot
        The closest points, ``(n, d)`` [m]: ``point - distance * normal``.
    """

    distance: Floats
    normal: Floats
    foot: Floats


class Obstacle(Protocol):
    """A rigid obstacle: any object with these two members."""

    @property
    def dim(self) -> int | None:
        """2 or 3; ``None`` if it works in both."""

    def closest(self, points: Floats, /) -> Closest:
        """The closest points to ``points (n, d)``."""


def check_points(points: object, dim: int | None) -> Floats:
    """Check the points ``(n, d)`` that are passed to an obstacle."""
    if dim is None:
        return vectors("points", points, rows="n", copy=False)
    places = floats("points", points, ndim=2, copy=False)
    if places.shape[1] != dim:
        raise ValueError(f"points has shape {places.shape}, expected (n, {dim})")
    return places


def check_direction(what: str, value: object, dim: int | None = None) -> Floats:
    """Check a direction, and scale it to length 1."""
    vector = floats(what, value, ndim=1)
    if len(vector) not in ((2, 3) if dim is None else (dim,)):
        wished = "(2,) or (3,)" if dim is None else f"({dim},)"
        raise ValueError(f"{what} has shape {vector.shape}, expected {wished}")
    # Divided by the largest component first: squares could overflow or underflow.
    size = np.abs(vector).max()
    if size == 0:
        raise ValueError(f"{what} is zero, expected a direction")
    vector = vector / size
    return np.asarray(vector / np.linalg.norm(vector), np.float64)
