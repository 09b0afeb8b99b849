"""Derivations of docs/theory.md checked with numbers, without using the package.

Names follow [dSF91]: t0, u0, h0 are the start of the step, dt and du its increments,
with components normal first; b(-du, dt) is the bipotential (54).
"""

import math

import numpy as np
import pytest
from numpy.typing import NDArray

Array = NDArray[np.float64]
MU = 0.7


def bipotential(du: Array, dt: Array, t0: Array, gap0: float, mu: float = MU) -> float:
    """(54) as printed; `gap0` is u_n0 + h0."""
    t = t0 + dt
    # Limits hold to the rounding of sums of a few numbers of order one.
    if np.linalg.norm(t[1:]) > mu * t[0] + 1e-14 or du[0] + gap0 < -1e-14:
        return math.inf
    at_start = t0[0] * du[0] + t0[1:] @ du[1:] + dt[0] * gap0
    return float(at_start + mu * t[0] * np.linalg.norm(du[1:]))


def on_the_law(rng: np.random.Generator, dim: int) -> tuple[Array, Array]:
    """Final traction t and (gap, slip) that satisfy Signorini and Coulomb."""
    side = rng.normal(size=dim - 1)
    side /= np.linalg.norm(side)
    t, x = np.zeros(dim), np.zeros(dim)
    match rng.integers(3):
        case 0:
            x[0], x[1:] = rng.exponential(), rng.normal(size=dim - 1)
        case 1:
            t[0] = rng.exponential()
            t[1:] = MU * t[0] * rng.random() * side
        case _:
            t[0] = rng.exponential()
            t[1:] = -MU * t[0] * side
            x[1:] = rng.exponential() * side
    return t, x


def start(rng: np.random.Generator, dim: int, kind: str) -> tuple[Array, float]:
    """Start tractions and gap: complementary, both positive, or penetrating."""
    t0 = np.zeros(dim)
    t0[0] = rng.exponential()
    t0[1:] = MU * t0[0] * rng.uniform(-1, 1, dim - 1) / math.sqrt(dim - 1)
    if kind == "complementary":
        return (t0, 0.0) if rng.random() < 0.5 else (0 * t0, float(rng.exponential()))
    return t0, float(rng.exponential()) * (1 if kind == "both" else -1)


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("kind", ["complementary", "both", "penetrated"])
def test_bipotential_lacks_the_product_of_the_start_state(dim: int, kind: str) -> None:
    rng = np.random.default_rng(1)
    for _ in range(500):
        t0, gap0 = start(rng, dim, kind)
        t, x = on_the_law(rng, dim)
        dt, du = t - t0, x.copy()
        du[0] -= gap0
        excess = bipotential(du, dt, t0, gap0) + du @ dt
        # On the law b = x·y - t_n0 (u_n0 + h0): right only if the product vanishes.
        assert excess == pytest.approx(-t0[0] * gap0, abs=1e-13)
        # Off the law it is larger by r·ṽ > 0.
        other, y = on_the_law(rng, dim)
        other[0] += 0.1
        y[0] += 0.1
        dt, du = other - t0, np.array([y[0] - gap0, *y[1:]])
        corrected = np.array([y[0] + MU * np.linalg.norm(y[1:]), *y[1:]])
        excess = bipotential(du, dt, t0, gap0) + du @ dt + t0[0] * gap0
        assert excess == pytest.approx(other @ corrected, abs=1e-13)
        assert excess > 0.005


@pytest.mark.parametrize("dim", [2, 3])
def test_normals_lie_in_the_polar_cone_and_slide_backwards(dim: int) -> None:
    rng = np.random.default_rng(2)
    for _ in range(300):
        # A normal to K_μ at its nearest point to a random tau.
        tau = rng.normal(size=dim)
        grid = rng.exponential(size=(200, dim))
        grid[:, 1:] = rng.normal(size=(200, dim - 1))
        grid[:, 1:] *= (MU * grid[:, 0] / np.linalg.norm(grid[:, 1:], axis=1))[:, None]
        normal = np.array([-MU, *tau[1:] / np.linalg.norm(tau[1:])])
        # (58): polar, so that normals have v·t <= 0 for all t of the cone.
        assert MU * np.linalg.norm(normal[1:]) + normal[0] <= 1e-14
        assert np.all(grid @ normal <= 1e-12)
        # (61): with du_t = -dv_t by (57), the normal is (-μ|du_t|, -du_t).
        t = np.array([1.0, *(MU * normal[1:])])
        du_t = -rng.exponential() * normal[1:]
        right = np.array([-MU * np.linalg.norm(du_t), *(-du_t)])
        printed = np.array([-MU * np.linalg.norm(du_t), *du_t])
        assert np.all((grid - t) @ right <= 1e-12)
        assert np.any((grid - t) @ printed > 1e-3)


def test_left_dual_holds_the_disc_of_the_unbarred_normal_traction() -> None:
    # sup over du of z·(-du) - b(-du, dt): brute force over a large box.
    t0, gap0, dt = np.array([1.0, 0.2]), 0.3, np.array([0.5, -0.4])
    t_n = t0[0] + dt[0]
    for z_n, z_t in [(0.4, 0.1), (-0.8, 0.3), (0.1, 0.84), (-0.9, 0.8), (2.0, 1.5)]:
        best = []
        for reach in (50.0, 100.0):
            n = np.linspace(-gap0, reach, 201)[:, None]
            s = np.linspace(-reach, reach, 401)[None]
            b = t0[0] * n + t0[1] * s + dt[0] * gap0 + MU * t_n * np.abs(s)
            best.append(float(np.max(-z_n * n - z_t * s - b)))
        bounded = best[1] <= best[0] + 1e-9
        # (62) with the disc ΔK_μ(Δt_n) of (76), and t_n0 + Δt̄_n >= 0.
        disc = abs(t0[1] + z_t) <= MU * t_n
        assert bounded == (disc and t0[0] + z_n >= 0)
        if bounded:
            assert best[0] == pytest.approx((t0[0] + z_n - dt[0]) * gap0, rel=1e-12)
        # The printed cone of the barred pair agrees with the supremum in only one case.
        cone = abs(t0[1] + z_t) <= MU * (t0[0] + z_n)
        assert (cone == bounded) == ((z_n, z_t) == (0.4, 0.1))


@pytest.mark.parametrize("dim", [2, 3])
def test_variational_inequality_with_the_displacement_hat(dim: int) -> None:
    rng = np.random.default_rng(3)
    wrong = 0
    for _ in range(300):
        t0, gap0 = start(rng, dim, "complementary")
        t, x = on_the_law(rng, dim)
        trial, _ = on_the_law(rng, dim)
        # (74) with û_t: for every t* of the cone.
        first = (x[0] + MU * np.linalg.norm(x[1:])) * (trial[0] - t[0])
        assert first + x[1:] @ (trial[1:] - t[1:]) >= -1e-13
        # With t̂_t, as printed, it fails (and the units differ).
        wrong += first + (t - t0)[1:] @ (trial[1:] - t[1:]) < -1e-3
        assert gap0 >= 0
    assert wrong > 10


def test_bipotential_alone_has_no_lower_bound() -> None:
    # t = 0 at the end of the step is admissible, and b then decreases along -t_t0.
    t0 = np.array([1.0, 0.5])
    values = [bipotential(np.array([0.0, -s]), -t0, t0, 0.0) for s in (1, 10, 100)]
    assert values == pytest.approx([-0.5, -5.0, -50.0], rel=1e-15)


def test_bifunctional_is_the_sum_of_distances_and_gaps() -> None:
    # Φ + Π + Σ b = ½|u - w|²_K + Σ r·ṽ, with w the elastic solution for f + Bᵀ r.
    rng = np.random.default_rng(4)
    for _ in range(50):
        root = rng.normal(size=(6, 6))
        K, B, f = root @ root.T + np.eye(6), rng.normal(size=(4, 6)), rng.normal(size=6)
        g, u = rng.normal(size=(2, 2)), rng.normal(size=6)
        r = np.abs(rng.normal(size=(2, 2)))
        r[:, 1] *= MU * r[:, 0] / (1 + r[:, 1])
        v = (B @ u).reshape(2, 2) + g
        w = np.linalg.solve(K, f + B.T @ r.ravel())
        lost = MU * r[:, 0] * np.abs(v[:, 1])
        phi, pi = 0.5 * u @ K @ u - f @ u, 0.5 * w @ K @ w
        total = phi + pi + lost.sum() + np.sum(r * g)
        gaps = np.sum(r * v) + lost.sum()
        # Sums of a hundred products of order ten.
        assert total == pytest.approx(
            0.5 * (u - w) @ K @ (u - w) + gaps,
            abs=1e-12 * float(1 + abs(phi) + abs(pi)),
        )


def test_one_contact_problem_always_has_a_slip_multiplier() -> None:
    # (18): pressed and not sticking, |r_t(λ)| - μ r_n(λ) changes sign on (0, ∞).
    rng = np.random.default_rng(5)
    tried = 0
    while tried < 100:
        root = rng.normal(size=(3, 3))
        W = root @ root.T + 0.1 * np.eye(3)
        q, mu = rng.normal(size=3), rng.exponential() * 2
        stick = -np.linalg.solve(W, q)
        if q[0] >= 0 or np.linalg.norm(stick[1:]) <= mu * stick[0]:
            continue
        tried += 1
        schur = W[1:, 1:] - np.outer(W[1:, 0], W[0, 1:]) / W[0, 0]
        rest = q[1:] - W[1:, 0] * q[0] / W[0, 0]

        def reaction(
            multiplier: float,
            W: Array = W,
            q: Array = q,
            S: Array = schur,
            p: Array = rest,
        ) -> Array:
            r_t = -np.linalg.solve(S + multiplier * np.eye(2), p)
            return np.array([-(q[0] + W[0, 1:] @ r_t) / W[0, 0], *r_t])

        def excess(multiplier: float, mu: float = mu) -> float:
            r = reaction(multiplier)
            return float(np.linalg.norm(r[1:]) - mu * r[0])

        low, high = 0.0, 1e12
        assert excess(low) > 0 > excess(high)
        for _ in range(200):
            middle = (
                (low + high) / 2 if low == 0 or high < 1e-3 else math.sqrt(low * high)
            )
            low, high = (middle, high) if excess(middle) > 0 else (low, middle)
        r = reaction(high)
        v = W @ r + q
        # Bisection to rounding: v_n = 0, v_t = -λ r_t with λ >= 0.
        assert abs(v[0]) <= 1e-12 * np.abs(q).max()
        np.testing.assert_allclose(v[1:], -high * r[1:], rtol=1e-9, atol=1e-12)
