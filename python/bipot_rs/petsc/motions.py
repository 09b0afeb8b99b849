"""Rigid motions at the degrees of freedom of this rank."""

from __future__ import annotations

from typing import Any

import numpy as np

from bipot_rs._lib.types import Floats

# Rotations in the planes of these axes.
_PLANES = ((0, 1), (1, 2), (2, 0))


def rigid_motions(
    comm: Any, MPI: Any, coordinates: Floats | None, rows: int, d: int
) -> Floats:
    """Translations, then rotations, ``(rows, m)``; translations alone without coordinates.

    Coordinates are taken from the centre of all nodes in units of their largest extent, so
    that neither the origin nor the unit of length matters.

    Parameters
    ----------
    coordinates
        Of the own degrees of freedom, ``(rows, d)``.
    """
    component = np.arange(rows) % d
    motions = np.zeros((rows, d if coordinates is None else 3 * (d - 1)))
    motions[np.arange(rows), component] = 1.0
    if coordinates is None:
        return motions
    low, high = np.full(d, np.inf), np.full(d, -np.inf)
    if rows:
        low, high = coordinates.min(axis=0), coordinates.max(axis=0)
    low, high = _all(comm, low, MPI.MIN), _all(comm, high, MPI.MAX)
    extent = float((high - low).max()) or 1.0
    at = (coordinates - (0.5 * low + 0.5 * high)) / extent
    for k, (i, j) in enumerate(_PLANES[: 2 * d - 3]):
        ours, theirs = component == i, component == j
        motions[ours, d + k] = -at[ours, j]
        motions[theirs, d + k] = at[theirs, i]
    return motions


def _all(comm: Any, values: Floats, operation: Any) -> Floats:
    found = np.empty_like(values)
    comm.Allreduce(values, found, op=operation)
    return found


def orthonormal(comm: Any, vectors: Floats) -> Floats:
    """Orthonormal vectors with the same span, dependent ones left out.

    Parameters
    ----------
    vectors
        The own rows, ``(rows, m)``.
    """
    for _ in range(2):  # the second time for the digits that the first one loses
        whole = np.empty((vectors.shape[1],) * 2)
        comm.Allreduce(vectors.T @ vectors, whole)
        size, turn = np.linalg.eigh(whole)
        kept = size > 1e-12 * size.max(initial=0.0)
        vectors = vectors @ (turn[:, kept] / np.sqrt(size[kept]))
    return np.ascontiguousarray(vectors)
