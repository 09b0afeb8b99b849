"""Nodes of a model shared among processes: their graph, and halves by coordinates."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy import sparse

from bipot_rs._lib.types import Floats, Ints
from bipot_rs.fem.bodies.body import Body


def by_coordinates(points: Floats, parts: int) -> Ints:
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
    found = np.zeros(len(points), np.int64)
    waiting = [(np.arange(len(points)), 0, parts)]
    while waiting:
        nodes, first, count = waiting.pop()
        if count == 1 or not nodes.size:
            found[nodes] = first
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
    return found


def neighbours(bodies: Sequence[Body], first: int, last: int) -> tuple[Ints, Ints]:
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
            own = of_cells[:, before + low : before + high]
            blocks.append(own.T.tocsr() @ of_cells)
        before += size
    if not blocks:
        return np.zeros(1, np.int64), np.zeros(0, np.int64)
    graph = sparse.vstack(blocks, "coo")
    off = graph.col != graph.row + first
    rest = (np.ones(off.sum(), np.int8), (graph.row[off], graph.col[off]))
    made = sparse.csr_array(rest, shape=graph.shape)
    made.sort_indices()
    return made.indptr.astype(np.int64), made.indices.astype(np.int64)
