"""Lengths and directions of vectors, rigid motions of points, and diagonal matrices."""

from __future__ import annotations

import numpy as np

import bipot_rs._core as _core
from bipot_rs._lib.types import CsrMatrix, Floats


def length(x: Floats) -> Floats:
    """Euclidean norm along the last axis."""
    return np.asarray(np.linalg.norm(x, axis=-1))


def direction(x: Floats) -> Floats:
    """``x/|x|`` along the last axis, zero where ``x`` is zero."""
    size = length(x)[..., None]
    return np.asarray(np.divide(x, size, out=np.zeros_like(x), where=size > 0))


def rigid_motions(arm: Floats, reach: float = 1.0) -> Floats:
    """Rigid motions of points at ``arm (n, d)`` from the centre, ``(n, d, m)``.

    Translations by 1 along the axes, then rotations ``e × arm / reach``: ``m`` is 3 in the
    plane and 6 in space.
    """
    n, d = arm.shape
    at = np.zeros((n * d, 3))
    at[:, :d] = np.repeat(arm, d, axis=0)
    direction = np.tile(np.arange(d, dtype=np.int64), n)
    return _core.rigid_motions(direction, at, d, reach).reshape(n, d, 3 * (d - 1))


def diagonal_matrix(values: Floats) -> CsrMatrix:
    """CSR array with ``values (n,)`` on its diagonal."""
    from scipy import sparse  # a tenth of a second, which dense problems do not need

    diagonal: CsrMatrix = sparse.csr_array(sparse.diags_array(values))
    return diagonal


def block_diagonal(blocks: Floats) -> CsrMatrix:
    """CSR array with blocks ``(n, d, d)`` on its diagonal."""
    from scipy import sparse

    count, d, _ = blocks.shape
    places = np.arange(count), np.arange(count + 1)
    made = sparse.bsr_array((blocks, *places), shape=(d * count, d * count))
    diagonal: CsrMatrix = made.tocsr()
    return diagonal
