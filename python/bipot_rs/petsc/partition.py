"""The partitioners of PETSc (PT-Scotch, ParMETIS) on a distributed graph."""

from __future__ import annotations

from types import ModuleType

import numpy as np

from bipot_rs._lib.types import Communicator, Ints, PetscMat
from bipot_rs.petsc.library import Library

# Partitioners in the order of preference. A PETSc has those it was built with.
KINDS = ("ptscotch", "parmetis")


def by_graph(
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
            own = _applied(PETSc, graph, kind, comm)
            if own is not None:
                return np.concatenate(comm.allgather(own)), kind
    finally:
        graph.destroy()
    return None


def _applied(
    PETSc: ModuleType, graph: PetscMat, kind: str, comm: Communicator
) -> Ints | None:
    """Part of each own node by one partitioner; None if PETSc does not have it."""
    partitioning = PETSc.MatPartitioning().create(comm)
    # A missing type is an error of PETSc, which would print a traceback of its own.
    PETSc.Sys.pushErrorHandler("ignore")
    try:
        partitioning.setAdjacency(graph)
        partitioning.setType(kind)
        found = PETSc.IS()
        partitioning.apply(found)
        return np.asarray(found.getIndices(), np.int64)
    except PETSc.Error:
        return None
    finally:
        PETSc.Sys.popErrorHandler()
        partitioning.destroy()
