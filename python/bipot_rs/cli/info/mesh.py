"""``bipot info`` of a mesh file: sizes, kinds of cells, named volumes and surfaces."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from bipot_rs._lib.messages import count_noun, printable

if TYPE_CHECKING:
    from bipot_rs._lib.types import AnyArray
    from bipot_rs.mesh.kinds import ElementMesh

# Files of bodies, and of surfaces of rigid obstacles.
_BODIES, _SURFACES = (".msh", ".inp", ".vtu"), (".stl",)
SUFFIXES = (*_BODIES, *_SURFACES)
_MANY = {"tetrahedron": "tetrahedra", "hexahedron": "hexahedra"}
# Most names that are listed.
_NAMES = 12


def summarise(path: Path) -> dict[str, Any]:
    """Summarise a mesh file.

    Returns ``kind``, ``nodes``, ``cells`` by kind, ``dim``, ``volumes`` and ``surfaces`` with
    their counts, ``mistake``, and ``lines`` for a terminal.
    Raises `OSError` or `ValueError` or `ModuleNotFoundError`: as `mesh_file.read_mesh`.
    """
    return _surface(path) if path.suffix.lower() in _SURFACES else _bodies(path)


def box(x: AnyArray) -> str:
    """The range of points ``(m, d)`` along each axis."""
    low, high = x.min(axis=0), x.max(axis=0)
    return " × ".join(f"[{a:.4g}, {b:.4g}]" for a, b in zip(low, high, strict=True))


def _bodies(path: Path) -> dict[str, object]:
    import numpy as np

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
