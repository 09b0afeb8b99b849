"""A hollow sphere of soil under internal pressure: closed form, order of convergence."""

import math
from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray

from bipot_rs.fem.bodies.elasticity import nodal_forces
from bipot_rs.theory.soil_body import Soil
from bipot_rs.theory.soils import DruckerPrager, tensor
from bipot_rs.theory.structure import Structure
from support.hollow_sphere import HollowSphere

pytestmark = pytest.mark.needs_extra

Array = NDArray[np.float64]
SPHERE = HollowSphere()
PRESSURE = 0.85 * SPHERE.limit


@cache
def errors(n: int) -> Array:
    """Of the displacement inside and, in L², the radial stress, on n × n cells a patch."""
    body = SPHERE.body(n)
    x, inside = body.points, body.surface("inner")
    planes = [3 * np.flatnonzero(np.abs(x[:, k]) < 1e-9) + k for k in range(3)]
    force = nodal_forces(body, inside, -PRESSURE * np.asarray(inside.normals))
    soil = DruckerPrager(SPHERE.alpha, SPHERE.beta, SPHERE.apex)
    wall = Soil.of_body(body, law=soil)
    (step,) = Structure([], [wall], None, np.concatenate(planes)).solve(force)
    radius = np.linalg.norm(x, axis=1)
    u = np.sum(step.displacement.reshape(-1, 3) * x / radius[:, None], axis=1)
    exact = SPHERE.displacement(PRESSURE, np.array([SPHERE.inner]))[0]
    moved = u[radius < SPHERE.inner * (1 + 1e-9)].mean() / exact - 1
    places, weights = wall.quadrature.places, wall.quadrature.weights
    r = np.linalg.norm(places, axis=0)
    stress = np.einsum("acq,cqab,bcq->cq", places, tensor(step.stress[0]), places)
    radial, _ = SPHERE.stress(PRESSURE, r)
    wrong = np.sum(weights * (stress / r**2 - radial) ** 2)
    return np.array([abs(moved), math.sqrt(wrong / np.sum(weights * radial**2))])


def test_errors_of_a_coarse_mesh() -> None:
    # Cells of second order: within half a percent.
    assert (errors(2) < 5e-3).all()
    assert (errors(1) > 5 * errors(2)).all()


@pytest.mark.slow
def test_order_of_convergence() -> None:
    displacement, stress = np.log2(errors(2) / errors(4))
    # Second order; the edge of the plastic zone is a kink of the stress.
    assert displacement > 1.9
    assert stress > 1.9
