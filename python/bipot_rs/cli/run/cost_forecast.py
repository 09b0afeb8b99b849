"""Sizes, memory and time of a scene, before it is solved."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from math import prod
from typing import TYPE_CHECKING

import numpy as np

import bipot_rs._core as _core
from bipot_rs._lib.machine import available, peak_mb, resident
from bipot_rs._lib.messages import count_noun, duration, size
from bipot_rs.contact import tuning
from bipot_rs.contact.path.choice import forecast_bytes, joins_surfaces
from bipot_rs.fem.assembly.assembly import Assembly
from bipot_rs.fem.bodies.body import Body
from bipot_rs.fem.bodies.elasticity import find_neighbours
from bipot_rs.scene.schema.root import Scene

if TYPE_CHECKING:
    from bipot_rs._lib.types import OpenRecord, Record
    from bipot_rs.scene.case import Case

# Nodes of a cell of first and of second order, and number of cells that a cell of the
# grid is divided into.
_NODES = {
    "triangle": (3, 6, 2),
    "quadrilateral": (4, 9, 1),
    "tetrahedron": (4, 10, 6),
    "hexahedron": (8, 27, 1),
}
# Bytes of a number and of an index of K on a rank.
_ENTRY = 12
# Nodes whose neighbours are counted.
_SAMPLE = 1000


class _Counted(Exception):
    """Ends the condensation when its cost is known."""


def counts(case: Case) -> tuple[OpenRecord, list[str]]:
    """The cost of condensing, if it gets that far, and messages on floating bodies.

    The geometry is checked first: the core may find a rigid motion only after its forecast.
    """
    from bipot_rs.contact.errors import FloatingBodyError
    from bipot_rs.fem.checks.free_bodies import describe_free_bodies

    forecast: OpenRecord = {}
    floating = list(describe_free_bodies(case.model, rough=True))

    def stop(counts: Record) -> None:
        forecast.update(counts)
        raise _Counted

    if case.scene is not None and case.scene.solver.engine == "petsc":
        return forecast, floating
    try:
        with suppress(_Counted):
            case = case.with_stiffness()
            case.problem(on_forecast=with_memory(stop, case.model))
    except FloatingBodyError as error:
        floating = floating or [str(error)]
    return forecast, floating


def with_memory(
    tell: Callable[[Record], object], model: Assembly
) -> Callable[[Record], object]:
    """``tell`` of counts with ``bytes_run``, the most that this process holds in a run.

    It begins from what the process holds now, before the core begins: meshes and K are known.
    """
    held = resident() + tuning.LATER_BYTES + tuning.ARRAY_BYTES * model.n

    return lambda counts: tell(
        {
            **counts,
            "bytes_run": max(2**20 * peak_mb(), held + core_bytes(counts, model)),
        }
    )


def seconds(counts: Record) -> float:
    """Rough time of the factor of K and the inverse of S, or of all iterative steps [s]."""
    flops = float(counts["flops"])
    if counts.get("engine") != "iterative":
        # Assumes b equal bodies: (m/b)³ each.
        bodies = max(int(counts["bodies"]), 1)
        flops += float(counts["n_contact_dofs"]) ** 3 / bodies**2
    return flops / (tuning.FLOP_RATE * _core.threads())


def sizes(model: Assembly, steps: int) -> list[str]:
    """Lines with the bodies, the contacts and the sizes of a model."""
    bodies = ", ".join(
        f"{body.name} ({count_noun(len(body.points), 'node')}, "
        f"{count_noun(body.mesh.nelements, 'cell')})"
        for body in model.bodies
    )
    contacts = ", ".join(
        contact.title
        + (f" against {'.'.join(contact.against)}" if contact.against else "")
        + (f" by {contact.pairing}" if contact.pairing != "match" else "")
        + f" ({int((model.group == k).sum())})"
        for k, contact in enumerate(model.contacts)
    )
    dofs = count_noun(model.n, "degree") + " of freedom"
    path = f"{count_noun(len(model.gap), 'contact')}, {count_noun(steps, 'load step')}"
    return [
        f"  bodies    {bodies}",
        f"  contacts  {contacts}",
        f"  sizes     {dofs}, {len(model.fixed)} prescribed, {path}",
    ]


def describe_stalling(counts: Record, model: Assembly) -> list[str]:
    """Sentences on bodies with which the iterative engine will probably stall."""
    if counts.get("engine") != "iterative":
        return []
    least = tuning.STALLING_POISSON
    names = [
        repr(body.name)
        for body in model.bodies
        if min(np.min(getattr(m, "poisson", 0.0)) for m in body.materials) >= least
    ]
    free = model.n - len(model.fixed)
    factor = size(forecast_bytes(free, len(model.gap)))
    sentence = (
        f"body {', '.join(names)}: with Poisson's ratio {least:g} or more the iterative engine "
        "will probably stall; the direct engine then solves from the start if its factor fits, "
        f'about {factor}. Use engine = "direct" at once, or a ratio up to 0.49'
    )
    return [sentence] if names else []


def cost(counts: Record, model: Assembly, steps: int) -> list[str]:
    """Lines with memory and time of a path, from the counts of the analysis."""
    free = available()
    of = "" if free is None else f", {size(free)} are free"
    head = [
        f"  engine    {counts['engine']}: {counts['engine_reason']}",
        f"  memory    about {size(counts['bytes_run'])}{of}",
    ]
    time = duration(seconds(counts))
    if counts["engine"] == "iterative":
        return [*head, f"  time      {time} for all load steps"]
    order = _order(counts, model)
    products = tuning.FIRST_PRODUCTS * order + tuning.PRODUCTS * steps
    if joins_surfaces(model.B, model.dim):
        products = tuning.JOINED_PRODUCTS * steps
    rate = tuning.BYTE_RATE * _core.threads()
    of_steps = duration(products * 8.0 * order**2 / rate)
    return [
        *head,
        f"  time      {time} to factorise the stiffness, {of_steps} for "
        + count_noun(steps, "load step"),
    ]


def of_ranks(model: Assembly, ranks: int) -> str:
    """A line with the number of ranks and the memory of each, for engine petsc."""
    return (
        f"  engine    petsc: {count_noun(ranks, 'rank')}, about {size(rank_bytes(model, ranks))} "
        "of memory on each"
    )


def rank_bytes(model: Assembly, ranks: int) -> float:
    """Forecast of the memory of one rank: its rows of K, and the mesh that all have."""
    nodes = len(model.nodes)
    middle = nodes // 2
    start, _ = find_neighbours(model.bodies, middle, min(middle + _SAMPLE, nodes))
    row = model.dim * (1 + start[-1] / max(len(start) - 1, 1))
    bytes_of_rank = model.n / ranks * row * _ENTRY * tuning.COPIES_ON_RANK
    return float(tuning.PROCESS_BYTES + tuning.NODE_BYTES * nodes + bytes_of_rank)


def peak(case: Case) -> float:
    """Most bytes that solving takes: the assembly, and the forecast of `counts`.

    The interpreter and its libraries are not included.
    """
    forecast, _ = counts(case)
    return _measure_entries(case.model.bodies) + core_bytes(forecast, case.model)


def core_bytes(counts: Record, model: Assembly) -> float:
    """Most bytes that the core takes: of the direct engine, to condense or in a load step."""
    peak = float(counts.get("bytes_peak", 0))
    if counts.get("engine") != "direct":
        return peak
    of_W = 8.0 * _order(counts, model) ** 2
    return max(peak, float(counts["bytes_factor"]) + tuning.COPIES_OF_W * of_W)


def _order(counts: Record, model: Assembly) -> int:
    """Rows of W, without the contacts that a working set leaves out."""
    return min(model.dim * len(model.gap), int(counts["n_contact_dofs"]))


def list_remarks(remarks: Sequence[str]) -> list[str]:
    """A line for each remark."""
    return [f"  remark    {remark}" for remark in remarks]


def fits(
    scene: Scene, meshed: Sequence[Body] | None = None, share: float = 1.0
) -> None:
    """Refuse a scene whose assembly does not fit into the free memory.

    ``scene``: the sizes of its boxes are known before meshing.
    ``meshed``: its bodies, if they are meshed.
    ``share``: the part of the assembly that this machine does.
    """
    needed = share * (assembly(scene) if meshed is None else _measure_entries(meshed))
    free = available()
    if free is None or needed <= free:
        return
    way = "use fewer cells"
    if scene.mesh is not None and scene.mesh.n and not any(scene.files()):
        dim = scene.dim or 2
        n = int(scene.mesh.n * (free / needed) ** (1 / dim))
        way = f"mesh.n up to {max(n, 1)} would fit, if all cells depend on it"
    raise MemoryError(
        f"the stiffness and its solution take {size(needed)}, but only {size(free)} of memory "
        f"are free: {way}"
    )


def assembly(scene: Scene) -> float:
    """Least bytes of a run, by the entries of all element matrices.

    A mesh in a file counts as zero, because its size is not known before it is read.
    """
    n = scene.mesh.n if scene.mesh else None
    total = 0.0
    for block in scene.body.values():
        cell = scene.cell(block)
        if cell is None or block.dim is None:
            continue
        axes = (block.x, block.y, block.z)
        cells = prod(len(axis.grid(n)) - 1 for axis in axes if axis is not None)
        *nodes, pieces = _NODES[cell]
        count = nodes[(scene.order(block) or 1) - 1]
        total += cells * pieces * (count * block.dim) ** 2 * tuning.LEAST_BYTES
    return total


def _measure_entries(meshed: Sequence[Body]) -> float:
    """Bytes of the entries of the stiffness of bodies that are meshed."""
    shapes = [(*body.cells.shape, body.dim) for body in meshed]
    return float(
        sum(m * (nodes * d) ** 2 * tuning.LEAST_BYTES for m, nodes, d in shapes)
    )
