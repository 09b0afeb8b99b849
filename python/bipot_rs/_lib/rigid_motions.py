"""Rigid motions of points, in the basis of the core."""

from __future__ import annotations

import numpy as np

import bipot_rs._core as _core
from bipot_rs._lib.types import Floats


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
