"""Where a rigid obstacle is at the contacts of a surface, at the start and in each step."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from bipot_rs._lib.types import Floats, Ints
from bipot_rs.fem.bodies.body import Body
from bipot_rs.fem.contact.contact import Contact, rigid_obstacle
from bipot_rs.fem.contact.surfaces import facets_of, outward, split_clearance
from bipot_rs.mortar.facet_mesh import FacetMesh, surface
from bipot_rs.obstacle.motion import Approach, Motion, approach

if TYPE_CHECKING:
    from bipot_rs.mortar.integrals import Weights


def follow_obstacle(
    body: Body, contact: Contact, motion: Motion | None, nodes: Ints, since: int = 0
) -> Approach:
    """Normals, gaps with clearance, and drag at contact nodes, in the states of a motion.

    Parameters
    ----------
    motion
        Instead of that of the contact.
    nodes
        Nodes of the body that have the contacts, ``(n_c,)``.
    since
        The first state, as in `approach`.
    """
    if contact.pairing != "match":
        return weigh_obstacle(body, contact, motion, since)[2]
    met = _approach_nodes(body, contact, motion, nodes, since)
    smooth, nodal = split_clearance(contact, body)
    clearance = smooth(body.points[nodes]) + nodal[nodes]
    return met._replace(distance=met.distance + clearance)


def weigh_obstacle(
    body: Body, contact: Contact, motion: Motion | None, since: int = 0
) -> tuple[FacetMesh, Weights, Approach]:
    """Weighted means of gap and drag over a surface, and normals at its contact nodes."""
    from bipot_rs.mortar.pairs import weigh_surface

    if contact.pairing != "mortar":
        raise ValueError(
            f"pairing is {contact.pairing!r}, expected 'match' or 'mortar' for a rigid "
            "obstacle"
        )
    obstacle = rigid_obstacle(contact, body.dim)
    smooth, nodal = split_clearance(contact, body)
    states = 1 if motion is None else 1 + motion.steps - since

    def fields(places: Floats) -> Floats:
        """Distances in all states, then drags in those after the first."""
        met = approach(obstacle, motion, places, since=since)
        apart = (met.distance + smooth(places)).T
        drag = met.drag[1:].transpose(1, 0, 2).reshape(len(places), -1)
        return np.column_stack([apart, drag])

    name = f"{contact.body}.{contact.surface}"
    slave = surface(f"points of {name}", body.points, name, facets_of(contact, body))
    found = weigh_surface(slave, fields)
    met = _approach_nodes(body, contact, motion, found.node, since)
    drag = np.zeros_like(met.drag)
    means = found.clearance[states:].reshape(states - 1, body.dim, len(found.node))
    drag[1:] = means.transpose(0, 2, 1)
    gap = found.clearance[:states] + found.slave @ nodal
    return slave, found, Approach(met.normal, gap, drag)


def _approach_nodes(
    body: Body, contact: Contact, motion: Motion | None, nodes: Ints, since: int
) -> Approach:
    obstacle, facing = rigid_obstacle(contact, body.dim), outward(body, contact.surface)
    try:
        return approach(obstacle, motion, body.points[nodes], facing[nodes], since)
    except ValueError as error:
        raise ValueError(
            f"obstacle of the contact on {contact.surface!r}: {error}"
        ) from None
