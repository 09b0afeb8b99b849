"""Orthonormal bases at contacts, the components of (2): normal first."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from bipot_rs._lib.types import Floats
from bipot_rs._lib.validation import floats


def frames(normals: ArrayLike, axis: ArrayLike | None = None) -> Floats:
    """Orthonormal bases with rows n, t1[, t2], from normals ``(n_c, d)``.

    The tangents are the coordinate axes, in their order, made orthogonal to the
    normal, leaving out the axis nearest to it: with n = z they are x and y. In space
    ``axis (3,)`` may be given: t1 is that direction made orthogonal to the normal, and
    t2 = n × t1.
    """
    n = floats("normals", normals, ndim=2)
    dim = n.shape[1]
    if dim not in (2, 3):
        raise ValueError(f"normals has shape {n.shape}, expected (n_c, 2) or (n_c, 3)")
    size = np.abs(n).max(axis=1)
    if not (size > 0).all():
        raise ValueError(f"a normal has length zero, that at {int(np.argmin(size))}")
    # Squares of large or small components leave the range; powers of two change no bit.
    n = np.ldexp(n, -np.frexp(size)[1][:, None])
    n = n / np.linalg.norm(n, axis=1)[:, None]
    nearest = np.argmax(np.abs(n), axis=1)
    frame = np.empty((len(n), dim, dim))
    frame[:, 0] = n
    if axis is not None:
        _along(frame, axis)
        return frame
    for k in range(1, dim):
        # The k-th axis other than the nearest one.
        axis = np.where(k - 1 < nearest, k - 1, k)
        t = np.eye(dim)[axis]
        # Twice: one pass leaves an error of ε over the sine of the angle.
        for _ in range(2):
            for j in range(k):
                t = t - np.sum(t * frame[:, j], axis=1, keepdims=True) * frame[:, j]
        frame[:, k] = t / np.linalg.norm(t, axis=1, keepdims=True)
    return frame


def _along(frame: Floats, axis: ArrayLike) -> None:
    """Fill tangents in behind the normals: the first along ``axis``."""
    if frame.shape[1] != 3:
        raise ValueError("axis was given, in the plane there is one tangent")
    direction = floats("axis", axis, shape=(3,))
    size = np.abs(direction).max()
    if size == 0:
        raise ValueError("axis is zero, expected a direction")
    n, t = frame[:, 0], np.broadcast_to(direction / size, (len(frame), 3))
    for _ in range(2):  # as in `frames`
        t = t - np.sum(t * n, axis=1, keepdims=True) * n
    length = np.linalg.norm(t, axis=1)
    # Below, the direction is the rounding of the normal.
    if (length < 1e-8).any():
        at = int(np.argmin(length))
        raise ValueError(
            f"axis is {direction.tolist()}, expected a direction aside of the normal, "
            f"which is {n[at].tolist()} at contact {at}"
        )
    frame[:, 1] = t / length[:, None]
    frame[:, 2] = np.cross(n, frame[:, 1])
