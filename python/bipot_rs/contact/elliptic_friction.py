"""Friction coefficients, one a contact or one a tangent of each, in the law (8).

With ``D = diag(mu_1, mu_2)``: friction lies within the ellipse ``‖D⁻¹ r_t‖ ≤ r_n``, and
a contact that slides has ``r_t = -r_n D² v_t / ‖D v_t‖``. Coulomb's law has ``D = μ I``.
"""

from __future__ import annotations

import numpy as np

from bipot_rs._lib.types import Floats


def isotropic(mu: Floats, d: int) -> tuple[Floats, Floats]:
    """Factors of the components, ``(n_c, d)``, that make the law Coulomb's, and its mu.

    With ``r = T r̃``, ``ṽ = T v`` and ``T = diag(1, D)`` the law between ``r̃`` and ``ṽ`` has
    ``mu = 1``; contacts without friction keep theirs, and so do those of Coulomb.
    """
    by = np.ones((len(mu), d))
    if mu.ndim == 1:
        return by, mu
    slides = mu.max(axis=1) > 0
    by[slides, 1:] = mu[slides]
    return by, slides.astype(np.float64)


def largest(mu: Floats) -> Floats:
    """The larger coefficient of each contact, ``(n_c,)``."""
    return mu if mu.ndim == 1 else np.asarray(mu.max(axis=1), np.float64)


def dissipation(mu: Floats, v_t: Floats) -> Floats:
    """``‖D v_t‖``, friction's work by unit pressure, of each contact ``(n_c,)``."""
    if mu.ndim == 1:
        return np.asarray(mu * np.linalg.norm(v_t, axis=1), np.float64)
    return np.asarray(np.linalg.norm(mu * v_t, axis=1), np.float64)


def resisting(mu: Floats, v_t: Floats) -> Floats:
    """``D² v_t / ‖D v_t‖``, minus friction at unit pressure; zero without slip."""
    size = np.linalg.norm(v_t, axis=1)
    unit = v_t / np.where(size > 0, size, 1.0)[:, None]
    if mu.ndim == 1:
        return np.asarray(mu[:, None] * unit, np.float64)
    steep = np.linalg.norm(mu * unit, axis=1)
    return np.asarray(mu**2 * unit / np.where(steep > 0, steep, 1.0)[:, None])


def limit(mu: Floats, r_t: Floats) -> Floats:
    """The most that friction can be along ``r_t`` at unit pressure, ``(n_c,)``."""
    if mu.ndim == 1:
        return mu
    size = np.linalg.norm(r_t, axis=1)
    unit = r_t / np.where(size > 0, size, 1.0)[:, None]
    # Of the ellipse's point r e: r ‖D⁻¹ e‖ = 1, without division by a zero of D.
    across = np.linalg.norm(mu[:, ::-1] * unit, axis=1)
    area = mu.prod(axis=1)
    reach = np.divide(area, across, out=np.zeros_like(area), where=across > 0)
    return np.asarray(reach, np.float64)
