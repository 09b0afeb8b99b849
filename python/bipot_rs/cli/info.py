"""Summaries of files for ``bipot info``: results, files for ParaView, scenes and meshes.

Each returns ``kind``, figures by name, and ``lines`` for a terminal.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from bipot_rs._lib.messages import count_noun, printable
from bipot_rs.contact.results.summary import Row, format_text
from bipot_rs.files.fields import FIELDS
from bipot_rs.files.series import has_no_points, read_collection, read_pieces
from bipot_rs.mesh.readers import Grid, read_grid

if TYPE_CHECKING:
    from bipot_rs._lib.types import AnyArray, OpenRecord, Record
    from bipot_rs.mesh.kinds import ElementMesh


def _report(title: str, rows: Iterable[Row], /, **figures: object) -> OpenRecord:
    shown = [(name, text) for name, text in rows if text]
    return {**figures, "lines": format_text((title, shown)).splitlines()}


# Attributes of a result file that say how it was solved.
_SETTINGS = ("package", "method", "tol", "engine", "preconditioner", "ranks")


def summarise_result(path: Path) -> OpenRecord:
    """Summarise a result file, as ``print`` of the result does."""
    from bipot_rs.contact.results.saved_result import load
    from bipot_rs.contact.results.tables import make_row
    from bipot_rs.files.export import read_saved

    if not path.exists():
        raise OSError(f"there is no {path}")
    contacts, _, attributes, _ = read_saved(path)
    result = load(path)
    count, x = len(result), contacts.get("x")
    # A problem given as arrays may have no points.
    number, dim = result.shape if count or x is None else x.shape
    figures: OpenRecord = {
        name: attributes.get(name) for name in ("scene", "message", *_SETTINGS)
    }
    for name in ("ranks", "planned"):
        figures[name] = int(attributes[name]) if name in attributes else None
    figures |= {"complete": bool(attributes.get("complete")), "steps": count}
    figures |= {"contacts": number if dim else None, "dim": dim or None}
    if count:
        last = result[-1]
        kept = last.computed.displacement
        counts = ("open", "slip", "stick", "broken")
        row = make_row(count - 1, None, last)
        figures["residual"] = float(result.residual.max())
        figures["displacements"] = None if kept is None else len(kept)
        figures["last"] = {name: row[name] for name in counts if name in row}
    whole = figures["planned"] or count
    of = "" if count == whole else f" of {whole}"
    by = [f"{name} {figures[name]}" for name in _SETTINGS if figures[name] is not None]
    rows = [
        ("by", ", ".join(by)),
        ("steps", f"{count_noun(count, 'load step')}{of}"),
        ("where", box(x) if x is not None and len(x) else ""),
    ]
    complete = "complete" if figures["complete"] else "not complete"
    source = figures["scene"] or "a problem given as arrays"
    title = f"{path}: a result of {source}, {complete}"
    report = _report(title, rows, kind="result", file=str(path), **figures)
    report["lines"] += str(result).splitlines()
    return report


def summarise_scene(name: str) -> OpenRecord:
    """Summarise a scene: a file, or a shipped one."""
    from bipot_rs.scene.reading import read

    scene = read(name)
    bodies = {
        body: " and ".join(dict.fromkeys(block.materials.values()))
        for body, block in scene.body.items()
    }
    units = scene.units.model_dump().items()
    tables = {key: getattr(scene, key) for key in type(scene).model_fields}
    loads = [
        count_noun(len(entries), key.replace("_", " "))
        for key, entries in tables.items()
        if isinstance(entries, list) and entries and key != "contact"
    ]
    touching = [
        f"{pair.on} against {pair.against or 'a plane'}, mu {pair.mu}"
        for pair in scene.contact
    ]
    steps, solver = scene.path.count(), scene.solver
    parameter = scene.path.parameter or "step number"
    rows = [
        ("units", ", ".join(f"{kind} in {unit}" for kind, unit in units if unit)),
        ("bodies", ", ".join(f"{body} ({of})" for body, of in bodies.items())),
        ("contacts", ", ".join(touching)),
        ("loads", ", ".join(loads)),
        ("path", f"{count_noun(steps, 'load step')}, parameter: {parameter}"),
        ("solver", f"{solver.method}, tol {solver.tol}, engine {solver.engine}"),
        ("next", f"bipot check {name}, bipot run {name}"),
    ]
    return _report(
        f"{name}: a scene, {scene.title or 'without a title'}",
        rows,
        kind="scene",
        scene=name,
        title=scene.title,
        bodies=list(bodies),
        contacts=[contact.on for contact in scene.contact],
        steps=steps,
        **solver.model_dump(include={"method", "engine", "tol"}),
    )


# Files of bodies, and of surfaces of rigid obstacles.
_BODIES, _SURFACES = (".msh", ".inp", ".med", ".vtu"), (".stl",)
MESH_SUFFIXES = (*_BODIES, *_SURFACES)
# Most names that are listed.
_NAMES = 12


def summarise_mesh(path: Path) -> OpenRecord:
    """Summarise a mesh file: cells by kind, volumes and surfaces with their counts."""
    if path.suffix.lower() not in _SURFACES:
        return _summarise_bodies(path)
    use = f'surface = "{printable(path.name)}" in [obstacle.NAME] of a scene'
    title = f"{path}: a surface, for a rigid obstacle"
    return _summarise_grids(
        "surface", title, path, [read_grid(path)], [("use it", use)]
    )


def box(x: AnyArray) -> str:
    """The range of points ``(m, d)`` along each axis."""
    low, high = x.min(axis=0), x.max(axis=0)
    return " × ".join(f"[{a:.4g}, {b:.4g}]" for a, b in zip(low, high, strict=True))


def _summarise_bodies(path: Path) -> OpenRecord:
    from bipot_rs.mesh.elements import kind_of
    from bipot_rs.mesh.readers import read_mesh, read_meshes

    several = mistake = ""
    try:
        parts = {"": read_mesh(path, check=False)}
        mistake = _find_mistake(parts)
    except ValueError as error:
        several = "it has several kinds of cells"
        try:
            parts = read_meshes(path, check=False)
        except ValueError:
            raise error from None
        mistake = _find_mistake(parts)
    if mistake and not several and len(parts[""].subdomains or {}) > 1:
        # Volumes that are not connected may each be correct.
        mistake = _find_mistake(read_meshes(path, check=False))
        several = "" if mistake else "its volumes are not connected"
    counts: dict[str, dict[str, int]] = {"cells": {}, "volumes": {}, "surfaces": {}}
    for mesh in parts.values():
        kind = kind_of(mesh).vtk
        counts["cells"][kind] = counts["cells"].get(kind, 0) + mesh.nelements
        named = {"volumes": mesh.subdomains, "surfaces": mesh.boundaries}
        for of, groups in named.items():
            counts[of] |= {name: len(part) for name, part in (groups or {}).items()}
    points = np.concatenate([mesh.p.T for mesh in parts.values()])
    mesh_value = f'"{printable(path.name)}"'
    if several and counts["volumes"]:
        group = printable(next(iter(counts["volumes"])))
        mesh_value = f'{{ file = {mesh_value}, group = "{group}" }}'
        several += ": read each volume with group="
    undefined = "none named: define them by position, [body.NAME.surface.OTHER]"
    rows = [
        ("cells", _list_counts(counts["cells"], "cell")),
        ("nodes", f"{len(points)}, {box(points)}"),
        ("volumes", _list_counts(counts["volumes"], "cell") or "none named"),
        ("surfaces", _list_counts(counts["surfaces"], "facet") or undefined),
        ("remark", several),
        ("mistake", mistake),
        ("use it", f"mesh = {mesh_value} in a scene: bipot new --template mesh"),
    ]
    dim = points.shape[1]
    return _report(
        f"{path}: a mesh in {dim} dimensions",
        rows,
        kind="mesh",
        file=str(path),
        dim=dim,
        nodes=len(points),
        mistake=mistake,
        **counts,
    )


def _find_mistake(parts: Mapping[str, ElementMesh]) -> str:
    """The first mistake of meshes, by name; "" without one."""
    from bipot_rs.mesh.quality import check_mesh

    try:
        for name, mesh in parts.items():
            check_mesh(mesh, f"volume {name!r}" if name else "it")
    except ValueError as error:
        return str(error)
    return ""


def _list_counts(counts: Mapping[str, int], noun: str) -> str:
    names: Sequence[str] = sorted(counts)
    shown = [f"{name} ({count_noun(counts[name], noun)})" for name in names[:_NAMES]]
    more = len(names) - _NAMES
    return ", ".join(shown) + (f" and {more} more" if more > 0 else "")


SERIES_SUFFIXES = (".pvd", ".pvtu", ".vtu")


def summarise_fields(path: Path) -> OpenRecord:
    """Summarise a series of steps, by its last one, or the file of one step.

    A VTU file without a load step is a mesh, whose fields are listed too.
    """
    if not path.is_file():
        raise FileNotFoundError(f"there is no file {path}")
    suffix = path.suffix.lower()
    if suffix == ".pvd":
        return _summarise_series(path)
    if suffix == ".vtu" and "time" not in (grid := _read_grid(path)).of_file:
        try:
            report = summarise_mesh(path)
        except ValueError:
            if not (grid.of_points or grid.of_cells):
                raise
            # Cells that are no body may have fields.
            title = f"{path}: points and cells with fields"
            return _summarise_grids("step", title, path, [grid])
        if grid.of_points:
            fields = _describe_fields([grid])
            report["fields"] = fields
            report["lines"] += format_text(("", _list_fields(fields))).splitlines()[1:]
        return report
    return _summarise_step(path)


def _summarise_series(path: Path) -> OpenRecord:
    steps = read_collection(path)
    times = [time for time, _ in steps]
    title = f"{path}: a series of {count_noun(len(steps), 'step')} for ParaView"
    series = {"kind": "series", "file": str(path), "steps": len(steps), "times": times}
    lost = [file for _, file in steps if not (path.parent / file).is_file()]
    if lost:
        raise ValueError(
            f"{path} names {count_noun(len(lost), 'file')} that do not exist, the first is "
            f"{lost[0]}: copy the whole folder, not the index only"
        )
    if not steps:
        return _report(title, (), **series)
    last = _summarise_step(path.parent / steps[-1][1])
    head = f"{title}, time {_between(min(times), max(times))}; the last step:"
    return last | series | {"lines": [head, *last["lines"]]}


def _summarise_step(path: Path) -> OpenRecord:
    """Summarise one step, whose parts may lie in several files."""
    files = [path]
    if path.suffix.lower() == ".pvtu":
        files = [path.parent / name for name in read_pieces(path)]
        if not files:
            raise ValueError(f"{path} has no pieces")
    parts = "" if len(files) == 1 else f" in {len(files)} parts"
    grids = [_read_grid(file) for file in files]
    return _summarise_grids(
        "step", f"{path}: one step for ParaView{parts}", path, grids
    )


def _read_grid(file: Path) -> Grid:
    """Read a VTU file; meshio refuses those without points, as of a rank without cells."""
    try:
        return read_grid(file)
    except ValueError as error:
        try:
            if has_no_points(file):
                return Grid(np.empty((0, 3)), [], {}, {}, {})
        except ValueError:
            pass  # not even XML
        raise error from None


def _summarise_grids(
    kind: str, title: str, path: Path, grids: list[Grid], more: Iterable[Row] = ()
) -> OpenRecord:
    """Summarise the parts of one set of points, cells and fields."""
    cells: dict[str, int] = {}
    for grid in grids:
        for name, nodes in grid.cells:
            cells[name] = cells.get(name, 0) + len(nodes)
    of_file = next((grid.of_file for grid in grids if grid.of_file), {})
    numbers = {
        name: float(of_file[name].ravel()[0])
        for name in ("load", "time")
        if np.size(of_file.get(name, ()))
    }
    points = np.concatenate([grid.points for grid in grids])
    fields = _describe_fields(grids)
    rows = [
        ("points", f"{len(points)}, {box(points)}" if len(points) else "none"),
        ("cells", ", ".join(f"{count} {name}" for name, count in cells.items())),
        *((name, f"{number:.6g}") for name, number in numbers.items()),
        *_list_fields(fields),
        *more,
    ]
    figures = {"points": len(points), "cells": cells, **numbers, "fields": fields}
    return _report(title, rows, kind=kind, file=str(path), **figures)


def _describe_fields(grids: Sequence[Grid]) -> dict[str, Record]:
    """Where each field is, its meaning, unit and range: of vectors that of their lengths."""
    units = _read_units(next((grid.of_file for grid in grids if grid.of_file), {}))
    fields: dict[str, Record] = {}
    for of in ("points", "cells"):
        # A part without cells may lack the fields of cells.
        parts = [getattr(grid, f"of_{of}") for grid in grids]
        for name in dict.fromkeys(name for part in parts for name in part):
            pieces = [part[name] for part in parts if name in part]
            width = int(pieces[0].shape[1]) if pieces[0].ndim == 2 else 1
            values = np.concatenate([piece.reshape(-1, width) for piece in pieces])
            sizes = np.linalg.norm(values, axis=1) if width == 3 else values
            meaning = {"meaning": FIELDS[name].meaning} if name in FIELDS else {}
            fields[name] = {
                **meaning,
                "of": of,
                "units": units.get(name),
                "components": width,
                "low": float(sizes.min()) if sizes.size else None,
                "high": float(sizes.max()) if sizes.size else None,
            }
    return fields


def _read_units(of_file: Mapping[str, AnyArray]) -> dict[str, str]:
    """Units by field; {} if the file does not name them."""
    try:
        text = np.asarray(of_file["units"], np.uint8).tobytes().decode()
        return {str(name): str(unit) for name, unit in json.loads(text).items()}
    except (KeyError, ValueError, AttributeError):
        return {}


def _list_fields(fields: Mapping[str, Record]) -> list[Row]:
    kinds = {1: "number", 3: "length of vector"}
    rows = []
    for name, field in fields.items():
        kind = kinds.get(field["components"], f"{field['components']} components")
        span = "-"
        if field["low"] is not None:
            span = f"{_between(field['low'], field['high'])} {field['units'] or ''}"
        rows.append((name, f"{kind} at {field['of']}, {span}".rstrip()))
    return rows


def _between(low: float, high: float) -> str:
    return f"{low:.4g}" if low == high else f"{low:.4g} to {high:.4g}"
