"""The appendix of [dSF91] as functions: indicators, support functions, projections, prox.

The last axis of an array contains the components of vectors; all other axes are batches.
The sets and functions are those of contact and soils: balls, norms, and the cone
``|t| <= slope n`` in any dimension.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from bipot_rs._lib.matrices import direction, length
from bipot_rs._lib.types import Bools, Floats
from bipot_rs.contact.law.contact_law import project

# Tolerance of a condition on a sum of a few rounded numbers, relative to their sizes: a
# point that is constructed on a border must count as inside.
ROUNDING = 16 * float(np.finfo(np.float64).eps)


def dot(x: Floats, y: Floats) -> Floats:
    """``x·y`` along the last axis."""
    return np.asarray(np.einsum("...i,...i->...", x, y))


def within(lack: Floats, size: Floats) -> Bools:
    """Whether ``lack <= 0``, with the rounding of terms of the given size as tolerance."""
    return np.asarray(lack <= ROUNDING * size)


def indicator(inside: Bools) -> Floats:
    """``Ψ``: 0 where the condition holds, ``+inf`` elsewhere."""
    return np.where(inside, 0.0, np.inf)


def support_ball(x: Floats, radius: Floats) -> Floats:
    """``sup { x·y : |y| <= radius } = radius |x|``, the conjugate of the ball's indicator."""
    return np.asarray(radius * length(x))


def project_ball(x: Floats, radius: Floats) -> Floats:
    """Nearest point of the ball ``|y| <= radius``, ``radius >= 0``."""
    size = length(x)
    outside = size > radius
    ratio = np.divide(radius, size, out=np.ones_like(size), where=outside)
    return np.asarray(x * ratio[..., None])


def shrink(x: Floats, weight: Floats) -> Floats:
    """Proximal point of ``weight |·|``, ``weight >= 0``: shorten each vector by the weight.

    By Moreau's decomposition this is x minus its projection onto the ball of that radius.
    It is computed from the length instead, so that zero is exact.
    """
    size = length(x)
    left = np.maximum(size - weight, 0.0)
    ratio = np.divide(left, size, out=np.zeros_like(size), where=size > 0)
    return np.asarray(x * ratio[..., None])


def project_cone(
    height: Floats, radial: Floats, slope: ArrayLike
) -> tuple[Floats, Floats]:
    """Nearest point of the cone ``|radial| <= slope height`` in any dimension.

    By rotational symmetry the problem reduces to the plane through the axis and the point,
    where it is `bipot_rs.project`.

    Parameters
    ----------
    height, radial
        Components along the axis ``(...)`` and across it ``(..., k)``.
    slope
        Finite and not negative, a number or ``(...)``.

    Returns
    -------
    height, radial
        Components of the projection.
    """
    across = length(radial)
    plane = np.stack([np.ravel(height), np.ravel(across)], axis=1)
    slopes = np.broadcast_to(np.asarray(slope, float), across.shape).ravel()
    nearest, _ = project(plane, slopes)
    up = nearest[:, 0].reshape(across.shape)
    out = nearest[:, 1].reshape(across.shape)
    return up, direction(radial) * out[..., None]


def conjugate_prox(
    prox: Callable[[Floats, float], Floats], x: Floats, r: float = 1.0
) -> Floats:
    """Proximal point of ``r F*``, from that of ``F`` by Moreau's decomposition.

    ``prox(x, r F*) = x - r prox(x/r, F/r)``; ``prox(x, s)`` gives the proximal point of
    ``s F``, and ``r > 0``.
    """
    return np.asarray(x - r * prox(x / r, 1.0 / r))
