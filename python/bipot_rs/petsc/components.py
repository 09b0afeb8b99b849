"""The body of each node of a distributed K: nodes that it couples, directly or not."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

import bipot_rs._core as _core
from bipot_rs._lib.types import Bools, Communicator, Floats, Ints
from bipot_rs.petsc.own_rows import OwnRows

# Rows of K that are looked at together: copies of more entries would take as much memory as K.
_ROWS = 1 << 13


def find_bodies(
    comm: Communicator,
    rows: OwnRows,
    local: Ints,
    free: Bools,
    d: int,
    bring: Callable[[Floats], Floats],
) -> tuple[Ints, int]:
    """Body of each own node, and the number of bodies.

    Parameters
    ----------
    rows, local
        Own rows, and their columns in local numbers (`OwnRows.local`).
    free
        Whether each own degree of freedom, and then each outside, is not prescribed.
        Prescribed ones couple nothing.
    bring
        Brings values of own degrees of freedom and those outside to this rank.
    """
    own_nodes = rows.count // d
    # Local numbers of nodes, own ones first. Outside, each degree of freedom counts.
    node = np.concatenate(
        [
            np.arange(rows.count) // d,
            np.arange(own_nodes, len(free) - rows.count + own_nodes),
        ]
    )
    count = own_nodes + len(free) - rows.count
    pieces = np.arange(count)
    for first in range(0, rows.count, _ROWS):
        last = min(first + _ROWS, rows.count)
        entries = slice(rows.pointer[first], rows.pointer[last])
        i = np.repeat(np.arange(first, last), np.diff(rows.pointer[first : last + 1]))
        j = local[entries]
        couples = (rows.values[entries] != 0) & free[i] & free[j]
        a, b = pieces[node[i[couples]]], pieces[node[j[couples]]]
        apart = a != b
        pieces = _join(pieces, a[apart], b[apart], count)
    # Pieces of all ranks get different numbers, and those that meet are joined.
    starts = np.cumsum([0, *comm.allgather(count)])
    mine = pieces + starts[comm.rank]
    theirs = bring(np.repeat(mine[:own_nodes], d).astype(float))[rows.count :].astype(
        np.int64
    )
    meeting = free[rows.count :]
    pairs = np.column_stack([mine[own_nodes:][meeting], theirs[meeting]])
    pairs = np.unique(pairs, axis=0)
    mine_meet, theirs_meet = np.concatenate(comm.allgather(pairs)).T.copy()
    joined = _join(np.arange(starts[-1]), mine_meet, theirs_meet, starts[-1])
    body_of_row = joined[mine[:own_nodes]]
    # Bodies are numbered in the order of their first nodes.
    used = np.concatenate(comm.allgather(_list_in_order(body_of_row)))
    _, at = np.unique(used, return_index=True)
    order = used[np.sort(at)]
    number = np.full(starts[-1] + 1, -1)
    number[order] = np.arange(len(order))
    return number[body_of_row], len(order)


def _list_in_order(values: Ints) -> Ints:
    _, at = np.unique(values, return_index=True)
    return values[np.sort(at)]


def _join(pieces: Ints, a: Ints, b: Ints, count: int) -> Ints:
    """Pieces after those of ``a`` are joined with those of ``b``."""
    return _core.connected(count, a, b)[pieces] if len(a) else pieces
