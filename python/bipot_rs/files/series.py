"""Series of files for ParaView: a PVD index, and a VTU file for each load step."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from itertools import repeat
from pathlib import Path
from typing import TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bipot_rs._lib.types import AnyArray, Record
from bipot_rs.files.drafts import aside, place
from bipot_rs.files.fields import OF_STEPS, increasing, named_units
from bipot_rs.files.vtu import Cells, write_collection, write_grid, write_pieces

_Number = TypeVar("_Number", bound=np.generic)


def write_series(
    path: str | os.PathLike[str],
    points: ArrayLike,
    cells: Cells | None,
    steps: Iterable[Record],
    of_cells: Iterable[Mapping[str, AnyArray]] | None = None,
    *,
    units: Mapping[str, str] | None = None,
) -> None:
    """Write a PVD index, and one binary VTU file in the same folder for each load step.

    ``path`` is ``DIR/NAME.pvd``, and step k is written to ``DIR/NAME_000k.vtu``; further files
    of an earlier, longer series are removed. ``points (points, d)``; ``cells`` as in
    `vtu.write_grid`, without them each point is a vertex. Of each step, arrays ``(points,)`` and
    ``(points, k)`` become fields, and the numbers ``load`` and ``time`` field data; all else is
    left out. The time in the index is the load if that grows from step to step, else the time,
    else the number. ``of_cells``: fields of the cells in each step. ``units``: names of the
    units of ``"length"``, ``"force"`` and ``"stress"``.
    """
    series = Series(path, points, cells, units=units)
    for step, in_cells in zip(steps, of_cells or repeat({}), strict=False):
        series.add(step, in_cells)
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
        """Write the next step; ``step`` and ``of_cells`` as in `write_series`."""
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
        units = named_units([*fields, *in_cells], self._units)
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
        times = increasing(*([n.get(name) for n in self._numbers] for name in OF_STEPS))
        with aside(index) as draft:
            write_collection(draft, self._names, times)
        if self._pieces > 1:
            # The folder is shared: another process may be writing into it.
            return
        written = set(self._names)
        for old in _beside(index):
            digits = old.name.removeprefix(f"{index.stem}_").removesuffix(".vtu")
            is_step = old.name == f"{index.stem}_{digits}.vtu" and len(digits) >= 4
            number = digits.isascii() and digits.isdigit()
            if is_step and number and old.name not in written:
                old.unlink()


def _beside(path: Path) -> list[Path]:
    """Contents of the folder of ``path``; [] without permission to read it."""
    try:
        return list(path.parent.iterdir())
    except PermissionError:
        return []


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
