"""Elastic bodies against rigid obstacles of any shape, at rest and in motion."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import bipot_rs as bp
from bipot_rs import fem, scene
from bipot_rs import obstacle as ob
from bipot_rs.discretisation import discretisation_error
from support.boxes import box, placed
from support.comparisons import close, near
from support.spheres import cube

pytestmark = pytest.mark.needs_extra

TOL = 1e-12
# Two solutions with η = 1e-12, relative to the smallest force that counts.
SAME = 1e-9


FLOOR = ob.Plane([0, 0], [0, -1])
GROUND, WALL = ob.Plane([0, -1], [0, 1]), ob.Plane([-0.5, 0], [1, 0])
E, NU = 1000.0, 0.3


def slab(n: int = 8, dim: int = 2, turn: Any = None, unit: float = 1.0) -> fem.Body:
    """A unit square or cube with its top at zero, rotated, in any unit of length."""
    axes = [np.linspace(-0.5, 0.5, n + 1)] * (dim - 1) + [np.linspace(-1, 0, n + 1)]
    mesh = fem.box(axes, "quadrilateral" if dim == 2 else "hexahedron")
    mesh = placed(mesh, unit * (mesh.p if turn is None else turn @ mesh.p))
    # In all units, forces in newtons and, in the plane, a thickness of one metre.
    steel = fem.Material(E / unit**2, NU, thickness=unit)
    return fem.Body("slab", mesh, steel)


def top(mu: float, obstacle: Any, **more: Any) -> fem.Contact:
    return fem.Contact("slab", "top", mu, obstacle=obstacle, **more)


def held(
    body: fem.Body, contacts: list[fem.Contact], **more: Any
) -> tuple[fem.Assembly, bp.ContactProblem]:
    """On a ground that holds it from below."""
    ground = fem.Support("slab", "bottom", tuple(range(body.dim)))
    model = fem.assemble([body], contacts, [ground])
    return model, model.problem(**more)


def forces(model: fem.Assembly, result: bp.Result) -> np.ndarray:
    """Contact forces on the nodes in global components, ``(steps, n_c, d)``."""
    frames = [model.in_step(step).frame for step in result]
    return np.einsum("kci,kcij->kcj", result.reaction, frames)


def nodal(model: fem.Assembly, result: bp.Result) -> np.ndarray:
    """Contact forces of the first step, summed over the contacts of each node."""
    force = np.zeros((model.n // 2, 2))
    np.add.at(force, model.contact_dofs[:, 0] // 2, forces(model, result)[0])
    return force


def test_a_torus_in_a_scene_turns_about_its_own_centre() -> None:
    """Pressed onto a block over half of the ring: one force on each half."""
    m = bp.Model("ring")
    m.path(press=[0.5, 1.0])
    m.material("soft", young=E, poisson=NU)
    side = {"from": -1.0, "to": 1.0, "cells": 10}
    axes: Any = {"x": side, "y": side, "z": [-1, -0.5, 0]}
    m.body("block", material="soft", cell="hexahedron", **axes)
    m.support("block.bottom", x=0, y=0, z=0)
    shape = {"axis": [0, 0, 2], "major_radius": 0.6, "minor_radius": 0.25}
    move = {"z": m.times(-0.02, "press")}
    turn = {"angle": m.times(0.1, "press"), "axis": [0, 0, 1]}
    m.obstacle("ring", torus={"centre": [0, 0, 0.25], **shape}, move=move, turn=turn)
    m.contact("block.top", against="ring", mu=0.2)
    result = m.solve()
    model = result.case.model
    force = forces(model, result)[-1]
    assert force[:, 2].sum() < 0
    pressed = result.reaction[-1][:, 0] > 0
    rho = np.hypot(*model.points[pressed, :2].T)
    # Where the ring is inside the block: 2 · 0.02 · 0.25 = (ρ - 0.6)², to first order.
    assert (np.abs(rho - 0.6) < 0.11).all()
    # A quarter turn does not change the scene, so forces balance and friction has a
    # moment about the axis, in the sense of the rotation.
    near(force[:, :2].sum(axis=0), 0, 1e-8 * abs(force).max())
    assert np.cross(model.points, force)[:, 2].sum() > 0


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("pairing", ["match", "mortar"])
def test_an_obstacle_that_moves_is_a_body_that_moves(pairing: str, dim: int) -> None:
    """Any shape translated by s is equivalent to supports that move by -s."""
    ways = np.zeros((4, dim))
    ways[:, -1] = [-0.02, -0.02, -0.025, -0.015]
    ways[:, 0] = [0.0, 0.01, -0.01, 0.0]
    origin, up = np.zeros(dim), np.eye(dim)[-1]
    slabs = slab(5 if pairing == "match" or dim == 2 else 3, dim)
    if pairing == "mortar":
        slabs = replace(slabs, mesh=fem.second_order(slabs.mesh))

    def run(motion: ob.Motion | None, moved: np.ndarray) -> Any:
        # A plane keeps normals and distances linear, so both are equal to rounding. For a ball,
        # its own motion is taken exactly, and that of the body is linearised.
        contact = top(0.3, ob.Plane(origin, -up), motion=motion, pairing=pairing)
        model, problem = held(slabs, [contact])
        prescribed = np.array([model.prescribed([way]) for way in moved])
        return problem.solve(prescribed=prescribed, gap=model.gaps(4), tol=TOL)

    moving, body = run(ob.Motion(ways), 0 * ways), run(None, -ways)
    assert np.array_equal(moving.status, body.status)
    assert {1, 2} <= set(body.status.ravel().tolist())
    for name in ("reaction", "slip"):
        close(getattr(moving, name), getattr(body, name), SAME)
    # The distance at the nodes is that of the ball in its new position.
    ball = ob.Sphere(1.5 * up, 1.5)
    model, _ = held(slab(5, dim), [top(0.3, ball, motion=ob.Motion(ways))])
    gaps = model.gaps(4)
    assert isinstance(gaps, bp.MovingGaps)
    for way, gap in zip(ways, gaps, strict=True):
        there = ob.Sphere(1.5 * up + way, 1.5).closest(model.points)
        near(gap.gap, there.distance, 1e-15)
        near(gap.frame[:, 0], there.normal, 1e-15)
        near(gap.by_component[:, 1:], -gap.frame[:, 1:] @ way, 1e-16)


@pytest.mark.parametrize("unit", [1.0, 1e3, 1e-6])
def test_turned_and_in_other_units_it_is_the_same(unit: float) -> None:
    Q = Rotation.from_rotvec([0, 0, 0.7]).as_matrix()[:2, :2]
    ways = np.array([[0, -0.01], [0.002, -0.02], [0.004, -0.015]])

    def run(turn: np.ndarray, unit: float) -> tuple[np.ndarray, bp.Result]:
        centre = unit * turn @ [0.05, 1.0]
        motion = ob.Motion(unit * (ways @ turn.T), [0.0, 0.01, 0.0], about=centre)
        wall = ob.Plane(unit * turn @ [0.49, 0], turn @ [-1, -0.5])
        contacts = [
            top(0.3, ob.Cylinder(centre, unit), motion=motion),
            fem.Contact("slab", "right", 0.2, obstacle=wall),
        ]
        model, problem = held(slab(8, turn=turn, unit=unit), contacts)
        result = problem.solve(gap=model.gaps(3), tol=TOL)
        return forces(model, result) @ turn, result

    (plain, first), (other, second) = run(np.eye(2), 1.0), run(Q, unit)
    assert np.array_equal(first.status, second.status)
    close(other, plain, SAME)


def test_a_node_in_a_corner_has_two_contacts() -> None:
    """A block pushed into a corner without friction: uniform stress at every node.

    The bottom may also touch the wall, and the left side the floor. At the corner node the
    same two obstacles then count twice, and only the sums of reactions are determined.
    """
    pairs = [("bottom", GROUND), ("left", WALL), ("bottom", WALL), ("left", GROUND)]
    contacts = [fem.Contact("slab", on, 0.0, obstacle=shape) for on, shape in pairs]
    model = fem.assemble([slab(4)], contacts)
    p, q = 3.0, 2.0
    load = model.pressure("slab", "top", p) + model.pressure("slab", "right", q)
    result = model.problem().solve(load, tol=TOL)
    force = nodal(model, result)
    area = np.array([0.125, 0.25, 0.25, 0.25, 0.125])
    bottom = np.flatnonzero(model.nodes[:, 1] == -1)
    left = np.flatnonzero(model.nodes[:, 0] == -0.5)
    np.testing.assert_allclose(force[bottom, 1], p * area, rtol=SAME)
    np.testing.assert_allclose(force[left, 0], q * area, rtol=SAME)
    # The traction of a node is the sum over its two contacts.
    fields = model.fields(result.displacement[0], result.reaction[0], result.status[0])
    pressure = fields["contact_pressure"]
    both = np.flatnonzero(model.nodes @ [1, 1] == -1.5)
    for nodes, wanted in ((bottom[1:], p), (left[1:], q), (both, p + q)):
        np.testing.assert_allclose(pressure[nodes], wanted, rtol=SAME)
    # Plane strain under the two pressures.
    k = (1 - NU**2) / E
    expected = -k * np.array([q - NU / (1 - NU) * p, p - NU / (1 - NU) * q])
    u = result[0].displacement.reshape(-1, 2)
    near(u, (model.nodes - [-0.5, -1]) * expected, SAME * k * p)


def test_discretisation_error_is_bounded_for_planes_only() -> None:
    """Another obstacle may project between the nodes."""
    body = fem.Body("slab", box("triangle", 2), fem.Material(E, NU))
    by_formula = ob.Distance(lambda x: 1 - x[:, 1])
    for shape, says in ((ob.Plane([0, 1], [0, -1]), False), (by_formula, True)):
        model, problem = held(body, [top(0.0, shape, motion=ob.Motion([[0, -0.01]]))])
        result = problem.solve(gap=model.gaps(1), tol=TOL)
        case = scene.Case(model, None, np.zeros((1, len(model.fixed))), np.ones(1))
        error = discretisation_error(case, result)
        told = "an obstacle whose shape is known only at the nodes" in error.reasons
        assert told == says
        assert error.total > 0


def test_clearance_adds_in_every_step() -> None:
    lift = ob.Motion([[0, 0.0], [0, -0.5]])
    moving = top(0.3, FLOOR, motion=lift, clearance=lambda x: 0.1 + x[:, 0])
    still = fem.Contact("slab", "left", 0.3, plane=([-1.0, 0], [1, 0]))
    model, _ = held(slab(2), [moving, still])
    gaps = model.gaps(2)
    assert gaps is not None
    on = model.group == 0
    x = model.points[on, 0]
    np.testing.assert_allclose(model.gap[on], 0.1 + x, atol=1e-15)
    np.testing.assert_allclose(gaps[:, on, 0], [0.1 + x, x - 0.4], atol=1e-15)
    np.testing.assert_array_equal(gaps[:, ~on, 0], [model.gap[~on]] * 2)
    np.testing.assert_array_equal(gaps[:, ~on, 1], 0)


@pytest.mark.parametrize(
    ("contacts", "message"),
    [
        ([top(0, FLOOR, plane=([0, 0], [0, 1]))], "needs exactly one of plane,"),
        (
            [top(0, None, against=("b", "c"), motion=ob.Motion([[0, 0]]))],
            "motion of the contact on 'top' was given, but",
        ),
        (
            [top(0, ob.Cylinder([0, 0], 1.0))],
            r"on 'top': the point \(0, 0\) is at the axis",
        ),
        ([top(0, ob.Sphere([0, 0, 1], 1.0))], r"on 'top': points has shape \(9, 2\)"),
        (
            [top(0, FLOOR, motion=ob.Motion([[0, 0]] * k)) for k in (1, 2)],
            "the motions of obstacles have 1 and 2 steps: give",
        ),
        (
            [top(0, FLOOR, motion=ob.Motion([[0, 0, 0]]))],
            "motion has 3 dimensions, but the points have 2",
        ),
        ([top(0, 3)], "obstacle of the contact on 'top' is 3, expect"),
    ],
)
def test_invalid_contacts_with_obstacles(
    contacts: list[fem.Contact], message: str
) -> None:
    with pytest.raises((TypeError, ValueError), match=message):
        fem.assemble([slab()], contacts)


@pytest.mark.parametrize("moving", [False, True])
@pytest.mark.parametrize("pairing", ["match", "mortar"])
def test_a_punch_with_sharp_edges_presses_straight(pairing: str, moving: bool) -> None:
    """Nodes on its edges and corners, where the normals of up to three faces meet."""
    turn = Rotation.random(random_state=1).as_matrix()
    corners, facets = cube()
    places, motion = (corners * [2, 2, 1] - [1, 1, 0]) @ turn.T, None
    grid = np.linspace(-2, 2, 9)
    mesh = fem.box([grid, grid, np.linspace(-1, 0, 3)], "hexahedron")
    body = fem.Body("slab", placed(mesh, turn @ mesh.p), fem.Material(E, NU))
    if moving:  # it comes from above and rotates into place
        lift = 3 * turn[:, 2]
        way = Rotation.from_rotvec([0.3, -0.4, 0.2])
        angle, axis = way.magnitude(), way.as_rotvec()
        motion = ob.Motion([-lift], [angle], about=[0, 0, 0], axis=axis)
        places = (places + lift) @ way.as_matrix()
    punch = ob.Surface(places, facets)
    model = fem.assemble([body], [top(0.0, punch, motion=motion, pairing=pairing)])
    gap, normal = model.gap, model.frame[:, 0]
    if moving:
        assert isinstance(model.moving, bp.MovingGaps)
        gap, normal = model.moving.gap[-1], model.moving.frame[-1, :, 0]
    flat = model.points @ turn
    under = np.abs(flat[:, :2]).max(axis=1) <= 1 + 1e-9
    assert under.sum() == 25
    # The mean over facets also contains those beyond the edge.
    inner = under if pairing == "match" else np.abs(flat[:, :2]).max(axis=1) < 0.9
    near(gap[inner], 0, 1e-14)
    near(normal[under] + turn[:, 2], 0, 1e-13)


@pytest.mark.parametrize("width", [1 / 3, 0.7])
@pytest.mark.parametrize("angle", [0.0, 30.0])
def test_a_punch_of_seven_digits_has_straight_normals_at_its_edge(
    width: float, angle: float, tmp_path: Path
) -> None:
    """A block on a cube from a file: the rounded digits must not tilt the normals."""
    turn = Rotation.from_euler("z", angle, degrees=True).as_matrix()
    x, facets = cube()
    lines = ["solid cube"]
    for face in (width * (x - [0, 0, 1]) @ turn.T)[facets]:
        lines += ["facet normal 0 0 0", "outer loop"]
        lines += ["vertex " + " ".join(f"{x:.6e}" for x in corner) for corner in face]
        lines += ["endloop", "endfacet"]
    file = tmp_path / "cube.stl"
    file.write_text("\n".join([*lines, "endsolid cube", ""]))
    mesh = box("hexahedron", width * np.linspace(0, 1, 4))
    block = fem.Body("block", placed(mesh, turn @ mesh.p), fem.Material(210e9, 0.3))
    top = fem.Support("block", "top", (0, 1, 2))
    forces = []
    for obstacle in (ob.Surface.from_file(file), ob.Plane((0, 0, 0), (0, 0, 1))):
        contact = fem.Contact("block", "bottom", 0.3, obstacle=obstacle)
        model = fem.assemble([block], [contact], [top])
        result = model.problem().solve(None, model.prescribed([[0, 0, -0.01 * width]]))
        forces.append(np.einsum("cij,ci->j", model.frame, result.reaction[0]))
    # Seven digits of coordinates relative to a penetration of a hundredth.
    close(forces[0], forces[1], 1e-4)
