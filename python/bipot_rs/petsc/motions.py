"""Rigid motions at the degrees of freedom of this rank."""

from __future__ import annotations

from types import ModuleType

import numpy as np

import bipot_rs._core as _core
from bipot_rs._lib.types import Communicator, Floats


def rigid_motions(
    comm: Communicator, MPI: ModuleType, coordinates: Floats | None, rows: int, d: int
) -> Floats:
    """Translations, then rotations, ``(rows, m)``; translations alone without coordinates.

    The centre is that of the box around all nodes, and the reach its largest side.

    Parameters
    ----------
    coordinates
        Of the own degrees of freedom, ``(rows, d)``.
    """
    if coordinates is None:
        return np.tile(np.eye(d), (rows // d, 1))
    low, high = np.full(d, np.inf), np.full(d, -np.inf)
    if rows:
        low, high = coordinates.min(axis=0), coordinates.max(axis=0)
    low, high = _reduce(comm, low, MPI.MIN), _reduce(comm, high, MPI.MAX)
    arm = np.zeros((rows, 3))
    arm[:, :d] = coordinates - (0.5 * low + 0.5 * high)
    direction = np.arange(rows, dtype=np.int64) % d
    reach = float((high - low).max()) or 1.0
    return _core.rigid_motions(direction, arm, d, reach)


def _reduce(comm: Communicator, values: Floats, operation: object) -> Floats:
    whole = np.empty_like(values)
    comm.Allreduce(values, whole, op=operation)
    return whole


def orthonormal(comm: Communicator, vectors: Floats) -> Floats:
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
