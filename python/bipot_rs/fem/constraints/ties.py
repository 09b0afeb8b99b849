"""Ties: linear relations between displacements, as a change of variables.

Homogeneous relations ``C u = 0`` express some degrees of freedom, the dependent ones, by the
others: ``u = T y``. Row i of T is that of the identity if i is independent, and column i is
zero if i is dependent, so that ``T T = T``. Displacements that satisfy the relations are in
equilibrium, tested by all others that do, if

    Tᵀ K T y = Tᵀ f + (B T)ᵀ r,     v = B T y + g,     u = T y.

With ``Tᵀ K T``, ``Tᵀ f`` and ``B T`` in place of K, f and B this is (1) and (2) with unchanged
numbers of the degrees of freedom. The dependent ones, whose rows and columns are zero, count as
prescribed with ``y = 0``. Displacements that supports prescribe are independent.

Inclined supports are such relations: with the unit normal q of a plane the displacement of a
node on it satisfies ``q · u = 0``, solved for the component along which the normal is largest.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy import sparse

from bipot_rs._lib.matrices import diagonal_matrix
from bipot_rs._lib.messages import place
from bipot_rs._lib.types import Bools, CsrMatrix, Floats, Ints
from bipot_rs.fem.bodies.elasticity import dofs_of
from bipot_rs.fem.tuning import PREFERRED

# Coefficients below this, relative to their relation, are rounding: mesh files give
# coordinates and unit normals with seven digits.
SAME = 1e-5
# Coefficients of T below this are rounding of double precision.
_GONE = 1e-14
# Sums below this part of the sum of their terms are rounding.
_NOTHING = 64 * float(np.finfo(np.float64).eps)


@dataclass(frozen=True)
class Relations:
    """Relations ``Σ coefficients · u[dofs] = 0``, one in each row."""

    # dofs, coefficients (relations, terms): the first degree of freedom of a row is preferred
    # as the dependent one. Terms with a coefficient of zero are ignored.
    dofs: Ints
    coefficients: Floats


@dataclass(frozen=True)
class Ties:
    """Relations between displacements, as a matrix; the `Held` of a contact problem."""

    within: CsrMatrix = field(repr=False)  # sparse (n, n): T
    # (m,): numbers of the dependent degrees of freedom, ascending.
    dependent: Ints = field(repr=False)
    # Sparse (k, n): relations between prescribed degrees of freedom alone.
    given: CsrMatrix = field(repr=False)
    # (fixed,): degrees of freedom that supports prescribe, and the dependent ones, ascending.
    fixed: Ints = field(repr=False)
    # (nodes, d): positions of all nodes and reference nodes [m].
    nodes: Floats = field(repr=False)

    def stiffness(self, K: CsrMatrix) -> CsrMatrix:
        """``Tᵀ K T``, bitwise symmetric if K is.

        K ``(n, n)``, or without the rows of the reference nodes, which have no stiffness.
        """
        stiffness: CsrMatrix = sparse.csr_array(K)
        stiffness.resize((self.nodes.size, self.nodes.size))
        if not self.dependent.size:
            return stiffness
        inner = sparse.csr_array(self.within.T @ stiffness @ self.within)
        reduced_stiffness: CsrMatrix = sparse.csr_array((inner + inner.T) / 2)
        idle = self._without_stiffness(stiffness, reduced_stiffness)
        if idle.size:
            kept = np.ones(reduced_stiffness.shape[0])
            kept[idle] = 0.0
            reduced_stiffness = (
                diagonal_matrix(kept) @ reduced_stiffness @ diagonal_matrix(kept)
            )
            reduced_stiffness.eliminate_zeros()
        reduced_stiffness.sort_indices()
        return reduced_stiffness

    def stiffness_rows(
        self, read: Callable[[Ints], CsrMatrix], nodes: Ints, count: int
    ) -> CsrMatrix:
        """Rows of ``Tᵀ K T`` of some nodes, with an entry on the diagonal, ``(d m, n)``.

        ``read`` gives rows of K of some of its ``count`` nodes.
        """
        d = self.nodes.shape[1]
        wanted = dofs_of(nodes, d)
        columns = sparse.csc_array(self.within)[:, wanted]
        needed = np.unique(columns.indices // d)
        needed = needed[needed < count]
        K = read(needed)
        K.resize((K.shape[0], self.nodes.size))
        rows = (columns.tocsr()[dofs_of(needed, d)].T @ K @ self.within).tocoo()
        # Zeros stay.
        row = np.concatenate([rows.row, np.arange(len(wanted))])
        column = np.concatenate([rows.col, wanted])
        data = np.concatenate([rows.data, np.zeros(len(wanted))])
        made: CsrMatrix = sparse.csr_array((data, (row, column)), shape=rows.shape)
        return made

    def measure_loss(self, K: CsrMatrix, reduced: CsrMatrix) -> Floats:
        """How many times larger than its entries the terms of each row of ``Tᵀ K T`` are.

        The row of a rigid set is the sum of those of its nodes, of which little is left; its
        rounding is that of the terms. At least 1, ``(n,)``.
        """
        T, size = abs(self.within), K.shape[0]
        forces = abs(K) @ (T @ np.ones(T.shape[1]))[:size]
        terms = np.asarray(T[:size].T @ forces, np.float64)
        entries = np.asarray(abs(reduced).sum(axis=1), np.float64)
        whole = np.where(entries > 0, entries, np.inf)
        return np.maximum(terms / whole, 1.0)

    def _without_stiffness(self, K: CsrMatrix, inner: CsrMatrix) -> Ints:
        """Independent degrees of freedom whose rows of ``Tᵀ K T`` are rounding.

        They move whole bodies as rigid ones. Their own size does not tell rounding from a
        stiffness, but that of the sums from which they come does.
        """
        T = sparse.csc_array(self.within)
        shared = np.flatnonzero(np.diff(T.indptr) > 1)
        terms = sparse.csr_array(abs(T[:, shared]).T @ abs(K) @ abs(T))
        real = sparse.csr_array(abs(inner[shared]) > _NOTHING * terms)
        real.eliminate_zeros()
        return np.asarray(shared[np.diff(real.indptr) == 0], np.int64)

    def relative(self, B: CsrMatrix) -> CsrMatrix:
        """``B T``, with entries set to zero that are rounding relative to the row of B.

        A direction that the relations block must be exactly zero: W would take its rounding
        for a compliance.
        """
        rows: CsrMatrix = sparse.csr_array(B @ self.within)
        largest = abs(B).max(axis=1).toarray().ravel()
        left = abs(rows).max(axis=1).toarray().ravel()
        rounding = np.where(left <= SAME * largest, left, _GONE * largest)
        rows.data[np.abs(rows.data) <= np.repeat(rounding, np.diff(rows.indptr))] = 0.0
        rows.eliminate_zeros()
        rows.sort_indices()
        return rows

    def load(self, force: Floats) -> Floats:
        """``Tᵀ f``; unchanged if no force acts on a dependent degree of freedom."""
        if not force[self.dependent].any():
            return force
        return np.asarray(self.within.T @ force, np.float64)

    def prescribed(self, values: Floats) -> None:
        """Refuse displacements ``(fixed,)`` that contradict the relations."""
        moved = np.zeros(self.nodes.size)
        moved[self.fixed] = values
        off = np.abs(self.given @ moved)
        wrong = off > SAME * (abs(self.given) @ np.abs(moved))
        if wrong.any():
            row, dim = int(np.argmax(wrong)), self.nodes.shape[1]
            dof = int(self.given.indices[self.given.indptr[row]])
            raise ValueError(
                f"the displacements that supports prescribe near "
                f"{place(self.nodes[dof // dim])} contradict a plane of symmetry, a rigid set, "
                f"a cyclic symmetry or the section of a bolt by {off[row]:g}: prescribe values "
                "that agree, or leave them out on one side"
            )

    def displacement(self, y: Floats) -> Floats:
        """``u = T y``, ``(n,)``."""
        return np.asarray(self.within @ y, np.float64)

    def unknowns(self, u: Floats) -> Floats:
        """The y of ``u = T y`` with zeros at the dependent degrees of freedom."""
        y = u.copy()
        y[self.dependent] = 0.0
        return y


def make_ties(
    relations: Sequence[Relations],
    fixed: Ints,
    nodes: Floats,
) -> Ties:
    """Solve relations for dependent degrees of freedom.

    ``relations`` are solved in their order.
    ``fixed``: degrees of freedom that supports prescribe, ascending.
    ``nodes``: as in `Ties`.
    """
    n = nodes.size
    prescribed = np.zeros(n, np.bool_)
    prescribed[fixed] = True
    simple, rest = _separate_relations(relations, prescribed)
    slow = _Elimination(prescribed)
    for dofs, coefficients in rest:
        slow.add(dofs, coefficients)
    rows, columns, values = slow.entries(n)
    dependent = np.zeros(n, np.bool_)
    dependent[list(slow.solved)] = True
    first = sparse.csr_array((values, (rows, columns)), shape=(n, n))
    rows, columns, values = simple
    dependent[rows] = True
    kept = np.ones(n)
    kept[rows] = 0.0
    fast = sparse.csr_array((values, (rows, columns)), shape=(n, n))
    T = sparse.csr_array((fast + diagonal_matrix(kept)) @ first)
    T.eliminate_zeros()
    T.sort_indices()
    return Ties(
        within=T,
        dependent=np.flatnonzero(dependent).astype(np.int64),
        given=slow.list_given_rows(n),
        fixed=np.union1d(fixed, np.flatnonzero(dependent)),
        nodes=nodes,
    )


def _separate_relations(
    relations: Sequence[Relations], prescribed: Bools
) -> tuple[tuple[Ints, Ints, Floats], Iterator[tuple[Ints, Floats]]]:
    """Entries of T of relations whose preferred degree of freedom is in no other, and the rest."""
    uses = np.zeros(len(prescribed), np.int64)
    for relation in relations:
        np.add.at(uses, relation.dofs[relation.coefficients != 0], 1)
    rows, columns, values = [np.zeros(0, np.int64)], [np.zeros(0, np.int64)], []
    rest: list[tuple[Ints, Floats]] = []
    for relation in relations:
        first = relation.dofs[:, 0]
        lead = np.abs(relation.coefficients[:, 0])
        simple = (uses[first] == 1) & ~prescribed[first]
        simple &= lead >= PREFERRED * np.abs(relation.coefficients).max(axis=1)
        dofs, share = relation.dofs[simple, 1:], relation.coefficients[simple]
        rows.append(np.repeat(first[simple], dofs.shape[1]))
        columns.append(dofs.ravel())
        values.append((-share[:, 1:] / share[:, :1]).ravel())
        rest += zip(relation.dofs[~simple], relation.coefficients[~simple], strict=True)
    data = np.concatenate([np.zeros(0), *values])
    return (np.concatenate(rows), np.concatenate(columns), data), iter(rest)


class _Elimination:
    """Gaussian elimination, relation by relation.

    ``solved``: the coefficients of the independent degrees of freedom, of each dependent one.
    """

    def __init__(self, prescribed: Bools) -> None:
        self._prescribed = prescribed
        self.solved: dict[int, dict[int, float]] = {}
        # The dependent ones whose coefficients name a degree of freedom.
        self._naming: dict[int, set[int]] = {}
        self._given: list[dict[int, float]] = []

    def add(self, dofs: Ints, coefficients: Floats) -> None:
        """Solve one more relation."""
        row: dict[int, float] = {}
        for dof, value in zip(dofs.tolist(), coefficients.tolist(), strict=True):
            for other, share in self.solved.get(dof, {dof: 1.0}).items():
                row[other] = row.get(other, 0.0) + value * share
        size = float(np.abs(coefficients).max())
        row = {dof: value for dof, value in row.items() if abs(value) > _GONE * size}
        free = {dof: value for dof, value in row.items() if not self._prescribed[dof]}
        largest = max((abs(value) for value in free.values()), default=0.0)
        if largest <= SAME * size:
            kept = {d: v for d, v in row.items() if d not in free and abs(v) > SAME}
            if kept:
                self._given.append(kept)
            return
        preferred = int(dofs[0])
        pivot = preferred
        if abs(free.get(preferred, 0.0)) < PREFERRED * largest:
            pivot = max(free, key=lambda dof: abs(free[dof]))
        lead = row.pop(pivot)
        self._solve(pivot, {dof: -value / lead for dof, value in row.items()})

    def _solve(self, pivot: int, row: dict[int, float]) -> None:
        for dependent in self._naming.pop(pivot, set()):
            terms = self.solved[dependent]
            share = terms.pop(pivot)
            for dof, value in row.items():
                terms[dof] = terms.get(dof, 0.0) + share * value
                self._naming.setdefault(dof, set()).add(dependent)
        self.solved[pivot] = row
        for dof in row:
            self._naming.setdefault(dof, set()).add(pivot)

    def entries(self, n: int) -> tuple[Ints, Ints, Floats]:
        """Rows, columns and values of T."""
        plain = np.ones(n, np.bool_)
        plain[list(self.solved)] = False
        same = np.flatnonzero(plain)
        rows = [i for i, row in self.solved.items() for _ in row]
        columns = [j for row in self.solved.values() for j in row]
        values = [value for row in self.solved.values() for value in row.values()]
        return (
            np.concatenate([same, np.array(rows, np.int64)]),
            np.concatenate([same, np.array(columns, np.int64)]),
            np.concatenate([np.ones(len(same)), np.array(values, np.float64)]),
        )

    def list_given_rows(self, n: int) -> CsrMatrix:
        """Relations between prescribed degrees of freedom alone, ``(k, n)``."""
        rows = [k for k, row in enumerate(self._given) for _ in row]
        columns = [dof for row in self._given for dof in row]
        values = [value for row in self._given for value in row.values()]
        shape = len(self._given), n
        made: CsrMatrix = sparse.csr_array(
            (values, (rows, columns)), shape=shape, dtype=float
        )
        return made


# A node that moves so many times as far as the component prescribed at it is on a plane whose
# normal is within half a degree of this component: a mistake.
_FAR = 100.0


@dataclass(frozen=True)
class Planes:
    """Planes in which nodes stay."""

    # Sparse (n, k): orthonormal normals at the nodes, without the components that supports
    # prescribe.
    normals: CsrMatrix = field(repr=False)
    relations: Relations = field(repr=False)  # of each node and plane

    def find_far(self, given: Floats, moved: Floats) -> int | None:
        """A node that its plane moves much farther than the component prescribed there.

        ``given (nodes, d)``: prescribed components, else 0. ``moved``: all that follow.
        """
        nodes = np.unique(self.relations.dofs // given.shape[1])
        size, length = (np.linalg.norm(u[nodes], axis=1) for u in (given, moved))
        far = nodes[(length > _FAR * size) & (size > 0)]
        return int(far[0]) if far.size else None

    def tangents(self, frame: Floats, first: Ints, within: Bools) -> Floats:
        """Turn frames ``(n_c, 3, 3)`` so that t2 is normal to the plane of their node.

        ``frame``: the frames; those that need no change stay bitwise the same.
        ``first``: first degree of freedom of the node of each contact.
        ``within``: ``(n_c,)``, whose tangents may be turned.
        """
        turned = frame.copy()
        normals = sparse.csr_array(self.normals)
        held = np.diff(normals.indptr) > 0
        on = held[first[:, None] + np.arange(3)].any(axis=1)
        for i in np.flatnonzero(within & on):
            Q = normals[first[i] : first[i] + 3].toarray()
            Q = Q[:, np.abs(Q).any(axis=0)]
            n = frame[i, 0]
            if Q.shape[1] != 1 or abs(n @ Q[:, 0]) > SAME:
                # With two planes there is no tangent; with a contact normal across the
                # plane there is nothing to turn.
                continue
            across = Q[:, 0] - (n @ Q[:, 0]) * n
            across /= np.linalg.norm(across)
            turned[i, 1:] = np.cross(across, n), across
        return turned


def make_planes(
    groups: Iterable[tuple[Ints, Floats]], fixed: Ints, nodes: Floats
) -> Planes | None:
    """Combine the planes of all nodes; None without any.

    ``groups``: first degrees of freedom of nodes ``(m,)``, and the unit normal ``(d,)`` of
    their plane.
    ``fixed``: prescribed degrees of freedom. ``nodes (nodes, d)``: positions of all nodes [m].
    """
    dim = nodes.shape[1]
    prescribed = np.zeros(nodes.size, np.bool_)
    prescribed[fixed] = True
    at: dict[int, list[Floats]] = {}
    for first, normal in groups:
        for dof in first.tolist():
            at.setdefault(dof, []).append(normal)
    if not at:
        return None
    columns = []
    for dof, normals_of_node in at.items():
        # Prescribed components are zero along the normals: the others stay free.
        left = np.where(prescribed[dof : dof + dim], 0.0, np.array(normals_of_node))
        _, size, directions = np.linalg.svd(left, full_matrices=False)
        columns += [(dof, row) for row in directions[size > SAME]]
    data = np.array([row for _, row in columns]).ravel()
    dofs = np.array([dof for dof, _ in columns], np.int64)[:, None] + np.arange(dim)
    entries = data, (dofs.ravel(), np.repeat(np.arange(len(columns)), dim))
    Q = sparse.csr_array(entries, shape=(nodes.size, len(columns)))
    Q.eliminate_zeros()
    rows = [(dof, normal) for dof, normals in at.items() for normal in normals]
    coefficients = np.array([normal for _, normal in rows])
    dofs = np.array([dof for dof, _ in rows], np.int64)[:, None] + np.arange(dim)
    order = np.argsort(-np.abs(coefficients), axis=1, kind="stable")
    relations = Relations(
        np.take_along_axis(dofs, order, 1), np.take_along_axis(coefficients, order, 1)
    )
    return Planes(Q, relations)
