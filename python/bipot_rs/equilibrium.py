"""Facet tractions in exact equilibrium with the loads, element by element.

From a displacement of linear triangles or tetrahedra, vertex by vertex, by the
prolongation condition of Ladeveze and Leguillon (1983): on every cell T, with corners i,

    Σ_F ∫_F φ_i t_T dA  =  ∫_T σ_h ∇φ_i dV - ∫_T φ_i f dV,                            (P)

over the facets of T that have corner i, with ``t_T = ± t_F``, one traction a facet. The
sum of (P) over the corners, with any rigid motion as weights, is the equilibrium of forces
and torques of T; the sum over the cells around i is the equation of node i of the finite
elements, which makes it solvable. Of its solutions the one nearest to the mean traction
of the two cells is taken.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bipot_rs import johnson_mercier
from bipot_rs.elasticity import Body, Floats, Ints, Material


@dataclass(frozen=True)
class Simplices:
    """Cells, their facets, and which belong together; areas without thickness.

    Attributes
    ----------
    points : (nodes, d)
    corners : (cells, d + 1)
    facets : (facets, d)
        Nodes of each facet.
    facet_of : (cells, d + 1)
        The facet opposite to each corner.
    sign : (cells, d + 1)
        1 where that facet's normal is the outward one of the cell, else -1.
    place : (cells, d + 1, d + 1)
        Entry [k, a]: where corner a stands among the nodes of the facet opposite to
        corner k; 0 for a = k.
    gradients : (cells, d + 1, d)
        Of the barycentric coordinates.
    edges : (cells, d, d)
        Column k goes from corner 0 to corner k + 1.
    volume : (cells,)
    area : (facets, d)
        Normal of the facet times its area.
    outside : (facets,)
        Whether it has one cell only.
    """

    points: Floats
    corners: Ints
    facets: Ints
    facet_of: Ints
    sign: Floats
    place: Ints
    gradients: Floats
    edges: Floats
    volume: Floats
    area: Floats
    outside: NDArray[np.bool_]

    @property
    def dim(self) -> int:
        """2 or 3."""
        return self.points.shape[1]

    @property
    def size(self) -> Floats:
        """Areas of the facets, ``(facets,)``."""
        return np.linalg.norm(self.area, axis=1)

    def linear_moments(self, facets: Ints, traction: Floats) -> Floats:
        """Moments ``(m, d nodes, d)`` of tractions linear on facets.

        Parameters
        ----------
        facets, traction
            Numbers of facets ``(m,)``; values at their nodes ``(m, d nodes, d)``.
        """
        total = traction.sum(axis=1, keepdims=True)
        share = self.size[facets, None, None] / (self.dim * (self.dim + 1))
        return np.asarray(share * (traction + total), dtype=np.float64)


def simplices(body: Body) -> Simplices:
    """Cells and facets of a body.

    Raises
    ------
    ValueError
        Its cells are no triangles or tetrahedra.
    """
    mesh, points, dim = body.mesh, body.points, body.dim
    corners = np.asarray(mesh.t, dtype=np.int64).T
    if corners.shape[1] != dim + 1:
        raise ValueError(
            f"body {body.name!r} has cells of {corners.shape[1]} corners, expected "
            'triangles or tetrahedra: mesh.element = "P1"'
        )
    facets = np.asarray(mesh.facets, dtype=np.int64).T
    listed = np.asarray(mesh.t2f, dtype=np.int64).T
    # A cell lacks one of its corners in each of its facets: the sums tell which.
    missing = corners.sum(axis=1)[:, None] - facets[listed].sum(axis=2)
    order = np.argmax(missing[:, None] == corners[:, :, None], axis=2)
    facet_of = np.take_along_axis(listed, order, axis=1)
    place = np.argmax(
        facets[facet_of][:, :, None] == corners[:, None, :, None], axis=3
    )
    edges = (points[corners[:, 1:]] - points[corners[:, :1]]).swapaxes(1, 2)
    inner = np.linalg.inv(edges)
    gradients = np.concatenate([-inner.sum(axis=1, keepdims=True), inner], axis=1)
    factorial = 2 if dim == 2 else 6
    volume = np.abs(np.linalg.det(edges)) / factorial
    first = np.asarray(mesh.f2t, dtype=np.int64)[0]
    sign = np.where(first[facet_of] == np.arange(len(corners))[:, None], 1.0, -1.0)
    area = np.empty((len(facets), dim))
    outward = -dim * volume[:, None, None] * gradients
    area[facet_of[sign > 0]] = outward[sign > 0]
    return Simplices(
        points=points,
        corners=corners,
        facets=facets,
        facet_of=facet_of,
        sign=sign,
        place=place,
        gradients=gradients,
        edges=edges,
        volume=volume,
        area=area,
        outside=np.asarray(mesh.f2t)[1] < 0,
    )


def strain(cells: Simplices, displacement: Floats) -> Floats:
    """Strain ``(cells, d, d)`` of nodal displacements ``(nodes, d)``."""
    gradient = np.einsum("cai,caj->cij", displacement[cells.corners], cells.gradients)
    return 0.5 * (gradient + gradient.swapaxes(1, 2))


def elastic(material: Material, deformation: Floats) -> Floats:
    """Stress ``(..., d, d)`` of a strain."""
    dim = deformation.shape[-1]
    lame_lambda, lame_mu = material.lame(dim)
    trace = np.trace(deformation, axis1=-2, axis2=-1)[..., None, None]
    found: Floats = 2 * lame_mu * deformation + lame_lambda * trace * np.eye(dim)
    return found


def complementary(material: Material, stress: Floats) -> Floats:
    """``σ : C⁻¹ σ`` of stresses ``(..., d, d)``."""
    dim = stress.shape[-1]
    lame_lambda, lame_mu = material.lame(dim)
    trace = np.trace(stress, axis1=-2, axis2=-1)
    square = np.einsum("...ij,...ij->...", stress, stress)
    # With the deviator: near ν = 1/2 the plain form is a difference of large numbers.
    deviator = square - trace**2 / dim
    bulk = dim * lame_lambda + 2 * lame_mu
    found: Floats = deviator / (2 * lame_mu) + trace**2 / (dim * bulk)
    return found


def moments(
    cells: Simplices,
    stress: Floats,
    body_force: Floats,
    given: Floats,
    known: NDArray[np.bool_],
) -> Floats:
    """Moments ``∫_F φ_i t_F`` of tractions that obey (P), ``(facets, d nodes, d)``.

    Parameters
    ----------
    cells
        The body.
    stress
        Of the finite elements, ``(cells, d, d)``, in equilibrium at the nodes with the
        loads below.
    body_force
        ``(cells, d)``, force per volume.
    given
        Moments of the tractions that act on facets outside, ``(facets, d nodes, d)``.
    known
        Components that are given, ``(facets, d)``; those of prescribed displacements are
        not, and facets inside have none.

    Raises
    ------
    ValueError
        Around a node nothing can balance its force: a component is prescribed at the
        node, and on no facet that ends in it.
    """
    dim, corners = cells.dim, cells.corners
    count = len(corners)
    # What each cell asks at each of its corners, less the mean of the two tractions.
    asked = cells.volume[:, None, None] * (
        np.einsum("cij,caj->cai", stress, cells.gradients)
        - body_force[:, None] / (dim + 1)
    )
    size = cells.size
    guess = np.zeros((len(size), dim))
    # Twice the mean where there are two cells, the only one outside.
    np.add.at(
        guess,
        cells.facet_of,
        np.einsum("cij,ckj->cki", stress, cells.area[cells.facet_of]),
    )
    guess *= np.where(cells.outside, 1.0, 0.5)[:, None] / dim
    found = np.where(known[:, None], given, guess[:, None])
    pairs = _pairs(dim)
    facet = np.stack([cells.facet_of[:, k] for k, _ in pairs], axis=1)
    at = np.stack([cells.place[:, k, a] for k, a in pairs], axis=1)
    sign = np.stack([cells.sign[:, k] for k, _ in pairs], axis=1)
    corner = np.array([a for _, a in pairs])
    rest = asked.copy()
    for p, (_, a) in enumerate(pairs):
        rest[:, a] -= sign[:, p, None] * found[facet[:, p], at[:, p]]

    # A graph around each node: its cells, joined by the facets between them.
    flat = corners.ravel()
    order = np.argsort(flat, kind="stable")
    many = np.bincount(flat, minlength=len(cells.points))
    rank = np.empty(flat.size, dtype=np.int64)
    start = np.concatenate([[0], np.cumsum(many)])[:-1]
    rank[order] = np.arange(flat.size) - np.repeat(start, many)
    rank = rank.reshape(count, dim + 1)
    # The other cell of each facet, by its local number at the same corner.
    key = (facet * dim + at).ravel()
    mine = rank[:, corner].ravel()
    total = np.bincount(key, mine, minlength=len(size) * dim)
    shared = ~cells.outside[facet].ravel()
    other = np.where(shared, total[key] - mine, mine).astype(np.int64)
    # The square of a change of moment over the area: that of the change of traction.
    free = np.where(known, 0.0, size[:, None])
    shift = np.zeros_like(rest)
    node = corners[:, corner].ravel()
    for n in np.unique(many[many > 0]):
        nodes = np.flatnonzero(many == n)
        index = np.full(len(many), -1)
        index[nodes] = np.arange(len(nodes))
        here = np.flatnonzero(many[node] == n)
        row = (index[node[here]] * n + mine[here]) * n
        whose = order[(start[nodes][:, None] + np.arange(n)).ravel()]
        right = rest.reshape(-1, dim)[whose].reshape(len(nodes), n, dim)
        for k in range(dim):
            weight = free[facet.ravel()[here], k]
            across = np.where(shared[here], weight, 0.0)
            cells_by_cells = len(nodes) * n * n
            graph = np.bincount(row + mine[here], weight, cells_by_cells)
            graph -= np.bincount(row + other[here], across, cells_by_cells)
            graph = graph.reshape(len(nodes), n, n)
            open_ends = np.bincount(
                index[node[here]], np.where(shared[here], 0.0, weight), len(nodes)
            )
            # Nothing but facets inside or given: the sum of all equations is that of
            # the node, and the shift of all is free.
            scale = np.trace(graph, axis1=1, axis2=2) / n
            scale = np.where(scale > 0, scale, 1.0)
            graph += np.where(open_ends > 0, 0.0, scale)[:, None, None] / n
            solved = np.linalg.solve(graph, right[:, :, k, None])[..., 0]
            shift.reshape(-1, dim)[whose, k] = solved.ravel()
    for p, (_, a) in enumerate(pairs):
        # Each facet inside is met from both its cells, and gets the difference.
        change = sign[:, p, None] * free[facet[:, p]] * shift[:, a]
        np.add.at(found, (facet[:, p], at[:, p]), change)
    _check(cells, asked, found, pairs)
    return found


def by_cell(cells: Simplices, found: Floats) -> Floats:
    """Outward moments ``(cells, d + 1, d + 1, d)``: facet opposite to k, corner a."""
    dim = cells.dim
    outward = np.zeros((len(cells.corners), dim + 1, dim + 1, dim))
    for k, a in _pairs(dim):
        outward[:, k, a] = (
            cells.sign[:, k, None] * found[cells.facet_of[:, k], cells.place[:, k, a]]
        )
    return outward


def equilibrated(
    cells: Simplices,
    stress: Floats,
    body_force: Floats,
    given: Floats,
    known: NDArray[np.bool_],
) -> Floats:
    """Stress in equilibrium with the loads in every point; arguments as of `moments`.

    Returns
    -------
    stress : (cells, d + 1, d + 1, d, d)
        As of `johnson_mercier.stress`.
    """
    tractions = by_cell(cells, moments(cells, stress, body_force, given, known))
    return johnson_mercier.stress(cells.edges, cells.gradients, tractions)


def _pairs(dim: int) -> Sequence[tuple[int, int]]:
    """Facets of a cell by the corner opposite, with the corners that they have."""
    return [(k, a) for k in range(dim + 1) for a in range(dim + 1) if a != k]


def _check(
    cells: Simplices,
    asked: Floats,
    found: Floats,
    pairs: Sequence[tuple[int, int]],
) -> None:
    left, terms = asked.copy(), np.abs(asked)
    for k, a in pairs:
        moment = found[cells.facet_of[:, k], cells.place[:, k, a]]
        left[:, a] -= cells.sign[:, k, None] * moment
        terms[:, a] += np.abs(moment)
    # Equations of nodes are met to the rounding of a factorisation; a force that
    # nothing balances leaves its own size. Compared with the largest moment: next to a
    # corner that carries everything, far cells know their digits only so far.
    bad = np.abs(left).max(axis=2)
    worst = np.unravel_index(int(np.argmax(bad)), bad.shape)
    if bad[worst] > 1e-6 * terms.max():
        place = ", ".join(f"{x:g}" for x in cells.points[cells.corners[worst]])
        raise ValueError(
            f"no tractions balance the forces at the node at ({place}): a displacement is "
            "prescribed at this node, and on no whole facet that ends in it"
        )
