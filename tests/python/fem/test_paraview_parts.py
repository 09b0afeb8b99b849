"""A series for ParaView that several processes write, each with its cells."""

import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any

import meshio
import numpy as np
import pytest

import bipot_rs as bp
from bipot_rs import fem
from bipot_rs.fem.paraview import BodySeries, Part
from bipot_rs.mesh import elements

COUNT = 3


def solved(cell: str, degree: int) -> tuple[fem.Assembly, bp.Result]:
    """Two bodies of different cells, the upper one pressed on the lower one."""
    d = 2 if cell in ("triangle", "quadrilateral") else 3
    grid = [np.linspace(0, 1, 4)] * d
    upper, lower = (fem.box(grid, kind) for kind in (cell, cell))
    if degree == 2:
        upper = elements.second_order(upper)
    names = sorted(upper.boundaries)
    assert "bottom" in names
    down = np.zeros((d, 1))
    down[-1] = 1.0
    lower = type(lower)(lower.p - down, lower.t, lower.boundaries)
    bodies = [
        fem.Body("upper", upper, fem.Material(3.0, 0.3)),
        fem.Body("lower", lower, fem.Material(1.0, 0.2)),
    ]
    contact = fem.Contact(
        "upper", "bottom", 0.3, against=("lower", "top"), pairing="mortar"
    )
    every = tuple(range(d))
    supports = [
        fem.Support("upper", "top", every),
        fem.Support("lower", "bottom", every),
    ]
    model = fem.assemble(bodies, [contact], supports)
    pressed = [0.0] * (d - 1) + [-0.01]
    moved = model.prescribed([pressed, [0.0] * d])
    return model, model.problem().solve(None, np.outer([0.5, 1.0], moved))


def read(path: Path) -> meshio.Mesh:
    return meshio.read(path)


def stacked(fields: list[Any]) -> Any:
    return np.concatenate(fields)


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
    whole = BodySeries(tmp_path / "whole.pvd", model)
    parts = [
        BodySeries(
            tmp_path / "it.pvd",
            model,
            Part(k, COUNT, [np.flatnonzero(of_rank == k) for of_rank in owner]),
        )
        for k in range(COUNT)
    ]
    every = np.concatenate(owner)
    rest = np.random.default_rng(1).normal(size=(sum(counts), 3, 3))
    for series in (whole, *parts):
        for step in result:
            series.add(step, rest, {"owner": every.astype(float)})
        series.end()
    for k in range(len(result)):
        expected = read(tmp_path / f"whole_{k:04d}.vtu")
        listing = ET.parse(tmp_path / f"it_{k:04d}.pvtu").getroot()
        assert listing.attrib["type"] == "PUnstructuredGrid"
        names = [piece.attrib["Source"] for piece in listing.iter("Piece")]
        assert names == [f"it_{k:04d}_{part:04d}.vtu" for part in range(COUNT)]
        # Fields of the cells, in the order of the whole: the number of each is known.
        place = np.argsort(np.argsort(every, kind="stable"), kind="stable")
        pieces = [read(tmp_path / name) for name in names]
        for name, field in expected.cell_data.items():
            of_rank = stacked([stacked(piece.cell_data[name]) for piece in pieces])
            np.testing.assert_allclose(
                of_rank[place], stacked(field), rtol=1e-12, atol=1e-15
            )
        for part, piece in enumerate(pieces):
            assert set(stacked(piece.cell_data["owner"])) == {float(part)}
            for name, field in expected.point_data.items():
                # Positions of two bodies may agree, and then their fields differ.
                for body, first in zip(model.bodies, model.offset, strict=True):
                    node = first // model.dim
                    check(
                        piece, name, field[node : node + len(body.points)], body, model
                    )
        named(tmp_path / names[0], listing)
    index = ET.parse(tmp_path / "it.pvd").getroot()
    files = [item.attrib["file"] for item in index.iter("DataSet")]
    assert files == [f"it_{k:04d}.pvtu" for k in range(len(result))]


def check(
    piece: meshio.Mesh, name: str, field: Any, body: fem.Body, model: fem.Assembly
) -> None:
    """Values of a field at nodes of one body that lie off the common plane."""
    d = model.dim
    fields_at = {
        tuple(np.round(x, 9) + 0.0): value
        for x, value in zip(body.points, field, strict=True)
    }
    common = {tuple(np.round(x, 9) + 0.0) for x in model.points}
    for x, value in zip(piece.points[:, :d], piece.point_data[name], strict=True):
        at = tuple(np.round(x, 9) + 0.0)
        if at in fields_at and at not in common and x[-1] != 0:
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
