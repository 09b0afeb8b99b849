"""Where a rigid obstacle is at the contacts of a surface, at the start and in each step."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from bipot_rs._lib.types import Floats, Ints
from bipot_rs.fem.contact.contact import Contact, rigid_obstacle
from bipot_rs.fem.contact.surfaces import ContactSurface, split_clearance
from bipot_rs.mortar.facet_mesh import FacetMesh
from bipot_rs.obstacle.motion import Approach, Motion, approach
from bipot_rs.obstacle.protocol import Obstacle

if TYPE_CHECKING:
    from bipot_rs.mortar.integrals import Weights


def follow_obstacle(
    side: ContactSurface,
    contact: Contact,
    motion: Motion | None,
    nodes: Ints,
    since: int = 0,
) -> Approach:
    """Normals, gaps with clearance, and drag at contact nodes, in the states of a motion.

    ``side``: the surface of the contact.
    ``motion``: instead of that of the contact.
    ``nodes``: nodes of the body that have the contacts, ``(n_c,)``.
    ``since``: the first state, as in `approach`.
    """
    if contact.pairing != "match":
        return weigh_obstacle(side, contact, motion, since)[2]
    obstacle = rigid_obstacle(contact, side.body.dim)
    met = _approach_nodes(side, obstacle, motion, nodes, since)
    smooth, nodal = split_clearance(contact, side)
    clearance = smooth(side.body.points[nodes]) + nodal[nodes]
    return met._replace(distance=met.distance + clearance)


def weigh_obstacle(
    side: ContactSurface, contact: Contact, motion: Motion | None, since: int = 0
) -> tuple[FacetMesh, Weights, Approach]:
    """Weighted means of gap and drag over a surface, and normals at its contact nodes."""
    from bipot_rs.mortar.pairs import weigh_surface

    if contact.pairing != "mortar":
        raise ValueError(
            f"pairing is {contact.pairing!r}, expected 'match' or 'mortar' for a rigid "
            "obstacle"
        )
    obstacle = rigid_obstacle(contact, side.body.dim)
    smooth, nodal = split_clearance(contact, side)
    states = 1 if motion is None else 1 + motion.steps - since

    def fields(places: Floats) -> Floats:
        """Distances in all states, then drags in those after the first."""
        met = approach(obstacle, motion, places, since=since)
        apart = (met.distance + smooth(places)).T
        drag = met.drag[1:].transpose(1, 0, 2).reshape(len(places), -1)
        return np.column_stack([apart, drag])

    slave = side.mesh()
    weights = weigh_surface(slave, fields)
    met = _approach_nodes(side, obstacle, motion, weights.node, since)
    drag = np.zeros_like(met.drag)
    means = weights.clearance[states:].reshape(states - 1, slave.dim, len(weights.node))
    drag[1:] = means.transpose(0, 2, 1)
    gap = weights.clearance[:states] + weights.slave @ nodal
    return slave, weights, Approach(met.normal, gap, drag)


def _approach_nodes(
    side: ContactSurface,
    obstacle: Obstacle,
    motion: Motion | None,
    nodes: Ints,
    since: int,
) -> Approach:
    points, outward = side.body.points[nodes], side.normals[nodes]
    try:
        return approach(obstacle, motion, points, outward, since)
    except ValueError as error:
        raise ValueError(f"obstacle of the contact on {side.name!r}: {error}") from None
