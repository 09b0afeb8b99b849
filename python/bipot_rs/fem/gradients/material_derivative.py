"""Derivatives of the elasticity tensor with respect to the moduli of a material."""

from __future__ import annotations

import numpy as np

from bipot_rs._lib.types import Floats
from bipot_rs.fem.bodies.materials import Material, elasticity


def of_young(material: Material, dim: int) -> Floats:
    """``∂C/∂E``, in the form of `elasticity`: C is proportional to E."""
    return elasticity(material, dim) / material.young


def of_poisson(material: Material, dim: int) -> Floats:
    """``∂C/∂ν`` [Pa], in the form of `elasticity`."""
    E, nu = material.young, material.poisson
    lame_mu = -E / (2 * (1 + nu) ** 2)
    flat = dim == 2 and material.plane_stress
    if flat:
        # λ = E ν / (1 - ν²).
        lame_lambda = E * (1 + nu**2) / (1 - nu**2) ** 2
    else:
        # λ = E ν / ((1 + ν) (1 - 2 ν)).
        lame_lambda = E * (1 + 2 * nu**2) / ((1 + nu) * (1 - 2 * nu)) ** 2
    unit = np.eye(3)
    if flat:
        unit[2, 2] = 0.0
    shear = np.einsum("ik,jl->ijkl", unit, unit)
    return np.asarray(
        lame_lambda * np.einsum("ij,kl->ijkl", unit, unit)
        + lame_mu * (shear + shear.swapaxes(2, 3))
    )
