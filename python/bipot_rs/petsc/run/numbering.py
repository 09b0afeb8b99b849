"""The nodes of a model shared among ranks, and the rows of K that each rank assembles."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from types import ModuleType

import numpy as np
from scipy import sparse

from bipot_rs._lib.types import Communicator, CsrMatrix, Floats, Ints, PetscMat
from bipot_rs.fem.assembly.assembly import Assembly
from bipot_rs.fem.bodies.elasticity import dofs_of, find_neighbours
from bipot_rs.petsc import tuning
from bipot_rs.petsc.library import Library
from bipot_rs.petsc.run.ranks import World


@dataclass(frozen=True)
class Numbering:
    """The nodes in the order of K: rank after rank, ascending within a rank."""

    owner: Ints  # (nodes,): rank of each node
    partitioner: str  # what has shared the nodes
    place: Ints  # (n,): row of K of each degree of freedom of the model
    nodes: Ints  # (m,): nodes of this rank
    rows: Ints  # (dim m,): degrees of freedom of the model of the rows of this rank
    counts: Ints  # (ranks,): number of rows of each rank

    @classmethod
    def of_owners(
        cls, owner: Ints, partitioner: str, ranks: World, dim: int
    ) -> Numbering:
        """Number the nodes of each rank."""
        place = np.empty(dim * len(owner), np.int64)
        place[dofs_of(np.argsort(owner, kind="stable"), dim)] = np.arange(len(place))
        nodes = np.flatnonzero(owner == ranks.number)
        counts = dim * np.bincount(owner, minlength=ranks.count)
        return cls(owner, partitioner, place, nodes, dofs_of(nodes, dim), counts)

    def list_own_cells(self, model: Assembly) -> Sequence[Ints]:
        """Cells of each body whose first node this rank owns: those that it writes."""
        is_own = np.zeros(len(self.owner), bool)
        is_own[self.nodes] = True
        first = np.cumsum([0] + [len(body.points) for body in model.bodies])
        return [
            np.flatnonzero(is_own[start + body.cells[:, 0]])
            for start, body in zip(first[:-1], model.bodies, strict=True)
        ]


def share_nodes(library: Library, ranks: World, model: Assembly) -> Numbering:
    """Share the nodes of a model: by its graph, or by coordinates without a partitioner.

    Each rank gets about as many nodes, wherever they are. Contacts need no special place,
    because their data are on all ranks.
    """
    nodes, count = len(model.nodes), ranks.count
    references = model.n // model.dim - nodes
    by_graph = None
    if count > 1:
        with ranks.together():
            first, last = (nodes * k // count for k in (ranks.number, ranks.number + 1))
            rows = find_neighbours(model.bodies, first, last)
        by_graph = divide_graph(library, ranks.comm, rows, nodes)
        sizes = np.bincount(by_graph[0], minlength=count) if by_graph else np.zeros(1)
        if not sizes.all() or np.ptp(sizes) > tuning.UNEQUAL_PARTS * sizes.mean():
            by_graph = None
    if by_graph is None:
        by_graph = divide_by_coordinates(model.nodes, count), "coordinates"
    owner, partitioner = by_graph
    # The last rank has the reference nodes.
    owner = np.append(owner, np.full(references, count - 1))
    return Numbering.of_owners(owner, partitioner, ranks, model.dim)


def assemble_stiffness(
    library: Library, ranks: World, model: Assembly, numbering: Numbering
) -> PetscMat:
    """K as a matrix of PETSc, assembled in parts."""
    PETSc = library.PETSc
    with ranks.together():
        rows = model.stiffness_rows(numbering.nodes)
        pointer = rows.indptr.astype(PETSc.IntType, copy=False)
        columns = numbering.place.astype(PETSc.IntType)[rows.indices]
        own_rows: CsrMatrix = sparse.csr_array(
            (rows.data, columns, pointer), shape=rows.shape
        )
        own_rows.sort_indices()
        del rows, columns
    K: PetscMat = PETSc.Mat().createAIJ(
        (own_rows.shape, own_rows.shape),
        bsize=model.dim,
        csr=(own_rows.indptr, own_rows.indices, own_rows.data),
        comm=ranks.comm,
    )
    K.setOption(PETSc.Mat.Option.SYMMETRIC, True)
    return K


# Partitioners in the order of preference. A PETSc has those it was built with.
KINDS = ("ptscotch", "parmetis")


def divide_graph(
    library: Library, comm: Communicator, rows: tuple[Ints, Ints], nodes: int
) -> tuple[Ints, str] | None:
    """Part of each node, as many parts as ranks, so that few edges join two parts.

    ``library, comm``: PETSc, and a communicator of mpi4py.
    ``rows``: compressed rows of the graph, ``indptr`` and ascending ``indices``, of the nodes
    of this rank: those of ranks follow each other.
    ``nodes``: number of all nodes.
    Returns ``owner, kind``: part of each node, ``(nodes,)``, the same on all ranks, and the
    name of the partitioner; None if PETSc has none.
    """
    PETSc = library.PETSc
    indptr, indices = (part.astype(PETSc.IntType, copy=False) for part in rows)
    sizes = len(indptr) - 1, nodes
    values = np.ones(len(indices))
    graph = PETSc.Mat().createAIJ(
        (sizes, sizes), csr=(indptr, indices, values), comm=comm
    )
    try:
        for kind in KINDS:
            parts = _apply_partitioner(PETSc, graph, kind, comm)
            if parts is not None:
                return np.concatenate(comm.allgather(parts)), kind
    finally:
        graph.destroy()
    return None


def _apply_partitioner(
    PETSc: ModuleType, graph: PetscMat, kind: str, comm: Communicator
) -> Ints | None:
    """Part of each own node by one partitioner; None if PETSc does not have it."""
    partitioning = PETSc.MatPartitioning().create(comm)
    # A missing type is an error of PETSc, which would print a traceback of its own.
    PETSc.Sys.pushErrorHandler("ignore")
    try:
        partitioning.setAdjacency(graph)
        partitioning.setType(kind)
        numbers = PETSc.IS()
        partitioning.apply(numbers)
        return np.asarray(numbers.getIndices(), np.int64)
    except PETSc.Error:
        return None
    finally:
        PETSc.Sys.popErrorHandler()
        partitioning.destroy()


def divide_by_coordinates(points: Floats, parts: int) -> Ints:
    """Part of each node by recursive bisection, ``(nodes,)`` from 0 to ``parts - 1``.

    Each cut is normal to the axis in which the nodes extend furthest. The numbers of nodes
    of two parts differ by one at most, or by the number of cuts that led to them.

    ``points``: positions of the nodes, ``(nodes, d)``.
    ``parts``: number of parts.
    """
    numbers = np.zeros(len(points), np.int64)
    waiting = [(np.arange(len(points)), 0, parts)]
    while waiting:
        nodes, first, count = waiting.pop()
        if count == 1 or not nodes.size:
            numbers[nodes] = first
            continue
        places = points[nodes]
        axes = np.argsort(-np.ptp(places, axis=0), kind="stable")
        # Nodes in one plane are divided along the next axes.
        order = nodes[np.lexsort(places[:, axes[::-1]].T)]
        half = count // 2
        cut = round(len(nodes) * half / count)
        # Ascending, so that equal places are divided in the same way on each process.
        waiting.append((np.sort(order[:cut]), first, half))
        waiting.append((np.sort(order[cut:]), first + half, count - half))
    return numbers
