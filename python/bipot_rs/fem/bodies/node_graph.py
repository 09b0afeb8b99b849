"""Nodes that share a cell: the pattern of the stiffness, without assembling it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy import sparse

from bipot_rs._lib.types import Ints
from bipot_rs.fem.bodies.body import Body


def find_neighbours(bodies: Sequence[Body], first: int, last: int) -> tuple[Ints, Ints]:
    """Nodes that share a cell with each of the nodes ``first`` to ``last - 1``.

    Parameters
    ----------
    bodies
        Their nodes are counted body after body.
    first, last
        Range of nodes.

    Returns
    -------
    indptr, indices
        Compressed rows ``(last - first,)`` of the graph, without the nodes themselves,
        ascending.
    """
    blocks, before = [], 0
    count = sum(len(body.points) for body in bodies)
    for body in bodies:
        size = len(body.points)
        low, high = (min(max(x - before, 0), size) for x in (first, last))
        if low < high:
            cells = body.cells
            near = ((cells >= low) & (cells < high)).any(axis=1)
            corners = cells[near]
            rows = np.repeat(np.arange(len(corners)), corners.shape[1])
            entries = np.ones(corners.size, np.int32), (rows, corners.ravel() + before)
            of_cells = sparse.csr_array(entries, shape=(len(corners), count))
            cells_of_nodes = of_cells[:, before + low : before + high]
            blocks.append(cells_of_nodes.T.tocsr() @ of_cells)
        before += size
    if not blocks:
        return np.zeros(1, np.int64), np.zeros(0, np.int64)
    graph = sparse.vstack(blocks, "coo")
    off = graph.col != graph.row + first
    rest = (np.ones(off.sum(), np.int8), (graph.row[off], graph.col[off]))
    made = sparse.csr_array(rest, shape=graph.shape)
    made.sort_indices()
    return made.indptr.astype(np.int64), made.indices.astype(np.int64)
