"""Series for ParaView are read back as written, with units and times."""

from pathlib import Path
from xml.etree import ElementTree as ET

import meshio
import numpy as np
import pytest

from bipot_rs.files import series


@pytest.mark.parametrize("name", ["a", "a[1]", "a*", "a_0001", 'a & <"b">'])
def test_shorter_series_replaces_a_longer_one_and_nothing_else(
    tmp_path: Path, name: str
) -> None:
    """Characters with a meaning in patterns and XML are ordinary letters of a name."""
    index = tmp_path / f"{name}.pvd"
    series.write_series(index, np.zeros((2, 3)), None, [{}] * 3)
    others = {f"{name}_0002b.vtu", f"{name}_02.vtu", f"{name}b_0002.vtu", "a1_0002.vtu"}
    others.add(f"{name}_²²²².vtu")
    for other in others:
        (tmp_path / other).touch()
    series.write_series(index, np.zeros((0, 2)), None, [{}])
    step = f"{name}_0000.vtu"
    left = {path.name for path in tmp_path.iterdir()}
    assert left == {f"{name}.pvd", step} | others
    (entry,) = ET.parse(index).getroot().findall(".//DataSet")
    assert entry.get("file") == step
    # A series without points is XML too.
    piece = ET.parse(tmp_path / step).getroot().find("UnstructuredGrid/Piece")
    assert piece is not None
    assert piece.attrib == {"NumberOfPoints": "0", "NumberOfCells": "0"}


def test_series_of_large_and_odd_fields(tmp_path: Path) -> None:
    """All number types, mixed cells, points in the plane."""
    random = np.random.default_rng(0)
    n = 9001  # points: the last block of each array is a partial one
    points = random.normal(size=(n, 2))
    nodes = {"tetra": 4, "hexahedron": 8, "triangle": 3, "quad": 4, "vertex": 1}
    cells = [(k, random.integers(n, size=(7, count))) for k, count in nodes.items()]
    half = random.normal(size=(n, 3))
    half[: n // 2] = 0
    fields = {
        "half empty": half,
        "nothing": np.zeros(n),
        "single": random.normal(size=n).astype(np.float32),
        "big endian": random.normal(size=n).astype(">f8"),
        "columns": np.asfortranarray(random.normal(size=(n, 3))),
        "long": random.integers(2**62, size=n),
        "short": random.integers(-128, 128, size=n).astype(np.int8),
        "whether": random.random(n) < 0.5,
    }
    names = np.full(n, "it")
    plane = {"plane": points, "load": 1.0}
    steps = [fields | {"names": names, "other": np.zeros(n - 1)}, {}, plane]
    series.write_series(tmp_path / "a.pvd", points, cells, steps)
    entries = ET.parse(tmp_path / "a.pvd").getroot().findall("Collection/DataSet")
    assert [e.get("file") for e in entries] == [f"a_000{k}.vtu" for k in range(3)]
    assert [e.get("timestep") for e in entries] == ["0", "1", "2"]
    mesh, nothing, last = (meshio.read(tmp_path / f"a_000{k}.vtu") for k in range(3))
    for read in (mesh.points, last.point_data["plane"]):
        np.testing.assert_array_equal(read, np.column_stack([points, np.zeros(n)]))
    for (kind, corners), block in zip(cells, mesh.cells, strict=True):
        assert block.type == kind
        np.testing.assert_array_equal(block.data, corners)
    assert mesh.point_data.keys() == fields.keys()
    for name, field in fields.items():
        np.testing.assert_array_equal(mesh.point_data[name], field)
        if name != "whether":
            assert mesh.point_data[name].dtype.kind == field.dtype.kind
    assert nothing.point_data == {}
    assert last.point_data.keys() == {"plane"}
    assert b"binary" in (tmp_path / "a_0002.vtu").read_bytes()


def test_fields_of_cells(tmp_path: Path) -> None:
    """Several kinds of cells, in their order; the field is absent in steps without it."""
    points = np.random.default_rng(0).normal(size=(6, 3))
    cells = [
        ("triangle", np.array([[0, 1, 2], [3, 4, 5]])),
        ("quad", np.array([[0, 1, 4, 3]])),
    ]
    error = np.array([1.0, 2.0, 3.0])
    of_steps = series.Series(tmp_path / "a.pvd", points, cells)
    of_steps.add({}, {"error": error})
    of_steps.add({})
    of_steps.end()
    mesh = meshio.read(tmp_path / "a_0000.vtu")
    np.testing.assert_array_equal(mesh.cell_data["error"][0], error[:2])
    np.testing.assert_array_equal(mesh.cell_data["error"][1], error[2:])
    assert meshio.read(tmp_path / "a_0001.vtu").cell_data == {}
