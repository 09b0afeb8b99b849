"""Obstacles under a force, rigid sets and forces at a distance."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import bipot_rs as bp
from bipot_rs import fem
from bipot_rs.fem.assembly.assembly import Support
from bipot_rs.fem.bodies.body import Body
from bipot_rs.fem.checks.inspection import inspect
from bipot_rs.fem.constraints.references import Remote
from bipot_rs.fem.contact.contact import Contact, Floating
from bipot_rs.obstacle.motion import Motion
from bipot_rs.obstacle.shapes import Plane, Sphere
from support.boxes import CELLS, box
from support.comparisons import close, near, refused

Floats = NDArray[np.float64]
SOFT = fem.Material(1000.0, 0.3)
# Residuals of 1e-13, times the condition of small elastic bodies, 1e3.
SOLVED = 1e-10


def block(cell: str, n: int = 4, degree: int = 1, size: float = 1.0) -> Body:
    return Body("it", box(cell, size * np.linspace(0, 1, n + 1), degree=degree), SOFT)


def plane_cell(d: int) -> str:
    return "quadrilateral" if d == 2 else "hexahedron"


def on_floor(d: int, mu: float = 0.3) -> Contact:
    return Contact("it", "bottom", mu, plane=(np.zeros(d), np.eye(d)[-1]))


def held_by(*remotes: Remote, body: Body, mu: float = 0.3) -> fem.Assembly:
    """A body on a floor, with remotes."""
    return fem.assemble([body], [on_floor(body.dim, mu)], remotes=remotes)


def punched(
    d: int, pairing: str = "match", body: Body | None = None, **more: Any
) -> fem.Assembly:
    """A block on a support, under a flat punch."""
    body = body or block(plane_cell(d))
    top = float(body.points[:, -1].max())
    punch = Plane(np.eye(d)[-1] * top, -np.eye(d)[-1])
    contact = Contact("it", "top", 0.3, obstacle=punch, pairing=pairing, **more)
    return fem.assemble([body], [contact], [Support("it", "bottom", range(d))])


def torque(lever: Floats, force: Floats) -> Floats:
    """Sum of the moments of forces, with one component in the plane."""
    if lever.shape[1] == 3:
        return np.cross(lever, force).sum(axis=0)
    return np.array([np.sum(lever[:, 0] * force[:, 1] - lever[:, 1] * force[:, 0])])


@pytest.mark.parametrize("d", [2, 3])
@pytest.mark.parametrize("pairing", ["match", "mortar"])
def test_a_force_equals_the_displacement_that_needs_it(d: int, pairing: str) -> None:
    down = np.zeros((1, d))
    down[0, -1], down[0, 0] = -0.01, 0.001
    moved = punched(d, pairing, motion=Motion(down))
    by_motion = moved.problem().solve(tol=1e-13)
    force = np.einsum("ck,ckd->d", by_motion.reaction[0], moved.frame)
    pushed = punched(d, pairing, floating=Floating("punch", range(d)))
    # Everywhere the obstacle moves with the body, nothing changes.
    u = np.zeros((pushed.n // d, d)) + np.arange(1.0, d + 1)
    assert np.abs(pushed.B @ u.ravel()).max() < 1e-14 * d
    two = pushed.problem().solve(pushed.reference_force("punch", force), tol=1e-13)
    motion, rotation = pushed.reference_motion("punch", two.displacement)
    near(motion, down, SOLVED * 0.01)
    assert rotation.shape == (1, 0)
    near(two.reaction, by_motion.reaction, SOLVED * by_motion.reaction.max())
    near(two.displacement[0, : moved.n], by_motion.displacement[0], SOLVED * 0.01)


def test_a_free_obstacle_balances_its_contacts() -> None:
    """Two surfaces touch one sphere; the engines agree."""
    results, pulls = [], (0.0, 1.0, -1.0)
    at: Any = {
        "obstacle": Sphere([0.5, 0.5, 3.0], 2.0),
        "floating": Floating("ball", (0, 2)),
    }
    contacts = [
        Contact("it", "top", 0.3, within={0: (0.0, 0.5)}, **at),
        Contact("it", "top", 0.2, within={0: (0.51, 1.0)}, **at),
    ]
    held = [Support("it", "bottom", range(3))]
    model = fem.assemble([block("hexahedron")], contacts, held)
    assert inspect(model) == []
    path = np.array([model.reference_force("ball", [x, 0.0, -10.0]) for x in pulls])
    for engine in ("direct", "iterative"):
        problem = model.problem(engine=engine)
        result = problem.solve(path, tol=1e-13)
        assert problem.stats["engine_reason"] == "it was asked for"
        for step, x in zip(result, pulls, strict=True):
            total = np.einsum("ck,ckd->d", step.reaction, model.frame)
            near(total[[0, 2]], [x, -10], 1e-10)
        results.append(result)
    first, two = results
    near(two.reaction, first.reaction, 1e-9)
    close(two.displacement, first.displacement, 1e-9)
    # A path that continues from a step has the same bits.
    rest = problem.solve(path[1:], tol=1e-13, start=two[0])
    np.testing.assert_array_equal(rest.reaction, two.reaction[1:])
    np.testing.assert_array_equal(rest.displacement, two.displacement[1:])


@pytest.mark.parametrize("engine", ["direct", "iterative"])
def test_obstacles_under_a_force_in_other_units_of_stress(engine: str) -> None:
    """Steel in Pa or in MPa: an obstacle has no stiffness from which a scale could follow."""
    wheel: Any = {
        "obstacle": Sphere([0.4, 3.0], 2.0),
        "floating": Floating("wheel", (0, 1)),
    }

    def solved(stress: float) -> bp.Result:
        soft = fem.Material(1000.0 * stress, 0.3)
        body = Body("it", box("quadrilateral", 6), soft)
        contact = Contact("it", "top", 0.3, **wheel)
        model = fem.assemble([body], [contact], [Support("it", "bottom", (0, 1))])
        loads = [
            model.reference_force("wheel", stress * np.array(force))
            for force in ([0.0, -20.0], [2.0, -20.0], [-3.0, -15.0])
        ]
        return model.problem(engine=engine).solve(loads, tol=1e-12)

    plain = solved(1.0)
    assert {0, 1, 2} <= set(plain.status.ravel().tolist())
    for stress in (2.0**40, 2.0**-40):
        other = solved(stress)
        np.testing.assert_array_equal(other.displacement, plain.displacement)
        np.testing.assert_array_equal(other.reaction / stress, plain.reaction)
        np.testing.assert_array_equal(other.iterations, plain.iterations)
    for stress in (1e12, 1e-9):
        other = solved(stress)
        close(other.displacement, plain.displacement, 10 * SOLVED)
        close(other.reaction / stress, plain.reaction, 10 * SOLVED)


def test_an_obstacle_that_nothing_holds() -> None:
    model = punched(2, floating=Floating("punch", (0, 1)))
    assert inspect(model) == []
    bare = replace(model.contacts[0], mu=0.0)
    (warning,) = inspect(fem.assemble(model.bodies, [bare], model.supports))
    assert warning == (
        "obstacle 'punch' can move freely, and no contact holds it: prescribe its motion, "
        "or add a contact or friction that stops it"
    )


@pytest.mark.parametrize("d", [2, 3])
def test_rigid_set_by_force_or_by_motion(d: int) -> None:
    """A force and a moment far away; then the motion that they caused, prescribed."""
    body = block("quadrilateral" if d == 2 else "tetrahedron")
    point = np.array([0.3, 0.4, 1.7])[[0, 2] if d == 2 else [0, 1, 2]]
    loaded = held_by(Remote("grip", "it", "top", point), body=body, mu=0.4)
    force = np.array([0.3, -0.2, -9.0][-d:])
    moment = np.array([0.5, 0.3, -0.2] if d == 3 else [-0.2])
    f = loaded.reference_force("grip", force, moment)
    result = loaded.problem().solve(f, tol=1e-13)
    shift, turn = loaded.reference_motion("grip", result.displacement[0])
    nodes = body.nodes("top")
    arm = body.points[nodes] - point
    u = result.displacement[0, : loaded.nodes.size].reshape(-1, d)[nodes]
    about = np.column_stack([-arm[:, 1], arm[:, 0]])
    near(u, shift + (np.cross(turn, arm) if d == 3 else turn * about), 1e-14)
    # Balance of forces and of moments about the point.
    push = np.einsum("ck,ckd->cd", result.reaction[0], loaded.frame)
    near(push.sum(axis=0), -force, SOLVED * 9)
    near(torque(loaded.points - point, push), -moment, SOLVED * 9)
    axes = range(3) if d == 3 else (2,)
    held = Remote("grip", "it", "top", point, components=range(d), rotations=axes)
    moved = held_by(held, body=body, mu=0.4)
    values = moved.prescribed([], {"grip": [*shift, *turn]})
    again = moved.problem().solve(None, values, tol=1e-13)
    near(again.displacement, result.displacement, SOLVED * np.abs(u).max())


@pytest.mark.parametrize("cell", ["triangle", "hexahedron"])
@pytest.mark.parametrize("stress", [1.0, 1e9])
def test_a_rigid_body_has_no_stiffness(cell: str, stress: float) -> None:
    """Its rows of K are rounding, not springs: a rigid tool equals a rigid plane."""
    d = CELLS[cell]
    soft = fem.Material(1000.0 * stress, 0.3)
    under = [np.linspace(-0.3, 1.3, 4)] * (d - 1) + [np.linspace(-1, 0, 3)]
    low = Body("low", fem.box(under, cell), soft)
    tool = Body("tool", box(cell), soft)
    held = [Support("low", "bottom", range(d))]
    turns = range(3) if d == 3 else [2]
    grip = Remote("grip", "tool", components=range(d - 1), rotations=turns)
    contact = Contact("tool", "bottom", 0.3, against=("low", "top"), pairing="mortar")
    model = fem.assemble([tool, low], [contact], held, remotes=[grip])
    reference = model.references[0]
    assert model.K[reference.dofs].nnz == 0
    assert model.K[reference.turns].nnz == 0
    push = np.outer([-5.0 * stress, -8.0 * stress], np.eye(d)[-1])
    f = [model.reference_force("grip", force) for force in push]
    result = model.problem().solve(f, tol=1e-13)
    force = np.einsum("skc,kcd->sd", result.reaction, model.frame)
    np.testing.assert_allclose(force[:, -1], -push[:, -1], rtol=SOLVED)
    motion, _ = model.reference_motion("grip", result.displacement)
    for k, u in enumerate(result.displacement):
        v = (model.B @ u).reshape(-1, d)[:, 0] + model.gap
        size = SOLVED * np.abs(motion[k]).max()
        np.testing.assert_allclose(v, result.relative_displacement[k, :, 0], atol=size)
        # Pressed contacts are closed.
        assert np.abs(v[result.reaction[k, :, 0] > 0]).max() < size


@pytest.mark.parametrize("soft", [1e-3, 1e-8, 1e-14])
def test_a_rigid_body_on_soft_springs(soft: float) -> None:
    """Its own stiffness leaves no rounding that springs would have to exceed."""
    stiffness = 1000.0 * soft
    above = Contact("it", "top", 0.3, plane=([0, 0, 9.0], [0, 0, -1.0]))
    model = fem.assemble(
        [block("hexahedron")],
        [above],
        springs=[fem.Spring("it", "bottom", stiffness)],
        remotes=[Remote("grip", "it", point=[0.5, 0.5, 0.0])],
    )
    wanted = np.array([0.5, 0.0, -1.0])
    f = model.reference_force("grip", stiffness * wanted)
    result = model.problem().solve(f, tol=1e-13)
    motion, turn = model.reference_motion("grip", result.displacement[0])
    # A force through the centre of a unit area of springs: rounding of their sums.
    near(motion, wanted, 1e-12)
    near(turn, 0, 1e-12)


def test_a_load_on_a_supported_node_is_named_with_its_place() -> None:
    """As `*CLOAD` of a deck becomes one: a set of one node, which does not turn."""
    at = [0.0, 0.0, 1.0]
    within = {axis: (x, x) for axis, x in enumerate(at)}
    remote = Remote("node", "it", within=within, rotations=(0, 1, 2))
    held = [Support("it", "bottom", (0, 1, 2)), Support("it", "top", (1,), at=at)]
    model = fem.assemble([block("hexahedron", 2)], [], held, remotes=[remote])
    (warning,) = inspect(model)
    assert warning.startswith(
        "a support holds the node at (0, 0, 1) in 1 of 3 directions: what 'node' loads"
    )


def test_supports_on_nodes_of_a_rigid_set_hold_it() -> None:
    """Three nodes held in three directions, 3-2-1: the set can only stay."""
    corners = ([0.0, 0, 1], (0, 1, 2)), ([1.0, 0, 1], (1, 2)), ([0.0, 1, 1], (2,))
    held = [Support("it", "top", components, at=x) for x, components in corners]
    remotes = [Remote("grip", "it", "top")]
    model = fem.assemble([block("hexahedron", 2)], [], held, remotes=remotes)
    (warning,) = inspect(model)
    assert warning == (
        "supports or symmetries on nodes of the rigid set 'grip' determine 6 of the 6 "
        "components of its motion: loads at its point act on these; exclude the nodes by "
        "within if the set should move"
    )
    f = model.body_force("it", [1.0, 2.0, -3.0])
    for part in model.reference_motion("grip", model.problem().solve(f).displacement):
        near(part, 0, 1e-15)
    moved = model.prescribed([[0.1, 0.2, 0.3], [0.2, 0.3], [0.4]])
    u = model.problem().solve(None, moved).displacement
    # Rotated about x by 0.1.
    shift, turn = model.reference_motion("grip", u[0])
    near(turn, [0.1, 0, 0], 1e-15)
    near(shift, [0.1, 0.2, 0.35], 1e-15)


@pytest.mark.parametrize("cell", CELLS)
@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("part", ["top", None])
def test_distributed_forces_have_the_resultant(
    cell: str, degree: int, part: str | None
) -> None:
    body, d = block(cell, 3, degree), CELLS[cell]

    def pulled(point: Floats) -> fem.Assembly:
        pull = Remote("pull", "it", part, point, distributed=True)
        return fem.assemble([body], [], remotes=[pull])

    point, force = np.array([0.2, 1.4, -0.6][:d]), np.array([1.0, -2.0, 0.5][:d])
    moment = np.array([0.3] if d == 2 else [0.3, -0.7, 0.2])
    f = pulled(point).reference_force("pull", force, moment).reshape(-1, d)
    # Sums of some hundred rounded products of size 1.
    near(f.sum(axis=0), force, 1e-13)
    near(torque(body.points - point, f), moment, 1e-13)
    if part is not None:
        assert not f[np.setdiff1d(np.arange(len(f)), body.nodes("top"))].any()
        # A force at the centre is a uniform traction.
        plain = pulled(body.points[body.nodes("top")].mean(axis=0))
        traction = plain.traction("it", "top", force)
        near(plain.reference_force("pull", force), traction, 1e-13)


@pytest.mark.parametrize("d", [2, 3])
def test_a_distant_point_keeps_digits_or_is_refused(d: int) -> None:
    """A force at a distance equals the same force nearby with its moment."""
    body, (ahead, *_, up) = block(plane_cell(d), 2), np.eye(d)
    turning = range(3) if d == 3 else [2]
    force = 0.4 + (-5.0 - 0.4) * up

    def solved(far: float, push: Floats, turn: Any = None, **held: Any) -> Floats:
        point = 0.5 + 0.5 * up + far * ahead
        model = held_by(Remote("grip", "it", "top", point, **held), body=body)
        f = model.reference_force("grip", push, turn)
        result = model.problem().solve(f, model.prescribed([]), tol=1e-13)
        return result.displacement[0, : model.nodes.size]

    def moment(far: float) -> Any:
        about = np.cross([-far, 0.0, 0.0], np.append(force, [0.0] * (3 - d)))
        return about if d == 3 else about[2]

    # The square of the distance, times rounding and the condition of the block.
    close(solved(1e3, force, moment(1e3)), solved(0.0, force), 1e-6)
    wanted = solved(0.0, force, rotations=turning)
    close(solved(1e3, force, rotations=turning), wanted, 1e-6)
    with refused(r"which extend over .*; choose a point near"):
        solved(1e5, force, moment(1e5))
    # Translation alone, and rotation alone about a distant point, are well determined.
    close(solved(1e5, force, rotations=turning), wanted, 1e-9)
    wanted = solved(0.0, force * up, components=range(d - 1), rotations=turning)
    turn = moment(1e5) * (np.eye(3)[1] if d == 3 else 1)
    held: Any = {"components": range(d), "rotations": [0, 2] if d == 3 else []}
    # The set turns by its height over the distance.
    close(solved(1e5, np.zeros(d), turn, **held), wanted, 1e-4)


def test_nodes_on_a_line_have_no_arm_about_it() -> None:
    body = block("hexahedron", 2)
    edge = Remote("edge", "it", "top", within={1: (0.0, 0.0)})
    spread = fem.assemble([body], [], remotes=[replace(edge, distributed=True)])
    with refused("no facet or cell with all nodes within"):
        spread.reference_force("edge", [0, 0, 1.0])
    held = [Support("it", "bottom", range(3))]
    model = fem.assemble([body], [], held, remotes=[edge])
    assert inspect(model) == []
    f = model.reference_force("edge", [0, 0, 1.0], [0, 0.1, 0.1])
    u = model.problem().solve(f).displacement[0]
    _, turn = model.reference_motion("edge", u)
    assert turn[0] == 0
    assert turn[1] != 0
    with refused("about the line on which all nodes of the set"):
        model.reference_force("edge", moment=[0.1, 0, 0])


def test_nodes_inside_a_body_are_held() -> None:
    mesh = fem.box([np.linspace(0, 1, 5)] * 2, "quadrilateral")
    middle = np.flatnonzero((np.abs(mesh.p[:, mesh.t].mean(axis=1) - 0.5) < 0.2).all(0))
    mesh = mesh.with_subdomains({"core": middle})
    body = Body("it", mesh, SOFT)
    assert len(body.members("core")) == 9
    held = fem.assemble([body], [], [Support("it", "core", (0, 1))])
    assert len(held.fixed) == 18
    inside = Support("it", None, (0,), within={0: (0.5, 0.5), 1: (0.2, 0.6)})
    at = Support("it", None, (0, 1), at=[0.3, 0.45])
    supported = fem.assemble([body], [], [inside, at])
    assert {tuple(x) for x in supported.nodes[supported.fixed // 2]} == {
        (0.5, 0.25),
        (0.5, 0.5),
        (0.25, 0.5),
    }
    values = supported.prescribed([[0.2], [0.1, -0.1]])
    u = supported.problem().solve(None, values).displacement[0].reshape(-1, 2)
    near = int(np.argmin(np.linalg.norm(supported.nodes - [0.25, 0.5], axis=1)))
    np.testing.assert_array_equal(u[near], [0.1, -0.1])


def under(*components: int) -> Contact:
    plane = Plane([0.0, 1.0], [0.0, -1.0])
    return Contact("it", "top", 0.3, obstacle=plane, floating=Floating("a", components))


@pytest.mark.parametrize(
    ("message", "given"),
    [
        (r"components of the floating obstacle 'a' are \[\]", [under()]),
        (r"components of the floating obstacle 'a' are \[2\]", [under(2)]),
        (
            r"components of the remote 'a' are \[2\]",
            [Remote("a", "it", components=[2])],
        ),
        (r"rotations of the remote 'a' are \[0\]", [Remote("a", "it", rotations=[0])]),
        (
            "names of floating obstacles, remotes and bolts repeat",
            [Remote("a", "it", "top"), Remote("a", "it", "left", distributed=True)],
        ),
        ("no surface or volume 'tpo', expected one of", [Remote("a", "it", "tpo")]),
        (
            r"at is \(3, 0\), outside body 'it', which extends",
            [Support("it", None, (0,), at=[3.0, 0.0])],
        ),
        (
            "has no nodes: within excludes all",
            [Support("it", None, (0,), within={0: (0.1, 0.2)})],
        ),
        (
            "within of surface 'top' .* has axis 5, expected one of",
            [Support("it", "top", (0,), within={5: (0.0, 1.0)})],
        ),
        (
            "only a rigid set has a prescribed motion",
            [Remote("a", "it", "top", components=[0], distributed=True)],
        ),
        (
            r"within of surface 'top' .* is \[\(0.0, 0.5\)\], expected ranges",
            [Support("it", "top", (0,), within=[(0.0, 0.5)])],  # type: ignore[arg-type]
        ),
        (
            r"within of surface 'top' .* has shape \(\), expected \(2,\)",
            [Support("it", "top", (0,), within={0: 0.5})],  # type: ignore[dict-item]
        ),
        (
            "components of the remote 'a' is 0, expected a",
            [Remote("a", "it", components=0)],  # type: ignore[arg-type]
        ),
    ],
)
def test_mistakes_of_references(message: str, given: list[Any]) -> None:
    parts = [[x for x in given if isinstance(x, c)] for c in (Contact, Support, Remote)]
    with pytest.raises((TypeError, ValueError), match=message):
        fem.assemble([block("quadrilateral", 2)], *parts[:2], remotes=parts[2])


def test_what_models_with_references_cannot_do() -> None:
    model = punched(2, floating=Floating("punch", (1,)))
    with refused("moment of the reference point 'punch' was given"):
        model.reference_force("punch", moment=[1.0])
    with refused("there is no reference point 'pnuch', expected one"):
        model.reference_force("pnuch", [0, 1.0])
    f = model.reference_force("punch", [0, -1.0])
    result = model.problem(engine="direct").solve(f)
    with refused("gradients with respect to parameters are not"):
        model.gradient(result.vjp(reaction=result.reaction))
