"""Inclined supports: nodes that stay in planes that are not normal to an axis.

With the unit normal q of a plane the displacement of a node on it satisfies ``q · u = 0``, which
`Ties` solve for the component along which the normal is largest.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np
from scipy import sparse

from bipot_rs._lib.types import Bools, CsrMatrix, Floats, Ints
from bipot_rs.fem.constraints.ties import SAME, Relations

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
