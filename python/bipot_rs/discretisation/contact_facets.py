"""Facets on which contact acts, and the curvature of the gap on them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from bipot_rs._lib.messages import place
from bipot_rs._lib.types import Bools, Floats, Ints
from bipot_rs.discretisation.simplices import Simplices
from bipot_rs.fem.assembly.assembly import Assembly
from bipot_rs.fem.contact.contact import both


@dataclass(frozen=True)
class FacetSide:
    """Contact facets on one of the two bodies."""

    # body, facet (m,): index of the body, and of the facet in its mesh.
    body: Ints
    facet: Ints
    contact: Ints  # (m, d): contact at each node of the facet


@dataclass(frozen=True)
class ContactFacets:
    """Facets whose nodes are all contacts."""

    # first, second: facets of the bodies that have the contacts, and the opposite facets;
    # the latter are missing for a rigid obstacle.
    first: FacetSide
    second: FacetSide
    area: Floats  # (m,): areas of `first`, including the thickness [m²]
    # (n_c,): tributary area of each contact [m²]; at the rim of `within` smaller than that of
    # the model.
    node_area: Floats
    edges: Ints  # (e, 2): contacts at the ends of the edges of `first`
    # (m, d (d - 1)/2): edges of each facet, in the order of `itertools.combinations` of its
    # nodes.
    edge_of: Ints
    # (e,): k_ij of the gap `g = Σ φ_i g_i - Σ k_ij φ_i φ_j` on a facet [m], from the gap at the
    # midpoints of edges; exact for `r²/(2 radius)`.
    curvature: Floats

    def traction_moments(
        self, bodies: Sequence[Simplices], traction: Floats
    ) -> list[Floats]:
        """Moments ``(facets, d nodes, d)`` on each body, of tractions linear on facets.

        ``bodies``: all bodies.
        ``traction``: traction on ``first`` at the contacts, ``(n_c, d)`` in global components.
        """
        moments = [np.zeros((len(b.facets), b.dim, b.dim)) for b in bodies]
        for side, sign in ((self.first, 1.0), (self.second, -1.0)):
            for owner, cells in enumerate(bodies):
                here = side.body == owner
                number = side.facet[here]
                nodal = sign * traction[side.contact[here]]
                np.add.at(moments[owner], number, cells.linear_moments(number, nodal))
        return moments


def contact_facets(model: Assembly, bodies: Sequence[Simplices]) -> ContactFacets:
    """Find the contact facets of a model.

    Raises `ValueError`: meshes in contact that do not match, a crack in one body, a contact
    node without contact facet, normals that change on a facet, or opposite quadrilaterals split
    along different diagonals.
    """
    dim = model.dim
    first: list[tuple[int, Ints, Ints]] = []
    second: list[tuple[int, Ints, Ints]] = []
    for group, contact in enumerate(model.contacts):
        if contact.against is not None and contact.against[0] == contact.body:
            # Facets at a tip carry tractions, but the tip is no contact.
            raise ValueError(
                f"surfaces {both(contact)} are the faces of a crack: the discretisation "
                "error needs contacts at all nodes of their facets"
            )
        mine = np.flatnonzero(model.group == group)
        numbered = model.numbered[contact.body]
        owner, cells = numbered.index, bodies[numbered.index]
        of_node = np.full(len(cells.points), -1)
        of_node[numbered.nodes_at(model.contact_dofs[mine, 0])] = mine
        facets = numbered.body.facets(contact.surface)
        at = of_node[cells.facets[facets]]
        whole = (at >= 0).all(axis=1)
        first.append((owner, facets[whole], at[whole]))
        if contact.against is None:
            continue
        numbered = model.numbered[contact.against[0]]
        obstacle, other = numbered.index, bodies[numbered.index]
        of_node = np.full(len(other.points), -1)
        of_node[numbered.nodes_at(model.contact_dofs[mine, 1])] = mine
        facets = numbered.body.facets(contact.against[1])
        theirs = of_node[other.facets[facets]]
        number_of_facet = {tuple(sorted(c)): i for i, c in enumerate(theirs.tolist())}
        match = [number_of_facet.get(tuple(sorted(c)), -1) for c in at[whole].tolist()]
        if -1 in match:
            raise ValueError(
                f"surfaces {both(contact)} do not match facet by facet: mesh both with the "
                "same facets"
            )
        second.append((obstacle, facets[match], theirs[match]))
    ours, opposite = _side(first, dim), _side(second, dim)
    frames = model.frame[ours.contact]
    # 1e-9: frames on a flat facet are equal up to rounding.
    if (np.abs(frames - frames[:, :1]) > 1e-9).any():
        raise ValueError(
            "a contact surface is curved: the discretisation error needs flat facets, each "
            "with one normal"
        )
    area = np.zeros(len(ours.facet))
    for owner, body in enumerate(model.bodies):
        here = ours.body == owner
        area[here] = body.depth * bodies[owner].size[ours.facet[here]]
    node_area = np.bincount(
        ours.contact.ravel(), np.repeat(area / dim, dim), minlength=len(model.gap)
    )
    if (node_area == 0).any():
        where = place(model.points[np.argmin(node_area)])
        raise ValueError(
            f"the contact node at {where} belongs to no facet whose nodes are all contacts, "
            "so that its force acts on no area: extend the contact surface"
        )
    pairs = [ours.contact[:, list(pair)] for pair in combinations(range(dim), 2)]
    ends = np.sort(np.stack(pairs, axis=1), axis=2)
    edges, inverse = np.unique(ends.reshape(-1, 2), axis=0, return_inverse=True)
    return ContactFacets(
        first=ours,
        second=opposite,
        area=area,
        node_area=np.asarray(node_area),
        edges=edges,
        edge_of=inverse.reshape(ends.shape[:2]),
        curvature=_curvature(model, edges),
    )


def prescribed_facets(model: Assembly, bodies: Sequence[Simplices]) -> list[Bools]:
    """Mask of components prescribed on whole facets of each body, ``(facets, d)``."""
    dim = model.dim
    names = [body.name for body in model.bodies]
    held = [np.zeros((len(cells.facets), dim), dtype=np.bool_) for cells in bodies]
    for support in model.supports:
        if support.surface is None:
            continue
        owner = names.index(support.body)
        body, cells = model.bodies[owner], bodies[owner]
        facets = body.facets(support.surface)
        nodes = body.nodes(support.surface, support.within)
        whole = facets[np.isin(cells.facets[facets], nodes).all(axis=1)]
        components = np.array(support.components, dtype=np.int64)
        held[owner][whole[:, None], components] = True
    return held


def _side(parts: Sequence[tuple[int, Ints, Ints]], dim: int) -> FacetSide:
    none = (np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros((0, dim), np.int64))
    body = [np.full(len(facets), owner) for owner, facets, _ in parts]
    return FacetSide(
        np.concatenate([none[0], *body]),
        np.concatenate([none[1], *(facets for _, facets, _ in parts)]),
        np.concatenate([none[2], *(at for _, _, at in parts)]),
    )


def _curvature(model: Assembly, edges: Ints) -> Floats:
    curvature = np.zeros(len(edges))
    for group, contact in enumerate(model.contacts):
        if not callable(contact.clearance):
            continue
        here = model.group[edges[:, 0]] == group
        ends = model.points[edges[here]]
        nodal = [np.asarray(contact.clearance(x)) for x in (ends[:, 0], ends[:, 1])]
        middle = np.asarray(contact.clearance(ends.mean(axis=1)))
        curvature[here] = 4 * (0.5 * (nodal[0] + nodal[1]) - middle)
    return curvature
