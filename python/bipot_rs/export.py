"""Files of results: HDF5 to read back, PVD and VTU for ParaView.

Every file is written aside and renamed when it is complete, so that a full disk
or a kill leaves the earlier one as it was.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import numpy as np
from numpy.typing import ArrayLike, NDArray

FORMAT = "bipot-result"
VERSION = 1
# Numbers of a step that are datasets, so that they can be read as columns.
_SCALAR_DATASETS = ("residual", "load")


def require() -> None:
    """Import what files need: better missing before a long solve than after it."""
    import h5py  # noqa: F401
    import meshio  # noqa: F401


def write_result(
    path: str | os.PathLike[str],
    contacts: Mapping[str, NDArray[Any] | None],
    steps: Sequence[Mapping[str, Any]],
    *,
    complete: bool,
    attributes: Mapping[str, Any] | None = None,
) -> None:
    """Write contacts and load steps to an HDF5 file.

    Parameters
    ----------
    path
        File to write or to replace.
    contacts
        Arrays of ``/contacts``, such as ``x (n_c, d)`` and ``mu (n_c,)``; those
        that are ``None`` are left out.
    steps
        One mapping a load step: arrays become datasets of ``/steps/0000``,
        numbers and strings its attributes, ``residual`` and ``load`` scalar
        datasets; ``None`` is left out.
    complete
        Whether the load path came to its end.
    attributes
        Further attributes of the file.

    Raises
    ------
    OSError
        The file cannot be written; an earlier one is intact.
    """
    import h5py

    digits = max(4, len(str(max(len(steps) - 1, 0))))
    with _aside(path) as draft, h5py.File(draft, "w") as file:
        file.attrs.update(dict(attributes or {}))
        file.attrs.update(format=FORMAT, version=VERSION, complete=bool(complete))
        group = file.create_group("contacts")
        for name, array in contacts.items():
            if array is not None:
                group[name] = array
        group = file.create_group("steps")
        for number, step in enumerate(steps):
            one = group.create_group(f"{number:0{digits}d}")
            for name, value in step.items():
                if value is None:
                    continue
                if np.ndim(value) > 0 or name in _SCALAR_DATASETS:
                    one[name] = value
                else:
                    one.attrs[name] = value


def read_result(
    path: str | os.PathLike[str],
) -> tuple[dict[str, NDArray[Any]], list[dict[str, Any]], dict[str, Any]]:
    """Read what `write_result` wrote.

    Returns
    -------
    contacts, steps, attributes
        As given to `write_result`; ``attributes`` holds ``complete`` and
        ``version`` besides.

    Raises
    ------
    ValueError
        The file is not a result, or of a later version of the format.
    """
    import h5py

    with h5py.File(place(path), "r") as file:
        attributes = {name: _plain(value) for name, value in file.attrs.items()}
        if attributes.pop("format", None) != FORMAT:
            raise ValueError(f"{path} is not a result: its format is not {FORMAT!r}")
        if attributes.get("version") != VERSION:
            raise ValueError(
                f"{path} has version {attributes.get('version')} of the format, "
                f"expected {VERSION}"
            )
        contacts = {name: data[()] for name, data in file["contacts"].items()}
        steps = []
        # By number: as text, step 10000 would come before step 9999.
        for name in sorted(file["steps"], key=int):
            group = file["steps"][name]
            step = {key: _plain(data[()]) for key, data in group.items()}
            step.update({key: _plain(value) for key, value in group.attrs.items()})
            steps.append(step)
    return contacts, steps, attributes


def write_series(
    path: str | os.PathLike[str],
    points: ArrayLike,
    cells: Sequence[tuple[str, NDArray[np.integer[Any]]]] | None,
    steps: Iterable[Mapping[str, Any]],
) -> None:
    """Write a PVD index and one binary VTU beside it for each load step.

    Parameters
    ----------
    path
        ``DIR/NAME.pvd``; step k goes to ``DIR/NAME_000k.vtu``. Files of an
        earlier and longer series of this name are removed.
    points
        ``(points, d)``.
    cells
        Pairs of a kind (``"triangle"``, ``"quad"``, ``"tetra"``,
        ``"hexahedron"``) and corners in the order of VTK; without them each
        point is a vertex.
    steps
        One mapping a step: arrays ``(points,)`` and ``(points, k)`` become
        fields, those of two components with a third that is zero; all else is
        left out. The time of a step is its number.
    """
    import meshio

    index = place(path)
    places = _three(np.asarray(points, dtype=float))
    if cells is None:
        cells = [("vertex", np.arange(len(places))[:, None])]
    root = ET.Element("VTKFile", type="Collection", version="0.1")
    collection = ET.SubElement(root, "Collection")
    written = set()
    for number, step in enumerate(steps):
        fields = {
            name: _three(np.asarray(value))
            for name, value in step.items()
            if np.ndim(value) in (1, 2) and len(value) == len(places)
        }
        name = f"{index.stem}_{number:04d}.vtu"
        mesh = meshio.Mesh(places, list(cells), point_data=fields)
        with _aside(index.with_name(name)) as draft:
            mesh.write(draft, file_format="vtu", binary=True)
        ET.SubElement(
            collection, "DataSet", timestep=str(number), group="", part="0", file=name
        )
        written.add(name)
    with _aside(index) as draft:
        ET.ElementTree(root).write(draft, encoding="utf-8", xml_declaration=True)
    for old in index.parent.glob(f"{index.stem}_[0-9][0-9][0-9][0-9]*.vtu"):
        if old.name not in written and old.stem[len(index.stem) + 1 :].isdigit():
            old.unlink()


def place(path: Any) -> Path:
    """A path, or a `TypeError` that says what was given for it."""
    try:
        return Path(os.fsdecode(path))
    except TypeError:
        raise TypeError(
            f"path is a {type(path).__name__}, expected the name of a file"
        ) from None


@contextmanager
def _aside(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Place to write ``path`` to; renamed on success, removed on failure."""
    target = place(path)
    # The name keeps its suffix and differs between processes.
    draft = target.with_name(f".{target.stem}.{os.getpid()}{target.suffix}")
    try:
        yield draft
        draft.replace(target)
    finally:
        draft.unlink(missing_ok=True)


def _three(array: NDArray[Any]) -> NDArray[Any]:
    """Vectors of the plane with a third component: VTK knows no others."""
    if array.ndim == 2 and array.shape[1] == 2:
        return np.column_stack([array, np.zeros(len(array), array.dtype)])
    return np.ascontiguousarray(array)


def _plain(value: Any) -> Any:
    """Numbers of NumPy as those of Python; arrays and text as they are."""
    if isinstance(value, bytes):
        return value.decode()
    return value.item() if isinstance(value, np.generic) else value
