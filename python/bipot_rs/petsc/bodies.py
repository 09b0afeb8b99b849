"""The bodies of a distributed K, their rigid motions, and whether all of these are held.

`src/primal/supports.rs` does the same where one process has all of ``K``. Here each rank
finds what holds a body in its own rows, and the core decides with those of all ranks. A
motion that nothing resists would be decided by rounding; such problems are refused.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from types import ModuleType
from typing import TypeVar

import numpy as np
from scipy.sparse import block_diag

import bipot_rs._core as _core
from bipot_rs._lib import matrices
from bipot_rs._lib.types import AnyArray, Bools, Communicator, CsrMatrix, Floats, Ints
from bipot_rs.contact.errors import NotIterativeError
from bipot_rs.petsc.own_rows import OwnRows

Array = TypeVar("Array", bound=AnyArray)


@dataclass(frozen=True)
class Bodies:
    """Bodies and their rigid motions."""

    # of_node, count: body of each own node, and the number of all bodies.
    of_node: Ints
    count: int
    motions: Floats  # rigid motions at the own degrees of freedom, `(rows, m)`
    fixed: Bools  # own rows that are prescribed


# Numbers of bodies, and a row for each that holds it, in the amounts of its motions.
HoldingRows = tuple[Ints, Floats]


def find_supported(comm: Communicator, count: int, prescribed: HoldingRows) -> Bools:
    """Whether a prescribed degree of freedom is coupled with each of ``count`` bodies."""
    return _reduce_all(comm, np.bincount(prescribed[0], minlength=count)) > 0


def check_holding(
    comm: Communicator,
    rows: OwnRows,
    local: Ints,
    bodies: Bodies,
    bring: Callable[[Floats], Floats],
    d: int,
    prescribed: HoldingRows,
    contact: tuple[CsrMatrix, Floats, Ints],
) -> bool:
    """Raise `NotIterativeError` on all ranks if something can move freely.

    Whether contact alone holds a body.

    ``prescribed``: from `hold_by_prescribed`.
    ``contact``: ``B`` at the places of the interface, with zeros at prescribed ones; the
    motions there; and the body of each place.
    """
    m = bodies.motions.shape[1]
    body = np.repeat(bodies.of_node, d)
    holding = np.zeros((bodies.count, m, m))
    nodes = _reduce_all(comm, np.bincount(bodies.of_node, minlength=bodies.count))
    # A body of one node cannot turn.
    holding[nodes == 1] = np.diag(np.arange(m) >= d)
    _hold(comm, holding, prescribed)
    moving = np.bincount(body[~bodies.fixed], minlength=bodies.count)
    loose = (_reduce_all(comm, moving) > 0) & ~_find_held(holding)
    if loose.any():
        everywhere = np.column_stack([bring(column) for column in bodies.motions.T])
        wanted = np.flatnonzero(loose[body] & ~bodies.fixed)
        own_rows = rows.pointer, local, rows.values
        number, forces, weak = _core.resisting_rows(own_rows, everywhere, wanted)
        if any(comm.allgather(weak)):
            raise NotIterativeError(
                "supports do not hold a body, and K has too few digits, or springs that are "
                "too weak, to show how it can move"
            )
        _hold(comm, holding, (body[number], forces))
        loose &= ~_find_held(holding)
    members = np.flatnonzero(loose)
    if not len(members):
        return False
    if len(members) > _core.most_loose_bodies:
        raise NotIterativeError("contact alone holds too many bodies")
    B, motions, body_of_place = contact
    size = np.sqrt(np.asarray(B.multiply(B).sum(axis=1)).ravel())
    parts = [B @ np.where((body_of_place == b)[:, None], motions, 0.0) for b in members]
    rows_of_contacts = np.hstack(parts)[size > 0] / size[size > 0, None]
    by_others = block_diag(holding[members]).toarray()
    if len(_core.free_motions(np.concatenate([by_others, rows_of_contacts]))):
        raise NotIterativeError("supports and contacts may leave a body free to move")
    return True


def _hold(comm: Communicator, holding: Floats, rows: HoldingRows) -> None:
    """Add rows of all ranks, each with its body, to triangles ``(bodies, m, m)``.

    The triangle of a QR factorisation tells what the rows tell.
    """
    body, values = rows
    order = np.argsort(body, kind="stable")
    parts = np.split(order, np.flatnonzero(np.diff(body[order])) + 1)
    ours = {int(body[part[0]]): _reduce(values[part]) for part in parts if len(part)}
    for triangles in comm.allgather(ours):
        for b, triangle in triangles.items():
            holding[b] = _reduce(np.concatenate([holding[b], triangle]))


def _reduce(rows: Floats) -> Floats:
    m = rows.shape[1]
    whole = np.concatenate([rows, np.zeros((m, m))])
    return np.asarray(np.linalg.qr(whole, mode="r"), np.float64)


def _find_held(holding: Floats) -> Bools:
    """Whether no motion of each body is free."""
    return np.array([not len(_core.free_motions(rows)) for rows in holding], bool)


def hold_by_prescribed(
    rows: OwnRows,
    local: Ints,
    bodies: Bodies,
    bring: Callable[[Floats], Floats],
    d: int,
) -> HoldingRows:
    """The bodies that prescribed own rows are coupled with, and the motions there."""
    of_dof = np.where(bodies.fixed, -1, np.repeat(bodies.of_node, d))
    everywhere = bring(of_dof.astype(float)).astype(np.int64)
    fixed = np.flatnonzero(bodies.fixed)
    counts = np.diff(rows.pointer)[fixed]
    first = np.repeat(rows.pointer[fixed] - np.cumsum(counts) + counts, counts)
    row, entry = np.repeat(fixed, counts), first + np.arange(counts.sum())
    body = everywhere[local[entry]]
    meets = (rows.values[entry] != 0) & (body >= 0)
    pairs = np.unique(np.column_stack([body[meets], row[meets]]), axis=0)
    return pairs[:, 0].copy(), bodies.motions[pairs[:, 1]]


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

    ``rows, local``: own rows, and their columns in local numbers (`OwnRows.local`).
    ``free``: whether each own degree of freedom, and then each outside, is not prescribed.
    Prescribed ones couple nothing.
    ``bring``: brings values of own degrees of freedom and those outside to this rank.
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
    order = _list_in_order(np.concatenate(comm.allgather(_list_in_order(body_of_row))))
    number = np.full(starts[-1] + 1, -1)
    number[order] = np.arange(len(order))
    return number[body_of_row], len(order)


def _list_in_order(values: Ints) -> Ints:
    _, at = np.unique(values, return_index=True)
    return values[np.sort(at)]


def _join(pieces: Ints, a: Ints, b: Ints, count: int) -> Ints:
    """Pieces after those of ``a`` are joined with those of ``b``."""
    return _core.connected(count, a, b)[pieces] if len(a) else pieces


def rigid_motions(
    comm: Communicator, MPI: ModuleType, coordinates: Floats | None, rows: int, d: int
) -> Floats:
    """Translations, then rotations, ``(rows, m)``; translations alone without coordinates.

    The centre is that of the box around all nodes, and the reach its largest side.

    ``coordinates``: of the own degrees of freedom, ``(rows, d)``.
    """
    if coordinates is None:
        return np.tile(np.eye(d), (rows // d, 1))
    low, high = np.full(d, np.inf), np.full(d, -np.inf)
    if rows:
        low, high = coordinates.min(axis=0), coordinates.max(axis=0)
    low, high = _reduce_all(comm, low, op=MPI.MIN), _reduce_all(comm, high, op=MPI.MAX)
    arm = coordinates[::d] - (0.5 * low + 0.5 * high)
    reach = float((high - low).max()) or 1.0
    motions = matrices.rigid_motions(arm, reach)
    # A rank without nodes has no rows, of which -1 would tell no number of motions.
    return motions.reshape(rows, motions.shape[2])


def _reduce_all(comm: Communicator, values: Array, **operation: object) -> Array:
    whole = np.empty_like(values)
    comm.Allreduce(values, whole, **operation)
    return whole


def orthonormal(comm: Communicator, vectors: Floats) -> Floats:
    """Orthonormal vectors with the same span, dependent ones left out.

    ``vectors``: the own rows, ``(rows, m)``.
    """
    for _ in range(2):  # the second time for the digits that the first one loses
        whole = _reduce_all(comm, vectors.T @ vectors)
        size, turn = np.linalg.eigh(whole)
        kept = size > 1e-12 * size.max(initial=0.0)
        vectors = vectors @ (turn[:, kept] / np.sqrt(size[kept]))
    return np.ascontiguousarray(vectors)
