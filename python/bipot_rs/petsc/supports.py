"""Whether supports, springs and contacts can hold every rigid motion of the bodies.

As `src/primal/supports.rs`, with ``K`` in parts. A motion that nothing resists would be
decided by rounding; such problems are refused.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from bipot_rs._lib.types import Bools, Floats, Ints
from bipot_rs.contact.errors import NotIterativeError
from bipot_rs.petsc.own_rows import OwnRows

# A force of a rigid motion below this part of its terms is rounding: no spring resists it.
_ROUNDING = 1e-12
# And above this part it is that of a spring. Between the two, K may have few digits, whose
# errors look like weak springs.
_SPRING = 1e-4
# Smallest singular value of the held motions, relative to the largest.
_LEAST = 1e-8
# More loose bodies than this are refused.
_MOST = 32


@dataclass(frozen=True)
class Bodies:
    """Bodies and their rigid motions.

    Attributes
    ----------
    of_node, count
        Body of each own node, and the number of all bodies.
    motions
        Rigid motions at the own degrees of freedom, ``(rows, m)``.
    fixed
        Own rows that are prescribed.
    """

    of_node: Ints
    count: int
    motions: Floats
    fixed: Bools


Held = tuple[Ints, Floats]


def held(comm: Any, count: int, prescribed: Held) -> Bools:
    """Whether a `prescribed` degree of freedom is coupled with each of ``count`` bodies."""
    mine = np.zeros(count, np.int64)
    mine[prescribed[0]] = 1
    whole = np.zeros_like(mine)
    comm.Allreduce(mine, whole)
    found: Bools = whole > 0
    return found


def check(
    comm: Any,
    rows: OwnRows,
    local: Ints,
    bodies: Bodies,
    bring: Callable[[Floats], Floats],
    d: int,
    holding: Held,
    contact: tuple[Any, Floats, Ints],
) -> bool:
    """Raise `NotIterativeError` on all ranks if something can move freely.

    Whether contact alone holds a body.

    Parameters
    ----------
    holding
        That of `prescribed`.
    contact
        ``B`` at the places of the interface, with zeros at prescribed ones; the motions
        there; and the body of each place.
    """
    m = bodies.motions.shape[1]
    R = _alone(comm, bodies, d, m)
    _hold(comm, R, holding)
    moves = np.zeros(bodies.count, np.int64)
    np.add.at(moves, np.repeat(bodies.of_node, d)[~bodies.fixed], 1)
    whole = np.empty_like(moves)
    comm.Allreduce(moves, whole)
    free = (whole > 0) & ~_independent(R)
    if free.any():
        found, weak = _springs(rows, local, bodies, bring, free, d)
        if any(comm.allgather(weak)):
            raise NotIterativeError(
                "the stiffness has few digits, or weak springs, and supports do not hold "
                "a body"
            )
        _hold(comm, R, found)
        free &= ~_independent(R)
    loose = np.flatnonzero(free)
    if not len(loose):
        return False
    if len(loose) > _MOST:
        raise NotIterativeError("contact alone holds too many bodies")
    B, motions, body = contact
    whole_columns = [np.zeros((m * len(loose), m * len(loose)))]
    for k, one in enumerate(loose):
        whole_columns[0][m * k : m * (k + 1), m * k : m * (k + 1)] = R[one]
    size = np.sqrt(np.asarray(B.multiply(B).sum(axis=1)).ravel())
    parts = [B @ np.where((body == one)[:, None], motions, 0.0) for one in loose]
    rows_of_contacts = np.hstack(parts)[size > 0] / size[size > 0, None]
    whole_columns.append(rows_of_contacts)
    if not _independent(np.concatenate(whole_columns)[None])[0]:
        raise NotIterativeError("supports and contacts may leave a body free to move")
    return True


def _alone(comm: Any, bodies: Bodies, d: int, m: int) -> Floats:
    """Triangles ``R (bodies, m, m)`` of what holds each body: one node cannot turn."""
    nodes = np.bincount(bodies.of_node, minlength=bodies.count)
    whole = np.empty_like(nodes)
    comm.Allreduce(nodes, whole)
    R = np.zeros((bodies.count, m, m))
    turns = np.zeros((m, m))
    turns[range(d, m), range(d, m)] = 1.0
    R[whole == 1] = turns
    return R


def _hold(comm: Any, R: Floats, found: Held) -> None:
    """Add rows, each with its body, to the triangles: a QR here, and one of all ranks."""
    body, values = found
    m = R.shape[2]
    order = np.argsort(body, kind="stable")
    ours, starts = np.unique(body[order], return_index=True)
    ends = [*starts, len(order)][1:]
    triangles = [
        (int(one), np.linalg.qr(values[order[a:b]], mode="r"))
        for one, a, b in zip(ours, starts, ends, strict=True)
    ]
    everything: dict[int, list[Floats]] = {}
    for part in comm.allgather(triangles):
        for one, triangle in part:
            everything.setdefault(one, []).append(triangle)
    for one, parts in everything.items():
        whole = np.linalg.qr(np.concatenate([R[one], *parts]), mode="r")
        R[one] = 0.0
        R[one, : min(m, len(whole))] = whole


def prescribed(
    rows: OwnRows,
    local: Ints,
    bodies: Bodies,
    bring: Callable[[Floats], Floats],
    d: int,
) -> Held:
    """The bodies that prescribed degrees of freedom are coupled with, and their motions.

    Each pair of a body and a prescribed own row has a number of the body, and the row
    ``(m,)`` of the motions, which holds that body.
    """
    of_dof = np.where(bodies.fixed, -1, np.repeat(bodies.of_node, d))
    everywhere = bring(of_dof.astype(float)).astype(np.int64)
    row, entry = _entries(rows, np.flatnonzero(bodies.fixed))
    body = everywhere[local[entry]]
    meets = (rows.values[entry] != 0) & (body >= 0)
    pairs = np.unique(np.column_stack([body[meets], row[meets]]), axis=0)
    return pairs[:, 0], bodies.motions[pairs[:, 1]]


def _entries(rows: OwnRows, wanted: Ints) -> tuple[Ints, Ints]:
    """Row and number of each entry of some rows."""
    counts = np.diff(rows.pointer)[wanted]
    first = np.repeat(rows.pointer[wanted] - np.cumsum(counts) + counts, counts)
    return np.repeat(wanted, counts), first + np.arange(counts.sum())


def _springs(
    rows: OwnRows,
    local: Ints,
    bodies: Bodies,
    bring: Callable[[Floats], Floats],
    free: Bools,
    d: int,
) -> tuple[Held, bool]:
    """Forces of the motions in rows of ``K``, relative to their terms, where not rounding.

    Whether some are neither rounding nor those of a spring, too.
    """
    from scipy.sparse import csr_array

    body = np.repeat(bodies.of_node, d)
    everywhere = np.column_stack([bring(column) for column in bodies.motions.T])
    shape = rows.count, len(everywhere)
    K = csr_array((rows.values, local, rows.pointer), shape=shape)
    force = K @ everywhere
    K = csr_array((np.abs(rows.values), local, rows.pointer), shape=shape)
    size = K @ np.abs(everywhere)
    force[np.abs(force) <= _ROUNDING * size] = 0.0
    relative = np.divide(force, size, out=np.zeros_like(force), where=size > 0)
    taken = free[body] & ~bodies.fixed & (relative != 0).any(axis=1)
    found = relative[taken]
    weak = bool((np.abs(found).max(axis=1, initial=0.0) < _SPRING).any())
    return (body[taken], found), weak


def _independent(R: Floats) -> Bools:
    """Whether the columns of each of some matrices are independent."""
    size = np.linalg.svd(R, compute_uv=False)
    if R.shape[1] < R.shape[2]:
        return np.zeros(len(R), bool)
    found: Bools = (size[:, 0] > 0) & (size[:, -1] > _LEAST * size[:, 0])
    return found
