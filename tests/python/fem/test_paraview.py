"""Files for ParaView that ranks write in parts: the cells and fields of the whole."""

import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any

import meshio
import numpy as np
import pytest

import bipot_rs as bp
from bipot_rs import fem
from bipot_rs.fem.bodies.stress_recovery import von_mises
from bipot_rs.fem.paraview import BodySeries, Part
from support.boxes import CELLS, box, placed


def test_von_mises() -> None:
    pull = np.diag([-3.0, 0.0, 0.0])
    shear = np.zeros((3, 3))
    shear[0, 1] = shear[1, 0] = 2.0
    every = np.stack([pull, shear, 5 * np.eye(3), pull + 7 * np.eye(3)])
    exact = [3.0, 2 * np.sqrt(3), 0.0, 3.0]
    np.testing.assert_allclose(von_mises(every), exact, rtol=1e-14)
    turn, _ = np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))
    np.testing.assert_allclose(von_mises(turn @ every @ turn.T), exact, atol=1e-14)


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
