"""``bipot info`` of files for ParaView: steps, points, cells, fields and their units."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from bipot_rs._lib.messages import count_noun
from bipot_rs.cli.info import mesh
from bipot_rs.files.fields import FIELDS
from bipot_rs.files.vtu import has_no_points, read_collection, read_pieces
from bipot_rs.mesh.readers import Grid, read_grid

if TYPE_CHECKING:
    from bipot_rs._lib.types import AnyArray, Record

SUFFIXES = (".pvd", ".pvtu", ".vtu")


def summarise(path: Path) -> dict[str, object]:
    """Summarise a series of steps, or the file of one step.

    A VTU file without a load step is a mesh: its summary lists the fields as well.

    Returns ``kind``, ``points``, ``cells`` by kind, ``fields`` by name, ``load`` and ``time``
    of the step, and ``lines`` for a terminal; of a series also ``steps``, ``times``.
    Raises `OSError` or `ValueError` or `ModuleNotFoundError`: as
    `bipot_rs.mesh.readers.read_grid`.
    """
    if not path.is_file():
        raise FileNotFoundError(f"there is no file {path}")
    suffix = path.suffix.lower()
    if suffix == ".pvd":
        return _series(path)
    if suffix == ".vtu":
        grid = _grid(path)
        if "time" not in grid.of_file:
            return _mesh(path, grid)
    return _step(path)


def _series(path: Path) -> dict[str, object]:
    steps = read_collection(path)
    times = [time for time, _ in steps]
    summary: dict[str, object] = {
        "kind": "series",
        "file": str(path),
        "steps": len(steps),
        "times": times,
    }
    title = f"{path}: a series of {count_noun(len(steps), 'step')} for ParaView"
    if not steps:
        return summary | {"lines": [title]}
    lines = [
        f"{title}, time {_between(min(times), max(times))}",
        f"  files     {steps[0][1]} to {steps[-1][1]}",
    ]
    lost = [file for _, file in steps if not (path.parent / file).is_file()]
    if lost:
        raise ValueError(
            f"{path} names {count_noun(len(lost), 'file')} that do not exist, the first is "
            f"{lost[0]}: copy the whole folder, not the index only"
        )
    last = _step(path.parent / steps[-1][1])
    _, *more = last.pop("lines")
    lines.append(f"  last step {last['file']}")
    return (
        summary
        | {k: v for k, v in last.items() if k not in summary}
        | {"lines": lines + more}
    )


def _step(path: Path) -> dict[str, Any]:
    """Summarise one step, whose parts may lie in several files."""
    files = [path]
    if path.suffix.lower() == ".pvtu":
        files = [path.parent / name for name in read_pieces(path)]
        if not files:
            raise ValueError(f"{path} has no pieces")
    grids = [_grid(file) for file in files]
    parts = "" if len(files) == 1 else f" in {len(files)} parts"
    summary = {"kind": "step", "file": str(path), **_contents(grids)}
    lines = [f"{path}: one step for ParaView{parts}", *_lines(grids, summary)]
    return summary | {"lines": lines}


def _grid(file: Path) -> Grid:
    """Read a VTU file; meshio refuses those without points, as of a rank without cells."""
    try:
        return read_grid(file)
    except ValueError:
        if not _is_empty(file):
            raise
    return Grid(np.empty((0, 3)), [], {}, {}, {})


def _is_empty(file: Path) -> bool:
    try:
        return has_no_points(file)
    except ValueError:
        return False


def _mesh(path: Path, grid: Grid) -> dict[str, object]:
    """Summarise a mesh and its fields; cells that are no body may have fields."""
    contents = _contents([grid])
    try:
        summary = mesh.summarise(path)
    except ValueError:
        if not contents["fields"]:
            raise
        summary = {"kind": "step", "file": str(path), **contents}
        lines = [f"{path}: points and cells with fields", *_lines([grid], contents)]
        return summary | {"lines": lines}
    if not grid.of_points:
        return summary
    lines = [*summary["lines"], *_field_lines(contents["fields"])]
    return summary | {"fields": contents["fields"], "lines": lines}


def _contents(grids: list[Grid]) -> dict[str, Any]:
    cells: dict[str, int] = {}
    for grid in grids:
        for kind, nodes in grid.cells:
            cells[kind] = cells.get(kind, 0) + len(nodes)
    first = next((grid for grid in grids if grid.of_file), grids[0])
    numbers = {
        name: float(first.of_file[name].ravel()[0])
        for name in ("load", "time")
        if first.of_file.get(name, np.zeros(0)).size
    }
    units = _units(first.of_file)
    named: dict[str, dict[str, object]] = {}
    for of in ("points", "cells"):
        # A part without cells may lack the fields of cells.
        parts = [getattr(grid, f"of_{of}") for grid in grids]
        for name in dict.fromkeys(name for part in parts for name in part):
            pieces = [part[name] for part in parts if name in part]
            named[name] = {"of": of, "units": units.get(name), **_range(pieces)}
            if name in FIELDS:
                named[name]["meaning"] = FIELDS[name].meaning
    return {
        "points": sum(len(grid.points) for grid in grids),
        "cells": cells,
        **numbers,
        "fields": named,
    }


def _units(of_file: Mapping[str, AnyArray]) -> dict[str, str]:
    """Units by field; {} if the file does not name them."""
    try:
        text = np.asarray(of_file["units"], np.uint8).tobytes().decode()
        return {str(name): str(unit) for name, unit in json.loads(text).items()}
    except (KeyError, ValueError, AttributeError):
        return {}


def _range(parts: list[AnyArray]) -> dict[str, object]:
    """Components and range of a field: of the lengths of vectors, else of all numbers."""
    width = int(parts[0].shape[1]) if parts[0].ndim == 2 else 1
    values = np.concatenate([part.reshape(-1, width) for part in parts])
    numbers = np.linalg.norm(values, axis=1) if width == 3 else values
    if not numbers.size:
        return {"components": width, "low": None, "high": None}
    return {
        "components": width,
        "low": float(numbers.min()),
        "high": float(numbers.max()),
    }


def _lines(grids: list[Grid], found: Record) -> list[str]:
    cells = ", ".join(f"{count} {kind}" for kind, count in found["cells"].items())
    points = np.concatenate([grid.points for grid in grids])
    where = f", {mesh.box(points)}" if len(points) else ""
    lines = [f"  points    {found['points']}{where}", f"  cells     {cells or 'none'}"]
    numbers = [
        f"{name} {found[name]:.6g}" for name in ("load", "time") if name in found
    ]
    if numbers:
        lines.append(f"  step      {', '.join(numbers)}")
    return lines + _field_lines(found["fields"])


def _field_lines(named: Mapping[str, Record]) -> list[str]:
    lines = []
    wide = max(map(len, named), default=0)
    for of in ("points", "cells"):
        title = f"of {of}"
        for name, field in named.items():
            if field["of"] != of:
                continue
            unit = f" {field['units']}" if field["units"] else ""
            kind = {1: "number", 3: "vector"}.get(
                field["components"], f"{field['components']} components"
            )
            span = (
                "-" if field["low"] is None else _between(field["low"], field["high"])
            )
            size = " of length" if field["components"] == 3 else ""
            lines.append(f"  {title:<9} {name:<{wide}}  {kind}{size} {span}{unit}")
            title = ""
    return lines


def _between(low: float, high: float) -> str:
    return f"{low:.4g}" if low == high else f"{low:.4g} to {high:.4g}"
