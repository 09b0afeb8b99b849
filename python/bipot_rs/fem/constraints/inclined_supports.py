"""Inclined supports: nodes that stay in planes that are not normal to an axis.

With Q the unit normals at the nodes (orthonormal columns, node by node) and
``P = I - Q Qᵀ``, a displacement with ``Qᵀ u = 0`` is in equilibrium, tested by all
displacements with the same property, if

    P K u = P (f + Bᵀ r),     v = B u + g,     Qᵀ u = 0.

With ``P K P + Q A Qᵀ``, ``P f`` and ``B P`` in place of K, f and B this is (1) and (2) in the
same coordinates, for any A > 0: the two parts are independent, and no force acts on the second.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np
from scipy import sparse

from bipot_rs._lib.matrices import diagonal_matrix
from bipot_rs._lib.messages import place
from bipot_rs._lib.types import Bools, CsrMatrix, Floats, Ints

# Unit normals have seven digits in files: the part of a normal that is independent of other
# normals or of supports is rounding below this.
_SAME = 1e-5
# Entries of B P below this fraction of their row are rounding.
_GONE = 1e-14


@dataclass(frozen=True)
class Planes:
    """Planes in which nodes stay, as matrices; the `Held` of a contact problem."""

    # Sparse (n, k): Q, without the components that supports prescribe.
    normals: CsrMatrix = field(repr=False)
    within: CsrMatrix = field(repr=False)  # sparse (n, n): P
    # Sparse (m, n): the weighted sums of prescribed components that must be zero, a row for
    # each node and plane.
    given: CsrMatrix = field(repr=False)
    fixed: Ints = field(repr=False)  # (fixed,): prescribed degrees of freedom
    nodes: Floats = field(repr=False)  # (nodes, d): positions of all nodes [m]

    def stiffness(self, K: CsrMatrix, rows: Ints | None = None) -> CsrMatrix:
        """``P K P + Q A Qᵀ``, bitwise symmetric if K is.

        ``K``: stiffness ``(n, n)``, or its ``rows``.
        ``rows``: ascending numbers of the rows that K holds, all degrees of freedom of some
        nodes. The result holds these rows, with the bits of the whole matrix if K is bitwise
        symmetric.
        """
        P, Q = self.within, self.normals
        own_P, own_Q = P, Q
        if rows is not None:
            # P and Q couple the degrees of freedom of one node alone.
            own_P, own_Q = P[rows][:, rows], Q[rows]
        inner = own_P @ K @ P
        mirrored = inner if rows is None else P @ K.T @ own_P
        inner = (inner + mirrored.T) / 2
        # A of the size of the stiffness of the nodes, so that no digits are lost.
        diagonal = K.diagonal() if rows is None else K[:, rows].diagonal()
        scale_of_rows = diagonal_matrix(abs(own_Q).T @ diagonal)
        beside = own_Q @ scale_of_rows @ Q.T
        mirrored = beside if rows is None else Q @ scale_of_rows @ own_Q.T
        reduced_stiffness: CsrMatrix = sparse.csr_array(
            inner + (beside + mirrored.T) / 2
        )
        reduced_stiffness.sort_indices()
        return reduced_stiffness

    def relative(self, B: CsrMatrix) -> CsrMatrix:
        """``B P``, with entries set to zero that are rounding relative to the row of B.

        A direction that the planes block must be exactly zero: W would take its rounding
        for a compliance.
        """
        rows, largest = restrict_rows(B, self.within)
        left = abs(rows).max(axis=1).toarray().ravel()
        rows.data[np.repeat(left <= _SAME * largest, np.diff(rows.indptr))] = 0.0
        rows.eliminate_zeros()
        return rows

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
            if Q.shape[1] != 1 or abs(n @ Q[:, 0]) > _SAME:
                # With two planes there is no tangent; with a contact normal across the
                # plane there is nothing to turn.
                continue
            across = Q[:, 0] - (n @ Q[:, 0]) * n
            across /= np.linalg.norm(across)
            turned[i, 1:] = np.cross(across, n), across
        return turned

    def load(self, force: Floats) -> Floats:
        """Forces ``(n,)`` without the reactions of the planes; unchanged if there are none."""
        off = np.abs(self.normals.T @ force).max(initial=0.0)
        if off <= _GONE * np.abs(force).max(initial=0.0):
            return force
        return np.asarray(self.within @ force, np.float64)

    @property
    def dependent(self) -> Ints:
        """No degree of freedom follows others."""
        return np.zeros(0, np.int64)

    def displacement(self, y: Floats) -> Floats:
        """The displacements ``(n,)`` are the unknowns of (1) themselves."""
        return y

    def unknowns(self, u: Floats) -> Floats:
        """As `displacement`."""
        return u

    def prescribed(self, values: Floats) -> None:
        """Refuse displacements ``(fixed,)`` that leave the planes."""
        prescribed = np.zeros(self.nodes.size)
        prescribed[self.fixed] = values
        off = np.abs(self.given @ prescribed)
        terms = self.given.copy()
        terms.data = np.ones_like(terms.data)
        size = terms @ np.abs(prescribed)
        wrong = off > _SAME * size
        if wrong.any():
            row, dim = int(np.argmax(wrong)), self.nodes.shape[1]
            dof = int(self.given.indices[self.given.indptr[row]])
            raise ValueError(
                f"supports move the node at {place(self.nodes[dof // dim])} by "
                f"{off[row]:g} across its plane of symmetry: prescribe components whose "
                "sum lies in the plane"
            )


def restrict_rows(B: CsrMatrix, within: CsrMatrix) -> tuple[CsrMatrix, Floats]:
    """``B within`` without entries that are rounding, and the largest entry of each row of B."""
    rows: CsrMatrix = sparse.csr_array(B @ within)
    largest = abs(B).max(axis=1).toarray().ravel()
    rounding = _GONE * np.repeat(largest, np.diff(rows.indptr))
    rows.data[np.abs(rows.data) <= rounding] = 0.0
    rows.eliminate_zeros()
    rows.sort_indices()
    return rows, largest


def make_planes(
    groups: Iterable[tuple[Ints, Floats]], fixed: Ints, nodes: Floats
) -> Planes | None:
    """Combine the planes of all nodes; None without any.

    ``groups``: first degrees of freedom of nodes ``(m,)``, and the unit normal ``(d,)`` of
    their plane.
    ``fixed, nodes``: as in `Planes`.
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
    columns, entries_of_columns = [], []
    for dof, normals_of_node in at.items():
        normals = np.array(normals_of_node)
        held = prescribed[dof : dof + dim]
        entries_of_columns += [
            (dof, row) for row in np.where(held, normals, 0.0) if row.any()
        ]
        # Prescribed components are zero along the normals: the others stay free.
        left = np.where(held, 0.0, normals)
        _, size, directions = np.linalg.svd(left, full_matrices=False)
        columns += [(dof, row) for row in directions[size > _SAME]]

    def stacked(rows: list[tuple[int, Floats]]) -> CsrMatrix:
        data = np.array([row for _, row in rows]).ravel()
        dofs = np.array([dof for dof, _ in rows], np.int64)[:, None] + np.arange(dim)
        entries = data, (np.repeat(np.arange(len(rows)), dim), dofs.ravel())
        normals_matrix: CsrMatrix = sparse.csr_array(
            entries, shape=(len(rows), nodes.size)
        )
        normals_matrix.eliminate_zeros()
        return normals_matrix

    Q = sparse.csr_array(stacked(columns).T)
    P = sparse.csr_array(diagonal_matrix(np.ones(nodes.size)) - Q @ Q.T)
    return Planes(Q, P, stacked(entries_of_columns), fixed, nodes)
