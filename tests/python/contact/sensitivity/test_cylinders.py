"""Derivatives of the half-widths of contact and stick of a cylinder, with closed forms.

Strips with even pressure on a half-plane, [J85, 2.1]. The half-widths are those of the moments
of the tractions, which depend smoothly on the reactions, and not on the number of closed
strips. Where an edge lies within its strip changes derivatives by some strips' share, and the
half-widths themselves by its square; so derivatives are averaged over grids that are shifted
by parts of a strip.
"""

from collections.abc import Callable, Iterator

import numpy as np
import pytest
from numpy.typing import NDArray

import bipot_rs as bp

Array = NDArray[np.float64]

MODULUS, RADIUS, FORCE = 2.0, 10.0, 0.3  # E*, R, P of a unit length
# P = π E* a² / (4 R) without coupling.
WIDTH = np.sqrt(4 * FORCE * RADIUS / (np.pi * MODULUS))
CELLS, SHIFTS = 20, 8
# Displacement of the surface far away, which is only determined up to a constant: it makes
# all displacements point away from the force.
FAR = 2.0


def grids() -> Iterator[Array]:
    """Centres of the strips, ``CELLS`` to the half-width, on shifted grids."""
    h = WIDTH / CELLS
    count = int(1.35 * CELLS)
    for shift in (np.arange(SHIFTS) + 0.5) / SHIFTS:
        yield h * (np.arange(-count, count) + shift)


def compliance(x: Array, coupling: float) -> Array:
    """W of strips at ``x``; ``coupling`` is Dundurs' β of the two materials."""
    h, far = x[1] - x[0], x[:, None] - x[None, :]

    def integral(u: Array) -> Array:
        return np.asarray(u * np.log(np.abs(u)) - u)

    block_of_W = (
        FAR
        - 2 / (np.pi * MODULUS) * (integral(far + h / 2) - integral(far - h / 2)) / h
    )
    across = coupling / MODULUS * np.sign(np.round(far / h))
    W = np.kron(block_of_W, np.eye(2))
    W[::2, 1::2], W[1::2, ::2] = across, across.T
    return W


def average(found: Callable[[Array], list[float]]) -> Array:
    return np.mean([found(x) for x in grids()], axis=0)


def sliding(x: Array, coupling: float, mu: float) -> bp.Solution:
    """The cylinder pressed by P, and moved so far that every strip slides."""
    q = np.stack([x**2 / (2 * RADIUS), np.full_like(x, 50.0)], axis=1)
    sinks = np.tile([1.0, 0.0], len(x))[:, None]
    problem = bp.ReducedProblem(compliance(x, coupling), q, mu, rigid=(sinks, [-FORCE]))
    solution = problem.solve(tol=1e-12)
    assert (solution.status != bp.Status.STICK).all()
    return solution


def test_half_width_of_a_sliding_contact_by_friction() -> None:
    """Friction widens the contact of different materials: ``a² = 4 P R / (π E* (1 - 4 γ²))``.

    ``p ~ (a + x)^(1/2 + γ) (a - x)^(1/2 - γ)`` with ``tan π γ = β μ``, [J85, 7.2]. Its
    variance is ``a² (1/4 - γ²/9)``.
    """
    beta, mu = 0.5, 0.8
    gamma = np.arctan(beta * mu) / np.pi
    by_mu = beta / (np.pi * (1 + (beta * mu) ** 2))
    share = 1 / 4 - gamma**2 / 9
    exact = WIDTH / np.sqrt(1 - 4 * gamma**2)
    slope = exact * 4 * gamma * by_mu / (1 - 4 * gamma**2)

    def measured(x: Array) -> list[float]:
        sliding_solution = sliding(x, beta, mu)
        p = sliding_solution.reaction[:, 0] / FORCE
        change = sliding_solution.jvp(mu=1.0).reaction[:, 0] / FORCE
        middle = p @ x
        variance = p @ x**2 - middle**2
        of_variance = change @ x**2 - 2 * middle * (change @ x)
        a = np.sqrt(variance / share)
        return [a, (of_variance + a**2 * 2 * gamma * by_mu / 9) / (2 * share * a)]

    a, by_friction = average(measured)
    # Second order in the strips: 1/20 squared, and the derivative half a strip.
    assert a == pytest.approx(exact, rel=1 / CELLS**2)
    assert by_friction == pytest.approx(slope, rel=0.5 / CELLS)


def sheared(x: Array, mu: float, tangential: float) -> tuple[bp.Result, Array]:
    """Pressed by P, then pulled by Q: the result, and the loads of both steps.

    The last two degrees of freedom are the motions of the rigid cylinder, which only contact
    holds.
    """
    m = 2 * len(x)
    stiffness_of_pair = np.linalg.inv(compliance(x, 0.0))
    K = np.zeros((m + 2, m + 2))
    K[:m, :m] = (stiffness_of_pair + stiffness_of_pair.T) / 2
    B = np.hstack([np.eye(m), np.tile(np.eye(2), (len(x), 1))])
    load = np.zeros((2, m + 2))
    load[:, m] = -FORCE
    load[1, m + 1] = tangential
    problem = bp.ContactProblem(K, B, gap=x**2 / (2 * RADIUS), mu=mu)
    return problem.solve(load, tol=1e-12), load


def test_half_width_of_the_stick_zone() -> None:
    """``c = a √(1 - Q/(μ P))`` of Cattaneo and Mindlin: by μ, by Q and by P.

    The traction is ``μ p`` of the half-width a less ``μ p c/a`` of c, [J85, 7.2], so that
    ``∫ x² q = Q (a² + c²)/4`` and ``∫ x² p = P a²/4``. History: P is applied in the first
    step, and the change of P acts in both.
    """
    mu, share = 0.4, 0.6
    Q = share * mu * FORCE
    root = np.sqrt(1 - share)
    exact = WIDTH * root
    slopes = [
        WIDTH * share / (2 * mu * root),
        -WIDTH / (2 * mu * FORCE * root),
        WIDTH / (2 * FORCE) * (root + share / root),
    ]

    def measured(x: Array) -> list[float]:
        result, load = sheared(x, mu, Q)
        r = result.reaction[-1]
        pressed, pulled = r[:, 0] @ x**2 / FORCE, -r[:, 1] @ x**2 / Q
        c = 2 * np.sqrt(pulled - pressed)

        def slope(change: Array, by_force: float, by_pull: float) -> float:
            of_p = (change[:, 0] @ x**2 - by_force * pressed) / FORCE
            of_q = (-change[:, 1] @ x**2 - by_pull * pulled) / Q
            return float(2 * (of_q - of_p) / c)

        further, deeper = np.zeros((2, *load.shape))
        further[1, -1], deeper[:, -2] = 1.0, -1.0
        return [
            c,
            slope(result.jvp(mu=1.0).reaction[-1], 0.0, 0.0),
            slope(result.jvp(further).reaction[-1], 0.0, 1.0),
            slope(result.jvp(deeper).reaction[-1], 1.0, 0.0),
        ]

    c, *measured_slopes = average(measured)
    assert c == pytest.approx(exact, rel=1 / CELLS**2)
    # Half a strip of the stick zone.
    np.testing.assert_allclose(measured_slopes, slopes, rtol=0.5 / CELLS / root)
