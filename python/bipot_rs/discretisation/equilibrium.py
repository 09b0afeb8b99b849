"""Facet tractions in exact equilibrium with the loads on each element.

They are computed from a displacement of linear triangles or tetrahedra, node by node, by
the prolongation condition of Ladeveze and Leguillon (1983): on every cell T with corners i

    Σ_F ∫_F φ_i t_T dA  =  ∫_T σ_h ∇φ_i dV - ∫_T φ_i f dV,                            (P)

over the facets of T with corner i, where ``t_T = ± t_F`` and t_F is the traction of the
facet. The sum of (P) over the corners, weighted by a rigid motion, is the equilibrium of
forces and torques of T. The sum over the cells around i is the finite-element equation of
node i; therefore a solution exists. The one nearest to the mean traction of the two cells
is used.
"""

from __future__ import annotations

import numpy as np

from bipot_rs._lib.messages import place
from bipot_rs._lib.types import Bools, Floats
from bipot_rs.discretisation.simplices import Simplices, pairs


def moments(
    cells: Simplices, stress: Floats, body_force: Floats, given: Floats, known_at: Bools
) -> Floats:
    """Moments ``∫_F φ_i t_F`` of tractions that satisfy (P), ``(facets, d nodes, d)``.

    ``cells``: the body.
    ``stress``: stress of the finite elements, ``(cells, d, d)``, in equilibrium at the nodes
    with the following loads.
    ``body_force``: ``(cells, d)``, force per volume.
    ``given``: moments of the tractions on boundary facets, ``(facets, d nodes, d)``.
    ``known_at``: mask of given components, ``(facets, d)``: false for prescribed displacements and
    for interior facets.
    Raises `ValueError`: no tractions can balance the force at a node: a component is prescribed
    at the node, but on no facet with this node.
    """
    dim = cells.dim
    # Right-hand side of (P).
    asked = cells.volume[:, None, None] * (
        np.einsum("cij,caj->cai", stress, cells.gradients)
        - body_force[:, None] / (dim + 1)
    )
    size = cells.size
    guess = np.zeros((len(size), dim))
    # Mean traction of the two cells of an interior facet; that of the cell of a boundary one.
    np.add.at(
        guess,
        cells.facet_of,
        np.einsum("cij,ckj->cki", stress, cells.area[cells.facet_of]),
    )
    guess *= np.where(cells.outside, 1.0, 0.5)[:, None] / dim
    values = np.where(known_at[:, None], given, guess[:, None])
    local = pairs(dim)
    key, sign = cells.local_moments()
    facet, at = np.divmod(key, dim)
    rest = asked.copy()
    for p, (_, a) in enumerate(local):
        rest[:, a] -= sign[:, p, None] * values[facet[:, p], at[:, p]]

    # Minimise the squared changes of moments over the area, as those of tractions.
    free = np.where(known_at, 0.0, size[:, None])
    shift = _potentials(cells, free, rest)
    for p, (_, a) in enumerate(local):
        # An interior facet is visited from both its cells, and gets the difference.
        change = sign[:, p, None] * free[facet[:, p]] * shift[:, a]
        np.add.at(values, (facet[:, p], at[:, p]), change)
    _check(cells, asked, values)
    return values


def _potentials(cells: Simplices, free: Floats, rest: Floats) -> Floats:
    """Multipliers of (P) at the corners of cells, ``(cells, d + 1, d)``.

    The cells around a node form a graph, with an edge for each facet between two of them
    and an open end for each boundary facet. A change of moment is ``free`` times the
    difference of the multipliers of its cells; the changes of a cell add up to ``rest``.
    """
    dim, corners = cells.dim, cells.corners
    corner = np.array([a for _, a in pairs(dim)])
    facet_node, _ = cells.local_moments()
    flat = corners.ravel()
    order = np.argsort(flat, kind="stable")
    many = np.bincount(flat, minlength=len(cells.points))
    start = np.concatenate([[0], np.cumsum(many)])[:-1]
    # Number of each cell in the graph of each of its corners.
    rank = np.empty(flat.size, dtype=np.int64)
    rank[order] = np.arange(flat.size) - np.repeat(start, many)
    mine = rank.reshape(corners.shape)[:, corner].ravel()
    # The other cell of a facet is the sum of both minus this one.
    ends = facet_node.ravel()
    total = np.bincount(ends, mine, minlength=cells.facets.size)
    shared = ~cells.outside[ends // dim]
    other = np.where(shared, total[ends] - mine, mine).astype(np.int64)
    node = corners[:, corner].ravel()
    potentials = np.zeros((flat.size, dim))
    # Graphs of equal size are solved together.
    for n in np.unique(many[many > 0]):
        nodes = np.flatnonzero(many == n)
        index = np.full(len(many), -1)
        index[nodes] = np.arange(len(nodes))
        here = np.flatnonzero(many[node] == n)
        which = index[node[here]]
        row = (which * n + mine[here]) * n
        whose = order[(start[nodes][:, None] + np.arange(n)).ravel()]
        right = rest.reshape(-1, dim)[whose].reshape(len(nodes), n, dim)
        for k in range(dim):
            weight = free[ends[here] // dim, k]
            inside = np.where(shared[here], weight, 0.0)
            entries = len(nodes) * n * n
            graph = np.bincount(row + mine[here], weight, entries)
            graph -= np.bincount(row + other[here], inside, entries)
            graph = graph.reshape(len(nodes), n, n)
            open_ends = np.bincount(which, weight - inside, len(nodes))
            # Without an open end the equations add up to that of the node; a common shift
            # of all multipliers is then free.
            scale = np.trace(graph, axis1=1, axis2=2) / n
            scale = np.where(scale > 0, scale, 1.0)
            graph += np.where(open_ends > 0, 0.0, scale)[:, None, None] / n
            potentials[whose, k] = np.linalg.solve(graph, right[:, :, k, None]).ravel()
    return potentials.reshape(*corners.shape, dim)


def _check(cells: Simplices, asked: Floats, of_facets: Floats) -> None:
    left, terms = asked.copy(), np.abs(asked)
    for k, a in pairs(cells.dim):
        moment = of_facets[cells.facet_of[:, k], cells.place[:, k, a]]
        left[:, a] -= cells.sign[:, k, None] * moment
        terms[:, a] += np.abs(moment)
    # Equations of nodes are satisfied up to the rounding of a factorisation, while an
    # unbalanced force leaves a residual of its own size. The reference is the largest
    # moment: it determines the rounding in all cells.
    bad = np.abs(left).max(axis=2)
    worst = np.unravel_index(int(np.argmax(bad)), bad.shape)
    if bad[worst] > 1e-6 * terms.max():
        where = place(cells.points[cells.corners[worst]])
        raise ValueError(
            f"no tractions balance the forces at the node at {where}: a displacement is "
            "prescribed at this node, but on no whole facet with this node; support a facet"
        )
