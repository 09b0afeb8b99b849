"""Nodes held to planes that no axis of coordinates is normal to.

With Q the unit normals at the nodes (orthonormal columns, of the nodes one by one) and
``P = I - Q Qᵀ``, what satisfies ``Qᵀ u = 0`` is in equilibrium, against all displacements
that do too, if

    P K u = P (f + Bᵀ r),     v = B u + g,     Qᵀ u = 0.

With ``P K P + Q A Qᵀ``, ``P f`` and ``B P`` in the place of K, f and B that is (1) and (2) in
the same coordinates: the two parts do not meet, and in the second, any A > 0, nothing acts.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy import sparse

from bipot_rs._lib.messages import place
from bipot_rs._lib.types import Bools, Floats, Ints

# Of unit normals, which files know to seven digits: what is left of one beside others of
# the same plane, or beside what supports prescribe, is rounding.
_SAME = 1e-5
# Of a row of B: what rounding leaves of an entry that the planes take away.
_GONE = 1e-14


@dataclass(frozen=True)
class Planes:
    """Planes that nodes stay in.

    Attributes
    ----------
    normals : sparse (n, k)
        Q, without the components that supports prescribe.
    within : sparse (n, n)
        P.
    given : sparse (m, n)
        What these components must add up to zero by, a row a node and plane.
    """

    normals: Any = field(repr=False)
    within: Any = field(repr=False)
    given: Any = field(repr=False)

    def stiffness(self, K: Any) -> Any:
        """``P K P + Q A Qᵀ``, symmetric to the bit where K is."""
        inner = self.within @ K @ self.within
        inner = (inner + inner.T) / 2
        # Of the size of the stiffness of the nodes, so that no digits are lost.
        own = abs(self.normals).T @ K.diagonal()
        beside = self.normals @ sparse.diags_array(own) @ self.normals.T
        found = sparse.csr_array(inner + (beside + beside.T) / 2)
        found.sort_indices()
        return found

    def relative(self, B: Any) -> Any:
        """``B P``, of which nothing is left where it is rounding beside a row of B.

        A direction that the planes take away altogether is gone, not small: W would
        call what the digits of their normals leave of it a compliance.
        """
        found = sparse.csr_array(B @ self.within)
        rows = np.repeat(np.arange(found.shape[0]), np.diff(found.indptr))
        largest = abs(B).max(axis=1).toarray().ravel()
        found.data[np.abs(found.data) <= _GONE * largest[rows]] = 0.0
        left = abs(found).max(axis=1).toarray().ravel()
        found.data[(left <= _SAME * largest)[rows]] = 0.0
        found.eliminate_zeros()
        found.sort_indices()
        return found

    def tangents(self, frame: Floats, first: Ints, within: Bools) -> Floats:
        """Frames ``(n_c, 3, 3)`` whose last tangent is normal to the one plane of a node.

        Parameters
        ----------
        frame
            As they are; others than those asked for stay, to the bit.
        first
            First degree of freedom of the node of each contact.
        within
            Of which contacts the tangents may be turned.
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
                # Two planes leave no tangent, and across a plane nothing slips.
                continue
            across = Q[:, 0] - (n @ Q[:, 0]) * n
            across /= np.linalg.norm(across)
            turned[i, 1:] = np.cross(across, n), across
        return turned

    def load(self, force: Floats) -> Floats:
        """Forces ``(n,)`` without what the planes carry; those of a model as they are."""
        off = np.abs(self.normals.T @ force).max(initial=0.0)
        if off <= _GONE * np.abs(force).max(initial=0.0):
            return force
        return np.asarray(self.within @ force, np.float64)

    def refuse(self, prescribed: Floats, nodes: Floats) -> None:
        """Refuse prescribed displacements ``(n,)`` that would leave the planes."""
        off = np.abs(self.given @ prescribed)
        size = (self.given != 0) @ np.abs(prescribed)
        wrong = off > _SAME * size
        if wrong.any():
            row = int(np.argmax(wrong))
            dof = int(self.given.indices[self.given.indptr[row]])
            raise ValueError(
                f"supports move the node at {place(nodes[dof // nodes.shape[1]])} by "
                f"{off[row]:g} across its plane of symmetry: prescribe components whose "
                "sum lies in the plane"
            )


@dataclass(frozen=True)
class HeldNodes:
    """`Planes` as a contact problem asks for them (`loading.Held`)."""

    planes: Planes
    fixed: Ints
    nodes: Floats = field(repr=False)

    def stiffness(self, K: Any) -> Any:
        """`Planes.stiffness`."""
        return self.planes.stiffness(K)

    def load(self, force: Floats) -> Floats:
        """`Planes.load`."""
        return self.planes.load(force)

    def prescribed(self, values: Floats) -> None:
        """`Planes.refuse`, of the values at ``fixed``."""
        at = np.zeros(self.nodes.size)
        at[self.fixed] = values
        self.planes.refuse(at, self.nodes)


def planes(
    groups: Iterable[tuple[Ints, Floats]],
    fixed: Bools,
    dim: int,
) -> Planes | None:
    """Nodes held to planes, as one; None without any.

    Parameters
    ----------
    groups
        First degrees of freedom of nodes ``(m,)``, and the unit normal ``(d,)`` of the
        plane that they are in.
    fixed
        ``(n,)``, which degrees of freedom are prescribed.
    dim
        2 or 3.
    """
    at: dict[int, list[Floats]] = {}
    for first, normal in groups:
        for dof in first.tolist():
            at.setdefault(dof, []).append(normal)
    if not at:
        return None
    columns, given = [], []
    for dof, own in at.items():
        normals = np.array(own)
        held = fixed[dof : dof + dim]
        given += [(dof, row) for row in np.where(held, normals, 0.0) if row.any()]
        # Prescribed components, zero along the planes, ask nothing of the others.
        left = np.where(held, 0.0, normals)
        _, size, directions = np.linalg.svd(left, full_matrices=False)
        columns += [(dof, row) for row in directions[size > _SAME]]

    def stacked(rows: list[tuple[int, Floats]]) -> Any:
        entries = (
            np.array([row for _, row in rows]).ravel(),
            (
                np.repeat(np.arange(len(rows)), dim),
                (
                    np.array([dof for dof, _ in rows], np.int64)[:, None]
                    + np.arange(dim)
                ).ravel(),
            ),
        )
        found = sparse.csr_array(entries, shape=(len(rows), len(fixed)))
        found.eliminate_zeros()
        return found

    Q = sparse.csr_array(stacked(columns).T)
    P = sparse.csr_array(sparse.diags_array(np.ones(len(fixed))) - Q @ Q.T)
    return Planes(normals=Q, within=P, given=stacked(given))
