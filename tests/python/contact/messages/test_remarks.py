"""Remarks on arrays: penetration, normals, units, contacts that never close."""

import json
import pickle
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy import sparse

import bipot_rs as bp
from bipot_rs import fem
from bipot_rs import obstacle as ob
from bipot_rs._lib.validation import csr
from bipot_rs.contact.messages.remarks import measure_bodies
from support.matrix_and_tables import of_nodes
from support.orders import CELLS, body, by_component

pytestmark = pytest.mark.needs_extra

YOUNG = 210e3


def given(
    one: fem.Body, contact: fem.Contact, supports: Any = (), *others: fem.Body
) -> tuple[fem.Assembly, dict[str, Any]]:
    model = fem.assemble([one, *others], [contact], supports)
    return model, {
        "gap": model.gap,
        "mu": model.mu,
        "fixed": model.fixed,
        "points": model.points,
        "coordinates": np.repeat(model.nodes, model.dim, axis=0),
    }


def floor(d: int, height: float = 0.0, *, pairing: str = "match") -> fem.Contact:
    normal = np.eye(d)[d - 1]
    plane = (height * normal).tolist(), normal
    return fem.Contact("a", "bottom", 0.3, plane=plane, pairing=pairing)


def pairing_of(cell: str, order: int) -> str:
    """At faces of six nodes, a constant pressure gives no force at the corners."""
    return "mortar" if (cell, order) == ("tetrahedron", 2) else "match"


def held(d: int) -> list[fem.Support]:
    return [fem.Support("a", "top", tuple(range(d)))]


def at_start(K: Any, B: Any, options: dict[str, Any]) -> tuple[str, ...]:
    return bp.ContactProblem(K, B, **options).remarks.at_start


def two_bodies(cell: str, low_young: float) -> list[fem.Body]:
    """A body on another one."""
    grid = np.linspace(0, 1, 4)
    return [
        fem.Body(name, fem.box([grid, low + grid], cell), fem.Material(young, 0.3))
        for name, low, young in (("a", 0.0, 1.0), ("b", -1.0, low_young))
    ]


def turned_round(B: Any, d: int, contacts: Any = slice(None)) -> Any:
    sign = np.ones(B.shape[0])
    sign[d * np.arange(B.shape[0] // d)[contacts]] = -1.0
    return sparse.csr_array(sparse.diags_array(sign) @ B)


@pytest.mark.parametrize(("cell", "d"), [("quadrilateral", 2), ("tetrahedron", 3)])
def test_normals(cell: str, d: int) -> None:
    meshed = body(cell, d, 1, cells=2)
    for supports in (held(d), []):
        model, options = given(meshed, floor(d), supports)
        count = len(model.gap)
        load = -np.tile(np.eye(d)[d - 1], len(model.nodes)) * 1e-3
        result = bp.solve(model.K, model.B, load, **options)
        assert result.remarks == ()
        assert "remark" not in str(result)
        wrong = turned_round(model.B, d)
        problem = bp.ContactProblem(model.K, wrong, **options)
        (remark,) = problem.remarks.at_start
        # At a corner the outward direction lies between three faces, with areas 1 to 2.
        least = count if (cell, d) != ("tetrahedron", 3) else count - 4
        told = re.fullmatch(
            rf"the normals of (\d+) of the {count} contacts point out of the body, first at "
            r"contact \d+: a normal must point from the obstacle to the body, and B must give "
            r"the displacement of the body minus that of the obstacle",
            remark,
        )
        assert least <= int(told[1]) <= count
        assert remark in str(problem)
        if supports:
            result = problem.solve(load)
            assert result.remarks[0] == remark
            assert result.remarks[1].startswith("no contact closes in any load step")
            assert remark in str(result)
            assert result.success
        (first, *_) = at_start(model.K, turned_round(model.B, d, [1]), options)
        assert first.startswith(f"the normals of 1 of the {count} contacts")
        assert "first at contact 1:" in first
    # Also with the other order of components.
    turned = by_component(model.n, d)
    options["coordinates"] = np.tile(model.nodes, (d, 1))
    options["fixed"] = np.flatnonzero(np.isin(turned, model.fixed))
    K = model.K[turned][:, turned]
    assert at_start(K, model.B[:, turned], options) == ()
    assert at_start(K, wrong[:, turned], options) == (remark,)


@pytest.mark.parametrize("seed", range(216))
@pytest.mark.quick_variants(*map(str, {*range(16)} - {5, 7, 13, 15}))
def test_normals_of_any_face(seed: int) -> None:
    """Exactly the reversed normals are found, for a body of any shape and direction."""
    rng = np.random.default_rng(seed)
    cell, d, order = CELLS[seed % len(CELLS)]
    meshed = body(cell, d, order, cells=3, aspect=10 ** rng.uniform(-1.5, 1.5))
    turn = np.linalg.qr(rng.normal(size=(d, d)))[0]
    rotation = np.kron(np.eye(len(meshed.points)), turn)
    K = sparse.csr_array(rotation @ fem.stiffness(meshed).toarray() @ rotation.T)
    K = (K + K.T) / 2 * 10 ** rng.uniform(-6, 12)
    x = (meshed.points @ turn.T + rng.normal(size=d)) * 10 ** rng.uniform(-6, 6)
    name = ["left", "right", "bottom", "top", "front", "back"][rng.integers(2 * d)]
    at = meshed.nodes(name)
    axis = {"left": 0, "right": 0, "bottom": d - 1, "top": d - 1}.get(name, 1)
    # Along an edge the outward direction lies between two or three faces. At faces of six
    # nodes, a constant pressure gives no force at the corners.
    low, high = meshed.points.min(axis=0), meshed.points.max(axis=0)
    other = np.delete(np.arange(d), axis)
    within = (
        (meshed.points[at][:, other] > low[other] + 1e-9)
        & (meshed.points[at][:, other] < high[other] - 1e-9)
    ).all(axis=1)
    if (cell, order) == ("tetrahedron", 2):
        load = fem.assemble([meshed], []).traction("a", name, np.eye(d)[axis])
        within &= load.reshape(-1, d)[at, axis] > 1e-9 * load.max()
    at = at[within]
    inwards = turn[:, axis] * (1 if name in ("left", "bottom", "front") else -1)
    frame = fem.frames(np.tile(inwards, (len(at), 1)))
    rows = np.arange(d * len(at)).reshape(-1, d, 1) + np.zeros((1, 1, d), int)
    columns = (d * at[:, None] + np.arange(d))[:, None] + np.zeros((1, d, 1), int)
    B = sparse.csr_array(
        (frame.ravel(), (rows.ravel(), columns.ravel())), (d * len(at), x.size)
    )
    wrong = rng.random(len(at)) < rng.choice([0.0, 0.3, 1.0])
    options = {"gap": 0 * wrong, "mu": 0.3, "coordinates": np.repeat(x, d, axis=0)}
    remarks = at_start(K, turned_round(B, d, wrong), options)
    told = [remark for remark in remarks if "normals" in remark]
    assert len(told) == wrong.any()
    for remark in told:
        count = f"of {wrong.sum()} of the {len(at)} contact"
        assert count in remark
        assert f"first at contact {np.argmax(wrong)}:" in remark


@pytest.mark.parametrize("radius", [0.05, 0.3, 2.0])
@pytest.mark.parametrize("at", [0.0, 0.5, 1.0])
def test_a_ball_next_to_an_edge_gives_no_remark(radius: float, at: float) -> None:
    meshed = body("hexahedron", 3, cells=6)
    ball = ob.Sphere([at, 0.5, 1 + radius], radius)
    contact = fem.Contact("a", "top", 0.1, obstacle=ball)
    model, options = given(meshed, contact, [fem.Support("a", "bottom", (0, 1, 2))])
    assert at_start(model.K, model.B, options) == ()
    (remark,) = at_start(model.K, turned_round(model.B, 3), options)
    assert "point out of the body" in remark


def ring(cells: int, layers: int, thickness: float) -> fem.Body:
    """A coarse ring: at its hole the neighbours of a node lie towards the middle."""
    grid = [np.linspace(0, 1, layers + 1), np.linspace(0, 1, cells + 1)]
    mesh = fem.box(grid, "quadrilateral")
    angle = 0.5 * np.pi * mesh.p[1]
    radius = 1.0 + thickness * mesh.p[0]
    places = np.stack([radius * np.cos(angle), radius * np.sin(angle)])
    return fem.Body("a", replace(mesh, doflocs=places), fem.Material(YOUNG, 0.3))


@pytest.mark.parametrize("thickness", [0.01, 0.3, 2.0])
def test_normals_in_a_coarse_hole(thickness: float) -> None:
    meshed = ring(4, 2, thickness)
    hole = fem.Contact("a", "left", 0.1, obstacle=ob.Cylinder([0, 0], 0.99))
    model, options = given(meshed, hole)
    assert at_start(model.K, model.B, options) == ()
    (remark,) = at_start(model.K, turned_round(model.B, 2), options)
    # At the ends of the arc the surface turns: the outward direction is between two faces.
    assert re.match("the normals of [35] of the 5 contacts point out", remark)


@pytest.mark.parametrize("pairing", ["match", "mortar"])
def test_normals_of_pairs(pairing: str) -> None:
    bodies = two_bodies("quadrilateral", 1e4)
    pair = fem.Contact("a", "bottom", 0.3, against=("b", "top"), pairing=pairing)
    model, options = given(bodies[0], pair, held(2), bodies[1])
    assert at_start(model.K, model.B, options) == ()
    # Exchanging both bodies and normals changes nothing; reversing the normals alone does.
    both = at_start(model.K, -model.B, options)
    assert ["point out of the body" in remark for remark in both] == [True]
    (remark,) = at_start(model.K, turned_round(model.B, 2), options)
    assert "the normals of 4 of the 4 contacts" in remark


def test_penetration() -> None:
    model, options = given(body("quadrilateral", 2), floor(2, 0.01), held(2))
    result = bp.solve(model.K, model.B, **options)
    (remark,) = result.remarks
    assert remark == (
        "5 of the 5 contacts penetrate at the start, most of all contact 0 at (0, 0), by "
        "0.01, 1 % of the size of the model: the first step pushes them out; this is right "
        "for an interference fit, else check the sign of gap, which is positive when open"
    )
    # Without coordinates; with rounding only; and with sizes known from the gaps only.
    (plain,) = at_start(np.eye(4), np.eye(4), {"gap": [-1e-6, 2e-6], "mu": 0.3})
    assert plain.startswith("1 of the 2 contacts penetrate at")
    assert "contact 0, by 1e-06: the first" in plain
    for gap in ([-1e-16, 1.0], [0.0, 0.0]):
        assert at_start(np.eye(4), np.eye(4), {"gap": gap, "mu": 0.3}) == ()


@pytest.mark.parametrize(("cell", "d", "order"), CELLS)
@pytest.mark.parametrize("size", [1e-3, 1.0, 1e3])
def test_loads_in_inconsistent_units(
    cell: str, d: int, order: int, size: float
) -> None:
    """The force that strains a bar by 1 is Young's modulus times its section."""
    grid = np.linspace(0, size, 3)
    mesh = fem.box([grid] * d, cell)
    mesh = fem.second_order(mesh) if order == 2 else mesh
    for poisson in (0.0, 0.45):
        meshed = fem.Body("a", mesh, fem.Material(YOUNG, poisson))
        contact = floor(d, pairing=pairing_of(cell, order))
        model, options = given(meshed, contact, held(d))
        problem = bp.ContactProblem(model.K, model.B, **options)
        unit = model.traction("a", "right", np.eye(d)[0])
        strength = problem.remarks.strength
        share = np.abs(unit).sum() / strength.force[0]
        # E over 2.5 G lies between 2 and 3.
        assert share * YOUNG == pytest.approx(2 * (1 + poisson) / 2.5, rel=1e-9)
        assert problem.solve(0.01 * YOUNG * unit).remarks[:0] == ()
        calm = problem.solve(0.01 * YOUNG * unit).remarks
        loud = problem.solve(np.outer([0.01, 10.0], YOUNG * unit)).remarks
        assert not any("units" in remark for remark in calm)
        (remark,) = (remark for remark in loud if "units" in remark)
        assert remark.startswith(
            "check the units: the loads on the body of degree of freedom 0 would strain its "
            "largest section by "
        )


def test_the_softer_of_two_bodies_determines_the_remark() -> None:
    soft, stiff = two_bodies("triangle", 1e6)
    pair = fem.Contact("a", "bottom", 0.3, against=("b", "top"))
    supports = [*held(2), fem.Support("b", "bottom", (0, 1))]
    model, options = given(soft, pair, supports, stiff)
    problem = bp.ContactProblem(model.K, model.B, **options)
    assert problem.solve(model.traction("b", "right", [1.0, 0.0])).remarks == ()
    (remark,) = problem.solve(model.traction("a", "right", [1.0, 0.0])).remarks
    assert "degree of freedom 0" in remark


def test_rows_of_supports_within_the_stiffness_say_nothing() -> None:
    """Their sums are the supports, not forces of the body."""
    meshed = fem.Body(
        "a", fem.box([np.linspace(0, 1, 4)] * 3, "hexahedron"), fem.Material(210e3, 0.3)
    )
    whole = sparse.csr_array(fem.assemble([meshed], []).K)
    places = np.repeat(meshed.points, 3, axis=0)
    top = places[:, 2] == 1.0
    bare = measure_bodies(csr("K", whole), places, "node")
    held = measure_bodies(
        csr("K", whole + sparse.diags_array(whole.diagonal() * top)), places, "node"
    )
    assert bare[0][top].any()
    assert not held[0][top].any()
    np.testing.assert_array_equal(held[0][~top], bare[0][~top])
    # Shears of the rows that are left: less than those of all.
    assert 0 < held[1].force[0] < bare[1].force[0]
    springs = whole + sparse.diags_array(whole.diagonal())
    nothing = measure_bodies(csr("K", springs), places, "node")
    assert np.isnan(nothing[1].force).all()


def test_slip_beyond_the_extent_of_the_contacts() -> None:
    """Coordinates of the contacts only, in metres; displacements are in millimetres."""
    K, B = np.diag([1e3, 1.0, 1e3, 1.0]), np.eye(4)
    points = np.array([[0.0, 0.0], [0.1, 0.0]])
    load = np.array([-1.0, 5.0, -1.0, 5.0])
    problem = bp.ContactProblem(K, B, gap=[0.0, 0.0], mu=0.1, points=points)
    (remark,) = problem.solve(load).remarks
    assert remark.startswith("contacts slip by up to 4.9 in a load step")
    assert problem.solve(1e-3 * load).remarks == ()


def test_remarks_are_saved_and_pickled(tmp_path: Path) -> None:
    K = np.eye(2)
    result = bp.solve(K, np.eye(2), [[1.0, 0.0]], gap=[-0.1], mu=0.3)
    assert len(result.remarks) == 2
    result.save(tmp_path / "one.h5")
    assert bp.load(tmp_path / "one.h5").remarks == result.remarks
    assert pickle.loads(pickle.dumps(result)).remarks == result.remarks
    problem = bp.ContactProblem(K, np.eye(2), gap=[-0.1], mu=0.3)
    again = pickle.loads(pickle.dumps(problem))
    assert again.solve([1.0, 0.0]).remarks == result.remarks
    several = problem.solve_many([{"load": [1.0, 0.0]}])
    assert several[0].remarks == result.remarks
    followed = problem.follow([1.0, 0.0])
    assert followed.remarks == result.remarks


def test_remarks_in_files(bipot: Any) -> None:
    """`bipot solve` prints them; with --json they are in its last line."""
    meshed = body("quadrilateral", 2)
    top = np.isin(np.arange(meshed.points.size) // 2, meshed.nodes("top"))
    K = fem.stiffness(meshed) + sparse.diags_array(1e9 * top)
    at = meshed.nodes("bottom")
    load = "node,fx,fy\n" + "".join(f"{k + 1},0,-1\n" for k in at)
    command = of_nodes(K, meshed.points, at, load, up=-1)
    status, out, _ = bipot(*command)
    assert status == 0
    assert "remark: the normals of 5 of the 5 contacts point out of the body" in out
    last = json.loads(bipot(*command, "--json")[1].splitlines()[-1])
    assert last["remarks"][0] in out
