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

from bipot_rs.theory import convex, materials, soils
from support.law_pairs import (
    FORCE,
    LENGTH,
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
    # (8), (13a) and (13b).
    for gap in (materials.gap, materials.left_gap, materials.right_gap):
        gaps = gap(case.material, case.x, case.y)
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
    """(54) without t_n⁰(u_n⁰ + h₀) is no bipotential; Legendre's transform has it, μ = 0."""
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
    separable = materials.Separable(explicit).bipotential(x, y)
    assert np.all(np.abs(law.bipotential(x, y) - separable) <= size)


def test_printed_left_dual_is_the_associated_law() -> None:
    """(62) as printed has the cone of the barred pair: (16) then lets slip lift a contact."""
    rng = np.random.default_rng(47)
    mu, t = 0.6, np.array([2.0, 1.2])
    law = materials.Coulomb(mu, materials.Start.unloaded(np.zeros(4000), 2))
    slide, lift = np.array([0.0, -1.0]), np.array([mu, -1.0])
    around = rng.normal(size=(4000, 2)) + t
    printed = around[mu * around[:, 0] >= np.abs(around[:, 1])]
    right = around[law.left_dual(around, np.tile(t, (4000, 1))) == 0]
    assert min(len(printed), len(right)) > 500
    # x = -Δu is normal at t to the set of finite values.
    assert ((right - t) @ -slide).max() <= 1e-12
    assert ((right - t) @ -lift).max() > 0.1
    assert ((printed - t) @ -slide).max() > 0.1
    assert ((printed - t) @ -lift).max() <= 1e-12


def test_the_bipotential_alone_has_no_lower_bound() -> None:
    """t = 0 at the end of the step is admissible, and b then decreases along -t_t0."""
    slips = np.array([1.0, 10.0, 100.0])
    start = materials.Start([[1.0, 0.5]] * 3, np.zeros((3, 2)), np.zeros(3))
    x = np.column_stack([0 * slips, slips])
    b = materials.Coulomb(0.7, start).bipotential(-x * [1, -1], -start.reaction)
    np.testing.assert_allclose(b, -0.5 * slips, rtol=1e-15)


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


TURNS = np.linspace(0, 2 * np.pi, 360, endpoint=False)


def check_suprema(dual: Array, terms: list[list[Array]], size: Array) -> None:
    """Terms of each direction, at one and three times the distance from the vertex."""
    near, far = np.array(terms) / size
    slope = (far - near).max(axis=0) / 2
    # Directions are in steps of a degree: some are too close to decide.
    bounded, clear = slope <= ROUNDED, slope > 1e-4
    assert min(bounded.sum(), clear.sum()) > 10
    assert (bounded | clear).mean() > 0.95
    assert np.isposinf(dual[clear]).all()
    assert np.abs(dual / size - near.max(axis=0))[bounded].max() <= ROUNDED


@pytest.mark.parametrize("d", [2, 3])
@pytest.mark.slow_variants("3")
def test_duals_of_coulomb_are_the_suprema(d: int) -> None:
    rng = np.random.default_rng(30)
    n = 200
    start, mu = start_state(rng, n, d), rng.uniform(0.1, 1.5, n)
    law = materials.Coulomb(mu, start)
    around = np.array([[-1.0], [1.0]])
    if d == 3:
        around = np.stack([np.cos(TURNS), np.sin(TURNS)], axis=1)
    axis = np.eye(1, d)
    # Gaps and slips up to 1: normal, tangential and in between; and the edges of the cone.
    grid = [np.insert(s * around, 0, h, axis=1) for h in (0, 0.5, 1) for s in (0, 1)]
    ways, edges = np.vstack(grid), np.vstack([0 * axis, axis, grid[-1]])

    t = FORCE * np.abs(rng.normal(size=(n, 1)))
    dt = np.hstack([t, mu[:, None] * t * rng.random((n, 1)) * unit(rng, n, d - 1)])
    dt -= start.reaction
    w = LENGTH * rng.normal(size=(n, d))
    w[:, 0] = np.abs(w[:, 0])
    x = minus_increment(start, w)
    z = FORCE * (rng.normal(size=(n, d)) + axis) - start.reaction
    u = minus_increment(start, LENGTH * (rng.normal(size=(n, d)) + axis))

    def strain(way: Array) -> Array:
        return minus_increment(start, np.tile(LENGTH * way, (n, 1)))

    scale = np.column_stack([np.ones(n), *[mu] * (d - 1)])
    terms = [
        [np.sum(s * z, axis=1) - law.bipotential(s, dt) for s in map(strain, k * ways)]
        for k in (1.0, 3.0)
    ]
    size = energy_size(law, -x, z) + FORCE * LENGTH
    check_suprema(law.left_dual(z, dt), terms, size)
    stresses = [
        [FORCE * k * way * scale - start.reaction for way in edges] for k in (1.0, 3.0)
    ]
    terms = [
        [np.sum(s * u, axis=1) - law.bipotential(x, s) for s in reach]
        for reach in stresses
    ]
    size = energy_size(law, -x, dt) + energy_size(law, -u, dt) + FORCE * LENGTH
    check_suprema(law.right_dual(x, u), terms, size)


@pytest.mark.parametrize("beta", [0.0, 0.3, 0.9])
def test_duals_of_a_soil_are_the_suprema(beta: float) -> None:
    """In the plane of the given deviators, where the suprema are, and one direction outside."""
    rng = np.random.default_rng(31)
    alpha, apex, n = 0.9, 0.4, 100
    law = soils.DruckerPrager(alpha, beta, apex)
    basis = np.linalg.qr(deviators(rng, 3 * n).reshape(n, 3, 6).swapaxes(1, 2))[0]
    e1, e2, e3 = basis.transpose(2, 0, 1)
    volume = np.array([1 / 3] * 3 + [0] * 3)
    sides = [np.cos(turn) * e1 + np.sin(turn) * e2 for turn in TURNS] + [e3]
    # From the apex along the axis and along the surface.
    strains = [0 * e1, 0 * e1 + volume, *(side + beta * volume for side in sides)]
    stresses = [
        0 * e1,
        0 * e1 - 3 * volume,
        *(alpha * side - 3 * volume for side in sides),
    ]
    depth, e, more = rng.exponential(size=(3, n))
    y = volume_and_deviator(
        3 * (apex - depth), (alpha * depth * rng.random(n))[:, None] * e1
    )
    x = volume_and_deviator(beta * e + more, -e[:, None] * e1)
    p, q = rng.normal(size=(2, n)), 0.7 * rng.normal(size=(2, 2, n, 1))
    z = volume_and_deviator(3 * p[0], q[0, 0] * e1 + q[0, 1] * e2)
    u = volume_and_deviator(p[1], q[1, 0] * e1 + q[1, 1] * e2)
    # Numbers up to ten.
    size = np.full(n, 10.0)
    terms = [
        [np.sum(k * s * z, axis=1) - law.bipotential(k * s, y) for s in strains]
        for k in (1.0, 3.0)
    ]
    check_suprema(law.left_dual(z, y), terms, size)
    top = 3 * apex * volume
    terms = [
        [
            np.sum((k * s + top) * u, axis=1) - law.bipotential(x, k * s + top)
            for s in stresses
        ]
        for k in (1.0, 3.0)
    ]
    check_suprema(law.right_dual(x, u), terms, size)


def test_flow_is_the_gradient_of_the_potential() -> None:
    rng = np.random.default_rng(34)
    law = soils.DruckerPrager(0.9, 0.3, 0.4)
    associated = soils.DruckerPrager(0.9, 0.9, 0.4)
    y, h = rng.normal(size=(100, 6)), 1e-6
    for soil, potential in (
        (law, law.plastic_potential),
        (associated, associated.criterion),
    ):
        steps = h * np.eye(6)
        ends = [(potential(y + s), potential(y - s)) for s in steps]
        numeric = np.stack([(up - down) / (2 * h) for up, down in ends], axis=1)
        # Central differences: h² times third derivatives, and rounding over h.
        np.testing.assert_allclose(soil.flow(y), numeric, atol=1e-8)
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


def in_units(law: Any, force: float, metre: float) -> materials.Material:
    if isinstance(law, soils.DruckerPrager):
        return soils.DruckerPrager(law.friction, law.dilatancy, force * law.apex)
    start = materials.Start(
        force * law.start.reaction,
        metre * law.start.displacement,
        metre * law.start.gap,
    )
    if isinstance(law, materials.Coulomb):
        return materials.Coulomb(law.mu, start)
    return materials.Tresca(force * law.limit, start)


@pytest.mark.parametrize("kind", ["coulomb 3D", "tresca 3D", "soil"])
def test_units_have_no_effect(kind: str) -> None:
    """Powers of two as units: the same bits, and the same boundaries of the domain."""
    case, force, metre = CASES[kind](), 2.0**50, 2.0**-37
    rng = np.random.default_rng(49)
    z = case.stress * rng.normal(size=case.y.shape)
    u = case.strain * rng.normal(size=case.x.shape)
    r = case.stress / case.strain
    one = materials.implicit(case.material)
    two = materials.implicit(in_units(case.material, force, metre))
    pairs = (case.x, case.y), near(case, rng), (u, z), (case.x, z), (u, case.y)
    for x, y in pairs:
        for theirs, ours, size in (
            (
                two.bipotential(metre * x, force * y),
                one.bipotential(x, y),
                force * metre,
            ),
            (two.left_dual(force * z, force * y), one.left_dual(z, y), force * metre),
            (two.right_dual(metre * x, metre * u), one.right_dual(x, u), force * metre),
            (
                two.prox_at(force * y, metre * x, r * force / metre),
                one.prox_at(y, x, r),
                force,
            ),
        ):
            np.testing.assert_array_equal(theirs, size * ours)


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
        # The vector that is shorter by r, or zero.
        length = np.linalg.norm(x, axis=1, keepdims=True)
        shorter = np.maximum(1 - r / length, 0.0) * x
        np.testing.assert_allclose(prox, shorter, atol=1e-15)
    D = np.diag([1.0, 4.0, 9.0])
    body = materials.LinearElastic(D)
    prox = convex.conjugate_prox(body.prox, x, 0.5)
    # prox of r V: (I + r D) y = x.
    np.testing.assert_allclose(prox, x / (1 + 0.5 * np.diag(D)), rtol=1e-14)


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


START = materials.Start.unloaded([0.0], 2)
SPRINGS = materials.LinearElastic(np.eye(2))


MISTAKES: list[tuple[Callable[[], Any], str]] = [
    (lambda: materials.Tresca(-1.0, START), "limit of contact 0 is -1.0, expected zero"),
    (lambda: materials.Tresca([1.0, 2.0], START), r"limit has shape \(2,\), expected a n"),
    (lambda: materials.Coulomb(-0.1, START), "mu of contact 0 is -0.1"),
    (lambda: materials.Start(*np.zeros((2, 2, 4)), [0, 0]), r"reaction has shape \(2, 4"),
    (lambda: materials.Start(np.zeros((2, 3)), np.zeros((2, 2)), [0, 0]),
     r"displacement has shape \(2, 2\), expected \(2, 3\)"),
    (lambda: materials.Start(*np.zeros((2, 2, 3)), [0, np.inf]), "gap is inf at 1, exp"),
    (lambda: materials.Coulomb(0.1, START).bipotential([[0, 0, 0]], [[0, 0]]),
     r"x has shape \(1, 3\), expected \(1, 2\)"),
    (lambda: materials.LinearElastic([[1, 2], [2, 1]]), "stiffness has the eigenvalue -1.0"),
    (lambda: materials.LinearElastic([[1, 0.1], [0, 1]]), "stiffness is not symmetric"),
    (lambda: materials.LinearElastic([[1, 0.1]]), "expected a square matrix"),
    (lambda: SPRINGS.energy([1, 2, 3]), r"x has shape \(3,\), expected \(\.\.\., 2\)"),
    (lambda: materials.uzawa(SPRINGS, np.negative, [0, 0], 0.0, 1), "r is 0.0, expected po"),
    (lambda: materials.uzawa(SPRINGS, lambda _: np.zeros(3), [0, 0], 1.0, 1),
     r"strain\(y\) has shape \(3,\), expected \(2,\)"),
    (lambda: materials.uzawa(SPRINGS, lambda y: y + np.inf, [1, 1], 1.0, 9),
     r"strain\(y\) is .*inf at 0, expected finite numbers"),
    (lambda: materials.uzawa(SPRINGS, np.negative, [0, 0], 1.0, 0), "iterations is 0, exp"),
    (lambda: materials.elastic_strain(np.eye(3), np.zeros((2, 2))),
     r"compliance has shape \(3, 3\), expected \(4, 4\)"),
    (lambda: soils.DruckerPrager(0.0, 0.0, 1.0), "friction is 0.0, expected a positive"),
    (lambda: soils.DruckerPrager(0.3, 0.4, 1.0), "dilatancy is 0.4, expected 0 to 0.3, the"),
    (lambda: soils.DruckerPrager(0.3, -0.1, 1.0), "dilatancy is -0.1, expected 0 to 0.3"),
    (lambda: soils.DruckerPrager(0.3, 0.1, -1.0), "apex is -1.0, expected zero or positive"),
    (lambda: soils.DruckerPrager.from_angles(1.0, 2.0, 0.1), "friction_angle is 2.0, expec"),
    (lambda: soils.DruckerPrager.from_angles(1.0, 0.5, 0.6), "dilatancy_angle is 0.6, exp"),
    (lambda: soils.DruckerPrager.from_angles(-1.0, 0.5, 0.1), "cohesion is -1.0, expected"),
    (lambda: soils.DruckerPrager(0.3, 0.1, 1.0).criterion([1, 2]), r"y has shape \(2,\), e"),
    (lambda: soils.mandel(np.eye(2)), r"tensor has shape \(2, 2\), expected"),
]  # fmt: skip


@pytest.mark.parametrize(("call", "words"), MISTAKES)
def test_mistakes_are_named(call: Callable[[], Any], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        call()
