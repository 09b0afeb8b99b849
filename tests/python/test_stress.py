"""Stress of displacements, and initial strains, beside closed forms."""

import numpy as np
import pytest
from numpy.typing import NDArray

from bipot_rs import elements, fem, stress

Floats = NDArray[np.float64]
CELLS = {"triangle": 2, "quadrilateral": 2, "tetrahedron": 3, "hexahedron": 3}
YOUNG, POISSON, ALPHA, HEAT = 210e9, 0.3, 12e-6, 80.0


def mesh(cell: str, degree: int = 1, bent: float = 0.06) -> object:
    made = fem.box([np.linspace(0, 1, 4)] * CELLS[cell], cell)
    random = np.random.default_rng(5)
    moved = made.p + bent * random.uniform(-1, 1, made.p.shape)
    made = type(made)(moved, made.t).with_boundaries(made.boundaries)
    return made if degree == 1 else elements.second_order(made)


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
    found = stress.stress(body, body.points @ gradient.T, space=True)
    strain = np.zeros((3, 3))
    strain[:d, :d] = 0.5 * (gradient + gradient.T)
    if d == 2 and plane_stress:
        strain[2, 2] = -POISSON / (1 - POISSON) * np.trace(strain)
    # Hooke's law in the form of the moduli, not of Lame's constants.
    bulk = YOUNG / (3 * (1 - 2 * POISSON))
    G = YOUNG / (2 * (1 + POISSON))
    mean = np.trace(strain) / 3 * np.eye(3)
    wanted = 3 * bulk * mean + 2 * G * (strain - mean)
    # Slopes of cells of size 1/3 lose a digit of the displacement.
    np.testing.assert_allclose(
        found, np.broadcast_to(wanted, found.shape), atol=1e-12 * YOUNG * 1e-3
    )
    np.testing.assert_array_equal(
        stress.stress(body, (body.points @ gradient.T).ravel()), found[:, :d, :d]
    )
