"""What a rigid obstacle answers: where it is closest to some points."""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np

from bipot_rs._lib.types import Floats
from bipot_rs._lib.validation import floats


class Closest(NamedTuple):
    """The closest points of an obstacle to ``(n, d)`` others.

    Attributes
    ----------
    distance
        ``(n,)`` [m]: positive outside the obstacle, zero on it, negative within.
    normal
        Unit, from the obstacle towards where bodies are, ``(n, d)``.
    foot
        The closest points, ``(n, d)`` [m]: ``point - distance * normal``.
    """

    distance: Floats
    normal: Floats
    foot: Floats


class Obstacle(Protocol):
    """A rigid obstacle: whatever knows its closest points."""

    @property
    def dim(self) -> int | None:
        """2 or 3; ``None`` for one that is known by a formula for both."""

    def closest(self, points: Floats, /) -> Closest:
        """The closest points to ``points (n, d)``."""


def taken(points: object, dim: int | None) -> Floats:
    """Points ``(n, d)`` that an obstacle is asked about."""
    found = floats("points", points, ndim=2, copy=False)
    if found.shape[1] not in ((2, 3) if dim is None else (dim,)):
        wished = "(n, 2) or (n, 3)" if dim is None else f"(n, {dim})"
        raise ValueError(f"points has shape {found.shape}, expected {wished}")
    return found


def directed(what: str, value: object, dim: int | None = None) -> Floats:
    """A direction, of length 1."""
    found = floats(what, value, ndim=1)
    if len(found) not in ((2, 3) if dim is None else (dim,)):
        wished = "(2,) or (3,)" if dim is None else f"({dim},)"
        raise ValueError(f"{what} has shape {found.shape}, expected {wished}")
    # By the largest first: squares of large or small numbers leave the range.
    size = np.abs(found).max()
    if size == 0:
        raise ValueError(f"{what} is zero, expected a direction")
    found = found / size
    return np.asarray(found / np.linalg.norm(found), np.float64)


def length(values: Floats) -> Floats:
    """Lengths of vectors ``(..., d)``."""
    return np.asarray(np.linalg.norm(values, axis=-1), np.float64)
