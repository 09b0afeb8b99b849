"""A step of elasticity with Drucker–Prager flow: the bipotential β(ε, σ) of (22) for a soil.

Over a step the strain increment ``ε`` is an elastic part ``ε - p`` and a plastic flow ``p``.
The flow obeys the law of `soils` with the stress ``σ`` at the end of the step: Moreau's
implicit integration (backward Euler), as for contact in section V of [dSF91]. With the
stress ``σ0`` at the start, and D the elastic stiffness,

    ``V0(e) = ½ e·D e + σ0·e``,    ``W0(σ) = ½ (σ - σ0)·D⁻¹(σ - σ0)``,
    ``β(ε, σ) = min over p of [ V0(ε - p) + b(p, σ) ] + W0(σ)``,

b the bipotential of the soil. ``β >= σ·ε``, with equality on the law, because
``V0(e) + W0(σ) - σ·e = ½ (e - D⁻¹(σ - σ0))·D (e - D⁻¹(σ - σ0))`` and ``b - σ·p`` are not
negative. β is convex in ``ε``. It is convex in ``σ`` if and only if
``K (α - β)² <= 2 G``, K and G the bulk and shear modulus; with ``p`` as an argument of its
own, ``V0(ε - p) + W0(σ) + b(p, σ)`` is convex in ``(ε, p)`` and in ``σ`` without a condition.

Strains and stresses are vectors of six components, as `soils.mandel` makes them.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bipot_rs._lib.types import Bools, Floats
from bipot_rs._lib.validation import floats
from bipot_rs.theory import materials
from bipot_rs.theory.convex import direction, dot, length
from bipot_rs.theory.soils import DruckerPrager

N = TypeVar("N", bound=np.generic)

# The unit tensor, and the projection on deviators.
_UNIT = np.array([1.0, 1.0, 1.0, 0.0, 0.0, 0.0])
_DEVIATOR = np.eye(6) - np.outer(_UNIT, _UNIT) / 3


class PointEnd(NamedTuple):
    """End of a step with a given strain.

    Attributes
    ----------
    stress, plastic
        Stress ``(..., 6)`` [Pa], and increment of plastic strain ``(..., 6)``.
    tangent
        Derivative of the stress with respect to the strain, ``(..., 6, 6)`` [Pa]. It is
        not symmetric where the flow is not associated. At a kink it belongs to one side.
    """

    stress: Floats
    plastic: Floats
    tangent: Floats


@dataclass(frozen=True, eq=False)
class ElastoplasticStep:
    """One step of an isotropic elastic soil with Drucker–Prager flow.

    Parameters
    ----------
    soil
        Criterion and flow.
    bulk, shear
        K and G, positive, numbers or ``(...)`` [Pa].
    start
        Stress at the start of the step, ``(..., 6)`` [Pa].

    Raises
    ------
    TypeError, ValueError
        A wrong argument.
    """

    soil: DruckerPrager
    bulk: Floats
    shear: Floats
    start: Floats

    def __init__(
        self,
        soil: DruckerPrager,
        bulk: ArrayLike,
        shear: ArrayLike,
        start: ArrayLike,
    ) -> None:
        if not isinstance(soil, DruckerPrager):
            raise TypeError(
                f"soil is a {type(soil).__name__}, expected a DruckerPrager"
            )
        stress = floats("start", start)
        if stress.ndim == 0 or stress.shape[-1] != 6:
            raise ValueError(f"start has shape {stress.shape}, expected (..., 6)")
        object.__setattr__(self, "soil", soil)
        object.__setattr__(self, "start", stress)
        for name, value in (("bulk", bulk), ("shear", shear)):
            modulus = floats(name, value)
            if (modulus <= 0).any():
                raise ValueError(f"{name} is {modulus.min():g}, expected > 0")
            object.__setattr__(self, name, np.broadcast_to(modulus, stress.shape[:-1]))

    def elastic(self, strain: Floats) -> Floats:
        """``D e``, ``(..., 6)`` [Pa]."""
        volume = strain @ _UNIT
        deviator = strain - volume[..., None] / 3 * _UNIT
        mean = self.bulk * volume
        return np.asarray(
            mean[..., None] * _UNIT + (2 * self.shear)[..., None] * deviator
        )

    def compliance(self, stress: Floats) -> Floats:
        """``D⁻¹ σ``, ``(..., 6)``."""
        mean = stress @ _UNIT / 3
        deviator = stress - mean[..., None] * _UNIT
        third = mean / (3 * self.bulk)
        return np.asarray(
            third[..., None] * _UNIT + deviator / (2 * self.shear)[..., None]
        )

    def energy(self, strain: Floats) -> Floats:
        """``V0(e) = ½ e·D e + σ0·e`` of an elastic strain [J/m³]."""
        return 0.5 * dot(strain, self.elastic(strain)) + dot(self.start, strain)

    def complementary_energy(self, stress: Floats) -> Floats:
        """``W0(σ) = ½ (σ - σ0)·D⁻¹(σ - σ0)`` [J/m³]."""
        change = stress - self.start
        return 0.5 * dot(change, self.compliance(change))

    def bipotential(self, x: ArrayLike, y: ArrayLike) -> Floats:
        """``β(ε, σ)`` [J/m³]; infinite if σ violates the criterion.

        The minimum over ``p`` is reached by the flow of `frozen`.
        """
        strain, stress = floats("x", x), floats("y", y)
        p = self.frozen(strain, self.limit(stress)).plastic
        return self.energy(strain - p) + self.split_bipotential(p, stress)

    def split_bipotential(self, plastic: Floats, stress: Floats) -> Floats:
        """``b(p, σ) + W0(σ)``: with ``V0(ε - p)`` it is β before the minimum over ``p``."""
        stored = self.complementary_energy(stress)
        return self.soil.bipotential(plastic, stress) + stored

    def left_dual(self, z: ArrayLike, y: ArrayLike) -> Floats:
        """``β_l*(σ̄, σ) = W0(σ̄) - W0(σ) + b_l*(σ̄, σ)``, (14).

        The conjugate of a minimum over ``p`` is the sum of the conjugates of its terms.
        """
        bar, stress = floats("z", z), floats("y", y)
        change = self.complementary_energy(bar) - self.complementary_energy(stress)
        return change + self.soil.left_dual(bar, stress)

    def gap(self, x: ArrayLike, plastic: ArrayLike, y: ArrayLike) -> Floats:
        """``V0(ε - p) + W0(σ) + b(p, σ) - σ·ε >= 0``, zero on the law only [J/m³].

        It is computed as the sum of the elastic energy of the error and of the gap
        ``b - σ·p`` of the soil, neither of which is negative; the difference of the
        energies would lose half of the digits. The least value over ``p`` is
        ``β(ε, σ) - σ·ε``.
        """
        strain, p, stress = floats("x", x), floats("plastic", plastic), floats("y", y)
        error = strain - p - self.compliance(stress - self.start)
        elastic = 0.5 * dot(error, self.elastic(error))
        return elastic + materials.gap(self.soil, p, stress)

    def limit(self, stress: Floats) -> Floats:
        """``c = (α - β)(a - σ_m)``: the part of ``‖s‖`` that `frozen` keeps constant [Pa]."""
        excess = self.soil.friction - self.soil.dilatancy
        depth = np.maximum(self.soil.apex - stress @ _UNIT / 3, 0.0)
        return np.asarray(excess * depth)

    def response(self, strain: Floats) -> PointEnd:
        """Stress and flow of the law, ``σ ∈ ∂_ε β(ε, σ)``, (22), at strains ``(..., 6)``."""
        return self._return_to_criterion(
            strain, self.soil.friction, np.zeros(self.bulk.shape)
        )

    def frozen(self, strain: Floats, limit: Floats) -> PointEnd:
        """Stress and flow of the explicit material with the potential ``β(·, σ')``, (38a).

        In β the stress ``σ'`` is present through ``c = limit(σ')`` only: the potential is
        that of associated flow with the criterion ``‖s‖ <= c + β (a - σ_m)``, ``σ_m <= a``.

        Parameters
        ----------
        strain
            ``(..., 6)``.
        limit
            c, not negative, ``(...)`` [Pa].
        """
        return self._return_to_criterion(strain, self.soil.dilatancy, limit)

    def _return_to_criterion(
        self, strain: Floats, slope: float, limit: Floats
    ) -> PointEnd:
        """Closed form of the step for ``‖s‖ <= c + slope (a - σ_m)``, ``σ_m <= a``.

        The elastic trial stress stays, returns to the cone, or to the cap ``σ_m = a``:
        with ``c = 0``, the apex.
        """
        soil, K, G = self.soil, self.bulk, self.shear
        trial = self.start + self.elastic(strain)
        mean = trial @ _UNIT / 3
        s = trial - mean[..., None] * _UNIT
        # The trace that rounding left is large for a small deviator.
        s = s - (s @ _UNIT / 3)[..., None] * _UNIT
        size, n = length(s), direction(s)
        over = size - limit - slope * (soil.apex - mean)
        hardness = 2 * G + slope * soil.dilatancy * K
        flow = np.maximum(over, 0.0) / hardness
        cap = mean - K * soil.dilatancy * flow > soil.apex
        cone = (over > 0) & ~cap
        # On the cap both parts of the flow follow from what the stress loses. There the
        # dilatancy is at least β, which rounding must not violate.
        shear = np.where(cap, np.maximum(size - limit, 0.0) / (2 * G), flow)
        least = soil.dilatancy * shear
        volume = np.where(cap, np.maximum((mean - soil.apex) / K, least), least)
        level = np.where(cap, soil.apex, mean - K * volume)
        # Not from the flow: near the apex the rounding of the trial stress would be large.
        bound = limit + slope * (soil.apex - level)
        kept = np.where(cap | cone, np.minimum(size, bound), size)
        stress = np.where(
            (cap | cone)[..., None],
            level[..., None] * _UNIT + kept[..., None] * n,
            trial,
        )
        plastic = shear[..., None] * n + volume[..., None] / 3 * _UNIT
        share = np.divide(kept, size, out=np.ones_like(size), where=size > 0)
        edge = cap & (size > limit)
        tangent = self._tangent(n, share, slope, cone, cap, edge)
        return PointEnd(stress, plastic, tangent)

    def _tangent(
        self,
        n: Floats,
        share: Floats,
        slope: float,
        cone: Bools,
        cap: Bools,
        edge: Bools,
    ) -> Floats:
        """Derivative of the stress of `_return_to_criterion`; ``share`` of ``‖s‖`` is kept."""
        K, G = _matrices(self.bulk), _matrices(self.shear)
        dilatancy = self.soil.dilatancy
        normal = n[..., :, None] * n[..., None, :]
        # The deviator turns with the trial deviator, and is shortened.
        across = _DEVIATOR - _matrices(cone | edge) * normal
        kept = _matrices(~cap) * K * np.outer(_UNIT, _UNIT)
        kept = kept + 2 * G * _matrices(share) * across
        # Along the normal of the cone the stress loses what its flow relaxes. Of this,
        # `across` has lost the part 2 G n n.
        down = 2 * G * n[..., :, None] + dilatancy * K * _UNIT[:, None]
        up = 2 * G * n[..., None, :] + slope * K * _UNIT
        lost = down * up / (2 * G + slope * dilatancy * K) - 2 * G * normal
        return np.asarray(kept - _matrices(cone) * lost)


def _matrices(values: NDArray[N]) -> NDArray[N]:
    """Numbers ``(...)`` as factors of matrices ``(..., 6, 6)``."""
    return values[..., None, None]
