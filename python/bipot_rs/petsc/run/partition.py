"""Nodes shared among ranks: by a partitioner of PETSc, or in halves by coordinates."""

from __future__ import annotations

from types import ModuleType

import numpy as np

from bipot_rs._lib.types import Communicator, Floats, Ints, PetscMat
from bipot_rs.petsc.library import Library

# Partitioners in the order of preference. A PETSc has those it was built with.
KINDS = ("ptscotch", "parmetis")


def divide_graph(
    library: Library, comm: Communicator, rows: tuple[Ints, Ints], nodes: int
) -> tuple[Ints, str] | None:
    """Part of each node, as many parts as ranks, so that few edges join two parts.

    Parameters
    ----------
    library, comm
        PETSc, and a communicator of mpi4py.
    rows
        Compressed rows of the graph, ``indptr`` and ascending ``indices``, of the nodes of
        this rank: those of ranks follow each other.
    nodes
        Number of all nodes.

    Returns
    -------
    owner, kind
        Part of each node, ``(nodes,)``, the same on all ranks, and the name of the
        partitioner; None if PETSc has none.
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

    Parameters
    ----------
    points
        Positions of the nodes, ``(nodes, d)``.
    parts
        Number of parts.
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
