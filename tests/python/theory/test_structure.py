"""A structure of soil: patch test, triaxial and plane compression, B of (23), invariances."""

import math
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from bipot_rs import fem, theory
from bipot_rs.fem.bodies.elasticity import nodal_forces
from bipot_rs.mesh.boxes import box
from bipot_rs.mesh.elements import make_mesh, second_order
from bipot_rs.theory.functionals import measure_bifunctional
from bipot_rs.theory.soil_body import Soil
from bipot_rs.theory.soils import DruckerPrager, mandel, tensor
from bipot_rs.theory.structure import Contacts, Structure
from bipot_rs.theory.structure_state import StepNotConvergedError, StructureStep
from support.textbook import return_stress

pytestmark = pytest.mark.needs_extra

Array = NDArray[np.float64]
SOIL = DruckerPrager(0.5, 0.2, 1.0)
E, NU = 100.0, 0.3
BULK, SHEAR = E / (3 * (1 - 2 * NU)), E / (2 * (1 + NU))
TOL = 1e-12
CELLS = ["triangle", "quadrilateral", "tetrahedron", "hexahedron"]


def mesh_of(cell: str, *, n: int = 2, shaken: float = 0.15) -> Any:
    """Unit square or cube, the nodes inside moved at random."""
    d = 2 if cell in ("triangle", "quadrilateral") else 3
    mesh = box([np.linspace(0, 1, n + 1)] * d, cell)
    p = mesh.p.copy()
    inside = ((p > 1e-9) & (p < 1 - 1e-9)).all(axis=0)
    rng = np.random.default_rng(1)
    p[:, inside] += shaken / n * rng.uniform(-1, 1, (d, inside.sum()))
    moved = type(mesh)(p, mesh.t, mesh.boundaries)
    return second_order(moved, serendipity=cell in ("quadrilateral", "hexahedron"))


def body_of(mesh: Any) -> fem.Body:
    return fem.Body("soil", mesh, fem.Material(E, NU))


def structure_of(body: fem.Body, soil: DruckerPrager, fixed: Any) -> Structure:
    return Structure([], [Soil.of_body(body, law=soil)], None, fixed)


def body_in(structure: Structure) -> fem.Body:
    (soil,) = structure.soils
    return soil.body


def skin(body: fem.Body) -> Array:
    """Degrees of freedom of the nodes on the unit square or cube."""
    x = body.points
    nodes = np.flatnonzero(((x < 1e-9) | (x > 1 - 1e-9)).any(axis=1))
    return (body.dim * nodes[:, None] + np.arange(body.dim)).ravel()


def normal_supports(body: fem.Body, *names: str) -> Array:
    """Degrees of freedom along x, y, .. of the nodes at x = 0, y = 0, .. and of faces."""
    x = body.points
    dofs = [body.dim * np.flatnonzero(x[:, k] < 1e-9) + k for k in range(body.dim)] + [
        body.dim * body.nodes(name) + body.dim - 1 for name in names
    ]
    return np.unique(np.concatenate(dofs))


@pytest.mark.parametrize("cell", CELLS)
def test_patch_test(cell: str) -> None:
    """A linear displacement of the skin gives one strain, and the stress of one point."""
    body = body_of(mesh_of(cell))
    rng = np.random.default_rng(2)
    slope = np.zeros((3, 3))
    slope[: body.dim, : body.dim] = 0.03 * rng.normal(size=(body.dim, body.dim))
    fixed = skin(body)
    moved = (body.points @ slope[: body.dim, : body.dim].T).ravel()
    structure = structure_of(body, SOIL, fixed)
    (step,) = structure.solve(None, moved[fixed], tol=TOL)
    # 1e-12 of the stress, times the condition of the few free nodes.
    assert step.displacement == pytest.approx(moved, abs=1e-11)
    strain = 0.5 * (slope + slope.T)
    stress = return_stress(SOIL, BULK, SHEAR, np.zeros((3, 3)), strain)
    mean = np.trace(stress) / 3 * np.eye(3)
    plastic = mandel(strain - mean / (3 * BULK) - (stress - mean) / (2 * SHEAR))
    assert np.abs(plastic).max() > 1e-3
    assert np.abs(step.stress[0] - mandel(stress)).max() < 1e-9
    assert np.abs(step.plastic_strain[0] - plastic).max() < 1e-11


@pytest.mark.quick_variants("newton")
@pytest.mark.parametrize("method", ["newton", "displacements"])
def test_triaxial_compression(method: str) -> None:
    """A cube under the cell pressure 0.5, then compressed along z to a strain of 4 %."""
    body = body_of(mesh_of("hexahedron"))
    fixed = normal_supports(body, "top")
    down = (fixed % 3 == 2) & (body.points[fixed // 3, 2] > 0.5)
    structure = structure_of(body, SOIL, fixed)
    load = nodal_forces(body, body.surface("right"), [-0.5, 0.0, 0.0])
    load += nodal_forces(body, body.surface("back"), [0.0, -0.5, 0.0])
    moved = np.zeros((5, len(fixed)))
    moved[:, down] = -np.array([0.002, 0.015, 0.02, 0.04, 0.038])[:, None]
    start = structure.at_rest([-0.5 * np.eye(3)])
    steps = structure.solve(load, moved, start=start, method=method, tol=TOL)
    force = np.array([-step.support[down].sum() for step in steps])
    # Elastic below the limit: the deviator q = σ_lateral - σ_axial grows by E per strain.
    assert force[0] == pytest.approx(0.5 + E * 0.002, rel=1e-10)
    assert np.abs(steps[0].plastic_strain[0]).max() == 0.0
    # At the limit √(2/3) q = α (a + p + q/3), with the cell pressure p = 0.5.
    alpha = SOIL.friction
    q = 3 * alpha * (SOIL.apex + 0.5) / (math.sqrt(6) - alpha)
    assert q > E * 0.002
    # The tolerance of the step, 1e-12 of energies, is the square root in the stress.
    assert force[1:4] == pytest.approx(0.5 + q, rel=1e-9)
    # The flow: e along (1, 1, -2)/√6 and ε_v = β |e|. The axial plastic strain is then
    # -(√(2/3) - β/3) |e|.
    plastic = tensor(steps[3].plastic_strain[0])
    axial = 0.04 - q / E
    size = axial / (math.sqrt(2 / 3) - SOIL.dilatancy / 3)
    assert plastic[..., 2, 2] == pytest.approx(-axial, rel=1e-9)
    volume = np.trace(plastic, axis1=-2, axis2=-1)
    assert volume == pytest.approx(SOIL.dilatancy * size, rel=1e-9)
    # It is not normal to the criterion, which would dilate by α |e|.
    assert volume.max() < 0.41 * SOIL.friction * size
    # Unloading is elastic and keeps the plastic strain.
    assert force[4] == pytest.approx(0.5 + q - E * 0.002, rel=1e-9)
    assert np.array_equal(steps[4].plastic_strain[0], steps[3].plastic_strain[0])
    assert all(step.gap_soil <= TOL and step.imbalance <= TOL for step in steps)


def plane_limit(beta: float) -> float:
    """Strength of plane compression without lateral pressure, for SOIL's α and a.

    In the limit state the flow has no strain across the plane, s_zz = -β |s|/3, so that the
    radius of the circle in the plane is R = (a - P) α √((1 - β²/6)/2) / (1 - α β/6) at the
    mean stress P of the plane.
    """
    alpha = SOIL.friction
    sine = alpha * math.sqrt((1 - beta**2 / 6) / 2) / (1 - alpha * beta / 6)
    return 2 * SOIL.apex * sine / (1 - sine)


@pytest.mark.slow_variants("*-triangle")
@pytest.mark.parametrize("cell", ["triangle", "quadrilateral"])
@pytest.mark.parametrize("beta", [0.0, 0.2, 0.5])
def test_plane_compression(cell: str, beta: float) -> None:
    body = body_of(mesh_of(cell))
    fixed = normal_supports(body, "top")
    down = (fixed % 2 == 1) & (body.points[fixed // 2, 1] > 0.5)
    soil = DruckerPrager(SOIL.friction, beta, SOIL.apex)
    moved = np.zeros((12, len(fixed)))
    moved[:, down] = -np.linspace(0.02, 0.4, 12)[:, None]
    steps = structure_of(body, soil, fixed).solve(None, moved, tol=TOL)
    # The stress across the plane decays geometrically to that of the limit state.
    assert -steps[-1].support[down].sum() == pytest.approx(plane_limit(beta), rel=1e-9)
    # The flow in the plane dilates by the angle sin ψ = β/√(2 (1 - β²/6)).
    rate = tensor(steps[-1].plastic_strain[0] - steps[-2].plastic_strain[0])
    sine = (rate[..., 0, 0] + rate[..., 1, 1]) / (rate[..., 0, 0] - rate[..., 1, 1])
    expected = beta / math.sqrt(2 * (1 - beta**2 / 6))
    assert sine == pytest.approx(expected, abs=1e-8)


@cache
def pressed(soil: DruckerPrager = SOIL) -> tuple[Structure, tuple[StructureStep, ...]]:
    """A block on a rough base, pressed on the left half of its top, in three steps."""
    body = body_of(mesh_of("quadrilateral", n=4))
    x = body.points
    base = np.flatnonzero(x[:, 1] < 1e-9)
    top = np.flatnonzero((x[:, 1] > 1 - 1e-9) & (x[:, 0] < 0.5 + 1e-9))
    fixed = np.concatenate([2 * base, 2 * base + 1, 2 * top + 1])
    moved = np.zeros((3, len(fixed)))
    moved[:, 2 * len(base) :] = -np.array([0.01, 0.03, 0.05])[:, None]
    structure = structure_of(body, soil, fixed)
    return structure, structure.solve(None, moved, tol=1e-10)


def test_bifunctional_is_zero_at_the_solution_and_measures_errors() -> None:
    structure, steps = pressed()
    load = np.zeros(body_in(structure).points.size)
    start, end = steps[1], steps[2]
    work = end.work
    # Difference of energies of this size, and equilibrium to 1e-10.
    assert abs(measure_bifunctional(structure, start, end, load)) < 1e-9 * work
    # Another admissible displacement: the elastic energy of the error, exactly.
    rng = np.random.default_rng(3)
    error = 1e-3 * rng.normal(size=load.shape)
    error[structure.fixed] = 0.0
    energy = 0.5 * error @ structure.elastic @ error
    wrong = replace(end, displacement=end.displacement + error)
    value = measure_bifunctional(structure, start, wrong, load)
    assert value == pytest.approx(energy, rel=1e-8)
    # A stress outside the criterion has no finite B.
    outside = replace(end, stress=(1.5 * end.stress[0],))
    assert measure_bifunctional(structure, start, outside, load) == math.inf


def test_rotation_of_the_mesh() -> None:
    body = body_of(mesh_of("tetrahedron", n=2))
    rng = np.random.default_rng(5)
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    turn[:, 0] *= np.linalg.det(turn)
    x = body.points
    moved = 0.03 * np.stack(
        [np.sin(3 * x[:, 1]), x[:, 0] * x[:, 2], -(x[:, 2] ** 2)], axis=1
    )
    fixed = skin(body)
    (straight,) = structure_of(body, SOIL, fixed).solve(
        None, moved.ravel()[fixed], tol=TOL
    )
    mesh = body.mesh
    turned = body_of(type(mesh)(turn @ mesh.p, mesh.t))
    prescribed = (moved @ turn.T).ravel()[fixed]
    (two,) = structure_of(turned, SOIL, fixed).solve(None, prescribed, tol=TOL)
    assert np.abs(straight.plastic_strain[0]).max() > 1e-3
    u = straight.displacement.reshape(-1, 3) @ turn.T
    assert two.displacement == pytest.approx(u.ravel(), abs=1e-11)
    expected = turn @ tensor(straight.stress[0]) @ turn.T
    assert tensor(two.stress[0]) == pytest.approx(expected, abs=1e-8)


def test_initial_stress_in_equilibrium_moves_nothing() -> None:
    """Weight with the earth pressure of rest: no displacement, and no flow."""
    body = body_of(mesh_of("quadrilateral"))
    sides = normal_supports(body)
    fixed = np.union1d(sides, 2 * body.nodes("right"))
    structure = structure_of(body, SOIL, fixed)
    weight = nodal_forces(body, body.volume(), [0.0, -2.0])

    def at_rest(x: Array) -> Array:
        vertical = 2.0 * (x[1] - 1.0)
        stresses = np.zeros((3, 3, *vertical.shape))
        stresses[1, 1], stresses[0, 0], stresses[2, 2] = (
            vertical,
            0.5 * vertical,
            0.5 * vertical,
        )
        return stresses

    (step,) = structure.solve(weight, start=structure.at_rest([at_rest]), tol=TOL)
    # Rounding relative to the elastic settlement of the layer, about 0.01.
    assert np.abs(step.displacement).max() < 1e-15
    assert np.abs(step.plastic_strain[0]).max() == 0.0
    # Without the initial stress the weight settles it.
    (other,) = structure.solve(weight)
    assert np.abs(other.displacement).max() > 1e-3


def test_volumes_with_their_own_moduli() -> None:
    """Two layers in a smooth box settle by the sum of what each settles."""
    coarse = box([np.linspace(0, 1, 3), np.linspace(0, 1, 5)], "quadrilateral")
    mesh = second_order(coarse, serendipity=True)
    low = np.flatnonzero(mesh.p[1, mesh.t].mean(axis=0) < 0.5)
    high = np.setdiff1d(np.arange(mesh.t.shape[1]), low)
    layers = mesh.with_subdomains({"low": low, "high": high})
    soft, stiff = (
        fem.Material(E, NU, thickness=2.0),
        fem.Material(3 * E, NU, thickness=2.0),
    )
    body = fem.Body("layers", layers, {"low": soft, "high": stiff})
    fixed = np.union1d(normal_supports(body), 2 * body.nodes("right"))
    structure = structure_of(body, SOIL, fixed)
    load = nodal_forces(body, body.surface("top"), [0.0, -0.5])
    # Confined compression at ν = 0.3 stays elastic at this α.
    (step,) = structure.solve(load, tol=TOL)
    confined = E * (1 - NU) / ((1 + NU) * (1 - 2 * NU))
    settled = 0.5 * (0.5 / confined + 0.5 / (3 * confined))
    assert step.displacement.min() == pytest.approx(-settled, rel=1e-12)
    # The base carries the load on the thickness 2.
    base = (fixed % 2 == 1) & (body.points[fixed // 2, 1] < 1e-9)
    assert step.support[base].sum() == pytest.approx(0.5 * 2.0, rel=1e-12)


def test_a_step_that_does_not_converge_keeps_the_steps_before() -> None:
    structure, steps = pressed()
    last = steps[-1].displacement[structure.fixed]
    # The first step is elastic.
    moved = np.array([0.02, 1.0])[:, None] * last
    with pytest.raises(
        StepNotConvergedError, match="step 1 did not converge"
    ) as caught:
        structure.solve(None, moved, method="displacements", max_iterations=3)
    error = caught.value
    assert len(error.steps) == 1
    assert error.steps[0].converged
    assert not error.last.converged
    assert len(error.last.history) == 3


BODY = body_of(mesh_of("quadrilateral"))
HELD = normal_supports(BODY)
WOOD = fem.Orthotropic((1.0, 2.0, 3.0), (0.1, 0.1, 0.1), (1.0, 1.0, 1.0))
FLAT = fem.Material(E, NU, plane_stress=True)
SQUARE = np.array([[0.0, 0], [1, 0], [1, 1], [0, 1]])


def soil_of(corners: Array, cells: Any = (range(8),), weight: float = 0.0) -> Soil:
    """A body of cells of eight nodes."""
    points = np.concatenate([corners, (corners + np.roll(corners, -1, axis=0)) / 2])
    return theory.Soil(points, np.array(cells), E, NU, 30.0, 0.0, 1.0, weight)


def two_parts() -> Structure:
    """Only the left one is held."""
    cells = BODY.cells[:, BODY.kind.order_of_vtk]
    points = np.concatenate([BODY.points, np.add(BODY.points, [2.0, 0.0])])
    cells = np.concatenate([cells, cells + len(BODY.points)])
    pair = body_of(make_mesh("quad8", points, cells)[0])
    x = pair.points
    left = np.flatnonzero((x[:, 0] < 1.5) & (x < 1e-9).any(axis=1))
    return structure_of(pair, SOIL, np.concatenate([2 * left, 2 * left + 1]))


def start_from(stress: Any) -> Any:
    return structure_of(BODY, SOIL, HELD).at_rest(stress)


def solve(**changed: Any) -> Any:
    return structure_of(BODY, SOIL, HELD).solve(**changed)


def of_parts(**parts: Any) -> Structure:
    return Structure(**{"bodies": [np.eye(2)]} | parts)


MISTAKES: list[tuple[Callable[[], Any], str]] = [
    (lambda: structure_of(BODY, 0.3, HELD), r"law is 0\.3, expected 'mohr-"),  # type: ignore[arg-type]
    (lambda: structure_of(1, SOIL, HELD), r"body is a int, expected a bipot_rs\.fem\."),  # type: ignore[arg-type]
    (lambda: structure_of(BODY, SOIL, HELD[HELD % 2 == 0]),
     "fixed leaves a rigid motion of body 'soil'"),
    (two_parts, r"the part with its centre at \(2\.5"),
    (lambda: structure_of(fem.Body("sheet", BODY.mesh, FLAT), SOIL, HELD),
     "body 'sheet' is in plane stress"),
    (lambda: structure_of(fem.Body("plank", BODY.mesh, WOOD), SOIL, HELD),
     "'plank' has an orthotropic material"),
    (lambda: start_from([2.0 * np.eye(3)]), "stress of start violates the criterion"),
    (lambda: start_from([np.eye(2)]), r"stress has shape \(2, 2\), expected"),
    (lambda: start_from(-np.eye(3)), "stress has 3 fields, expected at most 1"),
    (lambda: start_from([np.eye(3, k=1)]), "stress is not symmetric"),
    (lambda: solve(method="secant"), "method is 'secant', expected 'newton' or"),
    (lambda: solve(tol=0.0), r"tol is 0\.0, expected a number between"),
    (lambda: solve(start=np.zeros(3)), "start is"),
    (lambda: of_parts(bodies=np.eye(2)), "bodies is a ndarray, expected a list"),
    (lambda: of_parts(bodies=[np.ones((2, 3))]), r"K has shape \(2, 3\), expected a sq"),
    (lambda: of_parts(bodies=[np.triu(np.ones((2, 2)))]), "K is not symmetric at row 0"),
    (lambda: of_parts(bodies=[np.diag([1.0, -1.0])]), "K is indefinite"),
    (lambda: of_parts(contacts=(np.eye(2), [0.0], 0.3)), "contacts is a tuple, expected"),
    (lambda: of_parts(contacts=Contacts(np.eye(2), "x", 0.3)), "gap has entries of type"),
    (lambda: soil_of(SQUARE, [range(1, 9)]), "nodes from 1 to 8, expected 0 to 7, rows of"),
    (lambda: soil_of(SQUARE, [range(-1, 7)]), "nodes from -1 to 6"),
    (lambda: soil_of(SQUARE, np.zeros((0, 8), int)), "cells is empty"),
    (lambda: soil_of(SQUARE, weight=np.nan), "weight is nan, expected a finite number"),
    (lambda: soil_of(SQUARE * [1, 0]), "cell 0 of body 'soil' is folded or flat"),
    (lambda: soil_of(SQUARE[[0, 2, 1, 3]]), "cell 0 of body 'soil' is folded or flat"),
]  # fmt: skip


@pytest.mark.parametrize(("call", "words"), MISTAKES)
def test_wrong_arguments_are_named(call: Callable[[], Any], words: str) -> None:
    with pytest.raises((TypeError, ValueError), match=words):
        call()


def test_a_model_with_cohesion_breaks_as_its_problem() -> None:
    """`fem.Assembly` has the law of its contacts; a block is pressed, pulled and dragged."""
    grid = box([np.linspace(0.0, 1.0, 5)] * 2, "quadrilateral")
    block = fem.Body("block", grid, fem.Material(E, NU))
    glue: dict[str, Any] = {"cohesion": 0.4, "dilatancy": 0.1}
    wall = fem.Contact("block", "bottom", 0.3, plane=((0, 0), (0, 1)), **glue)
    model = fem.assemble([block], [wall], [fem.Support("block", "top", (0, 1))])
    vertical = model.fixed % 2 == 1
    moved = np.zeros((4, len(model.fixed)))
    moved[:, ~vertical] = np.array([[0.0], [0.01], [0.03], [0.05]])
    moved[:, vertical] = np.array([[-0.01], [-0.01], [0.002], [-0.005]])
    # Tilted, so that some contacts open.
    moved[:, vertical] += np.linspace(-0.01, 0.01, vertical.sum())
    structure = Structure([block], contacts=model, fixed=model.fixed)
    steps = structure.solve(prescribed=moved, tol=TOL)
    result = model.problem().solve(None, moved, tol=1e-13)
    for step, other in zip(steps, result, strict=True):
        # Rounding of both stiffnesses, times their condition.
        scale = np.abs(other.reaction).max()
        assert np.abs(step.reaction - other.reaction).max() < 1e-12 * scale
        assert np.array_equal(step.broken, other.broken)
        assert np.abs(step.dilation - other.dilation).max() < 1e-14
    assert 0 < steps[-1].broken.sum() < len(steps[-1].broken)
    again = structure.solve(prescribed=moved[2:], start=steps[1], tol=TOL)[-1]
    assert np.array_equal(again.displacement, steps[-1].displacement)


def test_a_tolerance_below_rounding_is_the_reason() -> None:
    """The stress across the plane is the intermediate one; it is not blamed."""
    body = body_of(mesh_of("quadrilateral"))
    soil = theory.Soil.of_body(body, 20.0, 5.0, 1.0)
    fixed = normal_supports(body)
    structure = Structure([], [soil], fixed=fixed)
    moved = 1e-3 * np.random.default_rng(3).normal(size=len(structure.fixed))
    with pytest.raises(
        StepNotConvergedError, match="rounding: tol is 1e-30, use a larger"
    ):
        structure.solve(prescribed=moved, tol=1e-30)
