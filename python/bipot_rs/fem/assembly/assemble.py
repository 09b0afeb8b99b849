"""From bodies, contacts and supports to the arrays of an `Assembly`."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from scipy import sparse

from bipot_rs._lib.types import CsrMatrix, Floats, Ints
from bipot_rs._lib.validation import show_value
from bipot_rs.contact.law.contact_law import BESIDE_MU
from bipot_rs.contact.law.frames import turn_operator
from bipot_rs.contact.path.moving_gaps import MovingGaps, drop_equal_frames
from bipot_rs.fem.assembly.assembly import Assembly, Support
from bipot_rs.fem.bodies.body import ROUNDING, Body, NumberedBodies, number_bodies
from bipot_rs.fem.bodies.boundary import Spring, Symmetry, plane_of
from bipot_rs.fem.constraints.bolts import Bolt, Cut, cut_bodies
from bipot_rs.fem.constraints.references import (
    Remote,
    make_references,
    obstacle_columns,
    refuse_held_bolts,
    with_points,
)
from bipot_rs.fem.constraints.ties import Planes, make_planes, make_ties
from bipot_rs.fem.contact.contact import Contact, check_contact
from bipot_rs.fem.contact.meeting import (
    Meeting,
    gaps_of_steps,
    meet,
    relative_displacement,
)

if TYPE_CHECKING:
    from bipot_rs.fem.constraints.repetition import Images, Repetition

# Entries of a tangential row of B that remain when all its degrees of freedom are
# prescribed, relative to the row: rounding of the normal.
_NO_WAY = 1e-6


def assemble(
    bodies: Sequence[Body],
    contacts: Sequence[Contact],
    supports: Sequence[Support] = (),
    *,
    symmetries: Sequence[Symmetry] = (),
    springs: Sequence[Spring] = (),
    remotes: Sequence[Remote] = (),
    repetitions: Sequence[Repetition] = (),
    bolts: Sequence[Bolt] = (),
    stiffness: bool = True,
) -> Assembly:
    """Assemble K, B and the contact data of elastic bodies.

    Parameters
    ----------
    bodies, contacts
        The bodies, and where they may touch.
    supports
        Prescribed displacements; `Assembly.prescribed` takes their values.
    symmetries
        Planes of symmetry in any direction, of which the mesh is one half
        (`bipot_rs.fem.constraints.ties`).
    springs
        Elastic foundations.
    remotes
        Sets of nodes that move with a reference point or that a force at it acts on.
    repetitions
        Cuts of cyclic symmetries and periodicities.
    bolts
        Shanks that are cut; `Assembly.bodies` are the bodies with their cuts.
    stiffness
        Whether K is assembled. It takes most of the memory of a body;
        `Assembly.stiffness_rows` makes parts of it.

    A contact node whose tangential displacement is prescribed in every load step, on
    both sides of a pair, gets ``mu = 0`` and no cohesion: friction has no effect there.

    Raises
    ------
    ValueError
        Names that do not exist or repeat, nodes of a pair that do not match,
        a normal of length zero: the message has the name and the place.
    """
    # Iterators too: each is read several times.
    contacts, supports, symmetries = [*contacts], [*supports], [*symmetries]
    springs, remotes = [*springs], [*remotes]
    repetitions, bolts = [*repetitions], [*bolts]
    for part in (
        *(*contacts, *supports, *symmetries, *springs),
        *(*remotes, *repetitions, *bolts),
    ):
        _check_names(part)
    bodies, shanks = cut_bodies(bodies, bolts)
    numbered = number_bodies(bodies)
    dim, n = numbered.dim, numbered.n
    for contact in contacts:
        check_contact(contact, dim)
    if numbered.axisymmetric:
        _check_axisymmetric(contacts, remotes, repetitions, shanks)
    nodes = np.concatenate([body.points for body in bodies])
    straight, planes = _sort_planes(numbered, symmetries)
    supports = [*supports, *straight]
    support_dofs = [_find_dofs(numbered, support) for support in supports]
    held = [np.zeros(0, np.int64), *(dofs.ravel() for dofs in support_dofs)]
    fixed = np.unique(np.concatenate(held))

    meetings = [meet(numbered, n, contact) for contact in contacts]
    cuts: list[Images] = []
    if repetitions:
        from bipot_rs.fem.constraints.repetition import (
            find_images,
            merge_images,
            refuse_floating,
        )

        cuts = [find_images(numbered, repetition) for repetition in repetitions]
        for cut in cuts:
            meetings = merge_images(meetings, contacts, cut, cuts, nodes)
            refuse_floating(contacts, cut)
    met = _stack(meetings, contacts, dim)
    B = relative_displacement(meetings, n)
    B, bare = _stay_in_planes(B, met, contacts, numbered, planes, nodes), None

    oblique = [(first, n) for first, n in planes if np.count_nonzero(n) > 1]
    inclined = make_planes(oblique, fixed, nodes)
    if inclined is not None:
        frame_of_rows, met = met.frame, _turn_tangents(met, contacts, inclined)
        B = turn_operator(met.frame, frame_of_rows, B)
    points_of, relations = make_references(numbered, contacts, remotes, shanks)
    relations += [cut.relations() for cut in cuts]
    relations += [] if inclined is None else [inclined.relations]
    ties = None
    if points_of or relations:
        bare = B
        n += dim * sum(point.nodes for point in points_of)
        B.resize((B.shape[0], n))
        B = (B + obstacle_columns(contacts, met.group, met.frame, points_of, n)).tocsr()
        fixed = np.concatenate([fixed, *(point.fixed for point in points_of)])
        ties = make_ties(relations, fixed, with_points(nodes, points_of))
        refuse_held_bolts(points_of, ties)
        B, fixed = ties.relative(B), ties.fixed
    path = gaps_of_steps(meetings, contacts, met.frame, inclined is not None)
    free = np.ones(n)
    free[fixed] = 0.0
    # The shortening of a bolt is prescribed in some load steps only.
    free[[point.first for point in points_of if point.kind == "bolt"]] = 1.0
    whole = B if inclined is None or bare is None else bare
    stuck = _without_slip(B, whole, free, met.frame, path)
    for name in ("mu", *BESIDE_MU):
        getattr(met, name)[stuck] = 0.0

    assembly = Assembly(
        numbered=numbered,
        supports=tuple(supports),
        contacts=tuple(contacts),
        K=None,
        B=B,
        fixed=fixed,
        support_dofs=tuple(support_dofs),
        dim=dim,
        moving=None if path is None else drop_equal_frames(path, met.frame),
        nodes=nodes,
        symmetries=len(straight),
        springs=tuple(springs),
        inclined=inclined,
        remotes=tuple(remotes),
        references=points_of,
        ties=ties,
        images=tuple(cuts),
        _bare=bare,
        _path=path,
        **met._asdict(),
    )
    return assembly.with_stiffness() if stiffness else assembly


def _check_names(part: object) -> None:
    """Check that the names of bodies and surfaces in a part of a model are strings."""
    kind = type(part).__name__
    for field in ("body", "surface", "part"):
        name = getattr(part, field, None)
        if name is None and (field == "part" or isinstance(part, Support)):
            continue  # the whole body
        if hasattr(part, field) and not isinstance(name, str):
            raise TypeError(
                f"{field} of a {kind} is {show_value(name)}, expected a name"
            )
    for field in ("against", "on", "onto"):
        pair: Any = getattr(part, field, None)
        if pair is None and (field == "against" or not hasattr(part, field)):
            continue
        is_pair = isinstance(pair, (tuple, list)) and len(pair) == 2
        if not is_pair or not all(isinstance(name, str) for name in pair):
            raise TypeError(
                f"{field} of a {kind} is {show_value(pair)}, expected (body, surface)"
            )


def _sort_planes(
    bodies: NumberedBodies, symmetries: Sequence[Symmetry]
) -> tuple[list[Support], list[tuple[Ints, Floats]]]:
    """Planes normal to an axis as supports, and all by degrees of freedom and a normal."""
    straight, planes = [], []
    for symmetry in symmetries:
        numbered = bodies[symmetry.body]
        nodes, axis, normal = plane_of(numbered.body, symmetry)
        planes.append((numbered.dofs[nodes, 0], normal))
        if axis is not None:
            straight.append(Support(symmetry.body, symmetry.surface, (axis,)))
        if bodies.axisymmetric and axis != 1:
            raise ValueError(
                f"symmetry on {symmetry.surface!r} of body {symmetry.body!r}: a body of "
                "revolution has planes of symmetry z = const only; prescribe x = 0 by a "
                "support, nodes on the axis are held by themselves"
            )
    for numbered in bodies.values() if bodies.axisymmetric else ():
        # A body of revolution stays on its axis.
        r = numbered.body.points[:, 0]
        if r.min() <= ROUNDING * np.ptp(r):
            axis_of = {0: (-np.inf, 0.0)}
            straight.append(Support(numbered.body.name, None, (0,), axis_of))
    return straight, planes


def _check_axisymmetric(
    contacts: Sequence[Contact],
    remotes: Sequence[Remote],
    repetitions: Sequence[Repetition],
    shanks: Sequence[Cut],
) -> None:
    """Refuse what turns a half section, or moves it along r as a rigid body."""
    if remotes:
        raise ValueError(
            f"remote {remotes[0].name!r}: bodies of revolution have no remotes; use a support, "
            "a traction or a pressure"
        )
    if repetitions:
        raise ValueError(
            "bodies of revolution have no cyclic or periodic cuts: remove them"
        )
    for cut in shanks:
        if abs(cut.axis[0]) > _NO_WAY:
            raise ValueError(
                f"section of the bolt {cut.bolt.name!r}: a bolt of revolution is shortened "
                "along y, which is z; cut it by a section normal to this axis"
            )
    for contact in contacts:
        name = f"contact on {contact.surface!r} of body {contact.body!r}"
        if contact.motion is not None and contact.motion.turns:
            raise ValueError(f"{name}: an obstacle of revolution cannot turn")
        if contact.floating is not None and 0 in contact.floating.components:
            raise ValueError(
                f"{name}: the force on an obstacle of revolution is along y, which is z"
            )


def _find_dofs(bodies: NumberedBodies, support: Support) -> Ints:
    """Degrees of freedom of a support, ``(components, nodes)``."""
    numbered, components = bodies[support.body], list(range(bodies.dim))
    given: Any = support.components
    if not isinstance(given, Collection) or isinstance(given, str):
        raise TypeError(
            f"components of the support on {support.surface!r} are {show_value(given)}, "
            f"expected some of {components}"
        )
    if not set(given) <= set(components):
        raise ValueError(
            f"components of the support on {support.surface!r} are "
            f"{list(support.components)}, expected some of {components}"
        )
    try:
        nodes = numbered.body.members(support.surface, support.within, support.at)
    except ValueError as error:
        raise ValueError(f"support on {support.surface!r}: {error}") from None
    return numbered.dofs[nodes].T[list(support.components)]


class _Contacts(NamedTuple):
    """The arrays of all contacts, by their names in `Assembly`."""

    gap: Floats
    mu: Floats
    cohesion: Floats
    dilatancy: Floats
    area: Floats
    points: Floats
    frame: Floats
    contact_dofs: Ints
    group: Ints


def _stack(
    meetings: Sequence[Meeting], contacts: Sequence[Contact], dim: int
) -> _Contacts:
    def stacked(name: str, *shape: int) -> Floats:
        empty = np.zeros((0, *shape))
        return np.concatenate([empty, *(getattr(m, name) for m in meetings)])

    counts = [len(m.gap) for m in meetings]
    group = np.repeat(np.arange(len(contacts)), counts).astype(np.int64)
    pairs = np.array([np.broadcast_to(c.mu, 2) for c in contacts], np.float64)
    mu = pairs.reshape(-1, 2)[group]
    if all(np.ndim(c.mu) == 0 for c in contacts):
        mu = mu[:, 0].copy()
    numbers = np.array([(c.cohesion, c.dilatancy) for c in contacts], np.float64)
    stress, dilatancy = numbers.reshape(-1, 2)[group].T
    area = stacked("area")
    no_dofs = np.zeros((0, 2), np.int64)
    return _Contacts(
        gap=stacked("gap"),
        mu=mu,
        cohesion=stress * area,
        dilatancy=dilatancy.copy(),
        area=area,
        points=stacked("points", dim),
        frame=stacked("frame", dim, dim),
        contact_dofs=np.concatenate([no_dofs, *(m.dofs for m in meetings)]),
        group=group,
    )


def _turn_tangents(
    met: _Contacts, contacts: Sequence[Contact], inclined: Planes
) -> _Contacts:
    """The contacts with tangents along the inclined planes of their nodes."""
    if met.frame.shape[1] == 2:
        return met
    # Contacts with two friction coefficients keep their tangents.
    plain = np.array([np.ndim(c.mu) == 0 for c in contacts], np.bool_)[met.group]
    turned = inclined.tangents(met.frame, met.contact_dofs[:, 0], plain)
    return met._replace(frame=turned)


def _stay_in_planes(
    B: CsrMatrix,
    met: _Contacts,
    contacts: Sequence[Contact],
    bodies: NumberedBodies,
    planes: Sequence[tuple[Ints, Floats]],
    nodes: Floats,
) -> CsrMatrix:
    """B without what nodes beside a plane of symmetry move across it at contacts on it.

    The other halves of the facets move to the other side: the integral over both is zero.
    """
    d, near = nodes.shape[1], _NO_WAY * np.ptp(nodes, axis=0).max()
    for first, normal in planes:
        height = (nodes - nodes[first[0] // d]) @ normal
        flat = [other for other, _ in planes if (abs(height[other // d]) <= near).all()]
        on = np.isin(np.arange(len(nodes)), np.concatenate(flat) // d)
        sides = [c.against and bodies[c.against[0]].dofs[:, 0] // d for c in contacts]
        halved = np.array([side is None or on[side].any() for side in sides], np.bool_)
        inside = np.isin(met.contact_dofs[:, 0], first) & halved[met.group]
        inside &= abs(met.frame[:, 0] @ normal) <= _NO_WAY
        beside = B.tocoo()
        kept = inside[beside.row // d] & ~on[beside.col // d]
        if kept.any():
            entries = beside.data[kept], (beside.row[kept], beside.col[kept])
            across = sparse.kron(sparse.eye_array(len(nodes)), np.outer(normal, normal))
            B = sparse.csr_array(B - sparse.csr_array(entries, B.shape) @ across)
            B.eliminate_zeros()
    return B


def _without_slip(
    B: CsrMatrix, whole: CsrMatrix, free: Floats, frame: Floats, path: MovingGaps | None
) -> Ints:
    """Contacts that cannot slip in any load step.

    The tangents of an obstacle that turns or curves change: a node that cannot slip at the
    start may slip in a later step.

    ``B, whole``: B in ``frame``, and the same without planes of symmetry.
    ``free (n,)``: 1 at free degrees of freedom, 0 at prescribed ones.
    """
    count, d = frame.shape[:2]
    kept, before = np.arange(count), None
    for basis in [frame] if path is None else [frame, *path.frame]:
        there = basis[kept]
        if before is not None and np.array_equal(there, before):
            continue
        rows = (d * kept[:, None] + np.arange(d)).ravel()
        left, most = (
            (abs(turn_operator(there, frame[kept], part[rows])) @ weights).reshape(
                -1, d
            )
            for part, weights in ((B, free), (whole, np.ones(len(free))))
        )
        # A node that can slip only by the rounding of its normal cannot slip.
        held = (left <= _NO_WAY * most)[:, 1:].all(axis=1)
        kept, before = kept[held], there[held]
    return kept
