"""Stresses from displacements, and initial strains, compared with closed forms."""

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.sparse.linalg import spsolve

from bipot_rs import fem
from bipot_rs.fem.bodies import stress_recovery
from support.boxes import CELLS, box
from support.comparisons import close, near, refused

Floats = NDArray[np.float64]
# Rotated about the axes by arbitrary angles.
ROTATION = np.linalg.qr(np.random.default_rng(8).normal(size=(3, 3)))[0]
YOUNG, POISSON, ALPHA, HEAT = 210e9, 0.3, 12e-6, 80.0


def mesh(cell: str, degree: int = 1, bent: float = 0.06) -> Any:
    return box(cell, degree=degree, bent=bent, seed=5)


def displaced(model: fem.Assembly, f: Floats, held: Any) -> Floats:
    """Displacements where nothing moves but what is not held."""
    free = np.delete(np.arange(model.n), held)
    u, K = np.zeros(model.n), model.K.tocsc()
    u[free] = spsolve(K[free][:, free], f[free])
    return u


@pytest.mark.parametrize("cell", CELLS)
@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("plane_stress", [False, True])
def test_linear_displacement_has_the_stress_of_hooke(
    cell: str, degree: int, plane_stress: bool
) -> None:
    d = CELLS[cell]
    material = fem.Material(YOUNG, POISSON, plane_stress=plane_stress)
    body = fem.Body("it", mesh(cell, degree), material)
    gradient = 1e-3 * np.random.default_rng(1).uniform(-1, 1, (d, d))
    u = body.points @ gradient.T
    stresses = stress_recovery.stress(body, u, space=True)
    strain = np.zeros((3, 3))
    strain[:d, :d] = 0.5 * (gradient + gradient.T)
    if d == 2 and plane_stress:
        strain[2, 2] = -POISSON / (1 - POISSON) * np.trace(strain)
    # Hooke's law in terms of E and ν, not of Lamé's constants.
    bulk, G = YOUNG / (3 * (1 - 2 * POISSON)), YOUNG / (2 * (1 + POISSON))
    mean = np.trace(strain) / 3 * np.eye(3)
    wanted = 3 * bulk * mean + 2 * G * (strain - mean)
    # Gradients on cells of size 1/3 lose a digit of the displacement.
    near(stresses - wanted, 0, 1e-12 * YOUNG * 1e-3)
    plane = stress_recovery.stress(body, u.ravel())
    np.testing.assert_array_equal(plane, stresses[:, :d, :d])


@pytest.mark.parametrize("cell", CELLS)
@pytest.mark.parametrize("degree", [1, 2])
def test_mean_stress_is_the_integral_over_the_cell(cell: str, degree: int) -> None:
    """Compared with the integral of the stress at each point, for two materials and an
    initial strain, which the averaged gradients do not contain."""
    made = mesh(cell, degree)
    left = made.p[0, made.t].mean(axis=0) < 0.5
    parts = {"left": np.flatnonzero(left), "right": np.flatnonzero(~left)}
    wood = fem.Orthotropic((11e9, 0.9e9, 0.5e9), (0.3, 0.4, 0.4), (0.7e9, 0.6e9, 0.1e9))
    laws = {"left": fem.Material(YOUNG, POISSON), "right": wood}
    body = fem.Body("it", made.with_subdomains(parts), laws)
    u = 1e-3 * np.random.default_rng(2).normal(size=body.points.shape)
    heat = stress_recovery.thermal(ALPHA, lambda x: HEAT * np.sin(3 * x[0]))
    at_points = stress_recovery.stress_at_points(body, u, heat)
    weights = body.volume().weights
    wanted = np.einsum("abcq,cq->cab", at_points, weights)
    wanted /= weights.sum(axis=1)[:, None, None]
    stresses = stress_recovery.stress(body, u, heat, space=True)
    # Sums of 27 points of 27 nodes in another order.
    near(stresses, wanted, 1e-12 * np.abs(at_points).max())
    np.testing.assert_array_equal(stresses, stresses.swapaxes(1, 2))


def free(body: fem.Body, strain: stress_recovery.Initial) -> tuple[Floats, Floats]:
    """Displacement and stress of a body without supports, held at three nodes."""
    model = fem.assemble([body], [])
    d, x = body.dim, body.points
    f = model.initial_strain("it", strain)
    # Resultant force and moment of loads in equilibrium: rounding.
    near(f.reshape(-1, d).sum(axis=0), 0, 1e-12 * np.abs(f).max())
    # Held at three nodes, like a table on three legs: the supports carry no force.
    corner = [int(np.argmin(np.abs(x - at).sum(axis=1))) for at in np.eye(d + 1, d, -1)]
    held = [d * node + c for k, node in enumerate(corner) for c in range(k, d)]
    u = displaced(model, f, held)
    return u.reshape(-1, d), stress_recovery.stress(body, u, strain, space=True)


@pytest.mark.parametrize("cell", CELLS)
@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("name", ["plane strain", "plane stress", "wood"])
def test_free_expansion_has_no_stress(cell: str, degree: int, name: str) -> None:
    d = CELLS[cell]
    material: Any = fem.Material(YOUNG, POISSON, plane_stress=name == "plane stress")
    alpha: Any = ALPHA
    if name == "wood":
        constants = (12e9, 0.8e9, 0.5e9), (0.4, 0.35, 0.5), (0.7e9, 0.6e9, 0.05e9)
        axes = [[0.8, 0.6], [-0.6, 0.8]] if d == 2 else ROTATION
        material = fem.Orthotropic(*constants, axes=axes, plane_stress=d == 2)
        alpha = (5e-6, 30e-6, 40e-6)
    body = fem.Body("it", mesh(cell, degree), material)
    heat = fem.thermal(alpha, HEAT, axes=material.directions)
    u, stresses = free(body, heat)
    grown = np.asarray(heat)[:d, :d].copy()
    out = np.zeros((3, 3))
    if d == 2 and name == "plane strain":
        # Expansion that the plane prevents becomes in-plane expansion and stress.
        grown *= 1 + POISSON
        out[2, 2] = -YOUNG * ALPHA * HEAT
    # Condition of the mesh, 1e3, times rounding of the strain times the modulus.
    near(stresses - out, 0, 1e-10 * YOUNG * ALPHA * HEAT)
    arm = body.points - body.points[0]
    # Up to a rotation, whose gradient is skew.
    gradient = np.linalg.lstsq(arm, u - u[0] - arm @ grown.T, rcond=None)[0]
    near(gradient + gradient.T, 0, 1e-10 * ALPHA * HEAT)


def test_second_order_bends_without_stress_in_a_linear_temperature() -> None:
    """A temperature that is linear in space bends a body without stress (Boley)."""
    heat = fem.thermal(ALPHA, lambda x: HEAT * (1 + x[0] - 2 * x[2]))
    stresses = {}
    for degree in (1, 2):
        made, steel = (
            mesh("tetrahedron", degree, bent=0.0),
            fem.Material(YOUNG, POISSON),
        )
        _, stresses[degree] = free(fem.Body("it", made, steel), heat)
    near(stresses[2], 0, 1e-10 * YOUNG * ALPHA * HEAT)
    # Linear elements cannot bend in this way: their error is discretisation, not rounding.
    assert np.abs(stresses[1]).max() > 1e-3 * YOUNG * ALPHA * HEAT


def test_invalid_initial_strains() -> None:
    body = fem.Body("it", mesh("triangle"), fem.Material(YOUNG, POISSON))
    model = fem.assemble([body], [])
    strain: Any
    for strain, message in (
        ([1.0, 2.0], r"strain of body 'it' has shape \(2,\)"),
        ([[0.0, 1.0], [0.0, 0.0]], "is not symmetric"),
        ([[0, 0, 1.0], [0, 0, 0], [1.0, 0, 0]], "has shear out of the plane"),
        ({"warm": np.eye(2)}, "no volume 'warm': its mesh"),
        (fem.thermal(1.0, lambda _: np.zeros(3)), "temperature has shape"),
    ):
        with refused(message):
            model.initial_strain("it", strain)
    with refused(r"expansion has shape \(2,\)"):
        fem.thermal([1.0, 2.0], 3.0)
    with refused(r"displacement has shape \(3,\), expected"):
        stress_recovery.stress(body, np.zeros(3))
    with refused("space=True"):
        fem.von_mises(np.zeros((4, 2, 2)))


@pytest.mark.parametrize("cell", CELLS)
def test_internal_forces_are_those_of_the_stiffness(cell: str) -> None:
    """K u computed in another way: ∫ σ : ∇φ with the stress of u."""
    body = fem.Body("it", mesh(cell, 2), fem.Material(2.0, 0.3, thickness=0.4))
    u = np.random.default_rng(0).uniform(-1, 1, body.points.size)
    at_points = stress_recovery.stress_at_points(body, u)
    ours = stress_recovery.internal_forces(body, at_points)
    close(ours, fem.stiffness(body) @ u, 1e-12)


def test_von_mises() -> None:
    pull = np.diag([-3.0, 0.0, 0.0])
    shear = np.zeros((3, 3))
    shear[0, 1] = shear[1, 0] = 2.0
    every = np.stack([pull, shear, 5 * np.eye(3), pull + 7 * np.eye(3)])
    exact = [3.0, 2 * np.sqrt(3), 0.0, 3.0]
    np.testing.assert_allclose(fem.von_mises(every), exact, rtol=1e-14)
    turn, _ = np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))
    np.testing.assert_allclose(fem.von_mises(turn @ every @ turn.T), exact, atol=1e-14)
