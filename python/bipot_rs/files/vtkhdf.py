"""The group ``/VTKHDF`` of a result file, which ParaView and VTK open.

It is an unstructured grid with all load steps. Virtual datasets show what the file holds
already in the shapes of VTK, without a copy: nodes, cells and displacements of a mesh, or
the contacts as points. New and compressed are the fields of the contacts at their nodes,
since most nodes have no contact, and those of the cells, in single precision.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable, Iterable, Mapping
from types import ModuleType
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from bipot_rs._lib.types import AnyArray
from bipot_rs.files.fields import OF_STEPS, choose_times

if TYPE_CHECKING:
    from h5py import Dataset, Group

    from bipot_rs.files.result_mesh import ResultMesh

    # Where an array goes, the dataset that holds it, and its entries there.
    Part: TypeAlias = tuple[object, Dataset, object]

# Numbers of the types of cells in VTK, by their names there.
_TYPES = (
    {"vertex": 1, "line": 3, "triangle": 5, "quad": 9, "tetra": 10, "hexahedron": 12}
    | {"line3": 21, "triangle6": 22, "quad8": 23, "tetra10": 24, "hexahedron20": 25}
    | {"quad9": 28, "hexahedron27": 29}
)
# Nodes whose fields are written at once.
_BATCH = 2**18
# Numbers of a field from which on each component is packed apart, and runs of bytes only.
_MANY = 2**14
# Fields of the contacts that their nodes get, and the value at nodes without contact.
_AT_NODES = {"pressure": 0, "traction": 0, "slip": 0, "wear_depth": 0, "status": -1}


def write_group(
    h5py: ModuleType,
    file: Group,
    mesh: ResultMesh | None,
    of_cells: Iterable[Mapping[str, AnyArray]],
    label: Callable[[Dataset], None],
) -> None:
    """Add the group to a file with ``contacts``, ``steps``, ``fields`` and ``mesh``.

    ``of_cells`` are the fields of the cells of each step, ``(cells,)`` or ``(cells, k)``;
    ``label`` describes a dataset. Without a mesh and places of contacts there is no group.
    """
    places = file["contacts"].get("x") if mesh is None else file["mesh/nodes"]
    steps = [file["steps"][name] for name in sorted(file["steps"], key=int)]
    if places is None or not places.size:
        return
    (points, d), count, whole = places.shape, len(steps), slice(None)
    group = file.create_group("VTKHDF")
    group.attrs["Version"], group.attrs["Type"] = (2, 3), np.bytes_("UnstructuredGrid")
    of_points, in_cells = map(group.create_group, ("PointData", "CellData"))

    def show(where: Group, name: str, shape: tuple[int, ...], *parts: Part) -> None:
        layout = h5py.VirtualLayout(shape, parts[0][1].dtype)
        for target, data, entries in parts:
            # The file has another name later.
            held = h5py.VirtualSource(".", data.name, data.shape, data.dtype)
            layout[target] = held[entries]
        label(where.create_virtual_dataset(name, layout, fillvalue=0))

    show(group, "Points", (points, 3), (np.s_[:, :d], places, whole))
    blocks = [
        (cells.kind, file[f"mesh/cells/{k}"])
        for k, cells in enumerate(mesh.cells if mesh is not None else ())
        if cells.corners.size
    ]
    if blocks:
        ends = np.cumsum([data.size for _, data in blocks])
        parts: list[Part] = [
            (slice(end - data.size, end), data, whole)
            for end, (_, data) in zip(ends, blocks, strict=True)
        ]
        show(group, "Connectivity", (ends[-1],), *parts)
        each = [np.full(data.shape[0], data.shape[1]) for _, data in blocks]
        kinds = np.repeat([_TYPES[kind] for kind, _ in blocks], [*map(len, each)])
        offsets = np.cumsum(np.concatenate([[0], *each]))
    else:
        group["Connectivity"] = np.arange(points, dtype=np.int32)
        kinds, offsets = np.full(points, _TYPES["vertex"]), np.arange(points + 1)
    group["Offsets"] = offsets.astype(group["Connectivity"].dtype)
    group["Types"] = kinds.astype(np.uint8)
    group["NumberOfPoints"], group["NumberOfCells"] = [points], [len(kinds)]
    group["NumberOfConnectivityIds"] = [offsets[-1]]

    held: dict[str, Dataset] = {}

    def keep(where: Group, name: str, row: int, array: AnyArray) -> None:
        rows = points if where is of_points else len(kinds)
        if name not in held:
            # Seven digits of a stress are enough, but not of one beyond their range.
            short = where is in_cells and abs(array).max() < 1e30
            held[name] = where.create_dataset(
                name,
                (count * rows, *array.shape[1:]),
                np.float32 if short else array.dtype,
                chunks=(rows, *(1 if rows > _MANY else w for w in array.shape[1:])),
                compression="gzip",
                shuffle=True,
            )
            label(held[name])
        data = held[name]
        columns = array.astype(data.dtype).reshape(len(array), -1)
        width = data.chunks[-1] if array.ndim == 2 else 1
        for first in range(0, len(array), rows):
            for k in range(0, columns.shape[1], width):
                packed = _pack(columns[first : first + rows, k : k + width])
                data.id.write_direct_chunk((row + first, k)[: array.ndim], packed)

    fields = file["fields"]
    if mesh is None:
        for name, data in fields.items():
            if data.shape[:2] == (count, points):
                width = data.shape[2:]
                shape = (count * points, *(3 if w == 2 else w for w in width))
                target = np.s_[:, : width[0]] if width else whole
                show(of_points, name, shape, (target, data, whole))
    elif all("displacement" in step for step in steps):
        every = [step["displacement"] for step in steps]
        if np.array_equal(mesh.dofs.ravel(), np.arange(points * d)):
            parts = [
                (np.s_[k * points : (k + 1) * points, :d], u, slice(points * d))
                for k, u in enumerate(every)
            ]
            show(of_points, "displacement", (count * points, 3), *parts)
        else:
            for k, u in enumerate(every):
                in_space = np.pad(mesh.of_nodes(u[()]), ((0, 0), (0, 3 - d)))
                keep(of_points, "displacement", k * points, in_space)
    if mesh is not None and mesh.contact_nodes is not None:
        some = _BATCH // points + 1
        for name in (name for name in _AT_NODES if name in fields):
            for k in range(0, count, some):
                arrays = fields[name][k : k + some]
                shape = (len(arrays), points, 3)[: arrays.ndim]
                at_nodes = np.full(shape, _AT_NODES[name], arrays.dtype)
                entries = (whole, mesh.contact_nodes, slice(d))[: arrays.ndim]
                at_nodes[entries] = arrays
                keep(of_points, name, k * points, at_nodes.reshape(-1, *shape[2:]))
    # Not the reverse: of_cells ends after the last step, and closes its files then.
    for of_step, k in zip(of_cells, range(count), strict=False):
        for name, array in of_step.items():
            keep(in_cells, name, k * len(kinds), array)

    numbers = np.arange(count)
    group["FieldData/load"] = fields["load"]
    in_time = group.create_group("Steps")
    in_time.attrs["NSteps"] = count
    in_time["Values"] = choose_times(*(fields[name][()].tolist() for name in OF_STEPS))
    in_time["NumberOfParts"] = np.ones_like(numbers)
    for name in ("Part", "Point", "Cell", "ConnectivityId"):
        shape = (count,) if name.startswith("P") else (count, 1)
        in_time[f"{name}Offsets"] = np.zeros(shape, np.int64)
    in_time["FieldDataOffsets/load"] = numbers
    in_time["FieldDataSizes/load"] = np.ones((count, 2), np.int64)
    for where, size in ((of_points, points), (in_cells, len(kinds))):
        offsets_of = in_time.create_group(where.name.rpartition("/")[2] + "Offsets")
        for name in where:
            offsets_of[name] = size * numbers


def _pack(numbers: AnyArray) -> bytes:
    """What the filters of the dataset make of numbers: their bytes by digit, deflated."""
    digits = np.ascontiguousarray(numbers).view(np.uint8).reshape(-1, numbers.itemsize)
    # The search for repeated strings takes half of the time, for a twentieth of the size.
    strategy = zlib.Z_RLE if len(numbers) > _MANY else zlib.Z_DEFAULT_STRATEGY
    packer = zlib.compressobj(1, strategy=strategy)
    return packer.compress(digits.T.tobytes()) + packer.flush()
