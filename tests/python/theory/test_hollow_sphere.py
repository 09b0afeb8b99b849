"""A hollow sphere of soil under internal pressure: closed form, order of convergence."""

import math
from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from bipot_rs.fem.bodies.elasticity import nodal_forces
from bipot_rs.theory.limit_load import LimitLoadError
from bipot_rs.theory.soil_body import Soil
from bipot_rs.theory.soils import DruckerPrager, tensor
from bipot_rs.theory.structure import Structure
from support.hollow_sphere import HollowSphere

pytestmark = pytest.mark.needs_extra

Array = NDArray[np.float64]
SPHERE = HollowSphere()
PRESSURE = 0.85 * SPHERE.limit


@cache
def loaded(n: int) -> tuple[Soil, Structure, Array]:
    """The body on ``n × n`` cells a patch, and the nodal forces of a unit pressure."""
    body = SPHERE.body(n)
    x = body.points
    planes = [3 * np.flatnonzero(np.abs(x[:, k]) < 1e-9) + k for k in range(3)]
    soil = DruckerPrager(SPHERE.alpha, SPHERE.beta, SPHERE.apex)
    inside = body.surface("inner")
    force = nodal_forces(body, inside, -np.asarray(inside.normals))
    wall = Soil.of_body(body, law=soil)
    return wall, Structure([], [wall], None, np.concatenate(planes)), force


@cache
def errors(n: int, steps: int = 1) -> Array:
    """Relative errors of the displacement inside and of the radial stress, in L²."""
    wall, structure, force = loaded(n)
    steps_solved = structure.solve(
        PRESSURE * np.linspace(0, 1, steps + 1)[1:, None] * force
    )
    body = wall.body
    radius = np.linalg.norm(body.points, axis=1)
    outward = body.points / radius[:, None]
    u = np.sum(steps_solved[-1].displacement.reshape(-1, 3) * outward, axis=1)
    exact = SPHERE.displacement(PRESSURE, np.array([SPHERE.inner]))[0]
    moved = u[radius < SPHERE.inner * (1 + 1e-9)].mean() / exact - 1
    places, weights = wall.quadrature.places, wall.quadrature.weights
    r = np.linalg.norm(places, axis=0)
    stress = np.einsum(
        "acq,cqab,bcq->cq", places, tensor(steps_solved[-1].stress[0]), places
    )
    radial, _ = SPHERE.stress(PRESSURE, r)
    wrong = np.sum(weights * (stress / r**2 - radial) ** 2)
    return np.array([abs(moved), math.sqrt(wrong / np.sum(weights * radial**2))])


def test_closed_form_satisfies_the_equations() -> None:
    """Equilibrium, the criterion, and flow of constant direction, by integration."""
    s, p = SPHERE, PRESSURE
    c = s.radius(p)
    assert s.inner < c < s.outer
    radial, hoop = s.stress(p, np.array([s.inner, s.outer]))
    assert radial == pytest.approx([-p, 0.0], abs=1e-14)
    r = np.linspace(s.inner, c - 1e-9, 50)
    radial, hoop = s.stress(p, r)
    shear = math.sqrt(2 / 3) * (hoop - radial)
    limit = s.alpha * (s.apex - (radial + 2 * hoop) / 3)
    assert shear == pytest.approx(limit, abs=1e-14)

    def rates(r: float, y: Array) -> list[float]:
        """``dσ_r/dr`` and ``du/dr`` in the plastic zone, from law and compatibility."""
        radial, u = y
        # σ_θ from the criterion: √(2/3) Q = α (a - σ_r - 2 Q/3).
        q = s.alpha * (s.apex - radial) / (math.sqrt(2 / 3) + 2 * s.alpha / 3)
        mean = radial + 2 * q / 3
        e_r = mean / (3 * s.bulk) - q / (3 * s.shear)
        e_t = mean / (3 * s.bulk) + q / (6 * s.shear)
        flow = (u / r - e_t) / (1 / math.sqrt(6) + s.beta / 3)
        return [2 * q / r, e_r + flow * (s.beta / 3 - math.sqrt(2 / 3))]

    start = [s.stress(p, np.array([c]))[0][0], s.displacement(p, np.array([c]))[0]]
    there = solve_ivp(rates, (c, s.inner), start, rtol=1e-11, atol=1e-14).y[:, -1]
    exact = s.displacement(p, np.array([s.inner]))[0]
    assert there == pytest.approx([-p, exact], rel=1e-8)


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


def test_steps_do_not_change_the_end() -> None:
    # The flow keeps its direction in the closed form; on the mesh nearly so.
    assert errors(2, 4) == pytest.approx(errors(2), abs=2e-4)


@pytest.mark.slow
def test_pressure_above_the_limit_is_refused() -> None:
    wall, structure, force = loaded(1)
    # The limit of a mesh is above that of the closed form.
    with pytest.raises(LimitLoadError, match="the load of step 1 is above") as caught:
        structure.solve(np.array([[0.8], [1.3]]) * SPHERE.limit * force)
    # Every point of the wall moves outwards.
    outward = caught.value.mechanism.reshape(-1, 3) * wall.body.points
    assert (outward.sum(axis=1) > 0).all()
