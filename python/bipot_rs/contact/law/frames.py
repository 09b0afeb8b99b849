"""Orthonormal bases of contacts, normal first, for the components of (2)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from bipot_rs._lib.types import CsrMatrix, Floats, Ints
from bipot_rs._lib.validation import floats, vectors


def frames(normals: ArrayLike, axis: ArrayLike | None = None) -> Floats:
    """Orthonormal bases with rows n, t1[, t2], from normals ``(n_c, d)``.

    The tangents are the coordinate axes in their order, without the axis closest to the
    normal, and made orthogonal to it: with n = z they are x and y. With ``axis (3,)``, in
    space, t1 is this direction made orthogonal to the normal, and t2 = n × t1.
    """
    n = vectors("normals", normals)
    dim = n.shape[1]
    size = np.abs(n).max(axis=1)
    if not (size > 0).all():
        raise ValueError(
            f"normal {int(np.argmin(size))} has length zero, expected a direction"
        )
    # Squares of large or small components overflow. A power of two as factor is exact.
    n = np.ldexp(n, -np.frexp(size)[1][:, None])
    n = n / np.linalg.norm(n, axis=1)[:, None]
    nearest = np.argmax(np.abs(n), axis=1)
    frame = np.empty((len(n), dim, dim))
    frame[:, 0] = n
    if axis is not None:
        _along(frame, axis)
        return frame
    for k in range(1, dim):
        # The k-th axis, not counting the nearest one.
        axis = np.where(k - 1 < nearest, k - 1, k)
        t = np.eye(dim)[axis]
        # Twice: one pass has an error of ε over the sine of the angle.
        for _ in range(2):
            for j in range(k):
                t = t - np.sum(t * frame[:, j], axis=1, keepdims=True) * frame[:, j]
        frame[:, k] = t / np.linalg.norm(t, axis=1, keepdims=True)
    return frame


# Unit normals that differ by less are equal: rounding of a rotation about the normal.
_SAME = 4 * np.finfo(np.float64).eps
# Normals are opposite if their sum is shorter than this: the smallest rotation is unknown.
_OPPOSITE = 1e-6


def turn_frames(frame: Floats, normals: Floats) -> Floats:
    """Frames ``(n_c, d, d)`` turned to other unit normals by the smallest rotations.

    Tangents turn as little as the normals do, ``t' = t - (n'·t) (n + n') / (1 + n·n')``, so
    that they do not jump between load steps. Frames whose normal stays are bitwise the same.
    """
    n = frame[:, 0]
    both = n + normals
    size = np.linalg.norm(both, axis=1)
    turned = np.empty_like(frame)
    turned[:, 0] = normals
    opposite = size < _OPPOSITE
    other = frames(normals)
    # Of the same handedness.
    flip = np.linalg.det(other) * np.linalg.det(frame) < 0
    other[flip, -1] *= -1
    # 1 + n·n' = |n + n'|² / 2.
    half = np.where(opposite, 1.0, size**2 / 2)
    for k in range(1, frame.shape[1]):
        t = frame[:, k]
        t = t - (np.sum(t * normals, axis=1) / half)[:, None] * both
        t = t - np.sum(t * normals, axis=1, keepdims=True) * normals
        length = np.where(opposite, 1.0, np.linalg.norm(t, axis=1))
        turned[:, k] = t / length[:, None]
    turned[opposite] = other[opposite]
    same = np.abs(normals - n).max(axis=1) <= _SAME
    turned[same] = frame[same]
    return turned


def find_step_frames(step: object, frame: Floats) -> Floats:
    """Frames of the contacts in a step; ``frame`` are those of B."""
    frame_of_step: Floats | None = getattr(step, "frame", None)
    return frame if frame_of_step is None else frame_of_step


def find_rotation(frame: Floats, base: Floats) -> Floats:
    """Q of each contact with ``frame = Q base``, as the rows ``(d n_c, d)``."""
    turned = np.einsum("cki,cli->ckl", frame, base)
    # Exact for contacts whose frame is that of B.
    turned[(frame == base).all(axis=(1, 2))] = np.eye(frame.shape[1])
    return np.ascontiguousarray(turned.reshape(-1, frame.shape[1]))


def turn_operator(frame: Floats, base: Floats, B: CsrMatrix) -> CsrMatrix:
    """Convert B in the frames ``base (n_c, d, d)`` to the frames ``frame``."""
    if (frame == base).all():
        return B
    from scipy.sparse import csr_array

    from bipot_rs._lib.matrices import block_diagonal

    rotation = block_diagonal(find_rotation(frame, base).reshape(frame.shape))
    turned: CsrMatrix = csr_array(rotation @ B)
    return turned


def operator(frame: Floats, sides: Sequence[Ints], n: int) -> CsrMatrix:
    """B of (2), CSR ``(d n_c, n)``: one node minus another, in the frames of the contacts.

    ``sides`` holds the degrees of freedom ``(n_c, d)`` of the nodes and, if any, of their
    partners; a first one below zero means that there is no partner.
    """
    from scipy.sparse import coo_array

    count, dim = frame.shape[:2]
    rows = np.arange(dim * count).reshape(count, dim, 1)
    data, row, column = [], [], []
    for side, sign in zip(sides, (1.0, -1.0), strict=False):
        has = side[:, 0] >= 0
        blocks = sign * frame[has]
        data.append(blocks.ravel())
        row.append(np.broadcast_to(rows[has], blocks.shape).ravel())
        column.append(np.broadcast_to(side[has][:, None], blocks.shape).ravel())
    entries = np.concatenate(data), (np.concatenate(row), np.concatenate(column))
    B: CsrMatrix = coo_array(entries, shape=(dim * count, n)).tocsr()
    B.eliminate_zeros()
    return B


def _along(frame: Floats, axis: ArrayLike) -> None:
    """Fill in the tangents, the first along ``axis``."""
    if frame.shape[1] != 3:
        raise ValueError(
            "axis is given, but in the plane there is one tangent: leave it out"
        )
    direction = floats("axis", axis, shape=(3,))
    size = np.abs(direction).max()
    if size == 0:
        raise ValueError("axis is zero, expected a direction")
    n, t = frame[:, 0], np.broadcast_to(direction / size, (len(frame), 3))
    for _ in range(2):  # as in `frames`
        t = t - np.sum(t * n, axis=1, keepdims=True) * n
    length = np.linalg.norm(t, axis=1)
    # Below this length the tangent is rounding error of the normal.
    if (length < 1e-8).any():
        at = int(np.argmin(length))
        raise ValueError(
            f"axis is {direction.tolist()}, expected a direction that is not parallel to "
            f"the normal, which is {n[at].tolist()} at contact {at}"
        )
    frame[:, 1] = t / length[:, None]
    frame[:, 2] = np.cross(n, frame[:, 1])
