"""Obstacles whose normals change: each load step has the geometry of its own position."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest

import bipot_rs as bp
from bipot_rs import fem
from bipot_rs import obstacle as ob
from bipot_rs.discretisation.estimator import Estimator
from bipot_rs.fem.paraview import contact_fields
from bipot_rs.fem.resultants import contact_force, support_force
from bipot_rs.petsc.run.distributed import DistributedProblem
from support.boxes import box, placed
from support.comparisons import near, refused
from support.rollers import block, roller

pytestmark = pytest.mark.needs_extra

TOL = 1e-13
RADIUS, DEPTH, WAY = 50.0, 1.0, 8.0  # mm


def plate(n: int = 20, turn: Any = None, low: float = -20.0) -> fem.Body:
    """A plate of 40 mm x 20 mm, or less, its top at y = 0, in N and mm."""
    axes = [np.linspace(low, 20.0, n + 1), np.linspace(-20.0, 0.0, 11)]
    mesh = fem.box(axes, "quadrilateral")
    mesh = mesh if turn is None else placed(mesh, turn @ mesh.p)
    return fem.Body("plate", mesh, fem.Material(2000.0, 0.3))


def rolled(
    ways: Sequence[Sequence[float]],
    angles: Sequence[float] | None = None,
    mu: float = 0.0,
    pairing: str = "match",
    turn: np.ndarray | None = None,
    *,
    half: bool = False,
) -> tuple[fem.Assembly, bp.Result]:
    """The plate, or half of it, under a roller that starts above its middle."""
    turn = np.eye(2) if turn is None else turn
    centre = turn @ [0.0, RADIUS]
    motion = ob.Motion(np.array(ways) @ turn.T, angles, about=centre)
    disc = ob.Cylinder(centre, RADIUS)
    contact = fem.Contact(
        "plate", "top", mu, obstacle=disc, motion=motion, pairing=pairing
    )
    ground = fem.Support("plate", "bottom", (0, 1))
    body = plate(10, turn, 0.0) if half else plate(turn=turn)
    planes = [fem.Symmetry("plate", "left")] if half else []
    model = fem.assemble([body], [contact], [ground], symmetries=planes)
    return model, model.problem().solve(tol=TOL)


def turned(angle: float) -> np.ndarray:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s], [s, c]])


PRESSED_AND_MOVED = [[0.0, -DEPTH], [WAY, -DEPTH]]


@pytest.mark.parametrize("pairing", ["match", "mortar"])
def test_a_roller_that_will_move_presses_straight_before(pairing: str) -> None:
    """Without friction, the force of step 1 has no component along x, by symmetry."""
    _, rolled_result = rolled(PRESSED_AND_MOVED, pairing=pairing)
    force = rolled_result.resultant
    assert force[0, 1] < -100.0
    # 1e-10: some digits less than the tolerance of the solver.
    assert abs(force[0, 0]) < 1e-10 * abs(force[0, 1])
    # The state after the motion is that of a roller pressed there in one step.
    _, there = rolled([[WAY, -DEPTH]], pairing=pairing)
    np.testing.assert_allclose(force[1], there.resultant[0], rtol=1e-9)


@pytest.mark.parametrize("pairing", ["match", "mortar"])
def test_turned_as_a_whole_it_is_the_same(pairing: str) -> None:
    turn = turned(0.7)
    path = [[0.0, -DEPTH], [2.0, -DEPTH], [4.0, -DEPTH]], [0.0, -0.02, -0.04]
    _, other = rolled(*path, 0.3, pairing, turn)
    _, plain = rolled(*path, 0.3, pairing)
    assert {0, 1, 2} <= set(plain.status.ravel().tolist())
    assert np.array_equal(other.status, plain.status)
    size = np.abs(plain.reaction).max()
    near(other.resultant @ turn, plain.resultant, 1e-9 * size)
    near(np.abs(other.slip), np.abs(plain.slip), 1e-9 * WAY)


def test_planes_that_move_keep_the_frames_of_the_problem() -> None:
    """A translated plane, and one that turns about its normal, change no frame."""
    body = fem.Body("plate", box("hexahedron"), fem.Material(1, 0.3))
    plane = ob.Plane([0.5, 0.5, 1.0], [0, 0, -1.0])
    for motion in (
        ob.Motion([[0.1, 0.0, -0.1], [0.0, 0.2, -0.2]]),
        ob.Motion(rotation=[0.5, -2.0], about=plane.point, axis=[0.0, 0.0, 1.0]),
    ):
        contact = fem.Contact("plate", "top", 0.3, obstacle=plane, motion=motion)
        model = fem.assemble([body], [contact])
        assert isinstance(model.moving, np.ndarray)
        met = ob.approach(plane, motion, model.points)
        gaps = -np.einsum("cij,kcj->kci", model.frame, met.drag)
        gaps[:, :, 0] = met.distance
        assert np.array_equal(model.moving, gaps[1:])


def test_forces_of_supports_and_contacts_balance_in_each_step() -> None:
    case = roller().assemble()
    model, result = case.model, case.solve(tol=TOL)
    pushed = contact_force(model, result, "block.top")
    size = np.abs(pushed).max()
    near(pushed, -support_force(model, result, "block.bottom"), 1e-9 * size)
    near(pushed, result.resultant, 1e-12 * size)
    table = result.table()
    for k, axis in enumerate("xy"):
        near(table[f"force_{axis}"], pushed[:, k], 1e-12 * size)
    # In fields for ParaView forces are global too.
    for step, force in zip(result, pushed, strict=True):
        fields = contact_fields(model, step)
        np.testing.assert_allclose(fields["force"].sum(axis=0), force, atol=1e-9)
        assert np.array_equal(fields["normal"], step.frame[:, 0])
        there = model.in_step(step)
        nodal = there.fields(step.displacement, step.reaction, step.status)
        area = np.zeros(len(model.nodes))
        area[model.contact_dofs[:, 0] // 2] = model.area
        tangential = np.einsum("ck,ckd->d", step.reaction[:, 1:], step.frame[:, 1:])
        near(area @ nodal["contact_shear"], tangential, 1e-12 * size)


def test_planes_of_symmetry_inclined_to_the_axes() -> None:
    """B and the loads leave out the reaction of the plane, also in turned frames."""
    ways, Q = [[0, -0.5], [0, -DEPTH]], turned(np.pi / 6)
    _, plain = rolled(ways, mu=0.3, half=True)
    model, other = rolled(ways, mu=0.3, turn=Q, half=True)
    assert model.inclined is not None
    size = np.abs(plain.reaction).max()
    near(other.reaction[:, :, 0], plain.reaction[:, :, 0], 1e-9 * size)
    u = other.displacement.reshape(2, -1, 2) @ Q
    near(u, plain.displacement.reshape(2, -1, 2), 1e-9 * DEPTH)


@pytest.mark.parametrize("pairing", ["match", "mortar"])
def test_friction_where_a_support_blocks_slip_at_the_start_only(pairing: str) -> None:
    """Nodes that move along the first normal slip on the plane once it has turned."""
    rise, mu = 0.02, 0.4
    body = fem.Body("block", box("quadrilateral", 2), fem.Material(100.0, 0.3))
    plane = ([0.5, 0.0], [0.0, 1.0])
    held = [fem.Support("block", "top", (0, 1)), fem.Support("block", "bottom", (0,))]

    def model_of(motion: ob.Motion) -> fem.Assembly:
        more: Any = {"plane": plane, "motion": motion, "pairing": pairing}
        contact = fem.Contact("block", "bottom", mu, **more)
        return fem.assemble([body], [contact], held)

    model = model_of(ob.Motion([[0.0, rise]] * 2, [0.0, 0.6], about=[0.5, 0.0]))
    assert (model.mu == mu).all()
    result = model.problem().solve(prescribed=np.zeros((2, model.fixed.size)), tol=TOL)
    # At the start all slip is prescribed, and it is zero.
    assert not result.slip[0].any()
    pressed = result.status[1] > 0
    assert pressed.any()
    (normal, shear), slip = result.reaction[1, pressed].T, result.slip[1, pressed, 0]
    assert (np.abs(slip) > 0.1 * rise).all()
    # TOL, and some digits of the residual of all contacts.
    np.testing.assert_allclose(shear, -mu * normal * np.sign(slip), rtol=1e-10)
    # One that only moves has no tangent along which these nodes may slip.
    assert not model_of(ob.Motion([[0.01, rise]])).mu.any()


def test_engines_and_estimates_that_need_one_frame_refuse() -> None:
    case = roller().assemble()
    with refused("which engine='petsc' cannot solve"):
        DistributedProblem(case, None)  # type: ignore[arg-type]
    # A plane that turns: its frames differ between steps, but not along the surface.
    m = block(2, cell="triangle")
    floor = {"point": [0.0, 0.0], "normal": [0.0, -1.0]}
    turn = {"angle": m.times(1.0, "way"), "about": [0.0, 0.0]}
    m.obstacle("floor", plane=floor, turn=turn)
    m.contact("block.top", against="floor", mu=0.3)
    m.path(way=[0.5, 1.0])
    with refused("an obstacle that turns, or is curved and m"):
        Estimator(m.assemble())
