"""The closed forms of the faults in the examples, derived once more.

Each is checked as the solution of a boundary value problem: equilibrium by differences,
tractions and jumps on the fault, and what is left far away. The slips are checked against the
shear of their dislocations, ``-G / (2 π (1 - ν)) ∫ δ'(s) / (x - s) ds``, which the
displacements do not use.
"""

import math
from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

import bipot_rs as bp
from cases import faults
from support.comparisons import near

crack, reservoir = faults.inclined_crack, faults.reservoir
Array = NDArray[np.float64]
Displacement = Callable[[Array], Array]


def gradient(displacement: Displacement, x: Array, step: float) -> Array:
    """``∂_a u_i``, ``(n, i, a)``, by central differences."""
    moves = step * np.eye(2)
    parts = [displacement(x + m) - displacement(x - m) for m in moves]
    return np.stack(parts, axis=2) / (2 * step)


def stress(
    displacement: Displacement, x: Array, step: float, moduli: tuple[float, float]
) -> Array:
    slope = gradient(displacement, x, step)
    trace = np.einsum("nii->n", slope)[:, None, None]
    return moduli[0] * trace * np.eye(2) + moduli[1] * (slope + slope.swapaxes(1, 2))


def imbalance(
    displacement: Displacement, x: Array, step: float, moduli: tuple[float, float]
) -> Array:
    """``div σ``, ``(n, 2)``."""
    moves = step * np.eye(2)
    ahead, behind = (
        [
            stress(displacement, x + sign * m, step, moduli)[:, :, a]
            for a, m in enumerate(moves)
        ]
        for sign in (1, -1)
    )
    return np.asarray(sum(ahead) - sum(behind)) / (2 * step)


def dislocation_stress(
    x: Array, places: Array, weights: Array, density: Array
) -> Array:
    """``-∫ δ'(s) / (x - s) ds`` by a rule whose points are not among x."""
    return -(weights * density / (x[:, None] - places)).sum(axis=1)


def test_slip_of_the_crack_has_the_stress_drop() -> None:
    """δ' is c s / √(b² - s²) times -1: Gauss–Chebyshev is exact between its points."""
    n = 12
    places = crack.HALF * np.cos(np.pi * (np.arange(n) + 0.5) / n)
    between = crack.HALF * np.cos(np.pi * np.arange(1, n) / n)
    # The weight of the rule is 1 / √(b² - s²).
    density = -crack.exact_slip(0.0) / crack.HALF * places
    stresses = dislocation_stress(between, places, np.full(n, np.pi / n), density)
    shear = crack.YOUNG / (2 * (1 + crack.NU))
    stresses *= shear / (2 * np.pi * (1 - crack.NU))
    np.testing.assert_allclose(stresses, -crack.DROP, rtol=1e-12)  # sums of 12 terms
    # The numbers of the literature, to their digits.
    assert abs(crack.PRESSURE - 11.6978e6) < 50
    assert abs(crack.exact_slip(0.0) - 3.80785e-3) < 5e-9


def test_displacement_around_the_crack() -> None:
    shear = crack.YOUNG / (2 * (1 + crack.NU))
    moduli = (crack.YOUNG * crack.NU / (1 + crack.NU) / (1 - 2 * crack.NU), shear)
    along = np.linspace(-0.8, 0.8, 9)

    def beside(off: float) -> Array:
        return np.stack([along, off + 0 * along], axis=1) @ crack.TURN.T

    jump = crack.exact_displacement(beside(1e-9))
    jump -= crack.exact_displacement(beside(-1e-9))
    slip = np.outer(crack.exact_slip(along), crack.TURN[:, 0])
    # 1e-9 m off the faces, the displacement differs by strain times this distance.
    near(jump, slip, 1e-11)
    # Over 0.2 m the fields vary by themselves: differences of step 1e-3 leave 1e-3² of it.
    x = np.random.default_rng(3).uniform(-2, 2, (40, 2))
    x = x[np.abs(x @ crack.TURN[:, 1]) > 0.2]
    residual = imbalance(crack.exact_displacement, x, 1e-3, moduli)
    assert np.abs(residual).max() < 1e-3 * crack.SIGMA
    # Tractions on both faces: 1e-5 m off them they differ by some 1e-5.
    for side in (1e-5, -1e-5):
        turned = stress(crack.exact_displacement, beside(side), 1e-6, moduli)
        faces = crack.TURN.T @ turned @ crack.TURN
        np.testing.assert_allclose(faces[:, 1, 1], -crack.PRESSURE, rtol=1e-3)
        np.testing.assert_allclose(faces[:, 0, 1], crack.MU * crack.PRESSURE, rtol=1e-3)
    far = stress(crack.exact_displacement, np.array([[3e4, 2e4]]), 1.0, moduli)[0]
    # The crack's own stress decays like the square of the distance.
    near(far, np.diag([-crack.SIGMA, 0.0]), 1e-6 * crack.SIGMA)


MODULI = (reservoir.LAME, reservoir.SHEAR)
LOST = reservoir.ALPHA * reservoir.FALL


def total_stress(x: Array, displacement: Displacement = reservoir.depletion) -> Array:
    """With the part -α Δp I in the layers."""
    left = (x[:, 0] < 0) & (x[:, 1] > -reservoir.A) & (x[:, 1] < reservoir.B)
    right = (x[:, 0] > 0) & (x[:, 1] > -reservoir.B) & (x[:, 1] < reservoir.A)
    inside = (left | right)[:, None, None]
    return stress(displacement, x, 1e-5, MODULI) - LOST * inside * np.eye(2)


# Heights of the fault away from ±a and ±b.
HEIGHTS = np.array([-250.0, -160, -120, -90, -40, 0, 30, 70, 100, 140, 170, 260])


def test_stress_of_the_depleted_layers() -> None:
    residual = imbalance(
        reservoir.depletion, np.array([[40.0, 20], [-90, 100], [60, 190]]), 0.1, MODULI
    )
    assert np.abs(residual).max() < 1e-6 * abs(
        LOST
    )  # Pa / m, by steps of 0.1 m in 20 m
    # 1e-4 m off the fault: tractions are those of the formulas, on both sides.
    for side in (1e-4, -1e-4):
        there = total_stress(np.stack([side + 0 * HEIGHTS, HEIGHTS], axis=1))
        pressure = reservoir.exact_pressure(HEIGHTS) - reservoir.INITIAL
        shear = reservoir.exact_shear(HEIGHTS)
        # Differences have the rounding of u, 1e-16 m over 2e-5 m, and the distance 1e-4 of 5 m.
        near(-there[:, 0, 0], pressure, 1e-4 * 2e7)
        near(-there[:, 0, 1], shear, 1e-4 * 2e7)
    # Tractions pass through the boundaries of the layers.
    for x in (50.0, -50.0):
        for z in (reservoir.A, reservoir.B, -reservoir.A, -reservoir.B):
            below, above = total_stress(np.array([[x, z - 1e-4], [x, z + 1e-4]]))
            near(above[1], below[1], 1e-4 * 2e7)
    # Far away each layer shortens in height only, by e; outside there is no stress.
    far = np.array([[4e6, 0.0], [-4e6, 0.0], [4e6, 200.0]])
    strain = np.diag([0.0, reservoir.SHRINK])
    slope = gradient(reservoir.depletion, far, 1.0)
    near(slope, [strain, strain, 0 * strain], 1e-4 * abs(reservoir.SHRINK))


def test_slip_of_the_fault_without_friction() -> None:
    a, b, nu = reservoir.A, reservoir.B, reservoir.NU
    assert abs(reservoir.SLIP - 0.181731) < 5e-7  # the digits of the literature
    # δ' is constant between a and b and between -b and -a: Gauss on each, away from both.
    points, weights = np.polynomial.legendre.leggauss(40)
    places = np.concatenate([s * (a + b) / 2 + (b - a) / 2 * points for s in (-1, 1)])
    slope = -reservoir.SLIP / (b - a) * np.repeat([1.0, -1.0], 40)
    outside = np.array([-260.0, -170, -60, 0, 50, 190])
    both = np.tile(weights, 2) * (b - a) / 2
    made = dislocation_stress(outside, places, both, slope)
    made *= reservoir.SHEAR / (2 * math.pi * (1 - nu))
    # It cancels the stress of the held fault, which is minus the traction on the right side.
    np.testing.assert_allclose(made, reservoir.exact_shear(outside), rtol=1e-10)

    right, left = (np.stack([s + 0 * HEIGHTS, HEIGHTS], axis=1) for s in (1e-9, -1e-9))
    jump = reservoir.dislocations(right) - reservoir.dislocations(left)
    wanted = np.stack([0 * HEIGHTS, reservoir.exact_slip(HEIGHTS)], axis=1)
    # 1e-9 m times the strain, and the rounding of sums of 300 m.
    near(jump, wanted, 1e-11)
    for side in (1e-4, -1e-4):
        x = np.stack([side + 0 * HEIGHTS, HEIGHTS], axis=1)
        there = stress(reservoir.dislocations, x, 1e-5, MODULI)
        near(there[:, 0, 0], 0, 1e-4 * 2e7)
        near(there[:, 0, 1], reservoir.exact_shear(HEIGHTS), 1e-4 * 2e7)
    off = np.array([[40.0, 20], [-90, 100], [60, 190]])
    residual = imbalance(reservoir.dislocations, off, 0.1, MODULI)
    assert np.abs(residual).max() < 1e-6 * abs(LOST)


def test_cohesion_holds_the_fault(monkeypatch: pytest.MonkeyPatch) -> None:
    """With an initial compression of 22 MPa, all between -a and a slips without it."""
    monkeypatch.setattr(reservoir, "INITIAL", 22e6)
    held = reservoir.solve(4, 1, reservoir.COHESION, reservoir.depletion)
    loose = reservoir.solve(4, 1, 0, reservoir.depletion)
    assert (held.result.status[-1] == bp.Status.STICK).all()
    assert not held.result.broken.any()
    # Neither more nor less shear than that of an intact fault.
    stronger = reservoir.solve(4, 1, 1e3 * reservoir.COHESION, reservoir.depletion)
    near(held.traction, stronger.traction, 1e-8 * 22e6)
    inside = np.abs(loose.z) <= reservoir.A
    assert (loose.slip[inside] < -0.02).all()  # m, downwards
