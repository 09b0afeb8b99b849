"""The displacement method with plastic bars, compared with trying all regimes."""

import itertools
from functools import cache
from typing import NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray

import bipot_rs as bp
from bipot_rs.theory.inelastic import HardeningBars, Truss, TrussSolution

Array = NDArray[np.float64]
POINTS = np.array([[0.0, 0.0], [1.0, 0.0], [0.1, 1.0], [1.1, 1.0]])
SEEDS = range(6)
BARS = [(0, 2), (1, 3), (2, 3), (0, 3), (1, 2)]


class Given(NamedTuple):
    """Two feet on the ground, two tops on springs to a wall, five bars that yield."""

    bars: HardeningBars
    C: Array
    B: Array
    gap: Array
    mu: Array
    load: Array


def given(seed: int) -> Given:
    rng = np.random.default_rng([3, seed])
    rows = []
    for a, b in BARS:
        way = POINTS[b] - POINTS[a]
        row = np.zeros((4, 2))
        row[b], row[a] = way / np.linalg.norm(way), -way / np.linalg.norm(way)
        rows.append(row.ravel())
    springs = np.eye(8)[4:]  # both components of the tops
    k = np.concatenate([rng.uniform(0.5, 2.0, 5), np.full(4, 0.2)])
    limit = np.concatenate([rng.uniform(0.2, 0.6, 5), np.full(4, np.inf)])
    plastic = np.concatenate([rng.normal(size=5) * 0.1, np.zeros(4)])
    B = np.zeros((4, 8))
    B[0, 1] = B[2, 3] = 1.0
    B[1, 0] = B[3, 2] = 1.0
    gap = np.abs(rng.normal(size=(2, 2))) * 0.05
    load = np.zeros(8)
    load[4:] = rng.normal(size=4) - np.array([0.0, 1.2, 0.0, 1.2])
    return Given(
        HardeningBars(k, 0.3 * k, limit, plastic),
        np.vstack([*rows, springs]),
        B,
        gap,
        rng.uniform(0.2, 0.5, 2),
        load,
    )


def enumerated(g: Given) -> list[tuple[Array, Array]]:
    """All solutions: every regime of every bar with every status of every contact."""
    k, h, y, p0 = g.bars.stiffness, g.bars.hardening, g.bars.limit, g.bars.plastic
    n, solutions = 8, []
    for regime in itertools.product((0, 1, -1), repeat=5):
        side = np.array([*regime, 0, 0, 0, 0])
        # N = slope e + shift: elastic, or N - h p = ± N_y with N = k (e - p).
        slope = np.where(side == 0, k, k * h / (k + h))
        bound = np.where(side == 0, 0.0, y)
        shift = np.where(side == 0, -k * p0, k * side * bound / (k + h))
        K = g.C.T * slope @ g.C
        force = g.load - g.C.T @ shift
        for status in itertools.product(("open", "stick", 1, -1), repeat=2):
            A = np.zeros((n + 4, n + 4))
            b = np.zeros(n + 4)
            A[:n, :n], A[:n, n:], b[:n] = K, -g.B.T, force
            for i, what in enumerate(status):
                rows = n + 2 * i + np.arange(2)
                if what == "open":
                    A[rows, rows] = 1.0
                    continue
                A[rows, :n] = g.B[2 * i : 2 * i + 2]
                b[rows] = -g.gap[i]
                if what != "stick":
                    A[rows[1]], b[rows[1]] = 0.0, 0.0
                    A[rows[1], rows[1]], A[rows[1], rows[0]] = 1.0, what * g.mu[i]
            x = np.linalg.solve(A, b)
            u, r = x[:n], x[n:].reshape(2, 2)
            e = g.C @ u
            N = slope * e + shift
            p = np.where(side == 0, p0, e - N / k)
            v = (g.B @ u).reshape(2, 2) + g.gap
            small = 1e-12
            ok = (np.abs(N - h * p) <= np.where(side == 0, y, np.inf) + small).all()
            ok &= (side * (p - p0) >= -small).all()
            for i, what in enumerate(status):
                if what == "open":
                    ok &= v[i, 0] >= -small
                    continue
                ok &= r[i, 0] >= -small
                if what == "stick":
                    ok &= abs(r[i, 1]) <= g.mu[i] * r[i, 0] + small
                else:  # r_t = -what μ r_n, against the slip
                    ok &= what * v[i, 1] >= -small
            if ok and not any(np.abs(u - other).max() < 1e-9 for other, _ in solutions):
                solutions.append((u, r))
    return solutions


@cache
def solved(seed: int) -> TrussSolution:
    g = given(seed)
    return Truss(g.bars, g.C, g.B, g.load, gap=g.gap, mu=g.mu).solve()


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.quick_variants("3")
def test_plastic_truss_with_friction(seed: int) -> None:
    g, solution = given(seed), solved(seed)
    assert solution.converged
    (answer,) = enumerated(g)
    # Solved to 1e-12 of the largest reaction; the condition of the truss is some hundred.
    assert solution.displacement == pytest.approx(answer[0], abs=1e-10)
    assert solution.reaction == pytest.approx(answer[1], abs=1e-10)
    # (37): every step in u decreases B, to the rounding of energies of order one.
    B = solution.bifunctional
    assert (B >= -1e-14).all()
    assert (B[1:, 0] <= B[:-1, 1] + 1e-14).all()
    # (38) may increase it, but two passes together decrease it.
    assert (B[2:, 1] <= B[:-2, 1] + 1e-14).all()
    # Of first order in the reactions.
    assert B[-1, 1] <= 1e-11
    assert B[0, 1] > 1e-6 or len(B) <= 2


def test_updating_the_stresses_may_raise_the_bifunctional() -> None:
    # The part of (31)-(34) that (38) leaves out: it does not always decrease B.
    rises = [
        (np.diff(solved(seed).bifunctional, axis=1) > 1e-6).any() for seed in SEEDS
    ]
    assert any(rises)


def test_some_of_these_yield_and_slip() -> None:
    yielded, slid, stuck = 0, 0, 0
    for seed in SEEDS:
        g, solution = given(seed), solved(seed)
        p = g.bars.yielded(g.C @ solution.displacement)
        yielded += (p != g.bars.plastic).any()
        drag = np.abs(solution.reaction[:, 1])
        limit = g.mu * solution.reaction[:, 0]
        slid += int(((limit > 0) & (drag > 0.999999 * limit)).any())
        stuck += int((drag < 0.99 * limit).any())
    assert yielded >= 4
    assert slid >= 2
    assert stuck >= 1


def test_potentials_of_the_bars_are_dual() -> None:
    rng = np.random.default_rng(2)
    k, h, y = rng.uniform(0.5, 2, (3, 200))
    bars = HardeningBars(k, h, y, rng.normal(size=200))
    e = 3 * rng.normal(size=200)
    N = bars.force(e)
    # Fenchel's equality on the law, to rounding of energies of order ten.
    assert bars.potential(e) + bars.dual(N) == pytest.approx(N * e, abs=1e-13)
    # Off the law it is at least half the squared distance in the stiffest direction.
    other = N + rng.normal(size=200)
    excess = bars.potential(e) + bars.dual(other) - other * e
    assert (excess >= 0.5 * (other - N) ** 2 / k - 1e-12).all()
    # By its definition V is the minimum over p: brute force.
    p = np.linspace(-8, 8, 20001)[:, None]
    values = (
        0.5 * k * (e - p) ** 2 + 0.5 * h * p**2 + y * np.abs(p - bars.plastic)
    ).min(axis=0)
    # The error of half a grid width, for a function of curvature k + h and slope y.
    width = 16 / 20000
    assert (values >= bars.potential(e) - 1e-12).all()
    assert (values <= bars.potential(e) + (k + h) * width**2 + y * width).all()
    # Away from the limit N is the derivative of V, and the tangent that of N.
    step = 1e-6
    slope = (bars.potential(e + step) - bars.potential(e - step)) / (2 * step)
    assert slope == pytest.approx(N, abs=1e-8)
    change = (bars.force(e + step) - bars.force(e - step)) / (2 * step)
    assert change == pytest.approx(bars.tangent(e), abs=1e-8)


def test_38a_as_printed_gives_a_strain() -> None:
    # ∂_σ β at (ε, σ) is the ε of (22); the stress is ∂_ε β.
    bars = HardeningBars(np.array([4.0]), np.array([1.0]), np.array([2.0]), np.zeros(1))
    e = np.array([1.5])
    N, step = bars.force(e), 1e-6
    printed = (bars.dual(N + step) - bars.dual(N - step)) / (2 * step)
    assert printed == pytest.approx(e, rel=1e-8)
    assert N[0] == pytest.approx(4 * 1.5 - 4 * (6 - 2) / 5, rel=1e-14)
    assert abs(printed[0] - N[0]) > 1


def test_in_elastic_bodies_it_equals_the_solution_of_the_solver() -> None:
    g = given(1)
    elastic = HardeningBars(
        g.bars.stiffness, g.bars.hardening, np.full(9, np.inf), np.zeros(9)
    )
    solution = Truss(elastic, g.C, g.B, g.load, gap=g.gap, mu=g.mu).solve()
    K = g.C.T * elastic.stiffness @ g.C
    result = bp.solve(K, g.B, g.load, gap=g.gap, mu=g.mu, tol=1e-13)
    assert solution.displacement == pytest.approx(result.displacement[0], abs=1e-11)
    assert solution.reaction == pytest.approx(result.reaction[0], abs=1e-11)


def test_wrong_arguments_are_named() -> None:
    g = given(0)
    with pytest.raises(ValueError, match=r"C has shape \(3, 8\), expected 9 rows"):
        Truss(g.bars, g.C[:3], g.B, g.load, gap=g.gap, mu=g.mu)
    with pytest.raises(
        ValueError, match=r"hardening of bar 0 is 0.0, expected a positive"
    ):
        HardeningBars(np.ones(2), np.zeros(2), np.ones(2), np.zeros(2))
    with pytest.raises(TypeError, match="bars is a NoneType"):
        Truss(None, g.C, g.B, g.load, gap=g.gap, mu=g.mu)  # type: ignore[arg-type]
