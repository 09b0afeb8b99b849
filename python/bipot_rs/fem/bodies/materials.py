"""Linear elastic materials, as fourth-order tensors without Voigt notation.

For 2D a material contains the assumption, plane strain, plane stress or axisymmetry, and
the thickness.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from bipot_rs._lib.types import Floats
from bipot_rs._lib.validation import floats, number

# Pairs of axes in the order of Poisson's ratios and shear moduli.
_PAIRS = ((0, 1), (0, 2), (1, 2))


@dataclass(frozen=True)
class Material:
    """Isotropic linear elasticity.

    Parameters
    ----------
    young
        Young's modulus, > 0 [Pa].
    poisson
        Poisson's ratio, in (-1, 1/2).
    plane_stress
        In 2D, plane stress instead of plane strain; no effect in 3D.
    thickness
        Thickness in 2D, > 0 [m]; no effect in 3D.
    axisymmetric
        In 2D, a body of revolution: coordinates and displacements are ``(r, z)``, direction
        3 is around the axis r = 0, and areas, forces and energies are of a full turn.
    """

    young: float
    poisson: float
    plane_stress: bool = False
    thickness: float = 1.0
    axisymmetric: bool = False

    def __post_init__(self) -> None:
        for name in ("young", "poisson", "thickness"):
            number(name, getattr(self, name))
        if not (np.isfinite(self.young) and self.young > 0):
            raise ValueError(f"young is {self.young}, expected a finite number > 0")
        if not -1 < self.poisson < 0.5:
            raise ValueError(
                f"poisson is {self.poisson}, expected a number between -1 and 1/2"
            )
        _thick(self)

    def lame(self, dim: int) -> tuple[float, float]:
        """Lamé's constants λ and μ [Pa]; in plane stress λ is the reduced one."""
        lame_mu = self.young / (2 * (1 + self.poisson))
        lame_lambda = 2 * lame_mu * self.poisson / (1 - 2 * self.poisson)
        if dim == 2 and self.plane_stress:
            # 2λμ/(λ + 2μ), in a form that works for λ = 0.
            lame_lambda = 2 * lame_mu * self.poisson / (1 - self.poisson)
        return lame_lambda, lame_mu

    def tensor(self, dim: int) -> Floats:
        """Elasticity C ``(d, d, d, d)`` of ``σ = C : ε`` [Pa], reduced in 2D."""
        lame_lambda, lame_mu = self.lame(dim)
        unit = np.eye(dim)
        shear = np.einsum("ik,jl->ijkl", unit, unit)
        elastic_tensor: Floats = lame_lambda * np.einsum("ij,kl->ijkl", unit, unit)
        elastic_tensor += lame_mu * (shear + shear.swapaxes(2, 3))
        return elastic_tensor

    @property
    def directions(self) -> Floats:
        """Axes of the material as rows: the coordinate axes."""
        return np.eye(3)


@dataclass(frozen=True)
class Orthotropic:
    """Linear elasticity with three planes of symmetry, such as wood or a laminate.

    Parameters
    ----------
    young
        Young's moduli ``(E1, E2, E3)`` along the axes of the material, > 0 [Pa].
    poisson
        ``(ν12, ν13, ν23)``: under tension along i, the contraction along j is ``ν_ij``
        times the extension; ``ν_ji = ν_ij E_j / E_i``.
    shear
        Shear moduli ``(G12, G13, G23)``, > 0 [Pa].
    axes
        Directions 1, 2, 3 as rows ``(3, 3)``, orthogonal, of any length; in 2D
        directions 1 and 2 as rows ``(2, 2)``; default the coordinate axes. Direction 3 is
        normal to the plane of a 2D body.
    plane_stress, thickness, axisymmetric
        As in `Material`.

    Raises
    ------
    ValueError
        Moduli are not positive, the elasticity is not positive definite, or axes are not
        orthogonal.
    """

    young: Sequence[float]
    poisson: Sequence[float]
    shear: Sequence[float]
    axes: ArrayLike | None = None
    plane_stress: bool = False
    thickness: float = 1.0
    axisymmetric: bool = False

    def __post_init__(self) -> None:
        for name in ("young", "poisson", "shear"):
            constants = floats(name, getattr(self, name), shape=(3,))
            if name != "poisson" and (constants <= 0).any():
                raise ValueError(
                    f"{name} is {constants.tolist()}, expected three numbers > 0"
                )
            # Tuples of floats, so that materials can be compared and hashed.
            object.__setattr__(self, name, tuple(constants.tolist()))
        _thick(self)
        if self.axes is not None:
            rows = _orthonormal(self.axes)
            object.__setattr__(self, "axes", tuple(map(tuple, rows.tolist())))
        _definite(self.young, self.poisson)

    @cached_property
    def directions(self) -> Floats:
        """Axes of the material as rows of length 1."""
        return np.eye(3) if self.axes is None else np.array(self.axes)

    def tensor(self, dim: int) -> Floats:
        """Elasticity C ``(d, d, d, d)`` of ``σ = C : ε`` [Pa], reduced in 2D.

        Raises
        ------
        ValueError
            In 2D, direction 3 is not normal to the plane: tension in the plane would
            shear the body out of it.
        """
        C = self._space
        if dim == 3:
            return C.copy()
        if abs(self.directions[2, 2]) < 1 - 1e-12:
            raise ValueError(
                f"axes have direction 3 along {self.directions[2].tolist()}, expected "
                "(0, 0, 1), the normal of the plane of a 2D body"
            )
        plane = C[:2, :2, :2, :2]
        if self.plane_stress:
            across = C[:2, :2, 2, 2]
            plane = plane - across[:, :, None, None] * across / C[2, 2, 2, 2]
        return np.array(plane)

    @cached_property
    def _space(self) -> Floats:
        C = np.zeros((3, 3, 3, 3))
        axis = np.arange(3)
        root = np.sqrt(self.young)
        normal = np.linalg.inv(_scale_constants(self.young, self.poisson)) * np.outer(
            root, root
        )
        C[axis[:, None], axis[:, None], axis, axis] = 0.5 * (normal + normal.T)
        for (i, j), modulus in zip(_PAIRS, self.shear, strict=True):
            C[i, j, i, j] = C[j, i, j, i] = C[i, j, j, i] = C[j, i, i, j] = modulus
        if self.axes is None:
            return C
        Q = self.directions
        turned = np.einsum("abcd,ai,bj,ck,dl->ijkl", C, Q, Q, Q, Q, optimize=True)
        # Rounding of the products must not destroy the symmetries: K needs them.
        turned = 0.5 * (turned + turned.transpose(1, 0, 2, 3))
        turned = 0.5 * (turned + turned.transpose(0, 1, 3, 2))
        return np.asarray(0.5 * (turned + turned.transpose(2, 3, 0, 1)))


Elastic: TypeAlias = Material | Orthotropic


def _thick(material: Elastic) -> None:
    thickness = number("thickness", material.thickness)
    if not (np.isfinite(thickness) and thickness > 0):
        raise ValueError(f"thickness is {thickness}, expected a finite number > 0")
    if material.axisymmetric and (material.plane_stress or thickness != 1.0):
        raise ValueError(
            "axisymmetric is given with plane_stress or thickness: a body of revolution has "
            "neither; forces are those of a full turn"
        )


def _scale_constants(young: Sequence[float], poisson: Sequence[float]) -> Floats:
    """Compliance of normal strains, entry ij times √(E_i E_j): dimensionless."""
    S = np.eye(3)
    for (i, j), ratio in zip(_PAIRS, poisson, strict=True):
        S[i, j] = S[j, i] = -ratio * np.sqrt(young[j] / young[i])
    return S


def _definite(young: Sequence[float], poisson: Sequence[float]) -> None:
    for (i, j), ratio in zip(_PAIRS, poisson, strict=True):
        most = np.sqrt(young[i] / young[j])
        if abs(ratio) >= most:
            raise ValueError(
                f"poisson has ν{i + 1}{j + 1} = {ratio:g}, expected |ν{i + 1}{j + 1}| < "
                f"√(E{i + 1}/E{j + 1}) = {most:g}: otherwise a strain has negative energy"
            )
    determinant = float(np.linalg.det(_scale_constants(young, poisson)))
    # Rounding of a determinant of entries below 1.
    if determinant <= 8 * np.finfo(float).eps:
        raise ValueError(
            f"poisson is {list(poisson)}: 1 - ν12 ν21 - ν23 ν32 - ν13 ν31 - 2 ν21 ν32 ν13 "
            f"is {determinant:g}, expected a positive number: otherwise a strain has "
            "negative energy"
        )


def _orthonormal(axes: ArrayLike) -> Floats:
    axes_given = floats("axes", axes, ndim=2)
    if axes_given.shape not in ((2, 2), (3, 3)):
        raise ValueError(
            f"axes has shape {axes_given.shape}, expected (3, 3) or (2, 2)"
        )
    length = np.linalg.norm(axes_given, axis=1, keepdims=True)
    if (length == 0).any():
        raise ValueError("axes has a row of zeros, expected directions")
    unit = axes_given / length
    # Tolerance for directions given with six digits.
    off = np.abs(unit @ unit.T - np.eye(len(unit))).max()
    if off > 1e-5:
        raise ValueError(
            f"axes are not orthogonal: the cosine of two of them is {off:g}, expected 0"
        )
    # The nearest orthogonal matrix.
    u, _, v = np.linalg.svd(unit)
    rows = np.eye(3)
    rows[: len(unit), : len(unit)] = u @ v
    return rows


def elasticity(material: Elastic, dim: int) -> Floats:
    """Elasticity ``(3, 3, 3, 3)``; in plane stress zero out of the plane."""
    if dim == 3 or not material.plane_stress:
        return material.tensor(3)
    law = np.zeros((3, 3, 3, 3))
    law[:2, :2, :2, :2] = material.tensor(2)
    return law


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
