"""What a scene will take, in a block of lines, before its numbers are made."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from math import prod
from pathlib import Path
from typing import Any

from bipot_rs._lib.messages import counted
from bipot_rs.fem.assembly import Assembly
from bipot_rs.fem.body import Body
from bipot_rs.scene.schema.root import Scene

# Nodes of a cell of first and of second order, and how many of its kind a cell of the
# grid is cut into.
_NODES = {
    "triangle": (3, 6, 2),
    "quadrilateral": (4, 9, 1),
    "tetrahedron": (4, 10, 6),
    "hexahedron": (8, 27, 1),
}
# A number and an index of four bytes.
_ENTRY = 12

# Rate of the condensation that seconds are foretold by [flop/s a core]: benches/README.md
# has twice as much on a server core; small bodies and old machines have less.
RATE = 2e10


def available() -> int | None:
    """Bytes that this machine can still give, where it tells (Linux)."""
    try:
        text = Path("/proc/meminfo").read_text(encoding="ascii")
        lines = dict(line.split(":", 1) for line in text.splitlines())
        return 1024 * int(lines["MemAvailable"].split()[0])
    except (OSError, LookupError, ValueError):
        return None


def work(counts: Mapping[str, Any]) -> float:
    """Operations of the condensation [flop]: the factor of K, and the inverse of S."""
    # Of bodies alike: (m/b)³ each.
    inverse = float(counts["n_contact_dofs"]) ** 3 / max(int(counts["bodies"]), 1) ** 2
    return float(counts["flops"]) + inverse


def seconds(counts: Mapping[str, Any], cores: int) -> float:
    """What the condensation may take, rough."""
    return work(counts) / (RATE * max(cores, 1))


def cores() -> int:
    """Threads that the core will use, as it counts them."""
    for name in ("BIPOT_NUM_THREADS", "RAYON_NUM_THREADS"):
        value = os.environ.get(name, "")
        if value.isdigit() and int(value) > 0:
            return int(value)
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else 1


def sizes(model: Assembly, steps: int) -> list[str]:
    """Bodies and contacts of a model, a line each kind."""
    bodies = ", ".join(
        f"{body.name} ({counted(len(body.points), 'node')}, "
        f"{counted(body.mesh.nelements, 'cell')})"
        for body in model.bodies
    )
    contacts = ", ".join(
        f"{contact.body}.{contact.surface}"
        + (f" against {'.'.join(contact.against)}" if contact.against else "")
        + (f" by {contact.pairing}" if contact.pairing != "match" else "")
        + f" ({int((model.group == k).sum())})"
        for k, contact in enumerate(model.contacts)
    )
    dofs = counted(model.n, "degree") + " of freedom"
    path = f"{counted(len(model.gap), 'contact')}, {counted(steps, 'load step')}"
    return [
        f"  bodies    {bodies}",
        f"  contacts  {contacts}",
        f"  sizes     {dofs}, {len(model.fixed)} prescribed, {path}",
    ]


def cost(counts: Mapping[str, Any]) -> list[str]:
    """Memory and time of the condensation, of the counts that the analysis has made."""
    free = available()
    of = "" if free is None else f" of {size(free)} free"
    threads = cores()
    most, factor = size(counts["bytes_peak"]), size(counts["bytes_factor"])
    entries = f"{counts['nnz_factor'] / 1e6:.3g} million entries"
    rate = f"{RATE / 1e9:g} a second on {'' if threads == 1 else 'each of '}"
    time = duration(seconds(counts, threads))
    rate += f"{counted(threads, 'core')}, rough; load steps come on top"
    return [
        f"  memory    {most} at the most{of}; the factor {factor}, {entries}",
        f"  time      {time} to condense: {work(counts) / 1e9:.3g} Gflop at {rate}",
    ]


def remarked(remarks: Sequence[str]) -> list[str]:
    """What a person should look at, a line each."""
    return [f"  remark    {remark}" for remark in remarks]


def size(count: float) -> str:
    """Bytes as a person says them."""
    units = ("bytes", "kB", "MB", "GB", "TB")
    step = 0
    while count >= 1000 and step < len(units) - 1:
        count, step = count / 1000, step + 1
    return f"{count:.0f} bytes" if step == 0 else f"{count:.3g} {units[step]}"


def duration(time: float) -> str:
    """Seconds as a person says them; a forecast has no more than one digit."""
    if time < 1:
        return "less than 1 s"
    if time < 90:
        return f"about {time:.0f} s"
    if time < 5400:
        return f"about {time / 60:.0f} min"
    return f"about {time / 3600:.0f} h"


def fits(scene: Scene, meshed: Sequence[Body] | None = None) -> None:
    """Refuse a scene whose assembly alone does not fit, before it is begun.

    Parameters
    ----------
    scene
        Of its boxes the sizes are known before they are meshed.
    meshed
        Its bodies, once files were read.

    Raises
    ------
    MemoryError
        With the figure, and what would fit.
    """
    needed = _assembly(scene) if meshed is None else _entries(meshed)
    free = available()
    if free is None or needed <= free:
        return
    way = "fewer cells take less"
    if scene.mesh is not None and scene.mesh.n and not any(scene.files()):
        dim = scene.dim or 2
        n = int(scene.mesh.n * (free / needed) ** (1 / dim))
        way = f"mesh.n up to {max(n, 1)} would fit, if all cells depend on it"
    raise MemoryError(
        f"the stiffness of so many cells takes {size(needed)} to assemble, more than "
        f"the {size(free)} this machine has free: {way}"
    )


def _assembly(scene: Scene) -> float:
    """Bytes that assembly takes at the least: entries of all element matrices."""
    n = scene.mesh.n if scene.mesh else None
    total = 0.0
    for block in scene.body.values():
        cell = scene.cell(block)
        if cell is None or block.dim is None:
            # Of a file: nobody knows before it is read.
            continue
        axes = (block.x, block.y, block.z)
        cells = prod(len(axis.grid(n)) - 1 for axis in axes if axis is not None)
        *nodes, pieces = _NODES[cell]
        count = nodes[(scene.order(block) or 1) - 1]
        total += cells * pieces * (count * block.dim) ** 2 * _ENTRY
    return total


def _entries(meshed: Sequence[Body]) -> float:
    """The same of meshes that are there."""
    shapes = [(*body.cells.shape, body.dim) for body in meshed]
    return float(sum(m * (nodes * d) ** 2 * _ENTRY for m, nodes, d in shapes))
