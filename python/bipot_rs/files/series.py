"""Series of files for ParaView: a PVD index, and a VTU file for each load step, by meshio.

The numbers of a step and the units of its fields are field data, which meshio reads but does
not write: the units are the bytes of a JSON text, because meshio cannot read field data of
text.
"""

from __future__ import annotations

import json
import os
import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TypeVar
from xml.etree import ElementTree

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bipot_rs._lib.optional import load_library
from bipot_rs._lib.types import AnyArray, Floats, Integers, Record
from bipot_rs.files.drafts import aside, place
from bipot_rs.files.fields import OF_STEPS, choose_times, name_units

Cells = Sequence[tuple[str, Integers]]
Fields = Mapping[str, AnyArray]
# With this a file of meshio ends, in at most so many bytes.
_END, _END_BYTES = b"</UnstructuredGrid>", 48


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
        point_data={name: _convert_for_vtk(field) for name, field in of_points.items()},
        cell_data={
            name: np.split(_convert_for_vtk(field), ends)
            for name, field in of_cells.items()
        },
    )
    # Compression takes longer than the rest of a load step with few contacts.
    meshio.vtu.write(path, grid, compression=None, header_type="UInt64")
    with path.open("r+b") as file:
        file.seek(-_END_BYTES, os.SEEK_END)
        end = file.read().rpartition(_END)[2]
        file.seek(-len(_END + end), os.SEEK_END)
        file.write(_field_data(numbers, units) + _END + end)


def _convert_for_vtk(field: AnyArray) -> AnyArray:
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
            kind = (
                _convert_for_vtk(field[:0]).dtype.name.title().replace("Uint", "UInt")
            )
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


_Number = TypeVar("_Number", bound=np.generic)


def write_series(
    path: str | os.PathLike[str],
    points: ArrayLike,
    cells: Cells | None,
    steps: Iterable[Record],
    *,
    units: Mapping[str, str] | None = None,
) -> None:
    """Write a PVD index, and one binary VTU file in the same folder for each load step.

    ``path`` is ``DIR/NAME.pvd``, and step k is written to ``DIR/NAME_000k.vtu``; further files
    of an earlier, longer series are removed. ``points (points, d)``; ``cells`` as in
    `write_grid`, without them each point is a vertex. Of each step, arrays ``(points,)`` and
    ``(points, k)`` become fields, and the numbers ``load`` and ``time`` field data; all else is
    left out. The time in the index is the load if that grows from step to step, else the time,
    else the number. ``units``: names of the units of ``"length"``, ``"force"`` and ``"stress"``.
    """
    series = Series(path, points, cells, units=units)
    for step in steps:
        series.add(step)
    series.end()


class Series:
    """A series that is written step by step; arguments as in `write_series`.

    Of several processes that write into one folder each has the number ``piece`` of ``pieces``:
    ``DIR/NAME_000k_000i.vtu`` is piece i of step k. Piece 0 also writes the lists
    ``DIR/NAME_000k.pvtu`` and the index.
    """

    def __init__(
        self,
        path: str | os.PathLike[str],
        points: ArrayLike,
        cells: Cells | None,
        *,
        piece: int = 0,
        pieces: int = 1,
        units: Mapping[str, str] | None = None,
    ) -> None:
        self._index = place(path)
        places = _three(np.asarray(points, dtype=float))
        if cells is None:
            cells = [("vertex", np.arange(len(places))[:, None])]
        self._points, self._cells = places, cells
        self._piece, self._pieces = piece, pieces
        self._units = dict(units or {})
        self._names: list[str] = []
        self._numbers: list[dict[str, float]] = []

    def add(
        self,
        step: Record,
        of_cells: Mapping[str, AnyArray] | None = None,
    ) -> None:
        """Write the next step, as in `write_series`; ``of_cells``: fields of the cells."""
        fields = {
            name: _three(np.asarray(value))
            for name, value in step.items()
            if np.ndim(value) in (1, 2)
            and len(value) == len(self._points)
            and np.asarray(value).dtype.kind in "fiub"
        }
        numbers = {
            name: float(step[name]) for name in OF_STEPS if step.get(name) is not None
        }
        in_cells = of_cells or {}
        units = name_units([*fields, *in_cells], self._units)
        index = self._index
        name = f"{index.stem}_{len(self._names):04d}"
        end = "" if self._pieces == 1 else f"_{self._piece:04d}"
        with aside(index.with_name(f"{name}{end}.vtu")) as draft:
            write_grid(
                draft,
                self._points,
                self._cells,
                fields,
                in_cells,
                numbers=numbers,
                units=units,
            )
        if self._pieces > 1 and self._piece == 0:
            pieces = [f"{name}_{k:04d}.vtu" for k in range(self._pieces)]
            with aside(index.with_name(f"{name}.pvtu")) as draft:
                write_pieces(draft, pieces, fields, in_cells)
        self._names.append(f"{name}.vtu" if self._pieces == 1 else f"{name}.pvtu")
        self._numbers.append(numbers)

    def end(self) -> None:
        """Write the index, and remove further files of an earlier, longer series."""
        if self._piece:
            return
        index = self._index
        times = choose_times(
            *([n.get(name) for n in self._numbers] for name in OF_STEPS)
        )
        with aside(index) as draft:
            write_collection(draft, self._names, times)
        if self._pieces > 1:
            # The folder is shared: another process may be writing into it.
            return
        step = re.compile(rf"{re.escape(index.stem)}_[0-9]{{4,}}\.vtu")
        for old in list(index.parent.glob("*.vtu")):
            if step.fullmatch(old.name) and old.name not in self._names:
                old.unlink()


def check_index(path: str | os.PathLike[str]) -> Path:
    """Path of the index of a series, which must end in ``.pvd`` for ParaView.

    Raises `ValueError`: it does not end in ``.pvd``.
    """
    index = place(path)
    if index.suffix.lower() != ".pvd":
        raise ValueError(f"path is {os.fspath(path)!r}, expected DIR/NAME.pvd")
    return index


def _three(array: NDArray[_Number]) -> NDArray[_Number]:
    """Extend vectors of two components by a zero: VTK needs three."""
    if array.ndim == 2 and array.shape[1] == 2:
        return np.column_stack([array, np.zeros(len(array), array.dtype)])
    return np.ascontiguousarray(array)
