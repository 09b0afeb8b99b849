"""Where surfaces of bodies meet obstacles and each other: frames, gaps, areas, B of (2)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from scipy import sparse

from bipot_rs._lib.messages import place
from bipot_rs._lib.types import CsrMatrix, Floats, Ints
from bipot_rs.contact.law.frames import frames, operator, turn_frames
from bipot_rs.contact.path.moving_gaps import MovingGaps
from bipot_rs.fem.bodies.body import NumberedBodies, NumberedBody
from bipot_rs.fem.contact.contact import (
    Contact,
    ContactSurface,
    both,
    evaluate_clearance,
    refuse_itself,
    refuse_negative_areas,
    rigid_obstacle,
    split_clearance,
)
from bipot_rs.fem.tuning import ALL_PAIRS
from bipot_rs.mortar.facet_mesh import FacetMesh
from bipot_rs.obstacle.motion import Approach, Motion, approach
from bipot_rs.obstacle.protocol import Obstacle

if TYPE_CHECKING:
    from bipot_rs.mortar.integrals import Weights
    from bipot_rs.mortar.pairs import Pairs


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
    distance = _drop_rounding(
        met.distance + clearance, side.body.points[nodes], obstacle, motion
    )
    return met._replace(distance=distance)


def _drop_rounding(gap: Floats, points: Floats, *others: object) -> Floats:
    """Gaps without the rounding of coordinates: zero where nodes touch.

    A node that supports hold may not penetrate, however little. ``others``: an obstacle and
    its motion.
    """
    size = max([float(np.abs(points).max(initial=0.0)), *map(_measure, others)])
    rounding = 8 * np.finfo(np.float64).eps * size
    return np.where(np.abs(gap) <= rounding, 0.0, gap)


def _measure(part: object) -> float:
    """The largest length of an obstacle or a motion, whose rounding distances have."""
    sizes = [_measure(inner) for inner in getattr(part, "obstacles", ())]
    for name in ("point", "centre", "radius", "major_radius", "translation", "about"):
        value = np.asarray(getattr(part, name, 0.0))
        # Obstacles of users may have anything by these names.
        if value.dtype.kind in "fiu":
            sizes.append(float(np.abs(value).max(initial=0.0)))
    return max(sizes, default=0.0)


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
    gap = _drop_rounding(gap, side.body.points[weights.node], obstacle, motion)
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


# The faces of a crack may overlap by the digits of a mesh file, relative to the body.
_CLOSED = 1e-7


@dataclass(frozen=True)
class Meeting:
    """The contact nodes of one `Contact`, with gaps and rows of B."""

    points: Floats  # (n_c, d): positions of the contact nodes [m]
    frame: Floats  # (n_c, d, d): rows n, t1[, t2], n from the obstacle towards the body
    # gap, area (n_c,): normal gap [m] and tributary area [m²].
    gap: Floats
    area: Floats
    # (n_c, 2): first degree of freedom of the node and of its partner, -1 without one.
    dofs: Ints
    # Sparse (d n_c, n) or None: rows of B, if they are not one node minus another node.
    rows: CsrMatrix | None = None
    # Approach or None: normals, gaps and drag of each step, if the obstacle moves.
    moved: Approach | None = None


def meet(bodies: NumberedBodies, n: int, contact: Contact) -> Meeting:
    """Find the contact nodes of one surface; a `ValueError` gives names and position."""
    numbered = bodies[contact.body]
    side = ContactSurface(numbered.body, contact.surface, contact.within)
    if not side.nodes.size:
        raise ValueError(
            f"contact on {contact.surface!r} of body {contact.body!r} has no nodes: within "
            "excludes all of them"
        )
    other = opposite = None
    if contact.against is not None:
        other = bodies[contact.against[0]]
        opposite = ContactSurface(other.body, contact.against[1])
    if contact.pairing != "match":
        return _meet_weighted(contact, (numbered, other), (side, opposite), n)
    refuse_negative_areas(side)
    nodes, facets, body = side.nodes, side.facets, side.body
    if other is numbered and opposite is not None:
        nodes = np.setdiff1d(nodes, opposite.nodes)
    area = body.depth * facets.moment(np.ones(facets.weights.shape))[nodes]
    points, moved = body.points[nodes], None
    if body.axisymmetric and (area <= 1e-12 * area.max()).any():
        at = place(points[np.argmin(area)])
        raise ValueError(
            f"contact on {contact.surface!r} of body {contact.body!r} has no area at {at}, on "
            'the axis: leave facets along the axis out of the surface, and use pairing="mortar" '
            "for cells of second order"
        )
    if other is None or opposite is None:
        met = follow_obstacle(side, contact, contact.motion, nodes)
        frame, gap = frames(met.normal[0], contact.axis), met.distance[0]
        moved = None if contact.motion is None else met.after()
        partner = np.full(len(nodes), -1, dtype=np.int64)
    else:
        frame = frames(-side.normals[nodes], contact.axis)
        facing = _find_opposite(side, nodes, opposite, contact, frame)
        partner = other.dofs[facing, 0]
        between = points - other.body.points[facing]
        gap = np.einsum("cd,cd->c", frame[:, 0], between)
        if (
            other is numbered
            and gap.min() < -_CLOSED * np.ptp(body.points, axis=0).max()
        ):
            refuse_itself(contact)
        gap = _drop_rounding(gap + evaluate_clearance(contact, points), points)
    dofs = np.stack([numbered.dofs[nodes, 0], partner], axis=1)
    return Meeting(points, frame, gap, area, dofs, moved=moved)


def _find_opposite(
    side: ContactSurface,
    nodes: Ints,
    opposite: ContactSurface,
    contact: Contact,
    frame: Floats,
) -> Ints:
    """Nodes of the other body opposite to the nodes of a contact, one to one."""
    points, theirs = side.body.points[nodes], opposite.nodes
    # Size of the whole surface: `within` may leave a single node.
    size = np.ptp(side.body.points[side.facets.corners.ravel()], axis=0).max()
    matched = match_nodes(points, opposite.body.points[theirs], frame, contact, size)
    facing = theirs[matched]
    towards = np.einsum("cd,cd->c", frame[:, 0], opposite.normals[facing])
    away = np.flatnonzero(towards <= 0)
    if away.size:
        raise ValueError(
            f"surfaces {both(contact)} do not face each other at "
            f"{place(points[away[0]])}: their outward normals must be opposite"
        )
    return facing


def _meet_weighted(
    contact: Contact,
    bodies: tuple[NumberedBody, NumberedBody | None],
    sides: tuple[ContactSurface, ContactSurface | None],
    n: int,
) -> Meeting:
    """Contacts for ``pairing="mortar"`` and ``pairing="nodes"``."""
    (numbered, other), (side, opposite) = bodies, sides
    body, moved = side.body, None
    dofs = numbered.dofs
    if other is None or opposite is None:
        from bipot_rs.mortar.pairs import make_rigid_pairs

        try:
            slave, weights, met = weigh_obstacle(side, contact, contact.motion)
        except ValueError as error:
            raise ValueError(f"contact on {contact.surface!r}: {error}") from error
        columns = dofs, np.zeros((0, body.dim), np.int64), n
        pairs = make_rigid_pairs(slave, weights, met.normal[0], contact.axis, columns)
        pairs = replace(pairs, gap=met.distance[0])
        moved = None if contact.motion is None else met.after()
    else:
        columns = dofs, other.dofs, n
        pairs = _pair_bodies(side, opposite, contact, columns)
    partner = np.full(len(pairs.node), -1, dtype=np.int64)
    return Meeting(
        points=pairs.points,
        frame=pairs.frame,
        gap=_drop_rounding(pairs.gap, pairs.points),
        area=body.depth * pairs.area,
        dofs=np.stack([numbered.dofs[pairs.node, 0], partner], axis=1),
        rows=pairs.B,
        moved=moved,
    )


def _pair_bodies(
    side: ContactSurface,
    opposite: ContactSurface,
    contact: Contact,
    columns: tuple[Ints, Ints, int],
) -> Pairs:
    from bipot_rs.mortar.pairs import pair_surfaces

    clearance = contact.clearance
    if not callable(clearance):
        # One number, or one for each node of the body.
        clearance = (
            split_clearance(contact, side)[1]
            if np.ndim(clearance)
            else evaluate_clearance(contact, side.body.points)
        )
    return pair_surfaces(
        side.mesh(),
        opposite.mesh(),
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
    for met in meetings:
        # A partner of -1 stays negative in its first component.
        sides = [first[:, None] + np.arange(met.frame.shape[1]) for first in met.dofs.T]
        rows.append(operator(met.frame, sides, n) if met.rows is None else met.rows)
    # The empty first block allows for no contacts.
    made: CsrMatrix = sparse.csr_array(
        sparse.vstack([sparse.csr_array((0, n)), *rows], "csr")
    )
    return made


def gaps_of_steps(
    meetings: Sequence[Meeting],
    contacts: Sequence[Contact],
    frame: Floats,
    turned: bool,
) -> MovingGaps | None:
    """Gaps, frames and drag of each step for all contacts; None if no obstacle moves.

    ``frame``: frames at the start, ``(n_c, d, d)``.
    ``turned``: whether their tangents were turned to those of inclined supports.
    """
    steps = sorted({len(met.moved.drag) for met in meetings if met.moved is not None})
    if not steps:
        return None
    if len(steps) > 1:
        raise ValueError(
            f"the motions of obstacles have {' and '.join(map(str, steps))} steps: give "
            "all the same number of steps"
        )
    parts, first = [], 0
    for met, contact in zip(meetings, contacts, strict=True):
        at_start = frame[first : first + len(met.gap)]
        first += len(met.gap)
        moved = met.moved
        if moved is None:
            shape = steps[0], *at_start.shape
            gap, bases = (
                np.broadcast_to(met.gap, shape[:2]),
                np.broadcast_to(at_start, shape),
            )
            parts.append((gap, bases, np.zeros(shape[:3])))
        else:
            bases = frames_of_steps(contact, at_start, moved.normal, turned)
            parts.append((moved.distance, bases, moved.drag))
    return MovingGaps(
        *(np.concatenate(part, axis=1) for part in zip(*parts, strict=True))
    )


def frames_of_steps(
    contact: Contact, frame: Floats, normals: Floats, turned: bool
) -> Floats:
    """Frames ``(steps, n_c, d, d)`` with given normals, one after the other from ``frame``.

    Tangents turn as little as normals do, unless ``axis`` determines them.
    """
    bases = np.empty((*normals.shape[:2], *frame.shape[1:]))
    for k, normal in enumerate(normals):
        before = frame if k == 0 else bases[k - 1]
        bases[k] = turn_frames(before, normal)
        if contact.axis is not None and (np.ndim(contact.mu) == 1 or not turned):
            other = (bases[k] != before).any(axis=(1, 2))
            bases[k, other] = frames(normal[other], contact.axis)
    return bases


def match_nodes(
    ours: Floats, theirs: Floats, frame: Floats, contact: Contact, size: float
) -> Ints:
    """Index of the node opposite to each of ours, along the normal."""
    match = nearest_points(ours, theirs)
    between = ours - theirs[match]
    along = np.einsum("cd,cd->c", frame[:, 0], between)
    aside = np.linalg.norm(between - along[:, None] * frame[:, 0], axis=1)
    # Coordinates of one point from two meshers differ in the last digits.
    bad = np.flatnonzero(aside > 1e-7 * size)
    if bad.size:
        raise ValueError(
            f"surfaces {both(contact)} do not match: no node lies opposite to the node at "
            f"{place(ours[bad[0]])}, the nearest is {aside[bad[0]]:g} aside; use "
            "pairing='mortar', or meshes with opposite nodes"
        )
    values, counts = np.unique(match, return_counts=True)
    if np.any(counts > 1):
        raise ValueError(
            f"surfaces {both(contact)} do not match: the node at "
            f"{place(theirs[values[counts > 1][0]])} lies opposite to several nodes; use "
            "pairing='mortar'"
        )
    return np.asarray(match, dtype=np.int64)


def nearest_points(ours: Floats, theirs: Floats) -> Ints:
    """Index in ``theirs`` of the point nearest to each of ``ours``."""
    if len(ours) * len(theirs) > ALL_PAIRS:
        from scipy.spatial import cKDTree

        _, match = cKDTree(theirs).query(ours)
        return np.asarray(match, dtype=np.int64)
    distance = np.zeros((len(ours), len(theirs)))
    for mine, other in zip(ours.T, theirs.T, strict=True):
        distance += np.subtract.outer(mine, other) ** 2
    return np.asarray(distance.argmin(axis=1), dtype=np.int64)
