"""Cyclic symmetry and periodicity, compared with the whole structure."""

from typing import Any

import numpy as np
import pytest
import skfem
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from bipot_rs import fem
from bipot_rs.fem.assembly.assembly import Support
from bipot_rs.fem.bodies.body import Body
from bipot_rs.fem.checks.inspection import inspect
from bipot_rs.fem.constraints.repetition import Cyclic, Periodic
from bipot_rs.fem.contact.contact import Contact
from bipot_rs.obstacle.motion import Motion
from bipot_rs.obstacle.shapes import Plane, Sphere
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
    v = part.displacement[-1, : one.nodes.size].reshape(-1, d)
    close(v, u, SOLVED)
    apart, at = cKDTree(whole.points).query(one.points)
    assert apart.max() < 1e-12
    wanted = np.einsum("ck,ckd->cd", full.traction[-1], whole.frame)[at]
    traction = np.einsum("ck,ckd->cd", part.traction[-1], one.frame)
    close(traction, wanted, 100 * SOLVED)
    fields = one.fields(part.displacement[-1], part.reaction[-1], part.status[-1])
    every = whole.fields(full.displacement[-1], full.reaction[-1], full.status[-1])
    _, at = cKDTree(places(whole)).query(places(one))
    # A node on the axis cannot slide: without friction, its status is slip.
    off = np.linalg.norm(one.nodes[:, :2], axis=1) > 0
    for name in ("contact_pressure", "contact_shear", "contact_status"):
        np.testing.assert_allclose(
            fields[name][off],
            every[name][at][off],
            rtol=0,
            atol=100 * SOLVED * np.abs(wanted).max(),
            err_msg=name,
        )


def pad(n: int, quarter: bool) -> Body:
    side = np.linspace(0, 1, n + 1) if quarter else np.linspace(-1, 1, 2 * n + 1)
    return Body(
        "pad", fem.box([side, side, np.linspace(0, 0.5, 3)], "hexahedron"), SOFT
    )


@pytest.mark.parametrize("engine", ["direct", "iterative"])
def test_quarter_of_a_twisted_pad(engine: str) -> None:
    """Pressed on a sphere-like floor and twisted: a path with slip, no plane of symmetry."""
    floor = Sphere([0.0, 0.0, -2000.0], 2000.0)
    contact = [Contact("pad", "bottom", 0.3, obstacle=floor)]

    def load(
        model: fem.Assembly, sides: dict[str, list[float]], twist: float
    ) -> Floats:
        f = model.pressure("pad", "top", 10.0)
        for side, force in sides.items():
            f = f + model.traction("pad", side, twist * np.array(force))
        return f

    two = {"right": [0.0, 1.5, 0.0], "back": [-1.5, 0.0, 0.0]}
    four = two | {"left": [0.0, -1.5, 0.0], "front": [1.5, 0.0, 0.0]}
    whole = fem.assemble([pad(3, False)], contact)
    cut = Cyclic(("pad", "front"), ("pad", "left"), 4, axis=[0, 0, 3.0])
    quarter = fem.assemble([pad(3, True)], contact, repetitions=[cut])
    assert quarter.area.sum() == pytest.approx(1.0, rel=1e-14)
    path = (0.3, 1.0, 0.2)
    full = whole.problem(engine="direct").solve(
        [load(whole, four, x) for x in path], tol=1e-13
    )
    problem = quarter.problem(engine=engine)
    part = problem.solve([load(quarter, two, x) for x in path], tol=1e-13)
    assert (full.status[1] == 1).any()
    compared(quarter, part, whole, full)
    assert inspect(quarter, prescribed=np.zeros(len(quarter.fixed))) == []
    rest = problem.solve(
        [load(quarter, two, x) for x in path[1:]], tol=1e-13, start=part[0]
    )
    np.testing.assert_array_equal(rest.displacement, part.displacement[1:])


def ring(name: str, radii: tuple[float, float], count: int, sectors: int) -> Body:
    """One of some sectors of a ring of quadrilaterals; a closed ring for one sector."""
    closed = sectors == 1
    turns = count * 6 // sectors
    angle = 2 * np.pi / 6 / count * np.arange(turns + (not closed))
    radius = np.linspace(*radii, 3)
    p = np.array(
        [(r * np.cos(a), r * np.sin(a)) for a in angle for r in radius], float
    ).T
    many = len(angle)
    cells = [
        [
            3 * j + i,
            3 * j + i + 1,
            3 * ((j + 1) % many) + i + 1,
            3 * ((j + 1) % many) + i,
        ]
        for j in range(turns)
        for i in range(2)
    ]
    mesh = skfem.MeshQuad(p, np.array(cells).T)
    facets = mesh.boundary_facets()
    mean = mesh.p[:, mesh.facets[:, facets]].mean(axis=1)
    size = np.linalg.norm(mean, axis=0)
    named = {
        "inner": facets[size < radius[0] * 1.01],
        "outer": facets[size > radius[-1] * 0.96],
    }
    if not closed:
        last = angle[-1]
        named["first"] = facets[np.abs(mean[1]) < 1e-9]
        across = -np.sin(last) * mean[0] + np.cos(last) * mean[1]
        named["last"] = facets[np.abs(across) < 1e-9]
    return Body(name, mesh.with_boundaries(named), SOFT)


def test_sector_of_a_shrink_fit() -> None:
    """Two rings with interference, twisted: bent contact surfaces, a cut at 60°."""

    def made(sectors: int) -> fem.Assembly:
        bodies = [
            ring("hub", (0.5, 1.0), 4, sectors),
            ring("rim", (1.0, 2.0), 4, sectors),
        ]
        cuts = [Cyclic((name, "first"), (name, "last"), 6) for name in ("hub", "rim")]
        return fem.assemble(
            bodies,
            [Contact("rim", "inner", 0.2, against=("hub", "outer"), clearance=-0.01)],
            [Support("hub", "inner", (0, 1))],
            repetitions=cuts if sectors > 1 else [],
        )

    def twist(model: fem.Assembly) -> Floats:
        return model.traction("rim", "outer", lambda x: 0.04 * np.stack([-x[1], x[0]]))

    whole, sector = made(1), made(6)
    full = whole.problem().solve([0 * twist(whole), twist(whole)], tol=1e-13)
    part = sector.problem().solve([0 * twist(sector), twist(sector)], tol=1e-13)
    assert (full.status[1] != 0).all()
    compared(sector, part, whole, full)


@pytest.mark.parametrize("pairing", ["match", "mortar"])
def test_one_period_of_two(pairing: str) -> None:
    def made(periods: int) -> tuple[fem.Assembly, Floats]:
        x = np.linspace(0, periods, 6 * periods + 1)
        mesh = fem.box([x, np.linspace(0, 1, 4)], "quadrilateral")
        contact = Contact(
            "it",
            "bottom",
            0.3,
            plane=([0, 0], [0, 1]),
            pairing=pairing,
            clearance=lambda x: 0.002 * (1 - np.cos(2 * np.pi * x[:, 0])),
        )
        model = fem.assemble(
            [Body("it", mesh, SOFT)],
            [contact],
            repetitions=[Periodic(("it", "left"), ("it", "right"))],
        )
        f = model.pressure("it", "top", 5.0)
        return model, f + model.traction("it", "top", [0.9, 0.0])

    whole, f2 = made(2)
    period, f1 = made(1)
    full = whole.problem().solve(f2, tol=1e-13)
    part = period.problem().solve(f1, tol=1e-13)
    assert len(np.unique(full.status)) > 1
    if pairing == "match":
        compared(period, part, whole, full)
    d = 2 * len(period.nodes)
    # A reaction on a cut of mortar contacts is shared by its two halves.
    assert part.reaction[0, :, 0].sum() == pytest.approx(5.0, rel=SOLVED)
    _, at = cKDTree(whole.nodes).query(period.nodes)
    u = full.displacement[0].reshape(-1, 2)[at].ravel()
    close(part.displacement[0, :d], u, SOLVED)


def test_period_in_two_directions() -> None:
    """A corner is the image of three others: a uniform pressure gives uniform strain."""
    mesh = fem.box([np.linspace(0, 1, 3)] * 3, "hexahedron")
    model = fem.assemble(
        [Body("it", mesh, SOFT)],
        [Contact("it", "bottom", 0.3, plane=(np.zeros(3), [0, 0, 1]))],
        repetitions=[
            Periodic(("it", "left"), ("it", "right")),
            Periodic(("it", "front"), ("it", "back")),
        ],
    )
    np.testing.assert_allclose(model.area, 0.25, rtol=1e-14)
    result = model.problem().solve(model.pressure("it", "top", 3.0), tol=1e-13)
    np.testing.assert_allclose(result.traction[0, :, 0], 3.0, rtol=SOLVED)
    # Held laterally by its neighbours: the constrained modulus.
    modulus = 1000 * 0.7 / (1.3 * 0.4)
    u = result.displacement[0].reshape(-1, 3)
    wanted = np.zeros_like(u)
    wanted[:, 2] = -3.0 / modulus * model.nodes[:, 2]
    near(u, wanted, SOLVED * 0.01)


def test_half_a_turn_about_an_axis_in_the_surface_of_the_cut() -> None:
    """The cut is one surface, mapped to itself: half of a pad, and the whole pad."""
    side, height = np.linspace(-1, 1, 7), np.linspace(0, 0.5, 3)
    floor = [Contact("pad", "bottom", 0.3, plane=([0, 0, 0], [0, 0, 1]))]

    def solved(y: Floats, *cuts: Any) -> tuple[fem.Assembly, Any]:
        body = Body("pad", fem.box([side, y, height], "hexahedron"), SOFT)
        model = fem.assemble([body], floor, repetitions=cuts)
        f = model.pressure("pad", "top", 10.0)
        f = f + model.traction("pad", "right", [0.0, 2.5, 0.0])
        f = f + model.traction("pad", "left", [0.0, -2.5, 0.0])
        return model, model.problem().solve(f, tol=1e-13)

    cut = Cyclic(("pad", "front"), ("pad", "front"), 2, axis=[0, 0, 1])
    half_model, part = solved(np.linspace(0, 1, 4), cut)
    assert half_model.area.sum() == pytest.approx(2.0, rel=1e-14)
    whole, full = solved(side)
    assert len(np.unique(full.status)) > 1
    compared(half_model, part, whole, full)
    on = ("pad", "left")
    with refused("are the same: name its two cuts"):
        fem.assemble(half_model.bodies, floor, repetitions=[Periodic(on, on)])


def test_an_obstacle_under_a_force_moves_along_the_axis_alone() -> None:
    """Four sectors push a common plane across the axis by forces that cancel."""
    floor = Plane([0, 0, 0], [0, 0, 1])
    sides = [fem.Floating("floor", (2,)), fem.Floating("floor", (0, 2))]
    low, aside = (
        [Contact("pad", "bottom", 0.3, obstacle=floor, floating=quarter)]
        for quarter in sides
    )
    held = [Support("pad", "top", (0, 1, 2))]
    whole = fem.assemble([pad(2, False)], aside, held)
    cut = Cyclic(("pad", "front"), ("pad", "left"), 4, axis=[0, 0, 1])
    quarter = fem.assemble([pad(2, True)], low, held, repetitions=[cut])
    f = quarter.reference_force("floor", [0, 0, 5.0])
    part = quarter.problem().solve(f, tol=1e-13)
    f = whole.reference_force("floor", [0, 0, 20.0])
    full = whole.problem().solve(f, tol=1e-13)
    compared(quarter, part, whole, full)
    shift, _ = whole.reference_motion("floor", full.displacement[0])
    near(shift[0], 0, SOLVED * shift[2])
    with refused(r"along x, but with the sectors of pad\.front and"):
        fem.assemble([pad(2, True)], aside, held, repetitions=[cut])


def test_a_period_on_a_body_that_does_not_repeat() -> None:
    """The nodes at both ends of the other body keep their contacts: none penetrates."""
    upper = fem.box([np.linspace(0, 1, 5), np.linspace(0, 1, 5)], "quadrilateral")
    lower = fem.box([np.linspace(0, 1, 5), np.linspace(-1, 0, 5)], "quadrilateral")
    cut = Periodic(("upper", "left"), ("upper", "right"))
    for contact in (
        Contact("upper", "bottom", 0.3, against=("lower", "top")),
        Contact("lower", "top", 0.3, against=("upper", "bottom")),
    ):
        model = fem.assemble(
            [Body("upper", upper, SOFT), Body("lower", lower, SOFT)],
            [contact],
            [Support("lower", "bottom", (0, 1)), Support("upper", "top", (0, 1))],
            repetitions=[cut],
        )
        moved = model.prescribed([[0.0, 0.0], [0.0, -0.01]])
        result = model.problem().solve(prescribed=moved, tol=1e-13)
        u = result.displacement[0].reshape(-1, 2)
        on, under = (
            np.flatnonzero((model.nodes[:, 1] == 0) & (places(model)[:, 2] == body))
            for body in (0, 1)
        )
        opening = u[on, 1] - u[under, 1]
        # The upper body is uniform along x: pressed at every node.
        near(opening, 0, SOLVED * 0.01)
        # Both bodies are symmetric about x = 1/2.
        force = np.einsum("ck,ckd->cd", result.reaction[0], model.frame)
        order = np.argsort(model.points[:, 0])
        np.testing.assert_allclose(
            force[order, 1], force[order[::-1], 1], atol=SOLVED * np.abs(force).max()
        )


def test_motions_and_clearances_that_do_not_repeat() -> None:
    """A plane that slides along x does not repeat itself about z, one that turns does."""
    floor = Plane([0, 0, 0], [0, 0, 1])
    cut = Cyclic(("pad", "front"), ("pad", "left"), 4, axis=[0, 0, 1])

    def made(motion: Motion) -> fem.Assembly:
        contact = Contact("pad", "bottom", 0.3, obstacle=floor, motion=motion)
        return fem.assemble([pad(2, True)], [contact], repetitions=[cut])

    made(Motion([[0.0, 0.0, 0.1]], [0.2], axis=[0, 0, 1]))
    with refused("gaps, normals or motions differ at"):
        made(Motion([[1e-6, 0.0, 0.0]]))
    mesh = fem.box([np.linspace(0, 1, 3)] * 2, "quadrilateral")
    under = fem.box([np.linspace(0, 1, 3), np.linspace(-1, 0, 3)], "quadrilateral")
    contact = Contact(
        "on", "bottom", 0.3, against=("under", "top"), clearance=lambda x: 0.1 * x[:, 0]
    )
    with refused(r"it is 0 at \(0, 0\) and 0\.1 at its image: give both"):
        fem.assemble(
            [Body("on", mesh, SOFT), Body("under", under, SOFT)],
            [contact],
            repetitions=[
                Periodic((name, "left"), (name, "right")) for name in ("on", "under")
            ],
        )


def test_mistakes_of_repetitions() -> None:
    body = pad(2, True)

    def refuse_it(message: str, *cuts: Any, contacts: Any = ()) -> None:
        with refused(message):
            fem.assemble([body], contacts, repetitions=cuts)

    on, onto = ("pad", "front"), ("pad", "left")
    refuse_it(
        "do not repeat each other: the image of the node at",
        Cyclic(on, onto, 5, axis=[0, 0, 1]),
    )
    refuse_it("axis of pad.front and pad.left is missing", Cyclic(on, onto, 4))
    refuse_it(
        "sectors of pad.front and pad.left is 1, expected",
        Cyclic(on, onto, 1, axis=[0, 0, 1]),
    )
    tilted = Contact("pad", "bottom", 0.3, obstacle=Plane([0, 0, 0], [0.1, 0, 1]))
    refuse_it(
        "does not repeat itself with the surfaces pad.front and pad.left",
        Cyclic(on, onto, 4, axis=[0, 0, 1]),
        contacts=[tilted],
    )
    longer = fem.box([np.linspace(0, 1, 3), np.linspace(0, 1, 4)], "quadrilateral")
    with refused("but have 3 and 4 nodes: mesh both in the same"):
        fem.assemble(
            [Body("it", longer, SOFT)],
            [],
            repetitions=[Cyclic(("it", "bottom"), ("it", "left"), 4)],
        )
