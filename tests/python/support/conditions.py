"""Signorini's and Coulomb's conditions as in textbooks, without cone or projection."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def violation(r: Array, v: Array, mu: Array | float, *sizes: Array) -> float:
    """Largest violation of (6) and (8) by r and v (n, d), relative to their sizes.

    `sizes` are displacements that give the size instead of v, for example if v is a small
    difference of them.
    """
    force = np.abs(r).max(initial=0.0)
    length = max(np.abs(x).max(initial=0.0) for x in sizes or [v])
    # If all forces, or all displacements, are zero, the products below are zero too.
    force, length = force or 1.0, length or 1.0
    r_t, v_t = np.linalg.norm(r[:, 1:], axis=1), np.linalg.norm(v[:, 1:], axis=1)
    # Slip against the reaction, at the friction limit: r_t·v_t = -μ r_n |v_t|.
    power = np.einsum("ij,ij->i", r[:, 1:], v[:, 1:]) + mu * r[:, 0] * v_t
    parts = [
        -r[:, 0] / force,
        -v[:, 0] / length,
        (r_t - mu * r[:, 0]) / force,
        np.abs(r[:, 0] * v[:, 0]) / (force * length),
        np.abs(power) / (force * length) / np.maximum(mu, 1),
    ]
    return max(float(x.max(initial=0.0)) for x in parts)
