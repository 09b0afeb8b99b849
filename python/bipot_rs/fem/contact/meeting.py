"""Where surfaces of bodies meet obstacles and each other: frames, gaps, areas, B of (2)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from scipy import sparse

from bipot_rs._lib.messages import place
from bipot_rs._lib.types import CsrMatrix, Floats, Ints
from bipot_rs.contact.law.frames import frames, operator
from bipot_rs.fem.bodies.body import Body, body_index
from bipot_rs.fem.contact.contact import Contact, both, check_contact, surface_names
from bipot_rs.fem.contact.matching import match_nodes
from bipot_rs.fem.contact.rigid import follow_obstacle, weigh_obstacle
from bipot_rs.fem.contact.surfaces import (
    evaluate_clearance,
    facets_of,
    facets_outward,
    nodal_normals,
    refuse_negative_areas,
    split_clearance,
)
from bipot_rs.mortar.facet_mesh import surface
from bipot_rs.obstacle.motion import Approach

if TYPE_CHECKING:
    from bipot_rs.mortar.pairs import Pairs


@dataclass(frozen=True)
class Meeting:
    """The contact nodes of one `Contact`, with gaps and rows of B.

    Attributes
    ----------
    points : (n_c, d)
        Positions of the contact nodes [m].
    frame : (n_c, d, d)
        Rows n, t1[, t2], n from the obstacle towards the body.
    gap, area : (n_c,)
        Normal gap [m] and tributary area [m²].
    dofs : (n_c, 2)
        First degree of freedom of the node and of its partner, -1 without one.
    rows : sparse (d n_c, n) or None
        Rows of B, if they are not one node minus another node.
    moved : Approach or None
        Normals, gaps and drag of each step, if the obstacle moves.
    """

    points: Floats
    frame: Floats
    gap: Floats
    area: Floats
    dofs: Ints
    rows: CsrMatrix | None = None
    moved: Approach | None = None


def meet(
    bodies: Sequence[Body], offset: Sequence[int], n: int, contact: Contact
) -> Meeting:
    """Find the contact nodes of one surface; a `ValueError` gives names and position."""
    check_contact(contact, bodies[0].dim)
    b = body_index(bodies, contact.body)
    body, other = bodies[b], None
    nodes = body.nodes(contact.surface, contact.within)
    if not nodes.size:
        raise ValueError(
            f"contact on {contact.surface!r} of body {body.name!r} has no nodes: within "
            "excludes all of them"
        )
    if contact.against is not None:
        other = body_index(bodies, contact.against[0])
        if other == b:
            raise ValueError(
                f"body {body.name!r} is in contact with itself: against must name another "
                "body"
            )
    if contact.pairing != "match":
        return _meet_weighted(bodies, offset, n, contact, (b, other))
    refuse_negative_areas(body, contact.surface)
    facets = body.surface(contact.surface)
    area = body.depth * facets.moment(np.ones(facets.weights.shape))[nodes]
    points, moved = body.points[nodes], None
    partner = np.full(len(nodes), -1, dtype=np.int64)
    if other is None:
        met = follow_obstacle(body, contact, contact.motion, nodes)
        frame, gap = frames(met.normal[0], contact.axis), met.distance[0]
        moved = None if contact.motion is None else met.after()
    else:
        frame = frames(-nodal_normals(facets)[nodes], contact.axis)
        opposite = _find_opposite(body, bodies[other], contact, nodes, frame)
        partner = offset[other] + body.dim * opposite
        between = points - bodies[other].points[opposite]
        gap = np.einsum("cd,cd->c", frame[:, 0], between)
        gap = gap + evaluate_clearance(contact, points)
    dofs = np.stack([offset[b] + body.dim * nodes, partner], axis=1)
    return Meeting(points, frame, gap, area, dofs, moved=moved)


def _find_opposite(
    body: Body, other: Body, contact: Contact, nodes: Ints, frame: Floats
) -> Ints:
    """Nodes of the other body opposite to the nodes of a contact, one to one."""
    name = (contact.against or ("", ""))[1]
    theirs, points = other.nodes(name), body.points[nodes]
    # Size of the whole surface: `within` may leave a single node.
    size = np.ptp(body.points[body.nodes(contact.surface)], axis=0).max()
    opposite = theirs[match_nodes(points, other.points[theirs], frame, contact, size)]
    facing = nodal_normals(other.surface(name))[opposite]
    away = np.flatnonzero(np.einsum("cd,cd->c", frame[:, 0], facing) <= 0)
    if away.size:
        raise ValueError(
            f"surfaces {both(contact)} do not face each other at "
            f"{place(points[away[0]])}: their outward normals must be opposite"
        )
    return opposite


def _meet_weighted(
    bodies: Sequence[Body],
    offset: Sequence[int],
    n: int,
    contact: Contact,
    sides: tuple[int, int | None],
) -> Meeting:
    """Contacts for ``pairing="mortar"`` and ``pairing="nodes"``."""
    b, other = sides
    body, moved = bodies[b], None

    def numbers(i: int) -> Ints:
        count = body.dim * len(bodies[i].points)
        return offset[i] + np.arange(count).reshape(-1, body.dim)

    if other is None:
        from bipot_rs.mortar.pairs import make_rigid_pairs

        try:
            slave, found, met = weigh_obstacle(body, contact, contact.motion)
        except ValueError as error:
            raise ValueError(f"contact on {contact.surface!r}: {error}") from error
        columns = numbers(b), np.zeros((0, body.dim), np.int64), n
        pairs = make_rigid_pairs(slave, found, met.normal[0], contact.axis, columns)
        pairs = replace(pairs, gap=met.distance[0])
        moved = None if contact.motion is None else met.after()
    else:
        columns = numbers(b), numbers(other), n
        pairs = _pair_bodies(body, bodies[other], contact, columns)
    partner = np.full(len(pairs.node), -1, dtype=np.int64)
    return Meeting(
        points=pairs.points,
        frame=pairs.frame,
        gap=pairs.gap,
        area=body.depth * pairs.area,
        dofs=np.stack([offset[b] + body.dim * pairs.node, partner], axis=1),
        rows=pairs.B,
        moved=moved,
    )


def _pair_bodies(
    body: Body, other: Body, contact: Contact, columns: tuple[Ints, Ints, int]
) -> Pairs:
    from bipot_rs.mortar.pairs import pair_surfaces

    slave, master = surface_names(contact)
    ours = facets_of(contact, body)
    theirs = facets_outward(other, (contact.against or ("", ""))[1])
    clearance = contact.clearance
    if not callable(clearance):
        # One number, or one for each node of the body.
        clearance = (
            split_clearance(contact, body)[1]
            if np.ndim(clearance)
            else evaluate_clearance(contact, body.points)
        )
    return pair_surfaces(
        surface(f"points of {slave}", body.points, slave, ours),
        surface(f"points of {master}", other.points, master, theirs),
        method=contact.pairing,
        clearance=clearance,
        axis=contact.axis,
        columns=columns,
    )


def relative_displacement(meetings: Sequence[Meeting], n: int) -> CsrMatrix:
    """B of (2), contact after contact."""
    if not meetings:
        empty: CsrMatrix = sparse.csr_array((0, n))
        return empty
    rows = []
    for one in meetings:
        # A partner of -1 stays negative in its first component.
        sides = [first[:, None] + np.arange(one.frame.shape[1]) for first in one.dofs.T]
        rows.append(operator(one.frame, sides, n) if one.rows is None else one.rows)
    # The empty first block allows for no contacts.
    made: CsrMatrix = sparse.csr_array(
        sparse.vstack([sparse.csr_array((0, n)), *rows], "csr")
    )
    return made
