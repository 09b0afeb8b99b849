"""The friction law (8) with one coefficient of each contact, or one of each tangent.

With ``D = diag(mu_1, mu_2)``, friction lies within the ellipse ``‖D⁻¹ r_t‖ ≤ r_n``, and
a sliding contact has ``r_t = -r_n D² v_t / ‖D v_t‖``. Coulomb's law has ``D = μ I``.
"""

from __future__ import annotations

import numpy as np

from bipot_rs._lib.types import Floats


def find_largest(mu: Floats) -> Floats:
    """The larger coefficient of each contact, ``(n_c,)``."""
    return mu if mu.ndim == 1 else np.asarray(mu.max(axis=1), np.float64)


def dissipation(mu: Floats, v_t: Floats) -> Floats:
    """``‖D v_t‖``, the work of friction per unit normal reaction, ``(n_c,)``."""
    if mu.ndim == 1:
        return np.asarray(mu * np.linalg.norm(v_t, axis=1), np.float64)
    return np.asarray(np.linalg.norm(mu * v_t, axis=1), np.float64)


def find_resisting(mu: Floats, v_t: Floats) -> Floats:
    """``D² v_t / ‖D v_t‖``, minus friction per unit normal reaction; zero without slip."""
    size = np.linalg.norm(v_t, axis=1)
    unit = v_t / np.where(size > 0, size, 1.0)[:, None]
    if mu.ndim == 1:
        return np.asarray(mu[:, None] * unit, np.float64)
    steep = np.linalg.norm(mu * unit, axis=1)
    return np.asarray(mu**2 * unit / np.where(steep > 0, steep, 1.0)[:, None])


def find_limit(mu: Floats, r_t: Floats) -> Floats:
    """The largest friction along ``r_t`` per unit normal reaction, ``(n_c,)``."""
    if mu.ndim == 1:
        return mu
    size = np.linalg.norm(r_t, axis=1)
    unit = r_t / np.where(size > 0, size, 1.0)[:, None]
    # The point s e of the ellipse has s ‖D⁻¹ e‖ = 1. D may have zeros: no D⁻¹ here.
    across = np.linalg.norm(mu[:, ::-1] * unit, axis=1)
    area = mu.prod(axis=1)
    reach = np.divide(area, across, out=np.zeros_like(area), where=across > 0)
    return np.asarray(reach, np.float64)
