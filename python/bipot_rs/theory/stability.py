"""What a plastic body may do besides: bands of strain, and how much hardening stops them.

With the tangent ``C`` of the law, a strain may gather in a band with the normal ``n`` where
``det Q(n) <= 0``, ``Q_ik = n_j C_ijkl n_l``. For flow that is not associated the tangent is
not symmetric, and the perfectly plastic point of Mohr and Coulomb has such directions. The
hardening above which it has none is

    ``H = G (sin φ - sin ψ)² / (8 (1 - ν))``.
"""

from __future__ import annotations

import numpy as np

from bipot_rs._lib.types import Floats
from bipot_rs.theory.convex import length
from bipot_rs.theory.points import PlasticPoints, PointEnd, Rate

# Directions over half a circle and over half a sphere.
_ANGLES, _SPIRAL = 3600, 400
# Rings around the best direction of these, one after the other.
_RING = 2 * np.pi * np.arange(12) / 12
# A further step, relative to the flow of the last one.
_SHORT = 1e-7
_RADII = 0.1 * 0.6 ** np.arange(16)
# The least hardening of the rate term in shear moduli, for flow that is nearly associated.
_LEAST = 0.01


def critical_hardening(points: PlasticPoints) -> Floats:
    """The hardening ``H`` of each point in the units of its springs, ``(m,)`` [Pa].

    It is at least 0.01 of them. For other laws than that of Mohr and Coulomb it is an
    estimate, with ``M_n/M_t`` in place of ``1/(1 - 2ν)``.
    """
    ratio = points.stiffness[:, 0] / points.stiffness[:, 1]
    nu = np.clip(0.5 * (1 - 1 / np.maximum(ratio, 0.5)), 0.0, 0.5)
    share = (points.law.mu - points.law.dilatancy) ** 2 / (8 * (1 - nu))
    return np.asarray(points.stiffness[:, 1] * np.maximum(share, _LEAST))


def find_ellipticity(
    points: PlasticPoints, end: PointEnd, rate: Rate | None = None
) -> Floats:
    """The least ``det Q(n)`` relative to the elastic one, of points with tensors.

    The tangent is that of the rates, if the flow goes on: of a short further step. 1 at
    points without flow, and of points whose strains are not tensors.
    """
    slip = length(end.flow[:, 1:])
    shifted = None if rate is None else Rate(rate.hardening, rate.before - slip)
    end = points.respond(_SHORT * end.flow, end.stress, rate=shifted)
    found = np.ones(len(points.weights))
    yields = length(end.flow) > 0
    if points.components.shape[1] == 6 and yields.any():
        X, M = points.components, points.springs[yields]
        tangent = np.einsum(
            "ki,mkl,ml,lj->mij", X, end.jacobian[yields], M, X, optimize=True
        )
        elastic = np.einsum("ki,mk,kj->mij", X, M, X)
        plane = not X[:, 3:5].any()
        found[yields] = _find_least(tangent, plane) / _find_least(elastic, plane)
    return found.reshape(points.shape)


def _find_least(tangent: Floats, plane: bool) -> Floats:
    """The least ``det Q`` over the directions."""
    if not plane:
        k = np.arange(_SPIRAL) + 0.5
        best = _determinants(tangent, _spiral(k / _SPIRAL, np.sqrt(_SPIRAL)))
        at = _spiral(k / _SPIRAL, np.sqrt(_SPIRAL))[best.argmin(axis=1)]
        least = best.min(axis=1)
        around = np.stack([np.cos(_RING), np.sin(_RING)], axis=1)
        for radius in _RADII:
            # A frame across each direction, and a ring of directions around it.
            one = np.cross(at, np.eye(3)[np.abs(at).argmin(axis=1)])
            one /= length(one)[:, None]
            frame = np.stack([one, np.cross(at, one)], axis=1)
            ring = at[:, None] + radius * np.einsum("qk,mkd->mqd", around, frame)
            ring /= length(ring)[..., None]
            values = _determinants(tangent, ring)
            rows, near = np.arange(len(at)), values.argmin(axis=1)
            falls = values[rows, near] < least
            at = np.where(falls[:, None], ring[rows, near], at)
            least = np.minimum(least, values[rows, near])
        return np.asarray(least)
    # In the plane det Q is a trigonometric polynomial of five terms, known from five angles.
    few = np.pi * np.arange(5) / 5
    values = _determinants(tangent, np.stack([np.cos(few), np.sin(few)], axis=1))
    terms = np.linalg.solve(_waves(few), values.T)
    return np.asarray(
        (_waves(np.pi * np.arange(_ANGLES) / _ANGLES) @ terms).min(axis=0)
    )


def _spiral(share: Floats, turns: float) -> Floats:
    """Directions over half a sphere, evenly."""
    flat, angle = np.sqrt(share * (2 - share)), 2 * np.pi * turns * share
    return np.stack([flat * np.cos(angle), flat * np.sin(angle), 1 - share], axis=1)


def _waves(angles: Floats) -> Floats:
    """``1, cos 2θ, sin 2θ, cos 4θ, sin 4θ``, ``(angles, 5)``."""
    twice = 2 * angles
    terms = [np.ones_like(angles)]
    terms += [wave(k * twice) for k in (1, 2) for wave in (np.cos, np.sin)]
    return np.stack(terms, axis=1)


def _determinants(tangent: Floats, directions: Floats) -> Floats:
    """``det Q(n)`` in directions ``(q, d)``, or ``(m, q, d)`` of each point: ``(m, q)``."""
    d, root = directions.shape[-1], 1 / np.sqrt(2)
    # Vectors of the tensors sym(e_i ⊗ n) of unit vectors e_i.
    along = np.zeros((*directions.shape, 6))
    for i in range(d):
        along[..., i, i] = directions[..., i]
    for row, (i, j) in zip((5, 4, 3), ((0, 1), (0, 2), (1, 2)), strict=True):
        if j < d:
            along[..., i, row] = root * directions[..., j]
            along[..., j, row] = root * directions[..., i]
    left = along @ tangent[:, None]
    return np.asarray(np.linalg.det(left @ np.swapaxes(along, -1, -2)))
