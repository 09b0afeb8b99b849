"""Obstacles whose normals change: each load step has the geometry of its own position."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
from scipy import sparse

import bipot_rs as bp
from bipot_rs import fem
from bipot_rs import obstacle as ob
from bipot_rs.fem.resultants import contact_force, support_force
from support.rollers import roller

pytestmark = pytest.mark.needs_extra

TOL = 1e-13
RADIUS, DEPTH, WAY = 50.0, 1.0, 8.0  # mm


def plate(n: int = 20, turn: Any = None) -> fem.Body:
    """A plate of 40 mm x 20 mm, its top at y = 0, in N and mm."""
    axes = [np.linspace(-20.0, 20.0, n + 1), np.linspace(-20.0, 0.0, n // 2 + 1)]
    mesh = fem.box(axes, "quadrilateral")
    if turn is not None:
        mesh = type(mesh)(turn @ mesh.p, mesh.t).with_boundaries(mesh.boundaries)
    return fem.Body("plate", mesh, fem.Material(2000.0, 0.3))


def rolled(
    ways: Sequence[Sequence[float]],
    angles: Sequence[float] | None = None,
    mu: float = 0.0,
    pairing: str = "match",
    turn: np.ndarray | None = None,
) -> tuple[fem.Assembly, bp.Result]:
    """The plate under a roller that starts above its middle."""
    turn = np.eye(2) if turn is None else turn
    centre = turn @ [0.0, RADIUS]
    motion = ob.Motion(np.array(ways) @ turn.T, angles, about=centre)
    contact = fem.Contact(
        "plate",
        "top",
        mu,
        obstacle=ob.Cylinder(centre, RADIUS),
        motion=motion,
        pairing=pairing,
    )
    ground = fem.Support("plate", "bottom", (0, 1))
    model = fem.assemble([plate(turn=turn)], [contact], [ground])
    return model, model.problem().solve(tol=TOL)


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
def test_a_step_does_not_depend_on_later_ones(pairing: str) -> None:
    angles = [0.0, -WAY / RADIUS]
    _, whole = rolled(PRESSED_AND_MOVED, angles, 0.3, pairing)
    _, first = rolled(PRESSED_AND_MOVED[:1], angles[:1], 0.3, pairing)
    for name in ("reaction", "slip", "relative_displacement", "displacement"):
        assert np.array_equal(getattr(first, name)[0], getattr(whole, name)[0])
    assert np.array_equal(first[0].frame, whole[0].frame)


@pytest.mark.parametrize("pairing", ["match", "mortar"])
def test_turned_as_a_whole_it_is_the_same(pairing: str) -> None:
    c, s = np.cos(0.7), np.sin(0.7)
    turn = np.array([[c, -s], [s, c]])
    ways = [[0.0, -DEPTH], [2.0, -DEPTH], [4.0, -DEPTH]]
    angles = [0.0, -0.02, -0.04]
    _, turned_result = rolled(ways, angles, 0.3, pairing, turn)
    _, plain = rolled(ways, angles, 0.3, pairing)
    assert {0, 1, 2} <= set(plain.status.ravel().tolist())
    assert np.array_equal(turned_result.status, plain.status)
    size = np.abs(plain.reaction).max()
    np.testing.assert_allclose(
        turned_result.resultant @ turn, plain.resultant, rtol=0, atol=1e-9 * size
    )
    np.testing.assert_allclose(
        np.abs(turned_result.slip), np.abs(plain.slip), rtol=0, atol=1e-9 * WAY
    )


def bed(
    points: np.ndarray, stiffness: float, mu: float, moving: bp.MovingGaps
) -> bp.ContactProblem:
    """Nodes on separate springs of equal stiffness in all directions."""
    base = np.tile([[0.0, -1.0], [1.0, 0.0]], (len(points), 1, 1))
    B = sparse.block_diag(list(base), format="csr")
    return bp.ContactProblem(
        stiffness * sparse.eye_array(points.size, format="csr"),
        B,
        gap=np.ones(len(points)),
        mu=mu,
        frame=base,
        gaps=moving,
    )


def passed(obstacle: ob.Obstacle, motion: ob.Motion, x: np.ndarray) -> bp.MovingGaps:
    """Geometry of each step, with tangents to the right of the normals."""
    met = ob.approach(obstacle, motion, x)
    n = met.normal[1:]
    t = np.stack([-n[..., 1], n[..., 0]], axis=-1)
    return bp.MovingGaps(met.distance[1:], np.stack([n, t], axis=2), met.drag[1:])


def test_a_disc_rolls_over_a_bed_of_springs() -> None:
    """Without friction, r = k |g| n at each node inside the disc, and u = |g| n."""
    k, radius, depth = 3.0, 10.0, 0.5
    x = np.column_stack([np.linspace(-6, 6, 25), np.zeros(25)])
    way = np.linspace(0.0, 3.0, 7)
    motion = ob.Motion(
        np.column_stack([way, np.full(7, -depth)]), -way / radius, about=[0, radius]
    )
    disc = ob.Cylinder([0.0, radius], radius)
    result = bed(x, k, 0.0, passed(disc, motion, x)).solve(tol=TOL)
    for s, step in zip(way, result, strict=True):
        arm = x - [s, radius - depth]
        far = np.linalg.norm(arm, axis=1)
        inside = np.maximum(radius - far, 0.0)
        u = (inside / far)[:, None] * arm
        np.testing.assert_allclose(
            step.displacement.reshape(-1, 2), u, rtol=0, atol=1e-12 * depth
        )
        np.testing.assert_allclose(
            result.resultant[list(way).index(s)], k * u.sum(axis=0), atol=1e-11
        )


def rolling(steps: int) -> tuple[np.ndarray, np.ndarray]:
    """Force on the bed, and displacements, after a disc rolled over it with friction."""
    radius, depth = 10.0, 0.5
    x = np.column_stack([np.linspace(-6, 6, 25), np.zeros(25)])
    way = np.linspace(0.0, 1.5, steps + 1)
    motion = ob.Motion(
        np.column_stack([way, np.full(steps + 1, -depth)]),
        -way / radius,
        about=[0, radius],
    )
    disc = ob.Cylinder([0.0, radius], radius)
    result = bed(x, 3.0, 0.2, passed(disc, motion, x)).solve(tol=TOL)
    return result.resultant[-1], result.displacement[-1]


def test_a_rolling_disc_converges_with_the_steps() -> None:
    """Slip is the motion relative to the surface of the disc: of first order in the step."""
    forces = np.array([rolling(steps)[0] for steps in (8, 16, 32, 64, 128)])
    changes = np.linalg.norm(np.diff(forces, axis=0), axis=1)
    orders = np.log2(changes[:-1] / changes[1:])
    # Nodes that enter and leave contact between steps disturb the single ratios.
    assert orders.mean() > 0.8
    assert changes[-1] < 0.01 * np.linalg.norm(forces[-1])


def turned_together(steps: int, angle: float) -> bp.Result:
    """A node on a spring and the plane that it presses turn as a whole.

    The base of the spring is prescribed to turn by ``angle`` about the origin, 1 m away;
    it is pressed by δ.
    """
    k, delta = 1e3, 1e-3
    angles = np.linspace(0.0, angle, steps + 1)[1:]
    x = np.array([[1.0, 0.0]])
    plane = ob.Plane([0.0, 0.0], [0.0, 1.0])
    moving = passed(plane, ob.Motion(rotation=angles), x)
    c, s = np.cos(angles), np.sin(angles)
    turned = np.column_stack([c + delta * s, s - delta * c])
    spring = k * np.array([[1.0, -1.0], [-1.0, 1.0]])
    base = np.array([[[0.0, 1.0], [-1.0, 0.0]]])
    problem = bp.ContactProblem(
        np.kron(spring, np.eye(2)),
        np.hstack([base[0], np.zeros((2, 2))]),
        gap=[0.0],
        mu=0.5,
        fixed=[2, 3],
        frame=base,
        gaps=moving,
    )
    return problem.solve(prescribed=turned - x, tol=TOL)


def test_what_turns_as_a_whole_keeps_its_contact_forces() -> None:
    """The normal force is exact; the slip, which is none, vanishes with the step size."""
    shears = []
    for steps in (10, 20, 40, 80):
        result = turned_together(steps, 0.4)
        # The gap of a plane is exact in any position.
        np.testing.assert_allclose(result.reaction[:, 0, 0], 1.0, rtol=1e-9)
        shears.append(abs(result.reaction[-1, 0, 1]))
    orders = np.log2(np.array(shears[:-1]) / shears[1:])
    # The next term of the error is of second order: half of the step, half the deviation.
    np.testing.assert_allclose(orders, 1.0, atol=0.15)
    assert abs(orders[-1] - 1.0) < 0.6 * abs(orders[-2] - 1.0)


def test_planes_that_move_keep_the_frames_of_the_problem() -> None:
    """A translated plane, and one that turns about its normal, change no frame."""
    body = fem.Body(
        "plate", fem.box([np.linspace(0, 1, 4)] * 3, "hexahedron"), fem.Material(1, 0.3)
    )
    point = [0.5, 0.5, 1.0]
    for motion in (
        ob.Motion([[0.1, 0.0, -0.1], [0.0, 0.2, -0.2]]),
        ob.Motion(rotation=[0.5, -2.0], about=point, axis=[0.0, 0.0, 1.0]),
    ):
        contact = fem.Contact(
            "plate", "top", 0.3, obstacle=ob.Plane(point, [0, 0, -1.0]), motion=motion
        )
        model = fem.assemble([body], [contact])
        assert isinstance(model.moving, np.ndarray)
        met = ob.approach(ob.Plane(point, [0, 0, -1.0]), motion, model.points)
        gaps = -np.einsum("cij,kcj->kci", model.frame, met.drag)
        gaps[:, :, 0] = met.distance
        assert np.array_equal(model.moving, gaps[1:])


def test_automatic_steps_are_those_of_the_path_in_parts() -> None:
    """A scene: the frames of a part of a load step depend only on where it ends."""
    automatic = {"first": 0.5, "smallest": 0.1, "largest": 0.5}
    model = roller(automatic=automatic).assemble()
    result = model.solve(tol=TOL)
    assert result.s is not None
    assert len(result.s) == 6
    assert all(step.frame is not None for step in result)
    parts = model.sampled(result.s)
    assert isinstance(parts.gaps, bp.MovingGaps)
    problem = model.problem()
    again = problem.solve(prescribed=parts.prescribed, gap=parts.gaps, tol=TOL)
    assert np.array_equal(again.reaction, result.reaction)
    assert np.array_equal(again.slip, result.slip)
    # The ends of whole load steps are where the path without parts has them.
    whole = roller().assemble()
    assert isinstance(whole.gaps, bp.MovingGaps)
    for k in range(3):
        part, end = parts.gaps[2 * k + 1], whole.gaps[k]
        np.testing.assert_allclose(part.gap, end.gap, rtol=0, atol=1e-14)
        np.testing.assert_allclose(part.frame, end.frame, rtol=0, atol=1e-14)
        np.testing.assert_allclose(part.drag, end.drag, rtol=0, atol=1e-14)


def test_forces_of_supports_and_contacts_balance_in_each_step() -> None:
    case = roller().assemble()
    result = case.solve(tol=TOL)
    pushed = contact_force(case.model, result, "block.top")
    held = support_force(case.model, result, "block.bottom")
    size = np.abs(pushed).max()
    np.testing.assert_allclose(pushed, -held, rtol=0, atol=1e-9 * size)
    np.testing.assert_allclose(pushed, result.resultant, rtol=0, atol=1e-12 * size)
    table = result.table()
    for k, axis in enumerate("xy"):
        listed = table[f"force_{axis}"]
        np.testing.assert_allclose(listed, pushed[:, k], rtol=0, atol=1e-12 * size)
    # In fields for ParaView forces are global too.
    from bipot_rs.fem.paraview import contact_fields

    for step, force in zip(result, pushed, strict=True):
        fields = contact_fields(case.model, step)
        np.testing.assert_allclose(fields["force"].sum(axis=0), force, atol=1e-9)
        assert np.array_equal(fields["normal"], step.frame[:, 0])
        nodal = case.model.in_step(step).fields(
            step.displacement, step.reaction, step.status
        )
        area = np.zeros(len(case.model.nodes))
        area[case.model.contact_dofs[:, 0] // 2] = case.model.area
        shear = (area[:, None] * nodal["contact_shear"]).sum(axis=0)
        tangential = np.einsum("ck,ckd->d", step.reaction[:, 1:], step.frame[:, 1:])
        np.testing.assert_allclose(shear, tangential, rtol=0, atol=1e-12 * size)


def test_planes_of_symmetry_inclined_to_the_axes() -> None:
    """B and the loads leave out the reaction of the plane, also in turned frames."""
    turn = np.pi / 6
    c, s = np.cos(turn), np.sin(turn)
    Q = np.array([[c, -s], [s, c]])

    def half(Q: np.ndarray) -> tuple[fem.Assembly, bp.Result]:
        axes = [np.linspace(0.0, 20.0, 11), np.linspace(-20.0, 0.0, 11)]
        mesh = fem.box(axes, "quadrilateral")
        mesh = type(mesh)(Q @ mesh.p, mesh.t).with_boundaries(mesh.boundaries)
        body = fem.Body("plate", mesh, fem.Material(2000.0, 0.3))
        centre = Q @ [0.0, RADIUS]
        motion = ob.Motion(np.array([[0, -0.5], [0, -DEPTH]]) @ Q.T)
        contact = fem.Contact(
            "plate", "top", 0.3, obstacle=ob.Cylinder(centre, RADIUS), motion=motion
        )
        model = fem.assemble(
            [body],
            [contact],
            [fem.Support("plate", "bottom", (0, 1))],
            symmetries=[fem.Symmetry("plate", "left")],
        )
        return model, model.problem().solve(tol=TOL)

    (_, plain), (model, half_result) = half(np.eye(2)), half(Q)
    assert model.inclined is not None
    size = np.abs(plain.reaction).max()
    np.testing.assert_allclose(
        half_result.reaction[:, :, 0], plain.reaction[:, :, 0], rtol=0, atol=1e-9 * size
    )
    u = half_result.displacement.reshape(2, -1, 2) @ Q
    expected = plain.displacement.reshape(2, -1, 2)
    np.testing.assert_allclose(u, expected, rtol=0, atol=1e-9 * DEPTH)


@pytest.mark.parametrize("pairing", ["match", "mortar"])
def test_friction_where_a_support_blocks_slip_at_the_start_only(pairing: str) -> None:
    """Nodes that move along the first normal slip on the plane once it has turned."""
    mesh = fem.box([np.linspace(0.0, 1.0, 3)] * 2, "quadrilateral")
    body = fem.Body("block", mesh, fem.Material(100.0, 0.3))
    turn, rise, mu = 0.6, 0.02, 0.4
    motion = ob.Motion([[0.0, rise]] * 2, [0.0, turn], about=[0.5, 0.0])
    contact = fem.Contact(
        "block",
        "bottom",
        mu,
        plane=([0.5, 0.0], [0.0, 1.0]),
        motion=motion,
        pairing=pairing,
    )
    model = fem.assemble(
        [body],
        [contact],
        [fem.Support("block", "top", (0, 1)), fem.Support("block", "bottom", (0,))],
    )
    assert (model.mu == mu).all()
    result = model.problem().solve(prescribed=np.zeros((2, model.fixed.size)), tol=TOL)
    # At the start all slip is prescribed, and it is zero.
    assert not result.slip[0].any()
    pressed = result.status[1] > 0
    assert pressed.any()
    force, slip = result.reaction[1], result.slip[1, :, 0]
    assert (np.abs(slip[pressed]) > 0.1 * rise).all()
    np.testing.assert_allclose(
        force[pressed, 1],
        -mu * force[pressed, 0] * np.sign(slip[pressed]),
        rtol=1e-10,  # TOL, and some digits of the residual of all contacts
    )
    # One that only moves has no tangent along which these nodes may slip.
    still = fem.Contact(
        "block",
        "bottom",
        mu,
        plane=([0.5, 0.0], [0.0, 1.0]),
        motion=ob.Motion([[0.01, rise]]),
        pairing=pairing,
    )
    model = fem.assemble([body], [still], model.supports)
    assert not model.mu.any()


def test_engines_and_estimates_that_need_one_frame_refuse() -> None:
    from bipot_rs.discretisation.estimator import Estimator
    from bipot_rs.petsc.run.distributed import DistributedProblem

    case = roller().assemble()
    with pytest.raises(ValueError, match="which engine='petsc' cannot solve"):
        DistributedProblem(case, None)  # type: ignore[arg-type]
    # A plane that turns: its frames differ between steps, but not along the surface.
    plane = ob.Plane([0.0, 0.0], [0.0, -1.0])
    m = bp.Model("Turning plane")
    m.material("soft", young=1000.0, poisson=0.3)
    side = np.linspace(0.0, 1.0, 3)
    m.body("block", material="soft", cell="triangle", x=side, y=side - 1.0)
    m.obstacle(
        "floor",
        plane={"point": plane.point, "normal": plane.normal},
        turn={"angle": m.times(1.0, "way"), "about": [0.0, 0.0]},
    )
    m.support("block.bottom", x=0.0, y=0.0)
    m.contact("block.top", against="floor", mu=0.3)
    m.path(way=[0.5, 1.0])
    with pytest.raises(ValueError, match="an obstacle that turns, or is curved and m"):
        Estimator(m.assemble())
