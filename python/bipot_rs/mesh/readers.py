"""Readers of mesh files: gmsh, Abaqus and CalculiX, MED of Salome and code_aster, VTU.

Names of volumes (``mesh.subdomains``) and surfaces (``mesh.boundaries``) come from:

- gmsh ``.msh``, versions 2.2 and 4.1, text and binary: physical groups, named
  ``physical 3`` if they have no name. A group of curves and a group of surfaces may have
  the same name.
- Abaqus and CalculiX ``.inp``: ELSET, SURFACE, and NSET. An NSET gives the surface of the
  facets whose nodes are all in it.
- ``.med``: groups of cells.
- ``.vtu``: integer cell data, with names such as ``tag 3`` for the value 3 of ``tag``.
  Select surfaces by `bipot_rs.fem.surface`.

Cells of one dimension less (lines, triangles, quadrilaterals) define surfaces. Of a surface
that is partly inside the body only the boundary facets are kept; one that is whole inside it,
which has no outward normal, can be the section of a bolt.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from contextlib import redirect_stderr
from dataclasses import dataclass
from io import StringIO
from pathlib import Path
from typing import Protocol

import numpy as np

from bipot_rs._lib.messages import count_noun
from bipot_rs._lib.optional import load_library
from bipot_rs._lib.text_files import strip_mark, without
from bipot_rs._lib.types import AnyArray, Bools, Floats, Ints
from bipot_rs.mesh import abaqus
from bipot_rs.mesh import gmsh as gmsh_groups
from bipot_rs.mesh.elements import Content, facet_nodes, keep_topology, make_mesh
from bipot_rs.mesh.kinds import OF_VTK, ElementMesh
from bipot_rs.mesh.quality import check_mesh

# Kinds of cells that may be facets: dimension and number of corners.
_FACETS = {
    kind.facet.vtk: (kind.dim - 1, kind.facet.corners) for kind in OF_VTK.values()
}
_IGNORED = ("vertex",)
# Up to this number of different values, integer cell data count as groups.
_GROUPS = 64
_SUFFIXES = (".msh", ".inp", ".med", ".vtu")


class _Block(Protocol):
    type: str
    data: AnyArray


class _MeshioMesh(Protocol):
    """What this module uses of a mesh of meshio."""

    points: Floats
    cells: Sequence[_Block]
    # By name: the members of each block, and the values of its cells.
    cell_sets: Mapping[str, Sequence[AnyArray | None]]
    cell_data: Mapping[str, Sequence[AnyArray]]
    point_data: Mapping[str, AnyArray]
    field_data: Mapping[str, AnyArray]
    cell_tags: Mapping[int, Sequence[str]]  # of meshlane: the groups of each family


def read_mesh(
    path: str | os.PathLike[str],
    group: str | Sequence[str] | None = None,
    *,
    check: bool = True,
) -> ElementMesh:
    """Read a mesh of scikit-fem from a file, with named volumes and surfaces.

    The class of the mesh gives the element: triangles and tetrahedra of first and
    second order, quadrilaterals with 4, 8 and 9 nodes, hexahedra with 8, 20 and 27.
    Points of no cell are left out. Cells of a 2D mesh must lie in a plane z = const.

    Parameters
    ----------
    path
        A file with the suffix ``.msh``, ``.inp``, ``.med`` or ``.vtu``.
    group
        Names of the volumes to read; default all cells.
    check
        Whether to call `check_mesh`.

    Raises
    ------
    OSError
        The file does not exist or cannot be read.
    ValueError
        The file does not have the format of its suffix or is incomplete, has no cells,
        lacks a volume, or has cells of several kinds; or `check_mesh` finds a fault.
    ModuleNotFoundError
        meshio is not installed, for ``.med`` meshlane; ``.inp`` does not need it.
    """
    where = Path(path)
    return _mesh(where, _open(where), group, check=check)


def read_meshes(
    path: str | os.PathLike[str], *, check: bool = True
) -> dict[str, ElementMesh]:
    """Read each named volume of a file, as `read_mesh` with ``group``; a mapping by name."""
    where = Path(path)
    file = _open(where)
    volumes = _volumes(file)
    if not volumes:
        raise ValueError(f"the mesh {where} has no named volume")
    return {name: _mesh(where, file, name, check=check) for name in volumes}


@dataclass(frozen=True)
class Grid:
    """Points, cells and fields of a VTU file."""

    points: Floats  # `(points, 3)`
    # Pairs of a kind and nodes `(cells, nodes of a cell)`.
    cells: list[tuple[str, Ints]]
    # of_points, of_cells, of_file: arrays by name: of all points, of all cells in their order,
    # and field data.
    of_points: dict[str, AnyArray]
    of_cells: dict[str, AnyArray]
    of_file: dict[str, AnyArray]


def read_grid(path: str | os.PathLike[str]) -> Grid:
    """Read a VTU file with its fields; raises as `read_cells`."""
    mesh = _read_any(Path(path), "a VTU file")
    return Grid(
        np.asarray(mesh.points, np.float64),
        _blocks(mesh),
        {name: np.asarray(array) for name, array in mesh.point_data.items()},
        {
            name: np.concatenate(parts)
            for name, parts in mesh.cell_data.items()
            if parts
        },
        {name: np.asarray(array) for name, array in mesh.field_data.items()},
    )


def read_cells(path: str | os.PathLike[str]) -> tuple[Floats, list[tuple[str, Ints]]]:
    """Read points ``(m, d)`` and cells by kind from any file of meshio, such as STL.

    Raises `OSError`: the file does not exist.
    Raises `ValueError`: the file cannot be read.
    Raises `ModuleNotFoundError`: meshio is not installed.
    """
    mesh = _read_any(Path(path), "a surface")
    return np.asarray(mesh.points, np.float64), _blocks(mesh)


def _blocks(mesh: _MeshioMesh) -> list[tuple[str, Ints]]:
    return [(block.type, np.asarray(block.data, np.int64)) for block in mesh.cells]


def _read_any(file: Path, what: str) -> _MeshioMesh:
    """Read a file by meshio; ``what`` it should be, for errors."""
    meshio = load_library("meshio", extra="fem", need="meshes in files")
    if not file.is_file():
        raise FileNotFoundError(f"there is no file {file}")
    try:
        # meshio first reads text STL as binary, and its count of triangles overflows.
        with strip_mark(file) as source, np.errstate(over="ignore"):
            mesh: _MeshioMesh = meshio.read(source)
            return mesh
    # Readers of meshio raise any exception; one of them calls sys.exit.
    except (Exception, SystemExit) as error:  # noqa: BLE001
        reason = " ".join(str(error).split()) or type(error).__name__
        raise ValueError(f"{file} cannot be read as {what}: {reason}") from None


def _open(path: Path) -> Content:
    suffix = path.suffix.lower()
    if suffix not in _SUFFIXES:
        raise ValueError(
            f"the mesh {path} has {f'the suffix {suffix}' if suffix else 'no suffix'}, "
            f"expected one of {', '.join(_SUFFIXES)}"
        )
    if not path.exists():
        raise FileNotFoundError(f"the mesh {path} does not exist")
    if not path.stat().st_size:
        raise ValueError(f"the mesh {path} is empty")
    if suffix == ".inp":
        return abaqus.read(path)
    _complete(path, suffix)
    with strip_mark(path) as source:
        return _of_meshio(path, suffix, source)


def _complete(path: Path, suffix: str) -> None:
    """Refuse incomplete files, which meshio reads in part or with unclear errors."""
    content = without(path.read_bytes())
    if suffix == ".msh" and not content.lstrip().startswith(
        (b"$MeshFormat", b"$Comme")
    ):
        raise ValueError(f"the mesh {path} is not a gmsh file: it has no $MeshFormat")
    # HDF5 itself refuses an incomplete .med file.
    end = {".msh": "$EndElements", ".vtu": "</VTKFile>"}.get(suffix, "")
    if end.encode() not in content:
        raise ValueError(f"the mesh {path} is incomplete: it has no {end}")


def _of_meshio(path: Path, suffix: str, source: Path) -> Content:
    """Read ``source`` with meshio, or meshlane; messages name ``path``."""
    if suffix == ".med":
        reader = load_library("meshlane", extra="med", need="MED files").med
    else:
        meshio = load_library("meshio", extra="fem", need="meshes in files")
        reader = {".msh": meshio.gmsh, ".vtu": meshio.vtu}[suffix]
    try:
        # meshio prints warnings for valid files, and for files refused below.
        with redirect_stderr(StringIO()):
            read: _MeshioMesh = reader.read(str(source))
    except OSError:
        raise
    # Readers of meshio raise any exception.
    except Exception as error:
        why = str(error) or type(error).__name__
        raise ValueError(
            f"the mesh {path} cannot be read: {why}{_hint(why)}"
        ) from error
    blocks = [(b.type, np.asarray(b.data, dtype=np.int64)) for b in read.cells]
    if np.ndim(read.points) != 2:
        raise ValueError(f"the mesh {path} has no nodes")
    for kind, nodes in blocks:
        # Readers of meshio give a missing node the index -1.
        if nodes.size and not 0 <= nodes.min() <= nodes.max() < len(read.points):
            raise ValueError(
                f"the mesh {path} has a {kind} with a node that is not in the file"
            )
    points = np.zeros((len(read.points), 3))
    points[:, : np.shape(read.points)[1]] = read.points
    file = Content(points, blocks)
    if suffix == ".msh":
        _add_groups(source, file, read)
    elif suffix == ".med":
        # A family, by its number, has the cells that are in the same groups.
        for family, names in read.cell_tags.items():
            cells = [np.flatnonzero(k == family) for k in read.cell_data["cell_tags"]]
            for name in names:
                held = file.sets.setdefault(name, _none(file))
                file.sets[name] = [*map(np.union1d, held, cells)]
        return file
    else:
        for name, parts in read.cell_sets.items():
            file.sets[name] = [
                np.asarray([] if part is None else part, np.int64) for part in parts
            ]
    _add_tags(file, read)
    return file


def _hint(why: str) -> str:
    """Advice for known errors of meshio."""
    if "gmsh:physical" in why:
        return ": some cells have no physical group, save without Mesh.SaveAll"
    if "parametric" in why:
        return ": save it in version 4.1, without Mesh.SaveParametric"
    return ""


def _add_groups(path: Path, file: Content, read: _MeshioMesh) -> None:
    """Add sets from the physical groups of gmsh."""
    named = gmsh_groups.names(path)
    entities = gmsh_groups.of_entities(path)
    key = "gmsh:physical" if entities is None else "gmsh:geometrical"
    groups: dict[tuple[int, int], list[Ints]] = {}
    for block, tags in enumerate(read.cell_data.get(key, [])):
        dim = _dimension(file.blocks[block][0])
        for tag in np.unique(tags).tolist():
            # The sign is the orientation; zero means no group.
            numbers = [abs(tag)] if entities is None else entities.get((dim, tag), [])
            for number in filter(None, numbers):
                members = groups.setdefault((dim, number), _none(file))
                members[block] = np.union1d(members[block], np.flatnonzero(tags == tag))
    # In the order of the names.
    order = {group: k for k, group in enumerate(named)}
    for group in sorted(groups, key=lambda one: order.get(one, len(order))):
        parts = groups[group]
        name = named.get(group, f"physical {group[1]}")
        existing = file.sets.setdefault(name, _none(file))
        file.sets[name] = [np.union1d(*p) for p in zip(existing, parts, strict=True)]


def _none(file: Content) -> list[Ints]:
    return [np.zeros(0, np.int64) for _ in file.blocks]


def _add_tags(file: Content, read: _MeshioMesh) -> None:
    """Add sets from integer cell data, if there is no set of the same name."""
    for key, parts in read.cell_data.items():
        if key.startswith("gmsh:") or not all(
            np.ndim(part) == 1 and np.asarray(part).dtype.kind in "iu" for part in parts
        ):
            continue
        flat = np.concatenate([np.zeros(0, np.int64), *map(np.asarray, parts)])
        values = np.unique(flat)
        # So many values number cells, not groups.
        if len(values) > max(_GROUPS, len(flat) // 2):
            continue
        for value in values.tolist():
            cells = [np.flatnonzero(np.asarray(part) == value) for part in parts]
            file.sets.setdefault(f"{key} {value}", cells)


def _dimension(kind: str) -> int:
    if kind in OF_VTK:
        return OF_VTK[kind].dim
    if kind in _FACETS:
        return _FACETS[kind][0]
    # Unknown kinds count as cells of a body, so that they are refused by name.
    return 0 if kind in _IGNORED else 3


def _volumes(file: Content) -> dict[str, list[Ints]]:
    top = max((_dimension(kind) for kind, _ in file.blocks), default=0)
    volumes = {}
    for name, parts in file.sets.items():
        by_block = [
            part if _dimension(kind) == top else part[:0]
            for part, (kind, _) in zip(parts, file.blocks, strict=True)
        ]
        if any(len(part) for part in by_block):
            volumes[name] = by_block
    return volumes


def _no_cells(path: Path) -> str:
    """Advice for a gmsh file that has only the surfaces of a 3D body."""
    if path.suffix != ".msh":
        return ""
    return (
        ": give the volumes of a 3D body a physical group; if there is any group, gmsh "
        "writes only cells in groups"
    )


def _mesh(
    path: Path, file: Content, group: str | Sequence[str] | None, *, check: bool
) -> ElementMesh:
    top = max((_dimension(kind) for kind, _ in file.blocks), default=0)
    volumes = _volumes(file)
    if top < 2:
        raise ValueError(
            f"the mesh {path} has no cells of a 2D or 3D body, "
            + (_counts(file.blocks) or "and no other cells")
        )
    names = ", ".join(map(repr, sorted(volumes))) or "no named volume"
    wanted = [group] if isinstance(group, str) else list(group or [])
    for name in wanted:
        if name not in volumes:
            raise ValueError(
                f"the mesh {path} has no volume {name!r}; it has {names}"
                + (_no_cells(path) if top == 2 and np.ptp(file.points[:, 2]) else "")
            )
    chosen = []
    for block, (kind, nodes) in enumerate(file.blocks):
        chosen_cells = np.zeros(len(nodes), dtype=np.bool_)
        if _dimension(kind) == top:
            chosen_cells[:] = not wanted
            for name in wanted:
                chosen_cells[volumes[name][block]] = True
        chosen.append(chosen_cells)
    kind, cells, index = _cells(path, file, chosen, volumes)
    bad = np.flatnonzero(~np.isfinite(file.points[cells]).all(axis=(1, 2)))
    if bad.size:
        raise ValueError(
            f"the mesh {path} has a node of cell {bad[0]} whose coordinates are not finite"
        )
    points = _plane(path, file.points, cells) if top == 2 else file.points
    try:
        mesh, number = make_mesh(kind, points, cells)
    except ValueError as error:
        raise ValueError(f"the mesh {path}: {error}") from None
    node = np.full(len(file.points), -1, dtype=np.int64)
    node[number] = np.arange(len(number))
    subdomains = {}
    for name, parts in volumes.items():
        inside = np.unique(index[_number_globally(file, parts)])
        if inside[-1] >= 0:
            subdomains[name] = inside[inside >= 0]
    boundaries = _surfaces(file, mesh, node, top, index)
    named = mesh.with_boundaries(boundaries) if boundaries else mesh
    if subdomains:
        named = named.with_subdomains(subdomains)
    keep_topology(named, mesh)
    if check:
        check_mesh(named, f"the mesh {path}")
    return named


def _counts(blocks: Sequence[tuple[str, Ints]]) -> str:
    total: dict[str, int] = {}
    for kind, nodes in blocks:
        total[kind] = total.get(kind, 0) + len(nodes)
    return ", ".join(f"{n} of kind {kind}" for kind, n in total.items() if n)


def _number_globally(file: Content, parts: Sequence[Ints]) -> Ints:
    """Indices of cells of blocks in the sequence of all blocks."""
    starts = np.cumsum([0, *(len(nodes) for _, nodes in file.blocks)])
    flat = [part + start for part, start in zip(parts, starts[:-1], strict=True)]
    return np.concatenate([np.zeros(0, np.int64), *flat])


def _cells(
    path: Path,
    file: Content,
    chosen: Sequence[Bools],
    volumes: Mapping[str, Sequence[Ints]],
) -> tuple[str, Ints, Ints]:
    """Kind and nodes of the chosen cells, and the new index of each cell of all blocks.

    The index is -1 for cells that were not chosen.
    """
    picked = [
        (kind, nodes[chosen_cells])
        for (kind, nodes), chosen_cells in zip(file.blocks, chosen, strict=True)
        if chosen_cells.any()
    ]
    kinds = {kind for kind, _ in picked}
    for kind in sorted(kinds):
        if kind not in OF_VTK:
            raise ValueError(
                f"the mesh {path} has cells of kind {kind}, expected one of "
                + ", ".join(OF_VTK)
            )
    if len(kinds) > 1:
        of = {
            name: sorted(
                {
                    k
                    for (k, _), part in zip(file.blocks, parts, strict=True)
                    if len(part)
                }
            )
            for name, parts in volumes.items()
        }
        alone = [f"{name!r} ({k[0]})" for name, k in sorted(of.items()) if len(k) == 1]
        raise ValueError(
            f"the mesh {path} has cells of several kinds, {_counts(picked)}, expected one "
            "kind for a body"
            + (f": read separate bodies by group= {', '.join(alone)}" if alone else "")
        )
    cells = np.concatenate([nodes for _, nodes in picked])
    numbers = _number_globally(
        file, [np.flatnonzero(chosen_cells) for chosen_cells in chosen]
    )
    _, first, which = np.unique(
        np.sort(cells, axis=1), axis=0, return_index=True, return_inverse=True
    )
    # gmsh 2.2 writes a cell once for each of its groups; elsewhere it is an error.
    if len(first) < len(cells) and path.suffix.lower() != ".msh":
        raise ValueError(
            f"the mesh {path} has {count_noun(len(cells) - len(first), 'cell')} twice: remove "
            "duplicates"
        )
    kept = np.sort(first)
    index = np.full(sum(len(nodes) for _, nodes in file.blocks), -1, dtype=np.int64)
    index[numbers] = np.searchsorted(kept, first[which.ravel()])
    return kinds.pop(), cells[kept], index


def _plane(path: Path, points: Floats, cells: Ints) -> Floats:
    """The x and y of the points; refuses cells that are not in a plane z = const."""
    x = points[np.unique(cells)]
    extent = np.ptp(x, axis=0)
    flat = np.flatnonzero(extent <= 1e-9 * extent.max())
    if 2 not in flat:
        where = f"the plane {'xyz'[flat[0]]} = const" if flat.size else "no plane"
        raise ValueError(
            f"the mesh {path} has 2D cells in {where}, expected a plane z = const, or 3D "
            f"cells{_no_cells(path)}"
        )
    return np.ascontiguousarray(points[:, :2])


def _surfaces(
    file: Content, mesh: ElementMesh, node: Ints, top: int, index: Ints
) -> dict[str, Ints]:
    """Facets by name: those of the boundary, or all if none is on the boundary."""
    border = np.asarray(mesh.boundary_facets(), dtype=np.int64)
    corners = np.asarray(mesh.facets, dtype=np.int64).T
    width = corners.shape[1]

    def of_faces(faces: Ints) -> Ints:
        """Facets among faces given by corners in the file."""
        rows = np.sort(node[faces[:, :width]])
        near = np.zeros(mesh.p.shape[1], dtype=np.bool_)
        near[rows[rows >= 0]] = True
        some = np.flatnonzero(near[corners].all(axis=1))
        sides = map(tuple, np.sort(corners[some]).tolist())
        key = dict(zip(sides, some.tolist(), strict=True))
        numbers = {key[row] for row in map(tuple, rows.tolist()) if row in key}
        return np.array(sorted(numbers), dtype=np.int64)

    facets_of: dict[str, list[Ints]] = {}
    for name, places in file.node_sets.items():
        inside = np.zeros(mesh.p.shape[1], dtype=np.bool_)
        inside[node[places][node[places] >= 0]] = True
        facets_of[name] = [border[inside[facet_nodes(mesh, border)].all(axis=1)]]
    for name, parts in file.sets.items():
        for part, (kind, nodes) in zip(parts, file.blocks, strict=True):
            if len(part) and _FACETS.get(kind) == (top - 1, width):
                facets_of.setdefault(name, []).append(of_faces(nodes[part]))
    # A surface replaces the node set of the same name.
    for name in {*file.faces, *file.free}:
        facets_of[name] = []
    for name, faces in file.faces.items():
        rows = [face for face in faces if len(face) == width]
        if rows:
            facets_of[name].append(of_faces(np.array(rows, dtype=np.int64)))
    cell_of, beyond = np.asarray(mesh.f2t)
    cell_of = cell_of[border]
    for name, parts in file.free.items():
        facets_of[name].append(
            border[np.isin(cell_of, index[_number_globally(file, parts)])]
        )
    whole = {
        name: np.unique(np.concatenate([np.zeros(0, np.int64), *f]))
        for name, f in facets_of.items()
    }
    outer = {name: facets[beyond[facets] < 0] for name, facets in whole.items()}
    return {
        name: (outer[name] if outer[name].size else facets).astype(np.int64)
        for name, facets in whole.items()
        if facets.size
    }
