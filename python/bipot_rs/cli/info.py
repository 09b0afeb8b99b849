"""Summaries of files for ``bipot info``: results, files for ParaView, scenes and meshes.

Each returns ``kind``, figures by name, and ``lines`` for a terminal.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from bipot_rs._lib.messages import count_noun, printable
from bipot_rs.contact.law.status import STATUS_NAMES
from bipot_rs.files.fields import FIELDS
from bipot_rs.files.series import has_no_points, read_collection, read_pieces
from bipot_rs.mesh.readers import Grid, read_grid

if TYPE_CHECKING:
    from bipot_rs._lib.types import AnyArray, Record
    from bipot_rs.mesh.kinds import ElementMesh

# Most load steps that are listed; of a longer path the first and the last are.
_STEPS = 3


def summarise_result(path: Path) -> dict[str, object]:
    """Summarise a result file.

    Returns ``kind``, figures by name, and ``lines`` for a terminal.
    """
    from bipot_rs.contact.results.saved_result import load
    from bipot_rs.contact.results.tables import BROKEN, make_row
    from bipot_rs.files.export import read_saved

    if not path.exists():
        raise OSError(f"there is no {path}")
    contacts, steps, attributes, _ = read_saved(path)
    result = load(path)
    count = len(result)
    x = contacts.get("x")
    # A problem given as arrays may have no points.
    contacts_n, d = result.shape if count else (0 if x is None else len(x), 0)
    dim = (d or None) if x is None else x.shape[1]
    ranks = int(attributes["ranks"]) if "ranks" in attributes else None
    summary: dict[str, object] = {
        "kind": "result",
        "file": str(path),
        "scene": attributes.get("scene"),
        "complete": bool(attributes.get("complete")),
        "message": attributes.get("message", ""),
        "package": attributes.get("package"),
        "method": attributes.get("method"),
        "tol": attributes.get("tol"),
        "engine": attributes.get("engine"),
        "ranks": ranks,
        "contacts": contacts_n if count or x is not None else None,
        "dim": dim,
        "steps": count,
        # The number of automatic steps is unknown, and other files lack it.
        "planned": int(attributes["planned"]) if "planned" in attributes else None,
    }
    source = summary["scene"] or "a problem given as arrays"
    by = f"method {summary['method'] or '-'}, tol {summary['tol'] or '-'}"
    lines = [
        f"{path}: a result of {source}, {'' if summary['complete'] else 'not '}complete",
        f"  message   {summary['message'] or '-'}",
    ]
    if summary["package"]:
        lines.append(f"  by        bipot_rs {summary['package']}, {by}")
    if summary["engine"]:
        parts = [summary["engine"], attributes.get("preconditioner")]
        if ranks:
            parts.append(count_noun(ranks, "rank"))
        lines.append(f"  engine    {', '.join(str(part) for part in parts if part)}")
    if dim is not None:
        where = f", {box(x)}" if x is not None and len(x) else ""
        lines.append(
            f"  contacts  {count_noun(contacts_n, 'contact')} in {dim} dimensions{where}"
        )
        numbers = [f"{_span(contacts.get('mu'))}; gap {_span(contacts.get('gap'))}"]
        numbers += [
            f"{name} {_span(contacts[name])}"
            for name in ("cohesion", "dilatancy")
            if name in contacts
        ]
        lines.append(f"  friction  {'; '.join(numbers)}")
    if count:
        summary["residual"] = float(result.residual.max())
        kept = result[0].computed.displacement
        summary["displacements"] = None if kept is None else len(kept)
        moved = "no" if kept is None else len(kept)
        whole = summary["planned"] or count
        missing = "" if count == whole else f" of {whole}"
        lines.append(
            f"  steps     {count_noun(count, 'load step')}{missing}, every residual at most "
            f"{summary['residual']:.1e}; {moved} displacements each"
        )
        rows = [
            make_row(k, float(steps[k].get("load", k)), step)
            for k, step in enumerate(result)
        ]
        is_counted = summary["complete"] or summary["planned"] is not None
        reached = "" if is_counted else " reached"
        ends = list(range(count))
        if count > _STEPS:
            ends[1 : 1 - _STEPS] = []
        for before, k in zip([-1, *ends], ends, strict=False):
            row = rows[k]
            if k > before + 1:
                lines.append(f"  ...       {count_noun(k - before - 1, 'load step')}")
            counts = {
                name: row[name] for name in (*STATUS_NAMES, BROKEN) if name in row
            }
            listed = ", ".join(f"{name} {count}" for name, count in counts.items())
            lines.append(
                f"  load step {k + 1} of {whole}{reached}: {listed}, normal force "
                f"{result[k].reaction[:, 0].sum():.5g}"
            )
            summary["last"] = counts
    return summary | {"lines": lines}


def _span(values: ArrayLike | None) -> str:
    if values is None or not np.size(values):
        return "-"
    return _between(float(np.min(values)), float(np.max(values)))


def summarise_scene(name: str) -> dict[str, object]:
    """Summarise a scene: a file, or a shipped one.

    Returns ``kind``, figures by name, and ``lines`` for a terminal.
    """
    from bipot_rs.scene.reading import read

    scene = read(name)
    bodies = {
        body: " and ".join(dict.fromkeys(block.materials.values()))
        for body, block in scene.body.items()
    }
    steps = scene.path.count()
    summary: dict[str, object] = {
        "kind": "scene",
        "scene": name,
        "title": scene.title,
        "bodies": list(bodies),
        "contacts": [contact.on for contact in scene.contact],
        "steps": steps,
        "method": scene.solver.method,
        "engine": scene.solver.engine,
        "tol": scene.solver.tol,
    }
    units = ", ".join(
        f"{quantity} in {unit}"
        for quantity, unit in scene.units.model_dump().items()
        if unit
    )
    loads = [
        count_noun(len(entries), kind)
        for kind, entries in (
            ("support", scene.support),
            ("symmetry", scene.symmetry),
            ("spring", scene.spring),
            ("traction", scene.traction),
            ("pressure", scene.pressure),
            ("body force", scene.body_force),
            ("initial strain", scene.strain),
            ("bolt", scene.bolt),
        )
        if entries
    ]
    touching = [
        f"{pair.name + ': ' if pair.name else ''}{pair.on} against "
        f"{pair.against or 'a plane'}, mu {pair.mu}"
        + "".join(
            f", {name} {getattr(pair, name):g}"
            for name in ("cohesion", "dilatancy")
            if getattr(pair, name)
        )
        for pair in scene.contact
    ]
    parameter, solver = scene.path.parameter or "step number", scene.solver
    lines = [
        f"{name}: a scene, {scene.title or 'without a title'}",
        f"  units     {units or 'not named'}",
        "  bodies    " + ", ".join(f"{b} ({m})" for b, m in bodies.items()),
        f"  contacts  {', '.join(touching)}",
        f"  loads     {', '.join(loads) or 'none'}",
        f"  path      {count_noun(steps, 'load step')}, parameter: {parameter}",
        f"  solver    {solver.method}, tol {solver.tol}, engine {solver.engine}",
        f"  next      bipot check {name}, bipot run {name}",
    ]
    return summary | {"lines": lines}


# Files of bodies, and of surfaces of rigid obstacles.
_BODIES, _SURFACES = (".msh", ".inp", ".med", ".vtu"), (".stl",)
MESH_SUFFIXES = (*_BODIES, *_SURFACES)
_MANY = {"tetrahedron": "tetrahedra", "hexahedron": "hexahedra"}
# Most names that are listed.
_NAMES = 12


def summarise_mesh(path: Path) -> dict[str, Any]:
    """Summarise a mesh file.

    Returns ``kind``, ``nodes``, ``cells`` by kind, ``dim``, ``volumes`` and ``surfaces`` with
    their counts, ``mistake``, and ``lines`` for a terminal.
    """
    return _surface(path) if path.suffix.lower() in _SURFACES else _bodies(path)


def box(x: AnyArray) -> str:
    """The range of points ``(m, d)`` along each axis."""
    low, high = x.min(axis=0), x.max(axis=0)
    return " × ".join(f"[{a:.4g}, {b:.4g}]" for a, b in zip(low, high, strict=True))


def _bodies(path: Path) -> dict[str, object]:
    from bipot_rs.mesh.elements import kind_of
    from bipot_rs.mesh.readers import read_mesh, read_meshes

    several = ""
    try:
        parts = [read_mesh(path, check=False)]
    except ValueError as error:
        # Cells of several kinds: each volume may have one kind.
        try:
            parts = list(read_meshes(path, check=False).values())
        except ValueError:
            raise error from None
        several = "it has several kinds of cells: read each volume with group="
    dim = int(parts[0].p.shape[0])
    cells: dict[str, int] = {}
    volumes: dict[str, int] = {}
    surfaces: dict[str, int] = {}
    mistake = ""
    for piece in parts:
        kind = kind_of(piece)
        order = "first" if kind.degree == 1 else "second"
        name = (
            f"{_MANY.get(kind.shape, kind.shape + 's')} of {order} order ({kind.vtk})"
        )
        cells[name] = cells.get(name, 0) + int(piece.t.shape[1])
        for counts, of in ((volumes, piece.subdomains), (surfaces, piece.boundaries)):
            for group, members in (of or {}).items():
                counts[group] = max(counts.get(group, 0), len(members))
        mistake = mistake or _wrong(piece, "it")
    if mistake and len(volumes) > 1 and not several:
        # Volumes that are not connected may each be correct.
        apart = read_meshes(path, check=False)
        mistakes = [_wrong(piece, f"volume {name!r}") for name, piece in apart.items()]
        mistake = next(filter(None, mistakes), "")
        several = (
            "" if mistake else "its volumes are not connected: read each with group="
        )
    points = np.concatenate([piece.p.T for piece in parts])
    summary: dict[str, object] = {
        "kind": "mesh",
        "file": str(path),
        "dim": dim,
        "nodes": len(points),
        "cells": cells,
        "volumes": volumes,
        "surfaces": surfaces,
        "mistake": mistake,
    }
    kinds = ", ".join(f"{count} {name}" for name, count in cells.items())
    lines = [
        f"{path}: a mesh in {dim} dimensions",
        f"  cells     {kinds}",
        f"  nodes     {len(points)}, {box(points)}",
        f"  volumes   {_list_counts(volumes, 'cell') or 'none named'}",
        f"  surfaces  {_list_counts(surfaces, 'facet') or _NO_SURFACE}",
    ]
    if several:
        lines.append(f"  remark    {several}")
    if mistake:
        lines.append(f"  mistake   {mistake}")
    mesh_value = f'"{printable(path.name)}"'
    if several and volumes:
        group = printable(next(iter(volumes)))
        mesh_value = f'{{ file = {mesh_value}, group = "{group}" }}'
    lines.append(
        f"  use it    mesh = {mesh_value} in a scene: bipot new --template mesh"
    )
    return summary | {"lines": lines}


def _wrong(mesh: ElementMesh, what: str) -> str:
    """The mistake of a mesh, or an empty text."""
    from bipot_rs.mesh.quality import check_mesh

    try:
        check_mesh(mesh, what)
    except ValueError as error:
        return str(error)
    return ""


_NO_SURFACE = "none named: define them by position, [body.NAME.surface.OTHER]"


def _surface(path: Path) -> dict[str, object]:
    from bipot_rs.mesh.readers import read_cells

    points, blocks = read_cells(path)
    cells = {kind: len(nodes) for kind, nodes in blocks}
    summary = {
        "kind": "surface",
        "file": str(path),
        "nodes": len(points),
        "cells": cells,
    }
    kinds = ", ".join(f"{count} of kind {kind}" for kind, count in cells.items())
    lines = [
        f"{path}: a surface, for a rigid obstacle",
        f"  facets    {kinds or 'none'}",
        f"  points    {len(points)}" + (f", {box(points)}" if len(points) else ""),
        f'  use it    surface = "{printable(path.name)}" in [obstacle.NAME] of a scene',
    ]
    return summary | {"lines": lines}


def _list_counts(known: Mapping[str, int], noun: str) -> str:
    names: Sequence[str] = sorted(known)
    shown = [f"{name} ({count_noun(known[name], noun)})" for name in names[:_NAMES]]
    more = len(names) - _NAMES
    return ", ".join(shown) + (f" and {more} more" if more > 0 else "")


SERIES_SUFFIXES = (".pvd", ".pvtu", ".vtu")


def summarise_fields(path: Path) -> dict[str, object]:
    """Summarise a series of steps, or the file of one step.

    A VTU file without a load step is a mesh: its summary lists the fields as well.

    Returns ``kind``, ``points``, ``cells`` by kind, ``fields`` by name, ``load`` and ``time``
    of the step, and ``lines`` for a terminal; of a series also ``steps``, ``times``.
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
        summary = summarise_mesh(path)
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
    where = f", {box(points)}" if len(points) else ""
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
