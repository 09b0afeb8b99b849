"""Materials of [dSF91], sections II and IV: inequalities, duals, prox, Uzawa.

References are independent of the materials: pairs made on each law by cases, suprema and
minima by sampling, solutions by linear algebra.
"""

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray

import bipot_rs as bp
from bipot_rs.theory import convex, materials, soils
from support.law_pairs import (
    FORCE,
    LENGTH,
    RHO,
    energy_size,
    on_the_law,
    start_state,
    unit,
)
from support.random_problems import random_problem

Array = NDArray[np.float64]
Draw = Callable[[np.random.Generator], Array]
N = 600
# Energies are sums of a dozen rounded products.
ROUNDED = 2e-14


class Case(NamedTuple):
    """A material with N pairs on its law, and random points of its domain."""

    material: materials.Material
    x: Array
    y: Array
    strains: Draw
    stresses: Draw
    energy: Array
    strain: float
    stress: float


def elastic() -> Case:
    rng = np.random.default_rng(10)
    root = rng.normal(size=(6, 6))
    D = 2e11 * (root @ root.T + np.eye(6))
    x = 1e-4 * rng.normal(size=(N, 6))
    return Case(
        materials.LinearElastic(D),
        x,
        x @ D,
        lambda rng: 1e-4 * rng.normal(size=(N, 6)),
        lambda rng: 1e7 * rng.normal(size=(N, 6)),
        # The condition of D, below 100, multiplies the rounding of D⁻¹.
        np.full(N, 1e-4**2 * 1e13 * 100),
        1e-4,
        1e8,
    )


def contact(d: int, kind: str) -> Case:
    rng = np.random.default_rng(11)
    start = start_state(rng, N, d)
    pairs = on_the_law(rng, N, d)
    mu = 0 * pairs.mu if kind == "frictionless" else pairs.mu
    t, v = FORCE * pairs.t, LENGTH * pairs.v
    limit = mu * t[:, 0]
    if kind == "frictionless":
        t[:, 1:] = 0.0
    material: materials.Material
    if kind == "coulomb":
        material = materials.Coulomb(mu, start)
    elif kind == "frictionless":
        material = materials.frictionless(start)
    else:
        # An open contact with Tresca friction keeps its limit and rubs.
        limit = np.where(t[:, 0] > 0, limit, FORCE * 0.7)
        speed = np.linalg.norm(v[:, 1:], axis=1)
        rubs = (speed > 0) & (t[:, 0] == 0)
        t[rubs, 1:] = -v[rubs, 1:] * (limit[rubs] / speed[rubs])[:, None]
        material = materials.Tresca(limit, start)

    def strains(rng: np.random.Generator) -> Array:
        w = LENGTH * rng.normal(size=(N, d))
        w[:, 0] = np.abs(w[:, 0]) * (rng.random(N) < 0.7)
        return minus_increment(start, w)

    def stresses(rng: np.random.Generator) -> Array:
        s = FORCE * rng.exponential(size=(N, 1))
        s[rng.random(N) < 0.1] = 0.0
        most = limit[:, None] if kind == "tresca" else mu[:, None] * s
        share = np.minimum(rng.uniform(0, 1.3, (N, 1)), 1.0)
        s = np.hstack([s, most * share * unit(rng, N, d - 1)])
        return np.asarray(s - start.reaction)

    x, y = minus_increment(start, v), t - start.reaction
    law = materials.Coulomb(np.maximum(mu, limit / FORCE), start)
    # Includes the random points, of which one in 1e4 numbers exceeds ten.
    energy = energy_size(law, -x, y) + 40 * FORCE * LENGTH * (1 + law.mu)
    return Case(material, x, y, strains, stresses, energy, LENGTH, FORCE)


def minus_increment(start: materials.Start, v: Array) -> Array:
    """``x = -Δu`` that leads to gap and slip ``v``."""
    return np.asarray(-(v - np.outer(start.opening, np.eye(v.shape[1])[0])))


def volume_and_deviator(volume: Array, deviator: Array) -> Array:
    """Vectors of a trace and a traceless part, without the package's formulas."""
    return np.asarray(deviator + np.outer(volume / 3, [1, 1, 1, 0, 0, 0]))


def deviators(rng: np.random.Generator, n: int) -> Array:
    """Random traceless directions of length one."""
    m = rng.normal(size=(n, 6))
    m -= np.outer(m[:, :3].mean(axis=1), [1, 1, 1, 0, 0, 0])
    return np.asarray(m / np.linalg.norm(m, axis=1, keepdims=True))


def soil(alpha: float, beta: float, apex: float) -> Case:
    rng = np.random.default_rng(12)
    pa, strain = 1e5, 1e-3
    material = soils.DruckerPrager(alpha, beta, apex * pa)
    side, kind = deviators(rng, N), rng.integers(4, size=N)
    # Inside, on the surface with and without flow, at the apex.
    depth = pa * rng.uniform(0.2, 3, N) * (kind != 3)
    share = np.where(kind == 0, rng.uniform(0, 0.9, N), 1.0)
    y = volume_and_deviator(
        3 * (apex * pa - depth), (alpha * share * depth)[:, None] * side
    )
    e = strain * rng.uniform(0.2, 3, N) * np.isin(kind, (1, 3))
    volume = beta * e + strain * rng.exponential(size=N) * (kind == 3)
    x = volume_and_deviator(volume, e[:, None] * side)

    def strains(rng: np.random.Generator) -> Array:
        e = strain * rng.exponential(size=N)
        more = strain * rng.exponential(size=N) * (rng.random(N) < 0.7)
        return volume_and_deviator(beta * e + more, e[:, None] * deviators(rng, N))

    def stresses(rng: np.random.Generator) -> Array:
        depth = pa * rng.exponential(size=N) * (rng.random(N) < 0.9)
        share = np.minimum(rng.uniform(0, 1.3, N), 1.0)
        side = (alpha * share * depth)[:, None] * deviators(rng, N)
        return volume_and_deviator(3 * (apex * pa - depth), side)

    energy = np.full(N, 30 * (1 + alpha) * (1 + apex) * pa * strain)
    return Case(material, x, y, strains, stresses, energy, strain, pa)


CASES: dict[str, Callable[[], Case]] = {
    "elastic": elastic,
    **{
        f"{kind} {d}D": lambda d=d, kind=kind: contact(d, kind)
        for kind in ("coulomb", "tresca", "frictionless")
        for d in (2, 3)
    },
    "soil": lambda: soil(0.9, 0.3, 0.4),
    "soil without dilatancy": lambda: soil(0.9, 0.0, 0.4),
    "soil without cohesion": lambda: soil(1.4, 0.7, 0.0),
    "associated soil": lambda: soil(0.6, 0.6, 0.4),
}


@pytest.fixture(scope="module", params=CASES)
def case(request: pytest.FixtureRequest) -> Case:
    return CASES[request.param]()


def near(case: Case, rng: np.random.Generator) -> tuple[Array, Array]:
    """Pairs in the domain but off the law: a strain and a stress of different pairs."""
    return case.strains(rng), case.stresses(rng)


def test_equal_on_the_law(case: Case) -> None:
    gaps = materials.gap(case.material, case.x, case.y)
    assert np.all(np.abs(gaps) <= ROUNDED * case.energy)
    # The same for (13a) and (13b).
    for half in (materials.left_gap, materials.right_gap):
        gaps = half(case.material, case.x, case.y)
        assert np.all(np.abs(gaps) <= ROUNDED * case.energy)


def test_more_off_the_law(case: Case) -> None:
    """b > x·y for independent arguments, by far more than rounding."""
    rng = np.random.default_rng(20)
    for _ in range(5):
        x, y = near(case, rng)
        gaps = materials.gap(case.material, x, y)
        assert np.all(gaps >= -ROUNDED * case.energy)
        assert np.mean(gaps > 1e-4 * case.strain * case.stress) > 0.6
        # One argument of a pair on the law, and the other from another pair.
        for mixed in ((case.x, y), (x, case.y)):
            gaps = materials.gap(case.material, *mixed)
            assert np.all(gaps >= -ROUNDED * case.energy)


def test_halves_of_the_law_are_one(case: Case) -> None:
    """(13a) ⇔ (13b) ⇔ (8): the three gaps are equal, as b_l*(y, y) = b_r*(x, x) = 0."""
    rng = np.random.default_rng(21)
    x, y = near(case, rng)
    whole = materials.gap(case.material, x, y)
    for half in (materials.left_gap, materials.right_gap):
        halves = half(case.material, x, y)
        assert np.all(np.abs(halves - whole) <= ROUNDED * case.energy)


def test_convex_in_each_argument(case: Case) -> None:
    b = materials.implicit(case.material).bipotential
    rng = np.random.default_rng(22)
    for _ in range(5):
        (x, y), (x2, y2) = near(case, rng), near(case, rng)
        s = rng.uniform(size=(N, 1))
        ends = (1 - s[:, 0]) * b(x, y) + s[:, 0] * b(x2, y)
        assert np.isfinite(ends).all()
        assert np.all(b((1 - s) * x + s * x2, y) <= ends + ROUNDED * case.energy)
        ends = (1 - s[:, 0]) * b(x, y) + s[:, 0] * b(x, y2)
        assert np.all(b(x, (1 - s) * y + s * y2) <= ends + ROUNDED * case.energy)


def test_not_convex_in_both_together() -> None:
    """Friction is bilinear: what makes the material implicit."""
    case = contact(2, "coulomb")
    b = materials.implicit(case.material).bipotential
    rng = np.random.default_rng(23)
    (x, y), (x2, y2) = near(case, rng), near(case, rng)
    middle = b((x + x2) / 2, (y + y2) / 2)
    assert np.any(middle > (b(x, y) + b(x2, y2)) / 2 + 1e-3 * case.energy)


def test_outside_the_domain() -> None:
    """b is infinite, or a dual -infinite, where the other argument has no partner."""
    start = materials.Start([[1.0, 0.2]] * 5, np.zeros((5, 2)), np.full(5, 0.3))
    law = materials.Coulomb(0.5, start)
    # Penetration; tension; beyond the limit; admissible; on the boundary of both.
    du = np.array([[-0.4, 0], [0, 0], [0, 0], [0, 0.1], [-0.3, 0.1]])
    dt = np.array([[0, 0], [-1.1, -0.2], [0, 0.4], [0, 0], [0, 0.3]])
    np.testing.assert_array_equal(
        np.isfinite(law.bipotential(-du, dt)), [False, False, False, True, True]
    )
    np.testing.assert_array_equal(law.left_dual(dt, dt), [0, -np.inf, -np.inf, 0, 0])
    np.testing.assert_array_equal(law.right_dual(-du, -du), [-np.inf, 0, 0, 0, 0])
    assert np.all(materials.left_gap(law, -du, dt)[:3] == np.inf)
    assert np.all(materials.right_gap(law, -du, dt)[:3] == np.inf)
    # Without friction tension is still outside: (53) lacks t_n >= 0.
    smooth = materials.Coulomb(0.0, materials.Start.unloaded([0.0], 2))
    assert smooth.bipotential([[0.0, 0.0]], [[-1.0, 0.0]]) == np.inf
    assert smooth.bipotential([[0.0, 0.0]], [[1.0, 0.0]]) == 0.0


def test_printed_constant() -> None:
    """(54) without t_n⁰(u_n⁰ + h₀) is no bipotential; Legendre's transform has it.

    At μ = 0 (54) is separable, and its two parts are conjugate only with the constant.
    """
    rng = np.random.default_rng(25)
    start = start_state(rng, N, 3)
    law, explicit = materials.Coulomb(0.0, start), materials.frictionless(start)
    pairs = on_the_law(rng, N, 3)
    t = FORCE * pairs.t
    t[:, 1:] = 0.0
    x, y = minus_increment(start, LENGTH * pairs.v), t - start.reaction
    with_it = materials.gap(law, x, y)
    size = ROUNDED * energy_size(law, -x, y)
    assert np.all(np.abs(with_it) <= size)
    printed = with_it - start.product
    beside = np.abs(start.product) > 1e-3 * FORCE * LENGTH
    assert np.all(np.abs(printed)[beside] > size[beside])
    assert beside.mean() > 0.4
    separable = materials.Separable(explicit)
    difference = law.bipotential(x, y) - separable.bipotential(x, y)
    assert np.all(np.abs(difference) <= size)


def test_printed_left_dual_is_the_associated_law() -> None:
    """(62) as printed has the cone of the barred pair: (16) then lets slip lift a contact."""
    rng = np.random.default_rng(47)
    mu, t = 0.6, np.array([2.0, 1.2])
    start = materials.Start.unloaded([0.0], 2)
    law = materials.Coulomb(mu, start)
    slide, lift = np.array([0.0, -1.0]), np.array([mu, -1.0])
    around = rng.normal(size=(4000, 2)) + t
    printed = around[mu * around[:, 0] >= np.abs(around[:, 1])]
    right = np.array([z for z in around if law.left_dual([z], [t])[0] == 0])
    assert min(len(printed), len(right)) > 500
    # x = -Δu is normal at t to the set of finite values.
    assert ((right - t) @ -slide).max() <= 1e-12
    assert ((right - t) @ -lift).max() > 0.1
    assert ((printed - t) @ -slide).max() > 0.1
    assert ((printed - t) @ -lift).max() <= 1e-12


def test_frozen_coulomb_is_tresca() -> None:
    """b(·, y) is Tresca's V up to a constant, and both have the same solutions."""
    rng = np.random.default_rng(48)
    for d in (2, 3):
        pairs, start = on_the_law(rng, N, d), start_state(rng, N, d)
        law = materials.Coulomb(pairs.mu, start)
        x = minus_increment(start, LENGTH * pairs.v)
        y = FORCE * pairs.t - start.reaction
        frozen, size = law.frozen(y), ROUNDED * energy_size(law, -x, y)
        assert np.all(np.abs(materials.fenchel_gap(frozen, x, y)) <= size)
        other = LENGTH * rng.normal(size=(N, d))
        other[:, 0] = np.abs(other[:, 0])
        x2 = minus_increment(start, other)
        difference = law.bipotential(x2, y) - law.bipotential(x, y)
        same = frozen.energy(x2) - frozen.energy(x)
        assert np.all(
            np.abs(difference - same) <= 2 * size + ROUNDED * energy_size(law, -x2, y)
        )


# Suprema and minima by sampling. The functions whose indicators these are, are linear along
# rays. So samples of directions, up to a far end, show whether they are bounded.


def sampled(values: Array, ends: Array) -> tuple[NDArray[np.bool_], Array]:
    """Whether a supremum is finite, and its value near the vertex, from samples."""
    bounded = ends.max(axis=-1) <= 0
    return bounded, values.max(axis=-1)


@pytest.mark.parametrize("d", [2, 3])
@pytest.mark.slow_variants("3")
def test_duals_of_coulomb_are_the_suprema(d: int) -> None:
    rng = np.random.default_rng(30)
    n = 200
    start = start_state(rng, n, d)
    mu = rng.uniform(0.1, 1.5, n)
    law = materials.Coulomb(mu, start)
    around = np.array([[-1.0], [1.0]])
    if d == 3:
        turn = np.linspace(0, 2 * np.pi, 720, endpoint=False)
        around = np.stack([np.cos(turn), np.sin(turn)], axis=1)
    origin = np.zeros((1, d))
    # Gaps and slips up to 1: normal, tangential and in between.
    grid = [np.insert(s * around, 0, h, axis=1) for h in (0, 0.5, 1) for s in (0, 1)]
    ways = np.vstack([origin, *grid]) * LENGTH
    unit_cone = np.vstack(
        [origin, [[1.0, *np.zeros(d - 1)]], np.insert(around, 0, 1, axis=1)]
    )

    t = FORCE * np.abs(rng.normal(size=(n, 1)))
    dt = np.hstack([t, mu[:, None] * t * rng.random((n, 1)) * unit(rng, n, d - 1)])
    dt -= start.reaction
    w = LENGTH * rng.normal(size=(n, d))
    w[:, 0] = np.abs(w[:, 0])
    du = -minus_increment(start, w)
    z = FORCE * rng.normal(size=(n, d))
    z[:, 0] += FORCE
    z -= start.reaction
    other = LENGTH * rng.normal(size=(n, d))
    other[:, 0] += LENGTH
    dw = -minus_increment(start, other)
    left, right = law.left_dual(z, dt), law.right_dual(-du, -dw)
    finite = np.zeros((2, 2), int)
    for k in range(n):
        start_here = materials.Start(
            np.repeat(start.reaction[k : k + 1], len(ways), axis=0),
            np.repeat(start.displacement[k : k + 1], len(ways), axis=0),
            np.repeat(start.gap[k : k + 1], len(ways)),
        )
        each = materials.Coulomb(mu[k], start_here)
        terms = []
        for reach in (1.0, 3.0):
            x = minus_increment(start_here, reach * ways)
            b = each.bipotential(x, np.repeat(dt[k : k + 1], len(ways), axis=0))
            terms.append(x @ z[k] - b)
        # From the vertex on all is linear: a supremum is zero there or infinite.
        slope = (terms[1] - terms[0]) / 2
        size = energy_size(law, du, z)[k] + FORCE * LENGTH
        lack = abs(np.max(slope)) if np.any(slope > ROUNDED * size) else 0.0
        if lack == 0 or lack > 1e-4 * size:  # # directions in steps of half a degree
            finite[0, int(lack == 0)] += 1
            expected = np.inf if lack else terms[0].max()
            assert left[k] == pytest.approx(expected, abs=ROUNDED * size)

        cone = unit_cone * np.array([1, *[mu[k]] * (d - 1)]) * FORCE
        m = len(cone)
        start_here = materials.Start(
            np.repeat(start.reaction[k : k + 1], m, axis=0),
            np.repeat(start.displacement[k : k + 1], m, axis=0),
            np.repeat(start.gap[k : k + 1], m),
        )
        each = materials.Coulomb(mu[k], start_here)
        terms = []
        for reach in (1.0, 3.0):
            y = reach * cone - start_here.reaction
            b = each.bipotential(np.repeat(-du[k : k + 1], m, axis=0), y)
            terms.append(y @ -dw[k] - b)
        slope = (terms[1] - terms[0]) / 2
        size = energy_size(law, du, dt)[k] + energy_size(law, dw, dt)[k]
        size += FORCE * LENGTH
        lack = abs(np.max(slope)) if np.any(slope > ROUNDED * size) else 0.0
        if lack == 0 or lack > 1e-4 * size:
            finite[1, int(lack == 0)] += 1
            expected = np.inf if lack else terms[0].max()
            assert right[k] == pytest.approx(expected, abs=ROUNDED * size)
    assert finite.min() > 20
    assert finite.sum() > 1.9 * n


@pytest.mark.parametrize("beta", [0.0, 0.3, 0.9])
def test_duals_of_a_soil_are_the_suprema(beta: float) -> None:
    """In the plane of the given deviators, where the suprema are, and one direction outside."""
    rng = np.random.default_rng(31)
    alpha, apex, n = 0.9, 0.4, 100
    material = soils.DruckerPrager(alpha, beta, apex)
    turn = np.linspace(0, 2 * np.pi, 720, endpoint=False)
    finite = np.zeros((2, 2), int)
    for _ in range(n):
        e1, e2, e3 = np.linalg.qr(deviators(rng, 3).T)[0].T
        around = np.vstack(
            [np.outer(np.cos(turn), e1) + np.outer(np.sin(turn), e2), e3]
        )
        zero = np.zeros((1, 6))
        unit_volume = np.array([[1 / 3] * 3 + [0] * 3])
        strains = np.vstack([zero, unit_volume, around + beta * unit_volume])
        # From the apex along the axis and along the surface.
        stresses = np.vstack([zero, -3 * unit_volume, alpha * around - 3 * unit_volume])
        depth = rng.exponential()
        y = volume_and_deviator(
            np.array([3 * (apex - depth)]), alpha * depth * rng.random() * around[:1]
        )[0]
        p, q = rng.normal(size=2), rng.normal(size=(2, 2)) * 0.7
        z = volume_and_deviator(3 * p[:1], (q[:1] @ [e1, e2]))[0]
        e = rng.exponential()
        x = volume_and_deviator(
            np.array([beta * e + rng.exponential()]), e * around[360:361]
        )[0]
        u = volume_and_deviator(p[1:], q[1:] @ [e1, e2])[0]

        terms = [
            s * strains @ z - material.bipotential(s * strains, np.tile(y, (723, 1)))
            for s in (1.0, 3.0)
        ]
        expected = check_supremum(terms)
        if expected is not None:
            finite[0, int(np.isfinite(expected))] += 1
            dual = float(material.left_dual(z, y))
            assert dual == pytest.approx(expected, abs=1e-13)  # numbers up to ten

        top = np.array([apex] * 3 + [0] * 3)
        terms = [
            (s * stresses + top) @ u
            - material.bipotential(np.tile(x, (723, 1)), s * stresses + top)
            for s in (1.0, 3.0)
        ]
        expected = check_supremum(terms)
        if expected is not None:
            finite[1, int(np.isfinite(expected))] += 1
            dual = float(material.right_dual(x, u))
            assert dual == pytest.approx(expected, abs=1e-13)
    assert finite.min() > 10


def check_supremum(terms: list[Array]) -> float | None:
    """From values at one and three times the distance; None if too close to decide."""
    slope = (terms[1] - terms[0]) / 2
    if slope.max() <= 1e-13:
        return float(terms[0].max())
    return math.inf if slope.max() > 1e-4 else None


def test_potentials_of_tresca_are_conjugate() -> None:
    """W is the supremum of x·y - V over sampled gaps and slips."""
    rng = np.random.default_rng(32)
    n = 300
    start = start_state(rng, n, 2)
    limit = FORCE * rng.exponential(size=n)
    law = materials.Tresca(limit, start)
    y = FORCE * rng.normal(size=(n, 2)) - start.reaction
    energies = law.complementary_energy(y)
    ways = [(0, 0), (0, 1), (0, -1), (1, 0)]
    terms = np.array(
        [
            [
                (x * y).sum(axis=1) - law.energy(x)
                for way in ways
                for x in [minus_increment(start, np.tile(way, (n, 1)) * s * LENGTH)]
            ]
            for s in (1.0, 3.0)
        ]
    )
    size = energy_size(materials.Coulomb(limit / FORCE, start), y / RHO, y)
    rises = ((terms[1] - terms[0]) > ROUNDED * size).any(axis=0)
    np.testing.assert_array_equal(np.isposinf(energies), rises)
    kept = ~rises
    assert 50 < kept.sum() < n - 50
    error = np.abs(energies - terms[0].max(axis=0))[kept]
    assert np.all(error <= ROUNDED * size[kept])


def test_left_dual_is_a_plastic_potential() -> None:
    """The set of σ̄ of a soil's left dual: inside, the plastic potential is not larger."""
    rng = np.random.default_rng(33)
    case = soil(0.9, 0.3, 0.4)
    law = case.material
    assert isinstance(law, soils.DruckerPrager)
    at_limit = np.abs(law.criterion(case.y)) <= 1e-12 * case.stress
    z, y = case.stresses(rng)[at_limit], case.y[at_limit]
    excess = law.plastic_potential(z) - law.plastic_potential(y)
    clear = np.abs(excess) > 1e-9 * case.stress
    inside = law.left_dual(z, y) == 0
    np.testing.assert_array_equal(inside[clear], (excess <= 0)[clear])
    assert 0.2 < inside.mean() < 0.9
    # All of them also satisfy the yield criterion, which is another surface.
    assert law.criterion(z).max() <= 1e-12 * case.stress


def test_flow_is_the_gradient_of_the_potential() -> None:
    rng = np.random.default_rng(34)
    law = soils.DruckerPrager(0.9, 0.3, 0.4)
    y = rng.normal(size=(100, 6))
    h = 1e-6
    steps = h * np.eye(6)
    numeric = np.stack(
        [
            (law.plastic_potential(y + s) - law.plastic_potential(y - s)) / (2 * h)
            for s in steps
        ],
        axis=1,
    )
    # Central differences: h² times third derivatives, and rounding over h.
    np.testing.assert_allclose(law.flow(y), numeric, atol=1e-8)
    associated = soils.DruckerPrager(0.9, 0.9, 0.4)
    numeric = np.stack(
        [
            (associated.criterion(y + s) - associated.criterion(y - s)) / (2 * h)
            for s in steps
        ],
        axis=1,
    )
    np.testing.assert_allclose(associated.flow(y), numeric, atol=1e-8)
    assert associated.associated
    assert not law.associated


def test_associated_soil_is_separable() -> None:
    """b(x, y) + b(x', y') = b(x, y') + b(x', y) for β = α only."""
    rng = np.random.default_rng(35)
    for beta, separable in ((0.6, True), (0.3, False)):
        case = soil(0.6, beta, 0.4)
        b = materials.implicit(case.material).bipotential
        (x, y), (x2, y2) = near(case, rng), near(case, rng)
        mixed = b(x, y) + b(x2, y2) - b(x, y2) - b(x2, y)
        if separable:
            assert np.all(np.abs(mixed) <= ROUNDED * case.energy)
        else:
            assert np.abs(mixed).max() > 1e-2 * case.strain * case.stress


def test_soil_without_dilatancy_is_friction() -> None:
    """β = 0, a = 0: Coulomb's bipotential of (-σ_m, s) and (ε_v, -e), with equal numbers."""
    rng = np.random.default_rng(36)
    alpha = 0.7
    friction = materials.Coulomb(alpha, materials.Start.unloaded(np.zeros(N), 3))
    dry = soils.DruckerPrager(alpha, 0.0, 0.0)
    side, other = np.linalg.qr(deviators(rng, 2).T)[0].T
    du, dt = rng.normal(size=(2, N, 3))
    du[:, 0] = np.abs(du[:, 0]) * (rng.random(N) < 0.8)
    dt[rng.random(N) < 0.7, 1:] *= 0.3
    plane = np.array([side, other])
    x = volume_and_deviator(du[:, 0], -du[:, 1:] @ plane)
    y = volume_and_deviator(-3 * dt[:, 0], dt[:, 1:] @ plane)
    ours, theirs = dry.bipotential(x, y), friction.bipotential(-du, dt)
    np.testing.assert_array_equal(np.isfinite(ours), np.isfinite(theirs))
    inside = np.isfinite(ours)
    assert 100 < inside.sum() < N - 100
    # Products of numbers up to ten.
    np.testing.assert_allclose(ours[inside], theirs[inside], atol=1e-13)


def test_prox_is_the_minimum(case: Case) -> None:
    """(44) at samples: r b(x, y') + ½|y' - ŷ|² is larger by at least ½|y' - y|²."""
    material = materials.implicit(case.material)
    rng = np.random.default_rng(40)
    r = case.stress / case.strain
    x = case.strains(rng)
    predictor = case.stresses(rng) + case.stress * rng.normal(size=case.y.shape)
    y = material.prox_at(predictor, x, r)

    def value(y: Array) -> Array:
        return r * material.bipotential(x, y) + 0.5 * ((y - predictor) ** 2).sum(axis=1)

    best = value(y)
    assert np.isfinite(best).all()
    scale = r * case.energy + (predictor**2).sum(axis=1) + (y**2).sum(axis=1)
    slack = ROUNDED * scale
    samples = [case.stresses(rng) for _ in range(10)]
    # Includes near points, on the way to points of the domain.
    samples += [y + s * (z - y) for s in (1e-1, 1e-3) for z in samples[:5]]
    for z in samples:
        margin = 0.5 * ((z - y) ** 2).sum(axis=1)
        assert np.all(value(z) >= best + margin - slack)


def test_prox_has_pairs_on_the_law_as_fixed_points(case: Case) -> None:
    """(40), (44): y = prox(y + r x, r b(x, ·)) exactly for pairs on the law."""
    material = materials.implicit(case.material)
    rng = np.random.default_rng(41)
    for r in np.array([0.1, 1.0, 10.0]) * case.stress / case.strain:
        back = material.prox_at(case.y + r * case.x, case.x, r)
        size = np.sqrt(r * case.energy) + np.linalg.norm(case.y + r * case.x, axis=1)
        start = getattr(case.material, "start", None)
        if start is not None:
            size += np.linalg.norm(start.reaction, axis=1)
        assert np.all(np.linalg.norm(back - case.y, axis=1) <= 1e-13 * size)
        x, y = near(case, rng)
        moved = np.linalg.norm(material.prox_at(y + r * x, x, r) - y, axis=1)
        far = materials.gap(case.material, x, y) > 1e-2 * case.strain * case.stress
        assert far.sum() > 100
        assert np.all(moved[far] > 1e-6 * case.stress)


@pytest.mark.parametrize("kind", ["coulomb", "tresca"])
def test_units_have_no_effect(kind: str) -> None:
    """Powers of two as units: the same bits, and the same boundaries of the domain."""
    case, force, metre = contact(3, kind), 2.0**50, 2.0**-37
    rng = np.random.default_rng(49)
    any_x, any_y = near(case, rng)
    z, u = FORCE * rng.normal(size=(2, N, 3)) * [[[1.0]], [[LENGTH / FORCE]]]
    law = case.material
    assert isinstance(law, (materials.Coulomb, materials.Tresca))
    start = materials.Start(
        force * law.start.reaction,
        metre * law.start.displacement,
        metre * law.start.gap,
    )
    other: materials.Material
    if isinstance(law, materials.Coulomb):
        other = materials.Coulomb(law.mu, start)
    else:
        other = materials.Tresca(force * law.limit, start)
    law_of_ours, two = materials.implicit(law), materials.implicit(other)
    pairs = (case.x, case.y), (any_x, any_y), (u, z), (case.x, z), (u, case.y)
    for x, y in pairs:
        np.testing.assert_array_equal(
            two.bipotential(metre * x, force * y),
            force * metre * law_of_ours.bipotential(x, y),
        )
        np.testing.assert_array_equal(
            two.left_dual(force * z, force * y),
            force * metre * law_of_ours.left_dual(z, y),
        )
        np.testing.assert_array_equal(
            two.right_dual(metre * x, metre * u),
            force * metre * law_of_ours.right_dual(x, u),
        )
        np.testing.assert_array_equal(
            two.prox_at(force * y, metre * x, RHO * force / metre),
            force * law_of_ours.prox_at(y, x, RHO),
        )


def test_units_have_no_effect_on_soil() -> None:
    case, pascal, strain = soil(0.9, 0.3, 0.4), 2.0**40, 2.0**-21
    law = case.material
    assert isinstance(law, soils.DruckerPrager)
    other = soils.DruckerPrager(law.friction, law.dilatancy, pascal * law.apex)
    rng = np.random.default_rng(49)
    z, u = rng.normal(size=(2, N, 6)) * [[[case.stress]], [[case.strain]]]
    for x, y in ((case.x, case.y), near(case, rng), (u, z)):
        np.testing.assert_array_equal(
            other.bipotential(strain * x, pascal * y),
            strain * pascal * law.bipotential(x, y),
        )
        np.testing.assert_array_equal(
            other.left_dual(pascal * z, pascal * y), law.left_dual(z, y)
        )
        np.testing.assert_array_equal(
            other.right_dual(strain * x, strain * u),
            strain * pascal * law.right_dual(x, u),
        )
        np.testing.assert_array_equal(
            other.prox_at(pascal * y, strain * x, 1e8 * pascal / strain),
            pascal * law.prox_at(y, x, 1e8),
        )


def test_prox_of_the_conjugate() -> None:
    """Moreau: shrinkage from the disc, V of elasticity from W; and the projection itself."""
    rng = np.random.default_rng(42)
    x = rng.normal(size=(200, 3))
    for r in (0.2, 1.0, 3.0):
        # |·| is the conjugate of the indicator of the unit ball, whose prox does not depend on r.
        prox = convex.conjugate_prox(
            lambda y, _: convex.project_ball(y, np.ones(len(y))), x, r
        )
        np.testing.assert_allclose(prox, convex.shrink(x, np.full(200, r)), atol=1e-15)
        # The nearest vector that is shorter by r, from samples.
        size = np.linalg.norm(prox - x, axis=1) ** 2 / 2 + r * np.linalg.norm(
            prox, axis=1
        )
        for _ in range(20):
            z = prox + rng.normal(size=x.shape) * 10 ** rng.uniform(-4, 0)
            other = np.linalg.norm(z - x, axis=1) ** 2 / 2 + r * np.linalg.norm(
                z, axis=1
            )
            assert np.all(other >= size - 1e-14)
    D = np.diag([1.0, 4.0, 9.0])
    body = materials.LinearElastic(D)
    prox = convex.conjugate_prox(body.prox, x, 0.5)
    # prox of r V: (I + r D) y = x.
    np.testing.assert_allclose(prox, x / (1 + 0.5 * np.diag(D)), rtol=1e-14)


def test_cone_in_five_dimensions() -> None:
    """The projection of (12) with a radial part of any dimension, by its conditions."""
    rng = np.random.default_rng(43)
    height, radial = rng.normal(size=500), rng.normal(size=(500, 5))
    slope = rng.uniform(0, 2, 500)
    up, out = convex.project_cone(height, radial, slope)
    size = np.hypot(height, np.linalg.norm(radial, axis=1)) * 1e-14
    assert np.all(np.linalg.norm(out, axis=1) <= slope * up + size * (1 + slope))
    left, beside = height - up, radial - out
    # The remainder is in the polar cone and orthogonal.
    assert np.all(slope * np.linalg.norm(beside, axis=1) <= -left + size * (1 + slope))
    assert np.all(np.abs(left * up + (beside * out).sum(axis=1)) <= size)


def test_fenchel_gap_is_an_error_in_energy() -> None:
    """For elasticity: ½ (x - D⁻¹y)·D (x - D⁻¹y)."""
    rng = np.random.default_rng(44)
    D = np.array([[3.0, 1.0], [1.0, 2.0]])
    body = materials.LinearElastic(D)
    x, y = rng.normal(size=(2, 50, 2))
    miss = x - y @ np.linalg.inv(D)
    expected = 0.5 * np.einsum("ni,ij,nj->n", miss, D, miss)
    np.testing.assert_allclose(materials.fenchel_gap(body, x, y), expected, atol=1e-14)
    np.testing.assert_allclose(body.stress(x), x @ D, atol=1e-14)
    np.testing.assert_allclose(body.strain(body.stress(x)), x, atol=1e-14)


def structure(W: Array, q: Array, start: materials.Start) -> Callable[[Array], Array]:
    """``Δt ↦ -Δu`` of a body with ``v = W t + q``, from the start state."""
    free = (W @ start.reaction.ravel()).reshape(q.shape) + q
    free[:, 0] -= start.opening
    return materials.elastic_strain(W, free)


@pytest.mark.parametrize("d", [2, 3])
@pytest.mark.parametrize("kind", ["held", "graded", "frictionless"])
@pytest.mark.slow_variants("*-3", "*held*")
def test_uzawa_has_the_solution_as_fixed_point(kind: str, d: int) -> None:
    """(45), (46) with (54), from any start state: the fixed point is the solver's reactions."""
    for seed in range(3):
        random_data = random_problem(kind, d, seed)
        W, q, mu = random_data.W, random_data.q, random_data.mu
        answer = random_data.problem().solve(tol=1e-14)
        rng = np.random.default_rng([51, seed])
        start = start_state(rng, len(q), d)
        size = np.linalg.norm(answer.reaction) or 1.0
        start = materials.Start(
            start.reaction / FORCE * size, start.displacement, start.gap
        )
        law = materials.Coulomb(mu, start)
        stiff = d / np.diag(W).reshape(q.shape).sum(axis=1)
        # Scaled as in the package; friction adds μ to the slope of r ↦ ṽ.
        root = np.sqrt(np.repeat(stiff, d))
        top = np.linalg.eigvalsh(root[:, None] * W * root)[-1]
        r = stiff / (top * (1 + mu.max()))
        iterates = materials.uzawa(
            law, structure(W, q, start), np.zeros(q.shape), r, 600
        )
        end = iterates[-1] + start.reaction
        # Linear convergence: after 600 steps only rounding of both is left.
        assert np.linalg.norm(end - answer.reaction) <= 1e-9 * size


@pytest.mark.parametrize("kind", ["coulomb", "tresca"])
@pytest.mark.quick_variants("tresca")
def test_uzawa_contracts(kind: str) -> None:
    """By max|1 - r λ(W)| for an explicit material, with r μ|W_t| added for Coulomb's."""
    rng = np.random.default_rng(55)
    n, d = 5, 3
    for _ in range(10):
        root = rng.normal(size=(n * d, n * d))
        W = np.eye(n * d) + 0.1 * root @ root.T / n
        q = rng.normal(size=(n, d)) - [1.0, 0, 0]
        values = np.linalg.eigvalsh(W)
        tangents = np.linalg.norm(np.delete(W, np.arange(n) * d, axis=0), 2)
        mu = 0.5 * values[0] / tangents
        r = 2 / (values[0] + values[-1])
        factor = np.abs(1 - r * values).max()
        start = start_state(rng, n, d)
        start = materials.Start(start.reaction / FORCE, start.displacement, start.gap)
        material: materials.Material = materials.Tresca(rng.exponential(size=n), start)
        if kind == "coulomb":
            material = materials.Coulomb(mu, start)
            factor += r * mu * tangents
        assert factor < 1
        iterates = materials.uzawa(
            material, structure(W, q, start), np.zeros((n, d)), r, 400
        )
        error = np.linalg.norm(iterates - iterates[-1], axis=(1, 2))
        seen = error > 1e-9 * error[0]
        ratio = error[1:][seen[1:]] / error[:-1][seen[1:]]
        # The last iterate replaces the solution; its error is 1e-6 of the errors compared.
        assert ratio.max() <= factor * (1 + 1e-5)
        assert error[8] <= factor**8 * error[0] * (1 + 1e-4)


@pytest.mark.parametrize("d", [2, 3])
def test_uzawa_is_the_method_of_the_package(d: int) -> None:
    """While its rule keeps ρ, `method="uzawa"` computes exactly these iterates."""
    n = 4
    rng = np.random.default_rng(52)
    root = rng.normal(size=(n * d, n * d))
    W = np.eye(n * d) + 0.03 * (root + root.T)
    grade = np.repeat(10 ** rng.uniform(-2, 2, n), d)
    W *= np.outer(grade, grade)
    q = rng.normal(size=(n, d))
    q[:, 0] -= 1.0
    q *= grade.reshape(n, d)
    problem = bp.ReducedProblem(W, q, 0.2)
    start = materials.Start.unloaded(np.zeros(n), d)
    stiff = d / np.diag(W).reshape(n, d).sum(axis=1)

    def ratio(r: Array, s: Array) -> float:
        """Change of ṽ relative to that of r, which sets ρ of its rule, in scaled variables."""
        tilde = [(W @ x.ravel()).reshape(n, d) + q for x in (r, s)]
        for v in tilde:
            v[:, 0] += 0.2 * np.linalg.norm(v[:, 1:], axis=1)
        dv = (tilde[1] - tilde[0]) * np.sqrt(stiff)[:, None]
        return float(
            np.linalg.norm(dv) / np.linalg.norm((s - r) / np.sqrt(stiff)[:, None])
        )

    # It starts at 1; a step above 0.9 is cut to 2/3 of the value that the ratio allows.
    law, strain = materials.Coulomb(0.2, start), structure(W, q, start)
    trial = materials.uzawa(law, strain, np.zeros((n, d)), stiff, 1)[1]
    first = ratio(np.zeros((n, d)), trial)
    rho = 1.0 if first <= 0.9 else 2 / 3 * min(1 / first, 1.0)
    iterates = materials.uzawa(law, strain, np.zeros((n, d)), rho * stiff, 12)
    for k in range(1, 12):
        # The rule does not change rho in this problem.
        assert 0.3 < rho * ratio(iterates[k], iterates[k + 1]) < 0.9
        same = problem.solve("uzawa", tol=1e-15, max_iterations=k)
        assert same.iterations == k
        size = np.abs(iterates[k] * grade.reshape(n, d)).max()
        error = np.abs((same.reaction - iterates[k]) * grade.reshape(n, d)).max()
        # A dozen products with W, rounded in another order.
        assert error <= 1e-13 * size
    answer = problem.solve(tol=1e-14)
    long = materials.uzawa(law, strain, np.zeros((n, d)), rho * stiff, 200)[-1]
    np.testing.assert_allclose(
        long, answer.reaction, rtol=0, atol=1e-11 * np.abs(long).max()
    )


@pytest.mark.parametrize("beta", [0.0, 0.25, 0.8])
def test_uzawa_returns_a_soil_to_its_criterion(beta: float) -> None:
    """One implicit step of elastoplasticity equals its closed form, including the apex."""
    rng = np.random.default_rng(53)
    K, G, alpha, apex = 2.0, 1.3, 0.8, 0.3
    law = soils.DruckerPrager(alpha, beta, apex)
    n = 300
    side, mean = deviators(rng, n), rng.normal(size=n)
    trial = volume_and_deviator(3 * mean, rng.exponential(size=n)[:, None] * side)

    def plastic(y: Array) -> Array:
        """The inelastic part of the strain: C⁻¹(σ_trial - σ)."""
        lost = trial - y
        volume = lost[:, :3].sum(axis=1)
        rest = lost - np.outer(volume / 3, [1, 1, 1, 0, 0, 0])
        return volume_and_deviator(volume / (3 * K), rest / (2 * G))

    stresses = materials.uzawa(law, plastic, trial, 2 * G, 300)[-1]

    s = np.linalg.norm(trial - np.outer(mean, [1, 1, 1, 0, 0, 0]), axis=1)
    over = s - alpha * (apex - mean)
    flow = np.maximum(over, 0) / (2 * G + alpha * beta * K)
    left = s - 2 * G * flow
    at_apex = (over > 0) & (left < 0)
    # Elastic, or back along the gradient of the plastic potential, or at the apex.
    expected = volume_and_deviator(3 * (mean - K * beta * flow), left[:, None] * side)
    expected[at_apex] = [apex] * 3 + [0] * 3
    # I - 2G C⁻¹ has the eigenvalues 0 and 1 - 2G/3K, and friction adds less.
    np.testing.assert_allclose(stresses, expected, atol=1e-12)
    assert min((over <= 0).sum(), at_apex.sum(), ((over > 0) & ~at_apex).sum()) > 20
    # On the law of the soil, by its own gap; at the apex the strain is the remainder.
    strain = volume_and_deviator(beta * flow, flow[:, None] * side)
    strain[at_apex] = plastic(expected)[at_apex]
    assert np.abs(materials.gap(law, strain, expected)).max() <= 1e-13


def test_soil_from_angles_meets_the_compressive_edge() -> None:
    """Mohr and Coulomb's strength in triaxial compression, from sheets of soil mechanics."""
    c, phi, psi = 5e3, math.radians(32), math.radians(8)
    law = soils.DruckerPrager.from_angles(c, phi, psi)
    for cell in (0.0, 1e4, 3e5):
        factor = math.tan(math.pi / 4 + phi / 2)
        axial = cell * factor**2 + 2 * c * factor
        y = soils.mandel(-np.diag([axial, cell, cell]))
        assert abs(float(law.criterion(y))) <= 1e-12 * axial
    assert law.apex == pytest.approx(c / math.tan(phi), rel=1e-15)
    # Bolton's check of dilatancy: -dε_v/dε_1 = 2 sin ψ/(1 - sin ψ) in compression.
    flow = soils.tensor(law.flow(y))
    dilation = np.trace(flow) / -flow[0, 0]
    expected = 2 * math.sin(psi) / (1 - math.sin(psi))
    assert dilation == pytest.approx(expected, rel=1e-12)
    both = soils.DruckerPrager.from_angles(c, phi, phi)
    assert both.associated


def test_tensors_as_vectors() -> None:
    rng = np.random.default_rng(54)
    a, b = (m + m.swapaxes(1, 2) for m in rng.normal(size=(2, 20, 3, 3)))
    np.testing.assert_allclose(soils.tensor(soils.mandel(a)), a, rtol=1e-15)
    work = np.einsum("nij,nij->n", a, b)
    np.testing.assert_allclose(
        (soils.mandel(a) * soils.mandel(b)).sum(axis=1), work, atol=1e-13
    )
    law = soils.DruckerPrager(0.5, 0.1, 0.2)
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    np.testing.assert_allclose(
        law.criterion(soils.mandel(turn @ a @ turn.T)),
        law.criterion(soils.mandel(a)),
        atol=1e-13,
    )


MISTAKES: dict[str, tuple[Callable[[], Any], str]] = {
    "limit": (
        lambda: materials.Tresca(-1.0, materials.Start.unloaded([0.0], 2)),
        r"limit of contact 0 is -1.0, expected zero or positive",
    ),
    "limit shape": (
        lambda: materials.Tresca([1.0, 2.0], materials.Start.unloaded([0.0], 2)),
        r"limit has shape \(2,\), expected a number or \(1,\)",
    ),
    "mu": (
        lambda: materials.Coulomb(-0.1, materials.Start.unloaded([0.0], 2)),
        r"mu of contact 0 is -0.1",
    ),
    "reaction": (
        lambda: materials.Start(np.zeros((2, 4)), np.zeros((2, 4)), np.zeros(2)),
        r"reaction has shape \(2, 4\), expected \(n_c, 2\) or \(n_c, 3\)",
    ),
    "displacement": (
        lambda: materials.Start(np.zeros((2, 3)), np.zeros((2, 2)), np.zeros(2)),
        r"displacement has shape \(2, 2\), expected \(2, 3\)",
    ),
    "gap": (
        lambda: materials.Start(np.zeros((2, 3)), np.zeros((2, 3)), [0.0, np.inf]),
        r"gap is inf at 1, expected finite",
    ),
    "x": (
        lambda: materials.Coulomb(0.1, materials.Start.unloaded([0.0], 2)).bipotential(
            np.zeros((1, 3)), np.zeros((1, 2))
        ),
        r"x has shape \(1, 3\), expected \(1, 2\)",
    ),
    "stiffness": (
        lambda: materials.LinearElastic([[1.0, 2.0], [2.0, 1.0]]),
        r"stiffness has the eigenvalue -1.0.*, expected a positive definite",
    ),
    "asymmetric": (
        lambda: materials.LinearElastic([[1.0, 0.1], [0.0, 1.0]]),
        "stiffness is not symmetric",
    ),
    "not square": (
        lambda: materials.LinearElastic([[1.0, 0.1]]),
        r"stiffness has shape \(1, 2\), expected a square matrix",
    ),
    "strain": (
        lambda: materials.LinearElastic(np.eye(2)).energy([1.0, 2.0, 3.0]),
        r"x has shape \(3,\), expected \(\.\.\., 2\)",
    ),
    "r": (
        lambda: materials.uzawa(
            materials.LinearElastic(np.eye(2)), lambda y: -y, [0.0, 0.0], 0.0, 1
        ),
        r"r is 0.0, expected positive numbers",
    ),
    "another shape": (
        lambda: materials.uzawa(
            materials.LinearElastic(np.eye(2)),
            lambda _: np.zeros(3),
            [0.0, 0.0],
            1.0,
            1,
        ),
        r"strain\(y\) has shape \(3,\), expected \(2,\)",
    ),
    "runs away": (
        lambda: materials.uzawa(
            materials.LinearElastic(np.eye(1)), lambda y: y + np.inf, [1.0], 1.0, 9
        ),
        r"strain\(y\) is .*inf at 0, expected finite numbers",
    ),
    "iterations": (
        lambda: materials.uzawa(
            materials.LinearElastic(np.eye(2)), lambda y: -y, [0.0, 0.0], 1.0, 0
        ),
        "iterations is 0, expected 1 or more",
    ),
    "compliance": (
        lambda: materials.elastic_strain(np.eye(3), np.zeros((2, 2))),
        r"compliance has shape \(3, 3\), expected \(4, 4\)",
    ),
    "friction": (
        lambda: soils.DruckerPrager(0.0, 0.0, 1.0),
        r"friction is 0.0, expected a positive number",
    ),
    "dilatancy": (
        lambda: soils.DruckerPrager(0.3, 0.4, 1.0),
        r"dilatancy is 0.4, expected 0 to 0.3, the friction: outside this range the law has no",
    ),
    "contraction": (
        lambda: soils.DruckerPrager(0.3, -0.1, 1.0),
        r"dilatancy is -0.1, expected 0 to 0.3",
    ),
    "apex": (
        lambda: soils.DruckerPrager(0.3, 0.1, -1.0),
        r"apex is -1.0, expected zero or positive",
    ),
    "angle": (
        lambda: soils.DruckerPrager.from_angles(1.0, 2.0, 0.1),
        r"friction_angle is 2.0, expected above 0, below pi/2",
    ),
    "dilatancy angle": (
        lambda: soils.DruckerPrager.from_angles(1.0, 0.5, 0.6),
        r"dilatancy_angle is 0.6, expected 0 to 0.5",
    ),
    "cohesion": (
        lambda: soils.DruckerPrager.from_angles(-1.0, 0.5, 0.1),
        r"cohesion is -1.0, expected zero or positive",
    ),
    "stress": (
        lambda: soils.DruckerPrager(0.3, 0.1, 1.0).criterion([1.0, 2.0]),
        r"y has shape \(2,\), expected \(\.\.\., 6\)",
    ),
    "tensor": (
        lambda: soils.mandel(np.eye(2)),
        r"tensor has shape \(2, 2\), expected \(\.\.\., 3, 3\)",
    ),
}


@pytest.mark.parametrize("name", MISTAKES)
def test_mistakes_are_named(name: str) -> None:
    call, expected_text = MISTAKES[name]
    with pytest.raises(ValueError, match=expected_text):
        call()
