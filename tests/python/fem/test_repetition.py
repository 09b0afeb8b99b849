"""Cyclic symmetry and periodicity, compared with the whole structure."""

import re
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import skfem
from numpy.typing import NDArray
from scipy.spatial import cKDTree

import bipot_rs as bp
from bipot_rs import fem
from bipot_rs.fem.assembly.assembly import Support
from bipot_rs.fem.bodies.body import Body
from bipot_rs.fem.checks.inspection import inspect
from bipot_rs.fem.constraints.repetition import Cyclic, Periodic
from bipot_rs.fem.contact.contact import Contact
from bipot_rs.obstacle.motion import Motion
from bipot_rs.obstacle.shapes import Plane, Sphere
from support.boxes import box, placed
from support.comparisons import close, near, refused

Floats = NDArray[np.float64]
SOFT = fem.Material(1000.0, 0.3)
# Residuals of 1e-13, times the condition of small elastic bodies, 1e3.
SOLVED = 1e-10


def places(model: fem.Assembly) -> Floats:
    """Nodes, with the number of their body: nodes of two bodies may coincide."""
    number = np.repeat(range(len(model.bodies)), [len(b.points) for b in model.bodies])
    return np.column_stack([model.nodes, number])


def compared(one: fem.Assembly, part: Any, whole: fem.Assembly, full: Any) -> None:
    """Displacements and tractions of a part, and of the same points of the whole."""
    d = one.dim
    apart, at = cKDTree(places(whole)).query(places(one))
    assert apart.max() < 1e-12
    u = full.displacement[-1, : whole.nodes.size].reshape(-1, d)[at]
    close(part.displacement[-1, : one.nodes.size].reshape(-1, d), u, SOLVED)
    apart, on = cKDTree(whole.points).query(one.points)
    assert apart.max() < 1e-12
    wanted = np.einsum("ck,ckd->cd", full.traction[-1], whole.frame)[on]
    traction = np.einsum("ck,ckd->cd", part.traction[-1], one.frame)
    close(traction, wanted, 100 * SOLVED)
    fields, every = (
        m.fields(r.displacement[-1], r.reaction[-1], r.status[-1])
        for m, r in ((one, part), (whole, full))
    )
    # A node on the axis cannot slide: without friction, its status is slip.
    off = np.linalg.norm(one.nodes[:, :2], axis=1) > 0
    for name in ("contact_pressure", "contact_shear", "contact_status"):
        limit = 100 * SOLVED * np.abs(wanted).max()
        near(fields[name][off], every[name][at][off], limit)


def pad(n: int, quarter: bool) -> Body:
    side = np.linspace(0, 1, n + 1) if quarter else np.linspace(-1, 1, 2 * n + 1)
    mesh = fem.box([side, side, np.linspace(0, 0.5, 3)], "hexahedron")
    return Body("pad", mesh, SOFT)


FLOOR = Plane([0, 0, 0], [0, 0, 1])
QUARTER = Cyclic(("pad", "front"), ("pad", "left"), 4, axis=[0, 0, 3.0])


def stacked(on: str, under: str) -> list[Body]:
    """A square on a square."""
    upper = box("quadrilateral", 4)
    lower = placed(upper, upper.p - [[0], [1]])
    return [Body(on, upper, SOFT), Body(under, lower, SOFT)]


@pytest.mark.parametrize("engine", ["direct", "iterative"])
def test_quarter_of_a_twisted_pad(engine: str) -> None:
    """Pressed on a sphere-like floor and twisted: a path with slip, no plane of symmetry."""
    floor = Sphere([0.0, 0.0, -2000.0], 2000.0)
    contact = [Contact("pad", "bottom", 0.3, obstacle=floor)]
    two = {"right": [0.0, 1.5, 0.0], "back": [-1.5, 0.0, 0.0]}
    four = two | {"left": [0.0, -1.5, 0.0], "front": [1.5, 0.0, 0.0]}

    def path(model: fem.Assembly, sides: dict[str, list[float]]) -> Floats:
        twist = sum(model.traction("pad", s, np.array(f)) for s, f in sides.items())
        down = model.pressure("pad", "top", 10.0)
        return np.array([down + share * twist for share in (0.3, 1.0, 0.2)])

    whole = fem.assemble([pad(3, False)], contact)
    quarter = fem.assemble([pad(3, True)], contact, repetitions=[QUARTER])
    assert quarter.area.sum() == pytest.approx(1.0, rel=1e-14)
    full = whole.problem(engine="direct").solve(path(whole, four), tol=1e-13)
    problem, loads = quarter.problem(engine=engine), path(quarter, two)
    part = problem.solve(loads, tol=1e-13)
    assert (full.status[1] == 1).any()
    compared(quarter, part, whole, full)
    assert inspect(quarter, prescribed=np.zeros(len(quarter.fixed))) == []
    rest = problem.solve(loads[1:], tol=1e-13, start=part[0])
    np.testing.assert_array_equal(rest.displacement, part.displacement[1:])


def ring(name: str, radii: tuple[float, float], sectors: int) -> Body:
    """One of some sectors of a ring of 24 quadrilaterals; a closed ring for one sector."""
    closed, turns = sectors == 1, 24 // sectors
    angle = 2 * np.pi / 24 * np.arange(turns + (not closed))
    radius = np.linspace(*radii, 3)
    p = np.array([(r * np.cos(a), r * np.sin(a)) for a in angle for r in radius]).T
    many = len(angle)
    cells = [
        [3 * j + i, 3 * j + i + 1, 3 * (k := (j + 1) % many) + i + 1, 3 * k + i]
        for j in range(turns)
        for i in range(2)
    ]
    mesh = skfem.MeshQuad(p, np.array(cells).T)
    facets = mesh.boundary_facets()
    x, y = mean = mesh.p[:, mesh.facets[:, facets]].mean(axis=1)
    size, last = np.linalg.norm(mean, axis=0), angle[-1]
    named = {
        "inner": facets[size < radius[0] * 1.01],
        "outer": facets[size > radius[-1] * 0.96],
    }
    if not closed:
        named["first"] = facets[np.abs(y) < 1e-9]
        named["last"] = facets[np.abs(np.cos(last) * y - np.sin(last) * x) < 1e-9]
    return Body(name, mesh.with_boundaries(named), SOFT)


def test_sector_of_a_shrink_fit() -> None:
    """Two rings with interference, twisted: bent contact surfaces, a cut at 60°."""
    fit = Contact("rim", "inner", 0.2, against=("hub", "outer"), clearance=-0.01)
    cuts = [Cyclic((name, "first"), (name, "last"), 6) for name in ("hub", "rim")]

    def solved(sectors: int) -> tuple[fem.Assembly, Any]:
        model = fem.assemble(
            [ring("hub", (0.5, 1.0), sectors), ring("rim", (1.0, 2.0), sectors)],
            [fit],
            [Support("hub", "inner", (0, 1))],
            repetitions=cuts if sectors > 1 else [],
        )
        f = model.traction("rim", "outer", lambda x: 0.04 * np.stack([-x[1], x[0]]))
        return model, model.problem().solve([0 * f, f], tol=1e-13)

    (whole, full), (sector, part) = solved(1), solved(6)
    assert (full.status[1] != 0).all()
    compared(sector, part, whole, full)


def test_a_fit_twisted_more_than_friction_holds() -> None:
    """Interference gives the normal forces: no verdict from statics, but the cause is named."""
    shaft = Sphere([0.0, 0.0], 1.01)
    model = fem.assemble(
        [ring("rim", (1.0, 2.0), 1)], [Contact("rim", "inner", 0.3, obstacle=shaft)]
    )
    press = model.pressure("rim", "outer", 5.0)
    twist = model.traction("rim", "outer", lambda x: 0.04 * np.stack([-x[1], x[0]]))
    held = model.problem().solve(press + 10 * twist)[0].reaction
    most = 10 * 0.3 * held[:, 0].sum() / np.abs(held[:, 1]).sum()
    with pytest.raises(bp.NotConvergedError, match="friction alone stops a") as raised:
        model.problem().solve(press + 20 * twist)
    share = float(re.findall(r"limit is (\S+) of what", str(raised.value))[0])
    # Of normal forces that slip has changed a little.
    assert share == pytest.approx(most / 20, rel=0.2)


@pytest.mark.parametrize("pairing", ["match", "mortar"])
def test_one_period_of_two(pairing: str) -> None:
    wavy: Any = {
        "plane": ([0, 0], [0, 1]),
        "pairing": pairing,
        "clearance": lambda x: 0.002 * (1 - np.cos(2 * np.pi * x[:, 0])),
    }
    cut = Periodic(("it", "left"), ("it", "right"))

    def solved(periods: int) -> tuple[fem.Assembly, Any]:
        x = np.linspace(0, periods, 6 * periods + 1)
        mesh = fem.box([x, np.linspace(0, 1, 4)], "quadrilateral")
        contacts = [Contact("it", "bottom", 0.3, **wavy)]
        model = fem.assemble([Body("it", mesh, SOFT)], contacts, repetitions=[cut])
        f = model.traction("it", "top", [0.9, -5.0])
        return model, model.problem().solve(f, tol=1e-13)

    (whole, full), (period, part) = solved(2), solved(1)
    assert len(np.unique(full.status)) > 1
    if pairing == "match":
        compared(period, part, whole, full)
    # A reaction on a cut of mortar contacts is shared by its two halves.
    assert part.reaction[0, :, 0].sum() == pytest.approx(5.0, rel=SOLVED)
    _, at = cKDTree(whole.nodes).query(period.nodes)
    u = full.displacement[0].reshape(-1, 2)[at].ravel()
    close(part.displacement[0, : u.size], u, SOLVED)


def test_period_in_two_directions() -> None:
    """A corner is the image of three others: a uniform pressure gives uniform strain."""
    pairs = (("left", "right"), ("front", "back"))
    model = fem.assemble(
        [Body("it", box("hexahedron", 2), SOFT)],
        [Contact("it", "bottom", 0.3, obstacle=FLOOR)],
        repetitions=[Periodic(("it", on), ("it", onto)) for on, onto in pairs],
    )
    np.testing.assert_allclose(model.area, 0.25, rtol=1e-14)
    result = model.problem().solve(model.pressure("it", "top", 3.0), tol=1e-13)
    np.testing.assert_allclose(result.traction[0, :, 0], 3.0, rtol=SOLVED)
    # Held laterally by its neighbours: the constrained modulus.
    modulus = 1000 * 0.7 / (1.3 * 0.4)
    wanted = np.outer(model.nodes[:, 2], [0, 0, -3.0 / modulus])
    near(result.displacement[0].reshape(-1, 3), wanted, SOLVED * 0.01)


def test_half_a_turn_about_an_axis_in_the_surface_of_the_cut() -> None:
    """The cut is one surface, mapped to itself: half of a pad, and the whole pad."""
    side, height = np.linspace(-1, 1, 7), np.linspace(0, 0.5, 3)
    floor = [Contact("pad", "bottom", 0.3, obstacle=FLOOR)]

    def solved(y: Floats, *cuts: Any) -> tuple[fem.Assembly, Any]:
        body = Body("pad", fem.box([side, y, height], "hexahedron"), SOFT)
        model = fem.assemble([body], floor, repetitions=cuts)
        f = model.pressure("pad", "top", 10.0)
        for on, push in (("right", 2.5), ("left", -2.5)):
            f = f + model.traction("pad", on, [0.0, push, 0.0])
        return model, model.problem().solve(f, tol=1e-13)

    cut = Cyclic(("pad", "front"), ("pad", "front"), 2, axis=[0, 0, 1])
    (half, part), (whole, full) = solved(np.linspace(0, 1, 4), cut), solved(side)
    assert half.area.sum() == pytest.approx(2.0, rel=1e-14)
    assert len(np.unique(full.status)) > 1
    compared(half, part, whole, full)
    on = ("pad", "left")
    with refused("are the same: name its two cuts"):
        fem.assemble(half.bodies, floor, repetitions=[Periodic(on, on)])


def test_an_obstacle_under_a_force_moves_along_the_axis_alone() -> None:
    """Four sectors push a common plane across the axis by forces that cancel."""
    held = [Support("pad", "top", (0, 1, 2))]

    def made(quarter: bool, *components: int) -> fem.Assembly:
        free = fem.Floating("floor", components)
        contact = Contact("pad", "bottom", 0.3, obstacle=FLOOR, floating=free)
        cuts = [QUARTER] if quarter else []
        return fem.assemble([pad(2, quarter)], [contact], held, repetitions=cuts)

    def pushed(model: fem.Assembly, force: float) -> Any:
        f = model.reference_force("floor", [0, 0, force])
        return model.problem().solve(f, tol=1e-13)

    whole, quarter = made(False, 0, 2), made(True, 2)
    part, full = pushed(quarter, 5.0), pushed(whole, 20.0)
    compared(quarter, part, whole, full)
    shift, _ = whole.reference_motion("floor", full.displacement[0])
    near(shift[0], 0, SOLVED * shift[2])
    with refused(r"along x, but with the sectors of pad\.front and"):
        made(True, 0, 2)


@pytest.mark.parametrize("swapped", [False, True])
def test_a_period_on_a_body_that_does_not_repeat(swapped: bool) -> None:
    """The nodes at both ends of the other body keep their contacts: none penetrates."""
    on, against = [("upper", "bottom"), ("lower", "top")][:: -1 if swapped else 1]
    model = fem.assemble(
        stacked("upper", "lower"),
        [Contact(*on, 0.3, against=against)],
        [Support("lower", "bottom", (0, 1)), Support("upper", "top", (0, 1))],
        repetitions=[Periodic(("upper", "left"), ("upper", "right"))],
    )
    moved = model.prescribed([[0.0, 0.0], [0.0, -0.01]])
    result = model.problem().solve(prescribed=moved, tol=1e-13)
    u = result.displacement[0].reshape(-1, 2)
    up, low = (
        u[(model.nodes[:, 1] == 0) & (places(model)[:, 2] == body), 1]
        for body in (0, 1)
    )
    # The upper body is uniform along x: pressed at every node.
    near(up - low, 0, SOLVED * 0.01)
    # Both bodies are symmetric about x = 1/2.
    force = np.einsum("ck,ckd->cd", result.reaction[0], model.frame)
    order = np.argsort(model.points[:, 0])
    size = SOLVED * np.abs(force).max()
    near(force[order, 1], force[order[::-1], 1], size)


def test_motions_and_clearances_that_do_not_repeat() -> None:
    """A plane that slides along x does not repeat itself about z, one that turns does."""

    def made(motion: Motion) -> fem.Assembly:
        contact = Contact("pad", "bottom", 0.3, obstacle=FLOOR, motion=motion)
        return fem.assemble([pad(2, True)], [contact], repetitions=[QUARTER])

    made(Motion([[0.0, 0.0, 0.1]], [0.2], axis=[0, 0, 1]))
    with refused("gaps, normals or motions differ at"):
        made(Motion([[1e-6, 0.0, 0.0]]))
    contact = Contact("on", "bottom", 0.3, against=("under", "top"))
    wedge = replace(contact, clearance=lambda x: 0.1 * x[:, 0])
    cuts = [Periodic((name, "left"), (name, "right")) for name in ("on", "under")]
    with refused(r"it is 0 at \(0, 0\) and 0\.1 at its image: give both"):
        fem.assemble(stacked("on", "under"), [wedge], repetitions=cuts)


@pytest.mark.parametrize(
    ("cut", "message"),
    [
        ({"sectors": 5}, "do not repeat each other: the image of the node at"),
        ({"axis": None}, "axis of pad.front and pad.left is missing"),
        ({"sectors": 1}, "sectors of pad.front and pad.left is 1, expected"),
        ({}, "does not repeat itself with the surfaces pad.front and pad.left"),
    ],
)
def test_mistakes_of_repetitions(cut: dict[str, Any], message: str) -> None:
    tilted = Contact("pad", "bottom", 0.3, obstacle=Plane([0, 0, 0], [0.1, 0, 1]))
    contacts = [] if cut else [tilted]
    with refused(message):
        cuts = [replace(QUARTER, **cut)]
        fem.assemble([pad(2, True)], contacts, repetitions=cuts)


def test_cuts_through_the_section_of_a_bolt() -> None:
    """The section doubles the nodes on it."""
    body = Body("it", fem.box([np.linspace(0, 1, 3)] * 2, "quadrilateral"), SOFT)
    with refused(
        r"several nodes of it.left are at \(0, 0.5\), as where the section of a"
    ):
        fem.assemble(
            [body],
            [],
            repetitions=[Periodic(("it", "left"), ("it", "right"))],
            bolts=[fem.Bolt("M8", "it", ([0.5, 0.5], [0, 1]))],
        )


def test_cuts_of_different_meshes() -> None:
    longer = fem.box([np.linspace(0, 1, 3), np.linspace(0, 1, 4)], "quadrilateral")
    cut = Cyclic(("it", "bottom"), ("it", "left"), 4)
    with refused("but have 3 and 4 nodes: mesh both in the same"):
        fem.assemble([Body("it", longer, SOFT)], [], repetitions=[cut])
