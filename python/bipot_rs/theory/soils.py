"""Drucker–Prager plasticity with independent dilatancy: an implicit material of solids.

This is de Saxcé's second example, after contact. Tension is positive. ``σ_m`` is the mean
stress and ``s`` the deviator, ``ε_v`` the volume strain and ``e`` the deviator of the
plastic strain increment, so that ``σ:ε = σ_m ε_v + s:e``. Tensors are stored as vectors of
six components (`mandel`), whose dot product is the double contraction.

criterion
    ``|s| <= α (a - σ_m)``
flow
    ``e = λ s/|s|``, ``ε_v = β |e|``, λ >= 0, zero inside the criterion; at the apex
    ``σ = a I``: ``ε_v >= β |e|``.

α is the friction, β the dilatancy, ``a`` the mean stress of the apex. The law is
associated only for β = α. For ``0 <= β <= α`` it has the bipotential

    ``b(ε, σ) = a ε_v + (α - β)(a - σ_m)|e| + Ψ(|s| <= α (a - σ_m)) + Ψ(ε_v >= β |e|)``,
    ``b - σ:ε = (a - σ_m)(ε_v - β|e|) + (α (a - σ_m)|e| - s:e) >= 0``:

In the domain neither bracket is negative, and both vanish exactly on the law. Convexity in
``ε`` gives the limits of β: for β > α the factor of ``|e|`` is negative inside the cone;
for β < 0 the set ``ε_v >= β|e|`` is the outside of a cone.

Coulomb contact is the case β = 0, ``a = 0`` with ``σ_m = -t_n``, ``ε_v = u_n``, ``s = t_t``,
``e = -u_t``: Coulomb friction is a soil without dilatancy.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from bipot_rs._lib.matrices import direction, length
from bipot_rs._lib.types import Bools, Floats
from bipot_rs._lib.validation import floats, number
from bipot_rs.theory.convex import indicator, project_cone, within
from bipot_rs.theory.materials import positive_step

# xx, yy, zz, then √2 times yz, xz, xy.
_ROWS = np.array([0, 1, 2, 1, 0, 0])
_COLUMNS = np.array([0, 1, 2, 2, 2, 1])
_WEIGHT = np.array([1.0, 1.0, 1.0, *3 * [math.sqrt(2)]])
_UNIT = np.array([1.0, 1.0, 1.0, 0.0, 0.0, 0.0])


def mandel(tensor: ArrayLike) -> Floats:
    """Symmetric tensors ``(..., 3, 3)`` as vectors ``(..., 6)``: xx, yy, zz, √2(yz, xz, xy).

    The upper triangle is read.
    """
    tensors = floats("tensor", tensor)
    if tensors.shape[-2:] != (3, 3):
        raise ValueError(f"tensor has shape {tensors.shape}, expected (..., 3, 3)")
    return np.asarray(tensors[..., _ROWS, _COLUMNS] * _WEIGHT)


def tensor(vector: ArrayLike) -> Floats:
    """Vectors ``(..., 6)`` of `mandel` as tensors ``(..., 3, 3)``."""
    vectors = _vectors("vector", vector) / _WEIGHT
    full = np.empty((*vectors.shape[:-1], 3, 3))
    full[..., _ROWS, _COLUMNS] = vectors
    full[..., _COLUMNS, _ROWS] = vectors
    return full


def _vectors(what: str, value: ArrayLike) -> Floats:
    vectors = floats(what, value)
    if vectors.ndim == 0 or vectors.shape[-1] != 6:
        raise ValueError(f"{what} has shape {vectors.shape}, expected (..., 6)")
    return vectors


def _stress(y: Floats) -> tuple[Floats, Floats]:
    """Mean stress and deviator."""
    mean = y @ _UNIT / 3
    return mean, y - mean[..., None] * _UNIT


def _strain(x: Floats) -> tuple[Floats, Floats]:
    """Volume strain and deviator."""
    volume = x @ _UNIT
    return volume, x - volume[..., None] / 3 * _UNIT


@dataclass(frozen=True)
class DruckerPrager:
    """Drucker–Prager material: ``x`` increments of plastic strain, ``y`` stresses, ``(..., 6)``.

    Parameters
    ----------
    friction
        α > 0.
    dilatancy
        β, from 0 to α.
    apex
        ``a >= 0``, the largest mean stress (in tension) [Pa].
    """

    friction: float
    dilatancy: float
    apex: float

    def __post_init__(self) -> None:
        alpha, beta = (
            number("friction", self.friction),
            number("dilatancy", self.dilatancy),
        )
        a = number("apex", self.apex)
        if not 0 < alpha < math.inf:
            raise ValueError(f"friction is {alpha}, expected a positive number")
        if not 0 <= beta <= alpha:
            raise ValueError(
                f"dilatancy is {beta}, expected 0 to {alpha}, the friction: outside this "
                "range the law has no bipotential of this form"
            )
        if not 0 <= a < math.inf:
            raise ValueError(f"apex is {a}, expected zero or positive")

    @classmethod
    def from_angles(
        cls, cohesion: float, friction_angle: float, dilatancy_angle: float
    ) -> DruckerPrager:
        """Material whose cone contains the compressive edges of the Mohr–Coulomb pyramid.

        Parameters
        ----------
        cohesion
            ``c >= 0`` [Pa].
        friction_angle, dilatancy_angle
            φ and ψ, ``0 <= ψ <= φ``, ``0 < φ < π/2`` [rad].
        """
        c, phi = number("cohesion", cohesion), number("friction_angle", friction_angle)
        psi = number("dilatancy_angle", dilatancy_angle)
        if not 0 < phi < math.pi / 2:
            raise ValueError(f"friction_angle is {phi}, expected above 0, below pi/2")
        if not 0 <= psi <= phi:
            raise ValueError(
                f"dilatancy_angle is {psi}, expected 0 to {phi} (the friction angle)"
            )
        if not 0 <= c < math.inf:
            raise ValueError(f"cohesion is {c}, expected zero or positive")
        alpha, beta = (
            2 * math.sqrt(6) * math.sin(v) / (3 - math.sin(v)) for v in (phi, psi)
        )
        return cls(alpha, beta, c / math.tan(phi))

    @property
    def associated(self) -> bool:
        """Whether the flow is normal to the criterion: an explicit material."""
        return self.dilatancy == self.friction

    def criterion(self, y: ArrayLike) -> Floats:
        """``|s| - α (a - σ_m)`` [Pa], not positive for an admissible stress."""
        mean, deviator = _stress(_vectors("y", y))
        return np.asarray(length(deviator) - self.friction * (self.apex - mean))

    def plastic_potential(self, y: ArrayLike) -> Floats:
        """``|s| + β σ_m`` [Pa]: the flow is normal to its level sets, not to the criterion."""
        mean, deviator = _stress(_vectors("y", y))
        return np.asarray(length(deviator) + self.dilatancy * mean)

    def flow(self, y: ArrayLike) -> Floats:
        """Gradient of the plastic potential, ``s/|s| + β I/3``: the flow divided by λ.

        At ``s = 0`` it is the volume part ``β I/3``.
        """
        _, deviator = _stress(_vectors("y", y))
        return np.asarray(direction(deviator) + self.dilatancy / 3 * _UNIT)

    def _bears(self, y: Floats) -> Bools:
        mean, deviator = _stress(y)
        size = length(y) + self.friction * (self.apex + length(y))
        return within(length(deviator) - self.friction * (self.apex - mean), size)

    def _dilates(self, x: Floats) -> Bools:
        volume, deviator = _strain(x)
        size = (1 + self.dilatancy) * length(x)
        return within(self.dilatancy * length(deviator) - volume, size)

    def bipotential(self, x: ArrayLike, y: ArrayLike) -> Floats:
        """``b(ε, σ)`` [J/m³]."""
        strain, stress = _vectors("x", x), _vectors("y", y)
        (volume, e), (mean, _) = _strain(strain), _stress(stress)
        excess = self.friction - self.dilatancy
        value = self.apex * volume + excess * (self.apex - mean) * length(e)
        return value + indicator(self._bears(stress) & self._dilates(strain))

    def left_dual(self, z: ArrayLike, y: ArrayLike) -> Floats:
        """``Ψ(σ̄_m <= a) + Ψ(|s̄| <= β(a - σ̄_m) + (α - β)(a - σ_m)) - Ψ(σ admissible)``, (14).

        For ``σ`` on the criterion, the level set of the plastic potential through ``σ`` bounds
        the set of ``σ̄``, cut off at the apex. Its normals at ``σ̄ = σ`` are the flow, (16).
        """
        bar, stress = _vectors("z", z), _vectors("y", y)
        (bar_mean, bar_s), (mean, _) = _stress(bar), _stress(stress)
        excess = self.friction - self.dilatancy
        limit = self.dilatancy * (self.apex - bar_mean) + excess * (self.apex - mean)
        size = length(bar) + length(stress) + self.apex
        inside = within(length(bar_s) - limit, (1 + self.friction) * size)
        value = indicator(inside & within(bar_mean - self.apex, size))
        return np.where(self._bears(stress), value, -np.inf)

    def right_dual(self, x: ArrayLike, u: ArrayLike) -> Floats:
        """``a (η_v - ε_v) + Ψ(η_v >= α|η_e| - (α - β)|e|) - Ψ(ε_v >= β|e|)``, (17)."""
        strain, other = _vectors("x", x), _vectors("u", u)
        (volume, e), (eta_v, eta_e) = _strain(strain), _strain(other)
        excess = self.friction - self.dilatancy
        lack = self.friction * length(eta_e) - excess * length(e) - eta_v
        size = (1 + self.friction) * (length(strain) + length(other))
        value = self.apex * (eta_v - volume) + indicator(within(lack, size))
        return np.where(self._dilates(strain), value, -np.inf)

    def prox_at(self, predictor: ArrayLike, x: ArrayLike, r: ArrayLike) -> Floats:
        """(44): the projection of ``σ̂ + r (α - β)|e| I/3`` onto the cone of the criterion.

        ``b(ε, ·)`` is linear in its domain, and ``I/3`` is the gradient of ``σ_m``.
        """
        stress, strain = _vectors("predictor", predictor), _vectors("x", x)
        _, e = _strain(strain)
        excess = self.friction - self.dilatancy
        pushed = positive_step(r) * excess * length(e) / 3
        mean, deviator = _stress(stress + pushed[..., None] * _UNIT)
        # |σ|² = 3 σ_m² + |s|²: in the variables √3 (a - σ_m), s the slope is α/√3.
        root = math.sqrt(3)
        height, radial = project_cone(
            root * (self.apex - mean), deviator, self.friction / root
        )
        return np.asarray(radial + (self.apex - height / root)[..., None] * _UNIT)
