"""The nodes of a model shared among ranks, and the rows of K that each rank assembles."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import sparse

from bipot_rs._lib.types import CsrMatrix, Ints, PetscMat
from bipot_rs.fem.assembly.assembly import Assembly
from bipot_rs.fem.bodies.elasticity import find_neighbours
from bipot_rs.petsc import tuning
from bipot_rs.petsc.library import Library
from bipot_rs.petsc.run.partition import divide_by_coordinates, divide_graph
from bipot_rs.petsc.run.ranks import World


@dataclass(frozen=True)
class Numbering:
    """The nodes in the order of K: rank after rank, ascending within a rank.

    Attributes
    ----------
    owner : (nodes,)
        Rank of each node.
    partitioner
        What has shared the nodes.
    place : (n,)
        Row of K of each degree of freedom of the model.
    nodes : (m,)
        Nodes of this rank.
    rows : (dim m,)
        Degrees of freedom of the model of the rows of this rank.
    counts : (ranks,)
        Number of rows of each rank.
    """

    owner: Ints
    partitioner: str
    place: Ints
    nodes: Ints
    rows: Ints
    counts: Ints

    @classmethod
    def of_owners(
        cls, owner: Ints, partitioner: str, ranks: World, dim: int
    ) -> Numbering:
        """Number the nodes of each rank."""
        place = np.empty(dim * len(owner), np.int64)
        place[_list_dofs(np.argsort(owner, kind="stable"), dim)] = np.arange(len(place))
        nodes = np.flatnonzero(owner == ranks.number)
        counts = dim * np.bincount(owner, minlength=ranks.count)
        return cls(owner, partitioner, place, nodes, _list_dofs(nodes, dim), counts)

    def list_own_cells(self, model: Assembly) -> Sequence[Ints]:
        """Cells of each body whose first node this rank owns: those that it writes."""
        is_own = np.zeros(len(self.owner), bool)
        is_own[self.nodes] = True
        first = np.cumsum([0] + [len(body.points) for body in model.bodies])
        return [
            np.flatnonzero(is_own[start + body.cells[:, 0]])
            for start, body in zip(first[:-1], model.bodies, strict=True)
        ]


def _list_dofs(nodes: Ints, dim: int) -> Ints:
    return (dim * nodes[:, None] + np.arange(dim)).ravel()


def share_nodes(library: Library, ranks: World, model: Assembly) -> Numbering:
    """Share the nodes of a model: by its graph, or by coordinates without a partitioner.

    Each rank gets about as many nodes, wherever they are. Contacts need no special place,
    because their data are on all ranks.
    """
    nodes, count = len(model.nodes), ranks.count
    by_graph = None
    if count > 1:
        with ranks.together():
            first, last = (nodes * k // count for k in (ranks.number, ranks.number + 1))
            rows = find_neighbours(model.bodies, first, last)
        by_graph = divide_graph(library, ranks.comm, rows, nodes)
    if by_graph is None or _is_unequal(by_graph[0], count):
        by_graph = divide_by_coordinates(model.nodes, count), "coordinates"
    return Numbering.of_owners(*by_graph, ranks, model.dim)


def _is_unequal(owner: Ints, count: int) -> bool:
    sizes = np.bincount(owner, minlength=count)
    return bool(np.ptp(sizes) > tuning.UNEQUAL_PARTS * sizes.mean() or not sizes.all())


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
