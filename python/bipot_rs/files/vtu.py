"""Files of VTK: unstructured grids by meshio, and the indexes that meshio does not know.

The numbers of a step and the units of its fields are field data, which meshio reads but does
not write: the units are the bytes of a JSON text, because meshio cannot read field data of
text.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from bipot_rs._lib.optional import load_library
from bipot_rs._lib.types import AnyArray, Floats, Integers

Cells = Sequence[tuple[str, Integers]]
Fields = Mapping[str, AnyArray]
# What follows the head of a file of meshio.
_GRID = b"<UnstructuredGrid>\n"


def write_grid(
    path: Path,
    points: Floats,
    cells: Cells,
    of_points: Fields,
    of_cells: Fields,
    *,
    numbers: Mapping[str, float],
    units: Mapping[str, str],
) -> None:
    """Write one step as a binary VTU file, with ``numbers`` of the step and ``units`` of fields.

    ``points (points, 3)``; ``cells``: pairs of a kind and corners in the order of VTK; fields
    ``(points,)``, ``(points, k)`` and ``(cells,)``, ``(cells, k)`` by name.
    """
    meshio = load_library("meshio", extra="fem", need="files for ParaView")
    # 32 bits are enough for almost every mesh that fits into memory.
    short = len(points) < 2**31 > sum(corners.size for _, corners in cells)
    integer = np.int32 if short else np.int64
    blocks = [
        (kind, corners.astype(integer)) for kind, corners in cells if len(corners)
    ]
    ends = np.cumsum([len(corners) for _, corners in blocks])[:-1]
    grid = meshio.Mesh(
        np.asarray(points, np.float64),
        blocks or [("vertex", np.zeros((0, 1), integer))],
        point_data={name: _as_stored(field) for name, field in of_points.items()},
        cell_data={
            name: np.split(_as_stored(field), ends) for name, field in of_cells.items()
        },
    )
    # Compression takes longer than the rest of a load step with few contacts.
    meshio.vtu.write(path, grid, compression=None, header_type="UInt64")
    content = path.read_bytes()
    path.write_bytes(content.replace(_GRID, _GRID + _field_data(numbers, units), 1))


def _as_stored(field: AnyArray) -> AnyArray:
    """A field in a type that VTK has."""
    if field.dtype.kind == "b":
        return field.astype(np.uint8)
    wide = field.dtype.kind == "f" and field.dtype.itemsize not in (4, 8)
    return np.ascontiguousarray(field, np.float64 if wide else None)


def _field_data(numbers: Mapping[str, float], units: Mapping[str, str]) -> bytes:
    """Numbers of a step, and units as the bytes of a JSON text."""
    arrays = [("Float64", name, [repr(float(x))]) for name, x in numbers.items()]
    if units:
        text = json.dumps(units, ensure_ascii=False).encode()
        arrays.append(("UInt8", "units", list(map(str, text))))
    if not arrays:
        return b""
    lines = [
        f'<DataArray type="{kind}" Name="{name}" NumberOfTuples="{len(values)}" '
        f'format="ascii">{" ".join(values)}</DataArray>'
        for kind, name, values in arrays
    ]
    return "\n".join(["<FieldData>", *lines, "</FieldData>\n"]).encode()


def write_collection(path: Path, names: Sequence[str], times: Sequence[float]) -> None:
    """Write the PVD index of a series of files and the time of each."""
    root = ElementTree.Element("VTKFile", type="Collection", version="0.1")
    collection = ElementTree.SubElement(root, "Collection")
    for name, time in zip(names, times, strict=True):
        ElementTree.SubElement(
            collection, "DataSet", timestep=f"{time:.17g}", file=name
        )
    ElementTree.ElementTree(root).write(path, encoding="utf-8", xml_declaration=True)


def write_pieces(
    path: Path, names: Sequence[str], of_points: Fields, of_cells: Fields
) -> None:
    """Write the PVTU index of one step in several files, with the types of their fields."""
    root = ElementTree.Element("VTKFile", type="PUnstructuredGrid", version="0.1")
    grid = ElementTree.SubElement(root, "PUnstructuredGrid", GhostLevel="0")
    points = {"Points": np.empty((0, 3))}
    for tag, fields in (
        ("PPoints", points),
        ("PPointData", of_points),
        ("PCellData", of_cells),
    ):
        group = ElementTree.SubElement(grid, tag)
        for name, field in fields.items():
            kind = _as_stored(field[:0]).dtype.name.title().replace("Uint", "UInt")
            array = ElementTree.SubElement(group, "PDataArray", type=kind, Name=name)
            if field.ndim == 2:
                array.set("NumberOfComponents", str(field.shape[1]))
    for name in names:
        ElementTree.SubElement(grid, "Piece", Source=name)
    ElementTree.ElementTree(root).write(path, encoding="utf-8", xml_declaration=True)


def read_collection(path: Path) -> list[tuple[float, str]]:
    """Time and file of each step of a PVD index; `OSError` or `ValueError` if it is none."""
    sets = _elements(path, "Collection", "DataSet", ("timestep", "file"))
    try:
        return [(float(time), file) for time, file in sets]
    except ValueError:
        raise ValueError(f"{path}: a timestep is not a number") from None


def read_pieces(path: Path) -> list[str]:
    """Files of the pieces of a PVTU file; raises as `read_collection`."""
    return [
        file for (file,) in _elements(path, "PUnstructuredGrid", "Piece", ("Source",))
    ]


def has_no_points(path: Path) -> bool:
    """Whether a VTU file has no points; raises as `read_collection`."""
    counts = _elements(path, "UnstructuredGrid", "Piece", ("NumberOfPoints",))
    return all(count == "0" for (count,) in counts)


def _elements(
    path: Path, kind: str, tag: str, names: Sequence[str]
) -> list[tuple[str, ...]]:
    """Attributes of all elements of a tag in a file of VTK."""
    content = path.read_bytes()
    if b"<!DOCTYPE" in content:
        # Its entities could grow without limit, and VTK writes none.
        raise ValueError(f"{path} has a document type, expected a file of VTK")
    try:
        root = ElementTree.fromstring(content)  # noqa: S314 - no entities
    except ElementTree.ParseError as error:
        raise ValueError(f"{path} is not XML: {error}") from None
    if root.tag != "VTKFile" or root.get("type") != kind:
        raise ValueError(f"{path} is not a file of VTK of type {kind}")
    elements = []
    for element in root.iter(tag):
        values = [element.get(name) for name in names]
        if None in values:
            raise ValueError(f"{path}: a {tag} lacks {' or '.join(names)}")
        elements.append(tuple(str(value) for value in values))
    return elements
