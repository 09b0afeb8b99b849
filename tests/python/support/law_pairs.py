"""Pairs on Coulomb's law and pairs off it, with any state at the start.

They are made from the textbook's cases, without a cone, a projection or a bipotential.
Forces and displacements are of the order of `FORCE` and `LENGTH`, so that the tests do
not depend on special units.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bipot_rs.theory.materials import Coulomb, Start

Array = NDArray[np.float64]
FORCE, LENGTH = 3e4, 2e-6
RHO = FORCE / LENGTH
OPEN, SLIP, STICK, LOOSE, TOUCH, EDGE = range(6)
SPOILED = (
    "penetrates",
    "pulls",
    "force at a distance",
    "beyond the limit",
    "slips within the limit",
    "slips askew",
    "slips forwards",
    "slips forwards and sinks",
    "stick that lifts",
)


class Pairs(NamedTuple):
    """Totals in units of `FORCE` and `LENGTH`."""

    t: Array
    v: Array
    mu: Array
    status: NDArray[np.int_]


def unit(rng: np.random.Generator, n: int, d: int) -> Array:
    x = rng.normal(size=(n, d))
    return np.asarray(x / np.linalg.norm(x, axis=1, keepdims=True))


def on_the_law(rng: np.random.Generator, n: int, d: int) -> Pairs:
    """Every status; one contact in eight has no friction."""
    status = rng.integers(6, size=n)
    mu = np.where(rng.random(n) < 0.125, 0.0, rng.uniform(0.05, 2.0, n))
    side = unit(rng, n, d - 1)
    # Away from zero, so that the errors added below have a known relative size.
    press, way = rng.uniform(0.3, 3.0, n), rng.uniform(0.3, 3.0, n)
    closed = np.isin(status, (SLIP, STICK, EDGE))
    share = np.where(status == STICK, rng.uniform(0, 0.8, n), 1.0)
    t, v = np.zeros((n, d)), np.zeros((n, d))
    t[:, 0] = press * closed
    t[:, 1:] = -(mu * share * t[:, 0])[:, None] * side
    v[:, 0] = way * np.isin(status, (OPEN, LOOSE))
    v[:, 1:] = (way * np.isin(status, (SLIP, LOOSE)))[:, None] * side
    return Pairs(t, v, mu, status)


def off_the_law(
    rng: np.random.Generator, n: int, d: int, how: str, size: float
) -> Pairs:
    """Pairs that violate one condition by ``size``, relative to unit forces and displacements."""
    p = on_the_law(rng, n, d)
    mu = rng.uniform(0.2, 2.0, n)
    side, press = unit(rng, n, d - 1), rng.uniform(0.3, 3.0, n)
    away = rng.uniform(0.3, 3.0, n)
    t, v = np.zeros((n, d)), np.zeros((n, d))
    match how:
        case "penetrates":
            t, v = p.t.copy(), p.v.copy()
            v[:, 0] = -size
            mu = p.mu
        case "pulls":
            t[:, 0] = -size
            v[:, 1:] = away[:, None] * side
        case "force at a distance":
            t[:, 0], v[:, 0] = size, away
        case "beyond the limit":
            t[:, 0] = press
            t[:, 1:] = -(mu * press + size)[:, None] * side
            v[:, 1:] = (away * (rng.random(n) < 0.5))[:, None] * side
        case "slips within the limit":
            t[:, 0] = press
            t[:, 1:] = -(mu * press * (1 - size))[:, None] * side
            v[:, 1:] = away[:, None] * side
        case "slips askew":
            t[:, 0] = press
            t[:, 1:] = -(mu * press)[:, None] * side
            if d == 2:
                v[:, 1:] = -away[:, None] * side
            else:
                turned = np.column_stack([-side[:, 1], side[:, 0]])
                v[:, 1:] = away[:, None] * (np.cos(size) * side + np.sin(size) * turned)
        case "slips forwards":
            t[:, 0] = press
            t[:, 1:] = (mu * press)[:, None] * side
            v[:, 1:] = size * side
        case "slips forwards and sinks":
            # Chosen so that -ṽ is the inward normal of the cone.
            t[:, 0] = press
            t[:, 1:] = (mu * press)[:, None] * side
            v[:, 0], v[:, 1:] = -2 * mu * size, size * side
        case "stick that lifts":
            t[:, 0], v[:, 0] = press, size
    return Pairs(t, v, mu, p.status)


def start_state(rng: np.random.Generator, n: int, d: int) -> Start:
    """In turn: complementary, both positive, penetrating, and far outside the cone."""
    kind = rng.integers(5, size=n)
    t0 = rng.normal(size=(n, d))
    t0[:, 0] = np.abs(t0[:, 0])
    opening = rng.exponential(size=n)
    opening[kind == 0] = 0.0
    t0[kind == 1] = 0.0
    opening[kind == 3] *= -1
    t0[kind == 4, 0] *= -1
    u0 = rng.normal(size=(n, d))
    return Start(FORCE * t0, LENGTH * u0, LENGTH * (opening - u0[:, 0]))


def as_step(pairs: Pairs, start: Start) -> tuple[Coulomb, Array, Array]:
    """Law, Δu and Δt that lead from the start state to the pairs."""
    du = LENGTH * pairs.v
    du[:, 0] -= start.opening
    return Coulomb(pairs.mu, start), du, FORCE * pairs.t - start.reaction


def energy_size(law: Coulomb, du: Array, dt: Array) -> Array:
    """Sizes of the terms of b and of x·y; their rounding is a few units of this."""
    forces = np.abs(law.start.reaction).sum(axis=1) + np.abs(dt).sum(axis=1)
    opening = np.abs(law.start.displacement[:, 0]) + np.abs(law.start.gap)
    return np.asarray(forces * (opening + (1 + law.mu) * np.abs(du).sum(axis=1)))
