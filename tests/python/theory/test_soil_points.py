"""The step of the points of a soil: textbook return mapping, inequality, duals."""

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import sparse

from bipot_rs.theory.points import PlasticPoints
from bipot_rs.theory.soils import DruckerPrager, mandel, tensor
from support.textbook import return_stress

Array = NDArray[np.float64]
N = 800
SOILS = {
    "frictional": DruckerPrager(0.8, 0.25, 1.0),
    "no dilatancy": DruckerPrager(0.6, 0.0, 0.5),
    "associated": DruckerPrager(0.5, 0.5, 2.0),
    "no cohesion": DruckerPrager(0.7, 0.3, 0.0),
}


# Volume strain and minus the deviator, in orthonormal components.
BASIS = np.linalg.qr(np.column_stack([np.r_[1.0, 1, 1, 0, 0, 0], np.eye(6)[:, 1:]]))[0]
X = np.vstack([[1.0, 1, 1, 0, 0, 0], -BASIS[:, 1:].T])


class Step:
    """A step of points of a soil, in tensors as vectors of `mandel`."""

    def __init__(
        self, soil: DruckerPrager, bulk: Array, shear: Array, start: Array
    ) -> None:
        m = len(start)
        self.soil, self.bulk, self.shear, self.start = soil, bulk, shear, start
        self.points = PlasticPoints(
            sparse.eye_array(6 * m),
            np.ones(m),
            np.column_stack([bulk, 2 * shear]),
            mu=soil.friction,
            dilatancy=soil.dilatancy,
            apex=soil.apex,
            components=X,
        )
        self.begin = self.points.from_tensors(start)

    def respond(self, strain: Array, limit: Array | None = None) -> tuple[Array, Array]:
        """Stress and plastic strain, of the law or with frozen limits."""
        end = self.points.respond(strain @ X.T, self.begin, frozen=limit)
        stress = self.points.to_tensors(end.stress, self.start)
        return stress, self.points.to_strain_tensors(end.flow)

    def limit(self, stress: Array) -> Array:
        return self.points.law.limit(self.points.from_tensors(stress))

    def separate(self, strain: Array, plastic: Array, stress: Array) -> Array:
        """``V0(ε - p) + W0(σ) + b(p, σ)``."""
        r = self.points.from_tensors(stress)
        value = self.points.bipotential(strain @ X.T, plastic @ X.T, r, self.begin)
        return value + np.sum(self.start * strain, axis=1)

    def bipotential(self, strain: Array, stress: Array) -> Array:
        """β, with the flow of the minimum."""
        _, p = self.respond(strain, self.limit(stress))
        return self.separate(strain, p, stress)

    def gap(self, strain: Array, plastic: Array, stress: Array) -> Array:
        r = self.points.from_tensors(stress)
        return self.points.gap(strain @ X.T, plastic @ X.T, r, self.begin)


def admissible(soil: DruckerPrager, stress: Array) -> Array:
    """Nearest stresses of the criterion; twice, as near the apex rounding is relative."""
    for _ in range(2):
        stress = soil.prox_at(stress, np.zeros_like(stress), 1.0)
    return stress


def drawn(soil: DruckerPrager) -> tuple[Step, Array]:
    """A step from random admissible stresses, and random strains."""
    rng = np.random.default_rng(5)
    start = admissible(soil, rng.normal(size=(N, 6)))
    step = Step(soil, rng.uniform(1, 3, N), rng.uniform(0.5, 2.0, N), start)
    return step, rng.normal(size=(N, 6))


@pytest.mark.parametrize("soil", SOILS.values(), ids=SOILS)
def test_stress_is_that_of_the_textbook(soil: DruckerPrager) -> None:
    step, strain = drawn(soil)
    stress, plastic = step.respond(strain)
    expected = [
        return_stress(soil, K, G, s, e)
        for K, G, s, e in zip(
            step.bulk, step.shear, tensor(step.start), tensor(strain), strict=True
        )
    ]
    # Rounding of stresses of the order of ten.
    assert stress == pytest.approx(mandel(np.array(expected)), abs=1e-13)
    # The rest of the strain is elastic.
    rest = strain - plastic
    volume = rest[:, :3].sum(axis=1)
    elastic = 2 * step.shear[:, None] * rest
    elastic[:, :3] += ((step.bulk - 2 * step.shear / 3) * volume)[:, None]
    assert stress - step.start == pytest.approx(elastic, abs=1e-13)
    # All three regimes are among them.
    flows = np.abs(plastic).max(axis=1) > 1e-12
    level = np.abs(stress[:, :3] - soil.apex).max(axis=1)
    assert min(flows.sum(), (~flows).sum(), (level < 1e-12).sum()) > 10
    assert (flows & (level > 0.1)).sum() > 100


@pytest.mark.parametrize("soil", SOILS.values(), ids=SOILS)
def test_gap_is_zero_on_the_law_and_positive_elsewhere(soil: DruckerPrager) -> None:
    step, strain = drawn(soil)
    stress, plastic = step.respond(strain)
    # Sums of a dozen rounded energies of the order of ten.
    law = step.gap(strain, plastic, stress)
    assert np.abs(law).max() < 5e-14
    rng = np.random.default_rng(6)
    for size in (1e-3, 1.0):
        other = stress + size * rng.normal(size=(N, 6))
        other = admissible(soil, other)
        gap = step.bipotential(strain, other) - np.sum(other * strain, axis=1)
        assert gap.min() > -5e-14
        # The gap is at least the energy of the difference, minimised over the flow. It is
        # zero only where the flow makes up for the difference, so the law holds.
        away = np.linalg.norm(other - stress, axis=1) > 0.1 * size
        assert (gap[away] > 1e-9 * size**2).all()


def convexity(poisson: float, rng: np.random.Generator) -> float:
    """Least second difference of ``β(ε, ·)`` on random segments, α = 0.9, β = 0."""
    soil = DruckerPrager(0.9, 0.0, 0.2)
    bulk = 2 * (1 + poisson) / (3 * (1 - 2 * poisson))  # G = 1
    ones = np.ones(4000)
    step = Step(soil, bulk * ones, ones, np.zeros((4000, 6)))
    strain = rng.normal(size=(4000, 6))
    ends = [admissible(soil, 3 * rng.normal(size=strain.shape)) for _ in range(2)]
    middle = admissible(soil, 0.5 * (ends[0] + ends[1]))
    values = [step.bipotential(strain, y) for y in (*ends, middle)]
    return float((values[0] + values[1] - 2 * values[2]).min())


def test_convex_in_the_stress_exactly_for_small_bulk_moduli() -> None:
    # K (α - β)² <= 2 G: with α = 0.9 up to ν = 0.32.
    rng = np.random.default_rng(10)
    assert convexity(0.3, rng) > -1e-12
    assert convexity(0.49, rng) < -0.1
