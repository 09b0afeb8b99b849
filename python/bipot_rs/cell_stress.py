"""Stress of linear elasticity from displacements, one tensor a cell."""

from __future__ import annotations

import numpy as np

from bipot_rs.check import floats
from bipot_rs.elasticity import (
    _ELEMENTS,
    Body,
    Floats,
    _inverse,
    _jacobian,
    _reference,
)


def cell_stress(body: Body, displacement: Floats) -> Floats:
    """Stress of each cell, its mean over the cell, ``(cells, 3, 3)`` [Pa].

    Parameters
    ----------
    body
        Mesh and material.
    displacement
        Of its nodes, ``(dim * nodes,)`` or ``(nodes, dim)`` [m].

    Returns
    -------
    numpy.ndarray
        Tension positive, in global components. In 2D with the stress out of the plane:
        zero in plane stress, ``λ tr ε`` in plane strain.
    """
    nodes, dim = body.points.shape
    u = floats(
        "displacement", np.asarray(displacement).reshape(-1), shape=(nodes * dim,)
    )
    corners = np.asarray(body.mesh.t, dtype=np.int64).T
    _, slopes, weights = _reference(*_ELEMENTS[type(body.mesh)])
    inverse, determinant = _inverse(_jacobian(body.points[corners], slopes))
    share = weights[:, None] * np.abs(determinant)
    share /= share.sum(axis=0)
    # ∂u_a/∂x_b, averaged over the points of Gauss.
    gradient = np.einsum(
        "qc,qgi,qgbc,cia->cab",
        share,
        slopes,
        inverse,
        u.reshape(-1, dim)[corners],
        optimize=True,
    )
    strain = np.zeros((len(corners), 3, 3))
    strain[:, :dim, :dim] = (gradient + gradient.swapaxes(1, 2)) / 2
    lame_lambda, lame_mu = body.material.lame(dim)
    stress = 2 * lame_mu * strain
    trace = lame_lambda * np.trace(strain, axis1=1, axis2=2)
    flat = dim == 2 and body.material.plane_stress
    for k in range(dim if flat else 3):
        stress[:, k, k] += trace
    return stress


def von_mises(stress: Floats) -> Floats:
    """``√(3/2 s:s)`` of the deviator ``s`` of stresses ``(..., 3, 3)``, ``(...)`` [Pa]."""
    mean = np.trace(stress, axis1=-2, axis2=-1)[..., None, None] / 3
    deviator = stress - mean * np.eye(3)
    return np.asarray(np.sqrt(1.5 * np.sum(deviator**2, axis=(-2, -1))))
