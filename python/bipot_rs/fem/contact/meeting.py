"""Where surfaces of bodies meet obstacles and each other: frames, gaps, areas, B of (2)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike
from scipy import sparse

from bipot_rs._lib.messages import place
from bipot_rs._lib.types import Floats, Ints
from bipot_rs._lib.validation import RATIO, floats, friction, number, shown
from bipot_rs.contact.law.frames import frames, operator
from bipot_rs.fem.bodies.body import Body, Box, Quadrature
from bipot_rs.mortar.facet_mesh import turned_outward
from bipot_rs.obstacle.motion import Motion
from bipot_rs.obstacle.protocol import Obstacle
from bipot_rs.obstacle.shapes import Approach, Plane, approach, ask, onwards

if TYPE_CHECKING:
    from bipot_rs.mortar.pairs import Pairs

# Up to this number of pairs, comparing all nodes is faster than importing a tree.
_ALL_PAIRS = 2**20


@dataclass(frozen=True)
class Floating:
    """A rigid obstacle that a force moves: its position is an unknown.

    Contacts with an equal ``floating`` touch the same obstacle.

    Parameters
    ----------
    name
        Name of the obstacle, for its force and its displacement.
    components
        Directions in which it may translate, some of 0 to d - 1; it does not rotate.
    """

    name: str
    components: Sequence[int]


@dataclass(frozen=True)
class Contact:
    """A named surface, and the obstacle or surface that it may touch.

    Give exactly one of ``plane = (point, normal)``, a rigid plane with the normal towards
    the body; ``obstacle``, another rigid obstacle of `bipot_rs.obstacle`; and
    ``against = (body, surface)``, the surface of another body. Rigid obstacles move along
    the load path by ``motion``, a `bipot_rs.obstacle.Motion`. For several obstacles,
    define several contacts on the same surface.

    Contacts are at the nodes of the surface. With ``pairing = "match"`` the nodes of two
    bodies must lie opposite each other, one to one. For other meshes, ``"mortar"``
    transmits constant pressures exactly, and ``"nodes"`` puts each node on the opposite
    facet, as in `bipot_rs.pairs`; this body is the slave. Faces with 6 or 8 nodes, whose
    corners have no positive area, need ``"mortar"`` with rigid obstacles too
    (`bipot_rs.rigid_pairs`).

    ``clearance`` is added to the gap [m]: a number, one number for each node of the
    surface in the order of `Body.nodes`, or a function of the positions ``(nodes, d)``;
    mortar takes the weighted mean. ``within`` selects nodes by position; if meshes do not
    match, facets with all nodes selected. In 3D ``mu`` may be a pair, for the tangents t1
    and t2: t1 is then ``axis (d,)``, a direction of the material such as its grain,
    projected onto the tangent plane; without ``axis``, the tangents are those of `frames`.

    With ``floating``, the force `Assembly.reference_force` moves the rigid obstacle, in
    addition to ``motion``: small translations, with the normals of the start.
    """

    body: str
    surface: str
    mu: float | Sequence[float]
    plane: tuple[ArrayLike, ArrayLike] | None = None
    against: tuple[str, str] | None = None
    clearance: ArrayLike | Callable[[Floats], ArrayLike] = 0.0
    within: Box | None = None
    axis: ArrayLike | None = None
    obstacle: Obstacle | None = None
    motion: Motion | None = None
    pairing: str = "match"
    floating: Floating | None = None


def _pair(contact: Contact) -> tuple[str, str]:
    """Names of the two surfaces, ``"body.surface"``."""
    return f"{contact.body}.{contact.surface}", ".".join(contact.against or ())


def both(contact: Contact) -> str:
    """Names of the two surfaces, for messages."""
    return " and ".join(_pair(contact))


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
    rows: Any = None
    moved: Approach | None = None


def meet(
    bodies: Sequence[Body], offset: Sequence[int], n: int, contact: Contact
) -> Meeting:
    """Find the contact nodes of one surface; a `ValueError` gives names and position."""
    _check(contact, bodies[0].dim)
    b = body_index(bodies, contact.body)
    body = bodies[b]
    nodes = body.nodes(contact.surface, contact.within)
    if not nodes.size:
        raise ValueError(
            f"contact on {contact.surface!r} of body {body.name!r} has no nodes: within "
            "excludes all of them"
        )
    if contact.pairing != "match":
        return _weighted(bodies, offset, n, contact)
    _refuse_negative_areas(body, contact.surface)
    facets = body.surface(contact.surface)
    area = body.depth * facets.moment(np.ones(facets.weights.shape))[nodes]
    points = body.points[nodes]
    partner = np.full(len(nodes), -1, dtype=np.int64)
    moved = None
    if contact.against is not None:
        frame = frames(-_normals(facets)[nodes], contact.axis)
        o = _other(bodies, b, contact.against[0])
        theirs = bodies[o].nodes(contact.against[1])
        # Size of the whole surface: `within` may leave a single node.
        size = np.ptp(body.points[body.nodes(contact.surface)], axis=0).max()
        match = _match(points, bodies[o].points[theirs], frame, contact, size)
        facing = _normals(bodies[o].surface(contact.against[1]))[theirs[match]]
        towards = np.einsum("cd,cd->c", frame[:, 0], facing)
        away = np.flatnonzero(towards <= 0)
        if away.size:
            raise ValueError(
                f"surfaces {both(contact)} do not face each other at "
                f"{place(points[away[0]])}: their outward normals must be opposite"
            )
        partner = offset[o] + body.dim * theirs[match]
        between = points - bodies[o].points[theirs[match]]
        gap = np.einsum("cd,cd->c", frame[:, 0], between)
    else:
        obstacle = rigid_obstacle(contact, body.dim)
        met = _rigid(contact, obstacle, points, _normals(facets)[nodes])
        frame, gap = frames(met.normal[0], contact.axis), met.distance[0]
        if contact.motion is not None:
            moved = Approach(*(field[1:] for field in met))
    clearance = _clearance(contact, points)
    if moved is not None:
        moved = moved._replace(distance=moved.distance + clearance)
    return Meeting(
        points=points,
        frame=frame,
        gap=gap + clearance,
        area=area,
        dofs=np.stack([offset[b] + body.dim * nodes, partner], axis=1),
        moved=moved,
    )


def _clearance(contact: Contact, points: Floats) -> Floats:
    extra = contact.clearance
    what = f"clearance of the contact on {contact.surface!r}"
    found = floats(what, extra(points) if callable(extra) else extra)
    if found.shape not in ((), (1,), (len(points),)):
        raise ValueError(
            f"{what} has shape {found.shape}, expected a number or ({len(points)},)"
        )
    return found


def _clearances(
    contact: Contact, body: Body
) -> tuple[Callable[[Floats], Floats], Floats]:
    """Clearance as a function of the position plus values at nodes; one of them is zero."""
    nodal = np.zeros(len(body.points))
    if callable(contact.clearance) or np.ndim(contact.clearance) == 0:
        return lambda places: _clearance(contact, places), nodal
    nodes = body.nodes(contact.surface, contact.within)
    nodal[nodes] = _clearance(contact, body.points[nodes])
    return lambda places: np.zeros(len(places)), nodal


def gaps_onwards(
    bodies: Sequence[Body], contact: Contact, motion: Motion, points: Floats
) -> Approach:
    """Where the obstacle is after the second step of a motion, and its drag in that step.

    Parameters
    ----------
    bodies, contact
        The contact has a rigid obstacle.
    motion
        Motion of the obstacle in two steps, which replaces that of the contact.
    points
        Positions of the contact nodes.
    """
    obstacle = rigid_obstacle(contact, points.shape[1])
    body = bodies[body_index(bodies, contact.body)]
    if contact.pairing == "match":
        nodes = body.nodes(contact.surface, contact.within)
        met = onwards(obstacle, motion, points, outward(body, contact.surface)[nodes])
        return met._replace(distance=met.distance + _clearance(contact, points))
    normal = onwards(obstacle, motion, points, _outwards(contact, body)(points)).normal
    facets = _facets_of(contact, body)
    return _mean(
        contact, body, facets, normal, lambda at: onwards(obstacle, motion, at)
    )


def _check(contact: Contact, dim: int) -> None:
    """Check the arguments that do not depend on a mesh."""
    what = f"mu of the contact on {contact.surface!r}"
    if np.ndim(contact.mu) == 1:
        friction(np.asarray(contact.mu)[None], 1, dim, ratio=RATIO)
    elif not 0 <= number(what, contact.mu) < np.inf:
        raise ValueError(
            f"{what} is {contact.mu}, expected a finite number, zero or positive"
        )
    given = [contact.plane, contact.obstacle, contact.against]
    if sum(one is not None for one in given) != 1:
        raise ValueError(
            f"contact on {contact.surface!r} needs exactly one of plane, obstacle and "
            "against"
        )
    if contact.obstacle is not None and not callable(
        getattr(contact.obstacle, "closest", None)
    ):
        raise TypeError(
            f"obstacle of the contact on {contact.surface!r} is {shown(contact.obstacle)}, "
            "expected an obstacle of bipot_rs.obstacle, or an object with closest(points)"
        )
    if contact.motion is not None and contact.against is not None:
        raise ValueError(
            f"motion of the contact on {contact.surface!r} was given, but "
            f"{'.'.join(contact.against)} is a surface of another body: move that body by "
            "supports"
        )
    if contact.pairing == "match":
        return
    from bipot_rs.mortar.pairs import METHODS

    if contact.pairing not in METHODS:
        raise ValueError(
            f"pairing of the contact on {contact.surface!r} is {contact.pairing!r}, "
            "expected 'match', " + " or ".join(map(repr, METHODS))
        )


def rigid_obstacle(contact: Contact, dim: int) -> Obstacle:
    """The rigid obstacle of a contact."""
    if contact.obstacle is not None:
        return contact.obstacle
    what = f"plane of the contact on {contact.surface!r}"
    if contact.plane is None or len(contact.plane) != 2:
        raise ValueError(f"{what} is {contact.plane!r}, expected (point, normal)")
    point, normal = (floats(what, a) for a in contact.plane)
    if point.shape != (dim,) or normal.shape != (dim,):
        raise ValueError(
            f"{what} has shapes {point.shape} and {normal.shape}, expected ({dim},)"
        )
    return Plane(point, normal)


def _other(bodies: Sequence[Body], own: int, name: str) -> int:
    found = body_index(bodies, name)
    if found == own:
        raise ValueError(
            f"body {name!r} is in contact with itself: against must name another body"
        )
    return found


def _rigid(
    contact: Contact, obstacle: Obstacle, points: Floats, outwards: Floats
) -> Approach:
    """A rigid obstacle at the start and after each step."""
    try:
        return approach(obstacle, contact.motion, points, outwards)
    except ValueError as error:
        raise ValueError(
            f"obstacle of the contact on {contact.surface!r}: {error}"
        ) from None


def _weighted(
    bodies: Sequence[Body], offset: Sequence[int], n: int, contact: Contact
) -> Meeting:
    """Contacts for ``pairing="mortar"`` and ``pairing="nodes"``."""
    what = f"contact on {contact.surface!r}"
    b = body_index(bodies, contact.body)
    body, dim = bodies[b], bodies[b].dim
    ours = _facets_of(contact, body)
    from bipot_rs.mortar.pairs import pairs

    moved = None

    def numbers(i: int) -> Ints:
        count = dim * len(bodies[i].points)
        return offset[i] + np.arange(count).reshape(-1, dim)

    try:
        if contact.against is not None:
            what = f"surfaces {both(contact)}"
            o = _other(bodies, b, contact.against[0])
            clearance = contact.clearance
            if not callable(clearance) and np.ndim(clearance) > 0:
                # `pairs` takes one number for each node of the body.
                clearance = _clearances(contact, body)[1]
            found = pairs(
                body.points,
                ours,
                bodies[o].points,
                _facets_outward(bodies[o], contact.against[1]),
                method=contact.pairing,
                clearance=clearance,
                axis=contact.axis,
                dofs_slave=numbers(b),
                dofs_master=numbers(o),
                n=n,
            )
        else:
            found, moved = _against_rigid(contact, body, ours, numbers(b), n)
    except ValueError as error:
        said = str(error)
        if contact.against is not None:
            # `pairs` names its arguments; the caller of `meet` knows surfaces.
            arguments = ("facets_slave", "facets_master")
            if all(argument in said for argument in arguments):
                what = ""
            for argument, name in zip(arguments, _pair(contact), strict=True):
                said = said.replace(argument, name)
        raise ValueError(f"{what}: {said}" if what else said) from error
    partner = np.full(len(found.node), -1, dtype=np.int64)
    return Meeting(
        points=found.points,
        frame=found.frame,
        gap=found.gap,
        area=body.depth * found.area,
        dofs=np.stack([offset[b] + dim * found.node, partner], axis=1),
        rows=found.B,
        moved=moved,
    )


def _facets_of(contact: Contact, body: Body) -> Ints:
    """Facets of a surface, outward, whose nodes are all within ``contact.within``."""
    facets = _facets_outward(body, contact.surface)
    if contact.within is None:
        return facets
    nodes = body.nodes(contact.surface, contact.within)
    facets = facets[np.isin(facets, nodes).all(axis=1)]
    if not len(facets):
        raise ValueError(
            f"contact on {contact.surface!r} has no facets: within contains all nodes of "
            "none of them"
        )
    return facets


def _outwards(contact: Contact, body: Body) -> Callable[[Floats], Floats]:
    """Outward directions at nodes of a body, from their positions."""
    out = outward(body, contact.surface)
    known = {x.tobytes(): n for x, n in zip(body.points, out, strict=True)}
    return lambda places: np.array([known[x.tobytes()] for x in places])


def _against_rigid(
    contact: Contact, body: Body, facets: Ints, dofs: Ints, n: int
) -> tuple[Pairs, Approach | None]:
    """Weighted gaps of a surface over a rigid obstacle, at the start and each step."""
    from bipot_rs.mortar.pairs import rigid_pairs

    if contact.pairing != "mortar":
        raise ValueError(
            f"pairing is {contact.pairing!r}, expected 'match' or 'mortar' for a rigid "
            "obstacle"
        )
    obstacle, motion = rigid_obstacle(contact, body.dim), contact.motion
    smooth, nodal = _clearances(contact, body)
    at_nodes = _outwards(contact, body)
    found = rigid_pairs(
        body.points,
        facets,
        lambda places: ask(obstacle, places).distance + smooth(places),
        normal=lambda places: approach(
            obstacle, motion, places, at_nodes(places)
        ).normal[0],
        axis=contact.axis,
        dofs=dofs,
        n=n,
    )
    found = replace(found, gap=found.gap + found.slave @ nodal)
    if motion is None:
        return found, None
    met = approach(obstacle, motion, found.points, at_nodes(found.points))
    return found, _mean(
        contact,
        body,
        facets,
        met.normal[1:],
        lambda places: Approach(
            *(field[1:] for field in approach(obstacle, motion, places))
        ),
    )


def _mean(
    contact: Contact,
    body: Body,
    facets: Ints,
    normal: Floats,
    meet_at: Callable[[Floats], Approach],
) -> Approach:
    """Weighted means of distance and drag, with the normals ``(steps, n_c, d)`` of nodes."""
    smooth, nodal = _clearances(contact, body)

    def at(places: Floats) -> Floats:
        met = meet_at(places)
        apart = met.distance[:, :, None] + smooth(places)[..., None]
        every = np.concatenate([apart, met.drag], axis=2)
        return np.ascontiguousarray(every.transpose(1, 0, 2)).reshape(len(places), -1)

    states, d = len(normal), body.dim
    means, slave = _means(body, facets, at, states * (1 + d))
    means = means.reshape(-1, states, 1 + d).transpose(1, 0, 2)
    return Approach(normal, means[..., 0] + slave @ nodal, means[..., 1:])


def _means(
    body: Body, facets: Ints, fields: Callable[[Floats], Floats], count: int
) -> tuple[Floats, Any]:
    """Means ``(n_c, count)`` of fields ``(m, count)``, weighted by the dual functions.

    Returns these, and the weights of the nodes, `Pairs.slave`.
    """
    from bipot_rs.mortar.pairs import rigid_pairs

    known: dict[bytes, Floats] = {}

    def one(k: int) -> Callable[[Floats], Floats]:
        def at(places: Floats) -> Floats:
            # All fields need the same points: computed once.
            key = places.tobytes()
            if key not in known:
                known[key] = fields(places)
            return np.ascontiguousarray(known[key][:, k])

        return at

    means = [rigid_pairs(body.points, facets, one(k)) for k in range(count)]
    return np.column_stack([mean.gap for mean in means]), means[0].slave


def relative_displacement(found: Sequence[Meeting], n: int) -> Any:
    """B of (2), contact after contact."""
    if not found:
        return sparse.csr_array((0, n))
    own = []
    for one in found:
        # A partner of -1 stays negative in its first component.
        sides = [first[:, None] + np.arange(one.frame.shape[1]) for first in one.dofs.T]
        own.append(operator(one.frame, sides, n) if one.rows is None else one.rows)
    # The empty first block allows for no contacts.
    return sparse.csr_array(sparse.vstack([sparse.csr_array((0, n)), *own], "csr"))


def outward(body: Body, surface: str) -> Floats:
    """Outward normals at all nodes ``(nodes, d)``, times area; zero off the surface."""
    return _normals(body.surface(surface))


def _refuse_negative_areas(body: Body, surface: str) -> None:
    """Refuse faces where a constant pressure gives no positive force at the corners."""
    facet = body.kind.facet
    if not facet.lumps:
        face = {"triangle6": "of 6 nodes", "quad8": "of 8 nodes"}[facet.vtk]
        none = "no force" if facet.vtk == "triangle6" else "a negative force"
        raise ValueError(
            f"contact on {surface!r} of body {body.name!r} is at the nodes of faces {face}, "
            f"where a constant pressure gives the corners {none}: use "
            'pairing="mortar", cells of first order, or hexahedra of 27 nodes'
        )


def _facets_outward(body: Body, surface: str) -> Ints:
    """Facets of a surface, numbered so that their normals point outwards."""
    facets = body.surface(surface)
    normals = np.asarray(facets.normals).mean(axis=2).T
    return turned_outward(body.points, facets.corners, normals)


def _normals(facets: Quadrature) -> Floats:
    """Outward normals at the nodes of a surface ``(nodes, d)``, times area."""
    normal = np.asarray(facets.normals)
    nodal = np.stack([facets.moment(component) for component in normal], axis=1)
    # A component of rounding size on a coordinate plane would couple B to
    # displacements that the contact does not feel.
    small = 1e-14 * np.abs(nodal).max(axis=1, keepdims=True)
    return np.where(np.abs(nodal) <= small, 0.0, nodal)


def _match(
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
    if len(ours) * len(theirs) > _ALL_PAIRS:
        from scipy.spatial import cKDTree

        _, match = cKDTree(theirs).query(ours)
        return np.asarray(match, dtype=np.int64)
    distance = np.zeros((len(ours), len(theirs)))
    for mine, other in zip(ours.T, theirs.T, strict=True):
        distance += np.subtract.outer(mine, other) ** 2
    return np.asarray(distance.argmin(axis=1), dtype=np.int64)


def body_index(bodies: Sequence[Body], name: str) -> int:
    """Index of the body with a name; `ValueError` lists the known names."""
    for at, body in enumerate(bodies):
        if body.name == name:
            return at
    raise ValueError(
        f"there is no body {name!r}, expected one of {[body.name for body in bodies]}"
    )
