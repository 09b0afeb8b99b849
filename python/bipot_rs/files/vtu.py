"""Write unstructured grids of VTK: the mesh is encoded once for the fields of many steps.

XML with inline binary arrays in the compressed layout of VTK: ``[number of blocks, bytes
of a block, bytes of the last block, compressed bytes of each block]`` in base64, followed
by the blocks in base64, each a zlib stream.

The unit of a field is its key ``UNITS_LABEL``, as VTK names it. The field data ``units``
hold all units again, as the bytes of a JSON text: meshio cannot read field data of text.
"""

from __future__ import annotations

import json
import sys
import zlib
from base64 import b64encode
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bipot_rs._lib.types import Floats

# Cell types of VTK.
KINDS = {
    "vertex": 1,
    "line": 3,
    "line3": 21,
    "triangle": 5,
    "quad": 9,
    "tetra": 10,
    "hexahedron": 12,
    "triangle6": 22,
    "quad8": 23,
    "tetra10": 24,
    "hexahedron20": 25,
    "quad9": 28,
    "hexahedron27": 29,
}
_ORDER = "LittleEndian" if sys.byteorder == "little" else "BigEndian"
_HEAD = (
    f'<VTKFile type="{{}}" version="1.0" byte_order="{_ORDER}" header_type="UInt64" '
    'compressor="vtkZLibDataCompressor">'
)
_START = (
    f'<?xml version="1.0"?>\n{_HEAD.format("UnstructuredGrid")}\n<UnstructuredGrid>\n'
).encode()
_UNIT = '<InformationKey name="UNITS_LABEL" location="vtkDataArray">{}</InformationKey>'
# The block size of VTK; a block fits into the cache.
_BLOCK = 2**15
# Bytes of each block that decide whether it is compressed.
_SAMPLE = 2**11


class Grid:
    """An encoded mesh, to be written with fields.

    Parameters
    ----------
    points
        ``(points, 3)``.
    cells
        Pairs of a kind and corners ``(cells, corners)`` in the order of VTK.

    Raises
    ------
    ValueError
        An unknown kind of cells.
    """

    def __init__(
        self, points: Floats, cells: Sequence[tuple[str, NDArray[np.integer[Any]]]]
    ) -> None:
        for kind, _ in cells:
            if kind not in KINDS:
                raise ValueError(
                    f"kind of cells is {kind!r}, expected one of {', '.join(KINDS)}"
                )
        corners = [np.asarray(c) for _, c in cells]
        # 32 bits are enough for almost every mesh that fits into memory.
        short = len(points) < 2**31 > sum(c.size for c in corners)
        integer = np.dtype(np.int32 if short else np.int64)
        none = np.zeros(0, integer)
        flat = np.concatenate([none, *(c.ravel() for c in corners)])
        widths = np.repeat([c.shape[1] for c in corners], [len(c) for c in corners])
        types = np.repeat([KINDS[k] for k, _ in cells], [len(c) for c in corners])
        self._count = len(points)
        self._mesh = b"".join(
            (
                f'<Piece NumberOfPoints="{len(points)}" '.encode(),
                f'NumberOfCells="{len(types)}">\n<Points>\n'.encode(),
                _array("Points", np.asarray(points, np.float64)),
                b"</Points>\n<Cells>\n",
                _array("connectivity", flat.astype(integer)),
                _array("offsets", np.cumsum(widths).astype(integer)),
                _array("types", types.astype(np.uint8)),
                b"</Cells>\n<PointData>\n",
            )
        )

    def file(
        self,
        fields: Mapping[str, NDArray[Any]],
        of_cells: Mapping[str, NDArray[Any]] | None = None,
        numbers: Mapping[str, float] | None = None,
        units: Mapping[str, str] | None = None,
    ) -> bytes:
        """The file of one step as bytes.

        Parameters
        ----------
        fields
            Arrays ``(points,)`` or ``(points, k)`` by name.
        of_cells
            Arrays ``(cells,)`` or ``(cells, k)`` by name.
        numbers
            Numbers of the step by name, written as field data.
        units
            Units of fields by name.
        """
        named = units or {}
        parts = [_START, *_field_data(numbers or {}, named), self._mesh]
        parts += (_array(name, field, named) for name, field in fields.items())
        parts.append(b"</PointData>\n")
        if of_cells:
            arrays = (_array(name, field, named) for name, field in of_cells.items())
            parts += [b"<CellData>\n", *arrays, b"</CellData>\n"]
        parts.append(b"</Piece>\n</UnstructuredGrid>\n</VTKFile>\n")
        return b"".join(parts)


def listing(
    pieces: Sequence[str],
    fields: Mapping[str, NDArray[Any]],
    of_cells: Mapping[str, NDArray[Any]],
) -> bytes:
    """PVTU file of one step, the names of its pieces and of their fields.

    Parameters
    ----------
    pieces
        Names of the files of the pieces.
    fields, of_cells
        As in `Grid.file`, of any piece: all pieces have the same names and types.
    """
    points = np.empty((0, 3))
    parts = (
        '<?xml version="1.0"?>',
        _HEAD.format("PUnstructuredGrid"),
        '<PUnstructuredGrid GhostLevel="0">',
        "<PPoints>",
        f"<PDataArray {_kind('Points', points)}/>",
        "</PPoints>",
        "<PPointData>",
        *(f"<PDataArray {_kind(name, field)}/>" for name, field in fields.items()),
        "</PPointData>",
        "<PCellData>",
        *(f"<PDataArray {_kind(name, field)}/>" for name, field in of_cells.items()),
        "</PCellData>",
        *(f"<Piece Source={_quoted(name)}/>" for name in pieces),
        "</PUnstructuredGrid>",
        "</VTKFile>\n",
    )
    return "\n".join(parts).encode()


def collection(names: Sequence[str], times: Sequence[float]) -> bytes:
    """PVD index of a series of files and the time of each."""
    head = '<?xml version="1.0" encoding="utf-8"?>\n<VTKFile type="Collection" version="0.1">'
    sets = (
        f'<DataSet timestep="{_number(t)}" group="" part="0" file={_quoted(name)} />'
        for t, name in zip(times, names, strict=True)
    )
    parts = (head, "<Collection>", *sets, "</Collection>", "</VTKFile>\n")
    return "\n".join(parts).encode()


def read_collection(path: Path) -> list[tuple[float, str]]:
    """Time and file of each step of a PVD index.

    Raises
    ------
    OSError
        The file cannot be read.
    ValueError
        The file is not a PVD index.
    """
    sets = _elements(path, "Collection", "DataSet", ("timestep", "file"))
    try:
        return [(float(time), file) for time, file in sets]
    except ValueError:
        raise ValueError(f"{path}: a timestep is not a number") from None


def read_listing(path: Path) -> list[str]:
    """Files of the pieces of a PVTU file; raises as `read_collection`."""
    return [
        file for (file,) in _elements(path, "PUnstructuredGrid", "Piece", ("Source",))
    ]


def without_points(path: Path) -> bool:
    """Whether a VTU file has no points; raises as `read_collection`."""
    counts = _elements(path, "UnstructuredGrid", "Piece", ("NumberOfPoints",))
    return all(count == "0" for (count,) in counts)


def _elements(
    path: Path, kind: str, tag: str, names: Sequence[str]
) -> list[tuple[str, ...]]:
    """Attributes of all elements of a tag in a file of VTK."""
    from xml.etree import ElementTree

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
    found = []
    for element in root.iter(tag):
        values = [element.get(name) for name in names]
        if None in values:
            raise ValueError(f"{path}: a {tag} lacks {' or '.join(names)}")
        found.append(tuple(str(value) for value in values))
    return found


def _number(value: float) -> str:
    """All digits of a number; whole numbers without a point."""
    whole = value.is_integer() and abs(value) < 2**53
    return str(int(value)) if whole else repr(value)


def _quoted(text: str) -> str:
    """Quote an XML attribute."""
    return f'"{_escaped(text)}"'


def _escaped(text: str) -> str:
    """Escape signs of XML; `xml.sax.saxutils` takes long to import."""
    for sign, entity in (("&", "&amp;"), ("<", "&lt;"), ('"', "&quot;")):
        text = text.replace(sign, entity)
    return text


def _kind(name: str, array: NDArray[Any]) -> str:
    """Attributes of a data array: type, name and number of components."""
    word = {"f": "Float", "i": "Int", "u": "UInt", "b": "UInt"}[array.dtype.kind]
    bits = 8 * _stored(array.dtype).itemsize
    width = f'NumberOfComponents="{array.shape[1]}" ' if array.ndim == 2 else ""
    return f'type="{word}{bits}" Name={_quoted(name)} {width}'


def _stored(dtype: np.dtype[Any]) -> np.dtype[Any]:
    """The type in which an array is written."""
    if dtype.kind == "b":
        return np.dtype(np.uint8)
    if dtype.kind == "f" and dtype.itemsize not in (4, 8):
        return np.dtype(np.float64)
    return dtype.newbyteorder("=")


def _array(
    name: str,
    array: NDArray[Any],
    units: Mapping[str, str] | None = None,
    *,
    more: str = "",
) -> bytes:
    """A data array; ``more`` are further XML attributes."""
    stored = array.astype(_stored(array.dtype), copy=False)
    unit = (units or {}).get(name)
    key = "" if unit is None else _UNIT.format(_escaped(unit))
    return b"".join(
        (
            f"<DataArray {_kind(name, array)}{more}".encode(),
            b'format="binary">',
            *_packed(stored.tobytes(), stored.dtype.itemsize),
            f"{key}</DataArray>\n".encode(),
        )
    )


def _field_data(numbers: Mapping[str, float], units: Mapping[str, str]) -> list[bytes]:
    """Numbers of a step, and units as the bytes of a JSON text."""
    arrays = {name: np.array([number], float) for name, number in numbers.items()}
    if units:
        text = json.dumps(units, ensure_ascii=False).encode()
        arrays["units"] = np.frombuffer(text, np.uint8)
    if not arrays:
        return []
    written = (
        _array(name, array, more=f'NumberOfTuples="{array.size}" ')
        for name, array in arrays.items()
    )
    return [b"<FieldData>\n", *written, b"</FieldData>\n"]


def _packed(data: bytes, size: int) -> tuple[bytes, bytes]:
    """Header and compressed blocks of numbers of ``size`` bytes, in base64."""
    blocks = [data[k : k + _BLOCK] for k in range(0, len(data), _BLOCK)]
    packed = [zlib.compress(block, _level(block, size)) for block in blocks]
    last = len(blocks[-1]) if blocks else 0
    header = np.array([len(blocks), _BLOCK, last, *map(len, packed)], dtype=np.uint64)
    return b64encode(header.tobytes()), b64encode(b"".join(packed))


def _level(block: bytes, size: int) -> int:
    """Compression level for numbers of ``size`` bytes: 1, or 0 if the digits look random.

    Compression shortens a displacement by only 5 %, and takes longer than the rest of
    the file. Contact fields, zero at most nodes, become very short.
    """
    if size < 8:
        return 1
    middle = len(block) // 16 * 8
    sample = memoryview(block)[max(middle - _SAMPLE // 2, 0) : middle + _SAMPLE // 2]
    words = sample[: len(sample) // 8 * 8].cast("Q")
    return int(2 * len(set(words)) <= len(words))
