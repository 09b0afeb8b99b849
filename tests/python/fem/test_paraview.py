"""Files for ParaView: stresses and surfaces are right, and are read back as written."""

import xml.etree.ElementTree as ET
from functools import cache
from pathlib import Path
from typing import Any

import meshio
import numpy as np
import pytest

import bipot_rs as bp
from bipot_rs import fem
from bipot_rs.fem import paraview
from bipot_rs.fem.bodies.stress_recovery import von_mises
from bipot_rs.fem.contact_surface import contact_surface
from bipot_rs.fem.paraview import BodySeries, Part
from support.boxes import CELLS, box, placed

FACETS = dict(zip(CELLS, ("line", "line", "triangle", "quad"), strict=True))
YOUNG, POISSON = 10.0, 0.3


def test_von_mises() -> None:
    pull = np.diag([-3.0, 0.0, 0.0])
    shear = np.zeros((3, 3))
    shear[0, 1] = shear[1, 0] = 2.0
    every = np.stack([pull, shear, 5 * np.eye(3), pull + 7 * np.eye(3)])
    exact = [3.0, 2 * np.sqrt(3), 0.0, 3.0]
    np.testing.assert_allclose(von_mises(every), exact, rtol=1e-14)
    turn, _ = np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))
    np.testing.assert_allclose(von_mises(turn @ every @ turn.T), exact, atol=1e-14)


@cache
def pressed(cell: str) -> tuple[fem.Assembly, Any]:
    """Two blocks, one on the other on a floor, pressed and dragged in two steps."""
    up = np.eye(dim := CELLS[cell])[-1]
    sides = [np.linspace(0, 1, 4)] * (dim - 1)
    high, low = (fem.box([*sides, z], cell) for z in ([0, 0.5, 1], [-1, -0.5, 0]))
    material = fem.Material(YOUNG, POISSON)
    model = fem.assemble(
        [fem.Body("low", low, material), fem.Body("high", high, material)],
        [
            fem.Contact("high", "bottom", mu=0.4, against=("low", "top")),
            fem.Contact("low", "bottom", 0.6, (-up, up)),
        ],
        [fem.Support("high", "top", range(dim))],
    )
    ways = [0.02 * k * np.eye(dim)[0] - 0.05 * up for k in (0, 1)]
    moved = np.array([model.prescribed([way]) for way in ways])
    return model, model.problem().solve(prescribed=moved)


@pytest.mark.parametrize("cell", CELLS)
def test_contact_surface(cell: str) -> None:
    model, _ = pressed(cell)
    ((kind, corners),) = contact_surface(model)
    assert kind == FACETS[cell]
    x = model.points[corners]
    if model.dim == 2:
        size = np.linalg.norm(x[:, 1] - x[:, 0], axis=1)
    else:
        normal = np.cross(x[:, 1] - x[:, 0], x[:, 2] - x[:, 1])
        # These normals point outwards, those of contacts inwards.
        assert (np.sum(normal * model.frame[corners[:, 0], 0], axis=1) < 0).all()
        # Facets are parallelograms or halves of them; a wrong order of corners breaks this.
        size = np.linalg.norm(normal, axis=1) / (2 if kind == "triangle" else 1)
    # Both surfaces are 1 wide, and no facet of one has a corner on the other.
    assert size.sum() == pytest.approx(2.0, rel=1e-14)
    assert (np.ptp(model.group[corners], axis=1) == 0).all()


def test_contacts_on_no_facet_are_points() -> None:
    mesh = fem.box([np.linspace(0, 1, 5), [0, 1]], "quadrilateral")
    it = fem.Body("it", mesh, fem.Material(YOUNG, POISSON))
    contacts = [
        fem.Contact("it", "bottom", 0.3, ([0, 0], [0, 1]), within={0: (0.2, 0.55)}),
        fem.Contact("it", "top", 0.3, ([0, 1], [0, -1]), within={0: (0.9, 1.0)}),
    ]
    model = fem.assemble([it], contacts, [fem.Support("it", "left", [0, 1])])
    assert len(model.points) == 3
    (line, ends), (vertex, alone) = contact_surface(model)
    assert (line, vertex) == ("line", "vertex")
    np.testing.assert_array_equal(np.sort(ends), [[0, 1]])
    np.testing.assert_array_equal(alone, [[2]])


@pytest.mark.parametrize("cell", CELLS)
def test_files_read_back(cell: str, tmp_path: Path) -> None:
    model, result = pressed(cell)
    paraview.write(tmp_path / "a.pvd", model, result)
    names = {p.name for p in tmp_path.iterdir()}
    series = {f"a{part}_000{k}.vtu" for part in ("", "_contact") for k in (0, 1)}
    assert names == {"a.pvd", "a_contact.pvd"} | series
    d, before = model.dim, 0.0
    for k, step in enumerate(result):
        whole = meshio.read(tmp_path / f"a_000{k}.vtu")
        xx, yy, zz, xy, yz, xz = np.concatenate(whole.cell_data["stress"]).T
        mises = (xx - yy) ** 2 + (yy - zz) ** 2 + (zz - xx) ** 2
        mises = np.sqrt(mises / 2 + 3 * (xy**2 + yz**2 + xz**2))
        written = np.concatenate(whole.cell_data["von_mises"])
        np.testing.assert_allclose(written, mises, rtol=1e-12)
        u = whole.point_data["displacement"][:, :d].ravel()
        np.testing.assert_array_equal(u, step.displacement)

        part = meshio.read(tmp_path / f"a_contact_000{k}.vtu")
        np.testing.assert_array_equal(part.points[:, :d], model.points)
        told = {name: np.asarray(v) for name, v in part.point_data.items()}
        normal, slip, traction, force, moved = (
            told[name][:, :d]
            for name in ("normal", "slip", "traction", "force", "displacement")
        )
        np.testing.assert_array_equal(told["status"], step.status)
        # B of the model and the fields lead to the same numbers independently.
        left = step.relative_displacement[:, 0]
        np.testing.assert_array_equal(told["gap"], left)
        v = (model.B @ step.displacement).reshape(-1, d)
        # All may stick and stay closed, where the difference is the rounding of u.
        size = 1e-12 * np.abs(step.displacement).max()
        np.testing.assert_allclose(left, v[:, 0] + model.gap, atol=size)
        if k:
            local = np.einsum("cdk,ck->cd", model.frame[:, 1:], slip)
            np.testing.assert_allclose(local, (v - before)[:, 1:], atol=size)
        before = v
        np.testing.assert_allclose(np.sum(slip * normal, axis=1), 0)
        pressure = np.sum(traction * normal, axis=1)
        np.testing.assert_allclose(told["pressure"], pressure, rtol=1e-12)
        np.testing.assert_allclose(force.sum(axis=0), result.resultant[k], rtol=1e-12)
        at = model.contact_dofs[:, 0, None] + np.arange(d)
        np.testing.assert_allclose(moved, step.displacement[at])


def test_stress_balances_the_pressure_of_contact() -> None:
    """Stacked bodies: -∫ σ_zz dV over a block is its height times the force."""
    model, result = pressed("hexahedron")
    step = result[0]
    fields = paraview.cell_fields(model, step.displacement)
    (_, low), (_, high) = model.cells
    volume = 1.0 / len(low)
    force = step.reaction[model.group == 0, 0].sum()
    zz = fields["stress"][:, 2]
    # Both blocks are 1 high and carry no other vertical load; in the upper one the
    # support is as far from its middle as the contact is.
    assert -zz[: len(low)].sum() * volume == pytest.approx(force, rel=1e-9)
    assert -zz[len(low) :].sum() * volume == pytest.approx(force, rel=1e-9)
    assert len(zz) == len(low) + len(high)


def test_result_writes_forces_in_global_components(tmp_path: Path) -> None:
    model, result = pressed("quadrilateral")
    result.write(tmp_path / "x.pvd")
    points = meshio.read(tmp_path / "x_0001.vtu").point_data
    np.testing.assert_allclose(
        points["force"].sum(axis=0)[:2], result.resultant[1], rtol=1e-12
    )
    np.testing.assert_array_equal(points["reaction_local"][:, :2], result[1].reaction)
    assert len(points["status"]) == len(model.points)


COUNT = 3


def solved(cell: str, degree: int) -> tuple[fem.Assembly, bp.Result]:
    """Two bodies, the upper one, perhaps of second order, pressed on the lower one."""
    upper, below = box(cell, degree=degree), box(cell)
    d = CELLS[cell]
    lower = placed(below, below.p - np.eye(d)[-1][:, None])
    bodies = [
        fem.Body("upper", upper, fem.Material(3.0, 0.3)),
        fem.Body("lower", lower, fem.Material(1.0, 0.2)),
    ]
    on = {"against": ("lower", "top"), "pairing": "mortar"}
    ends = ("upper", "top"), ("lower", "bottom")
    supports = [fem.Support(*end, range(d)) for end in ends]
    model = fem.assemble(bodies, [fem.Contact("upper", "bottom", 0.3, **on)], supports)
    moved = model.prescribed([-0.01 * np.eye(d)[-1], np.zeros(d)])
    return model, model.problem().solve(None, np.outer([0.5, 1.0], moved))


@pytest.mark.parametrize(
    ("cell", "degree"),
    [("quadrilateral", 1), ("tetrahedron", 1), ("hexahedron", 1), ("hexahedron", 2)],
)
def test_parts_have_the_cells_and_fields_of_the_whole(
    cell: str, degree: int, tmp_path: Path
) -> None:
    model, result = solved(cell, degree)
    counts = [int(body.mesh.nelements) for body in model.bodies]
    owner = [np.arange(count) % COUNT for count in counts]
    parts = [
        Part(k, COUNT, [np.flatnonzero(of_rank == k) for of_rank in owner])
        for k in range(COUNT)
    ]
    every = np.concatenate(owner)
    rest = np.random.default_rng(1).normal(size=(sum(counts), 3, 3))
    for series in (
        BodySeries(tmp_path / "whole.pvd", model),
        *(BodySeries(tmp_path / "it.pvd", model, part) for part in parts),
    ):
        for step in result:
            series.add(step, rest, {"owner": every.astype(float)})
        series.end()
    for k in range(len(result)):
        expected = meshio.read(tmp_path / f"whole_{k:04d}.vtu")
        listing = ET.parse(tmp_path / f"it_{k:04d}.pvtu").getroot()
        assert listing.attrib["type"] == "PUnstructuredGrid"
        names = [piece.attrib["Source"] for piece in listing.iter("Piece")]
        assert names == [f"it_{k:04d}_{part:04d}.vtu" for part in range(COUNT)]
        # Fields of the cells, in the order of the whole: the number of each is known.
        place = np.argsort(np.argsort(every, kind="stable"), kind="stable")
        pieces = [meshio.read(tmp_path / name) for name in names]
        for name, field in expected.cell_data.items():
            of_rank = np.concatenate([x for p in pieces for x in p.cell_data[name]])
            wanted = np.concatenate(field)
            np.testing.assert_allclose(of_rank[place], wanted, rtol=1e-12, atol=1e-15)
        for part, piece in enumerate(pieces):
            assert set(np.concatenate(piece.cell_data["owner"])) == {float(part)}
            for name, field in expected.point_data.items():
                # Positions of two bodies may agree, and then their fields differ.
                for body, first in zip(model.bodies, model.offset, strict=True):
                    at = slice(
                        first // model.dim, first // model.dim + len(body.points)
                    )
                    check(piece, name, field[at], body, model)
        named(tmp_path / names[0], listing)
    index = ET.parse(tmp_path / "it.pvd").getroot()
    files = [item.attrib["file"] for item in index.iter("DataSet")]
    assert files == [f"it_{k:04d}.pvtu" for k in range(len(result))]


def check(
    piece: meshio.Mesh, name: str, field: Any, body: fem.Body, model: fem.Assembly
) -> None:
    """Values of a field at nodes of one body that lie off the common plane."""

    def key(x: Any) -> tuple[float, ...]:
        return tuple(np.round(x[: model.dim], 9) + 0.0)

    fields_at = dict(zip(map(key, body.points), field, strict=True))
    common = {key(x) for x in model.points}
    for x, value in zip(piece.points, piece.point_data[name], strict=True):
        at = key(x)
        if at in fields_at and at not in common and at[-1] != 0:
            np.testing.assert_array_equal(value, fields_at[at])


def named(piece: Path, listing: Any) -> None:
    """The listing has the names, types and components of the fields of a piece."""
    root_of_piece = ET.parse(piece).getroot()
    for place in ("PointData", "CellData", "Points"):
        arrays = [array.attrib for array in root_of_piece.find(f".//{place}")]
        listed = [array.attrib for array in listing.find(f".//P{place}")]
        assert listed
        for mine, theirs in zip(arrays, listed, strict=True):
            assert {key: mine[key] for key in theirs} == theirs
            assert {"type", "Name"} <= set(theirs)


def test_a_part_without_cells(tmp_path: Path) -> None:
    """A rank may own no first node of a cell."""
    model, result = solved("quadrilateral", 1)
    none = [np.zeros(0, np.int64)] * 2
    every = [np.arange(int(body.mesh.nelements)) for body in model.bodies]
    for part in (Part(0, 2, every), Part(1, 2, none)):
        series = BodySeries(tmp_path / "it.pvd", model, part)
        series.add(result[0])
        series.end()
    empty = ET.parse(tmp_path / "it_0000_0001.vtu").getroot().find(".//Piece")
    assert empty is not None
    assert empty.attrib == {"NumberOfPoints": "0", "NumberOfCells": "0"}
