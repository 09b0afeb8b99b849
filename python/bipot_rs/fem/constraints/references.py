"""Reference points: rigid obstacles under a force, and node sets that follow a point.

A reference point has one reference node of ``d`` degrees of freedom for its translation. A
rigid set has a second one for its rotation: ``ψ = L θ`` with the largest distance L of its
nodes from the point, so that all degrees of freedom are lengths. Reference nodes follow the
nodes of the bodies in the numbering, and have no stiffness of their own.

A node at x of a rigid set follows ``u = a + θ × (x - p)``, with the translation a of the
point p. An obstacle that moves by a changes the relative displacement of its contacts by
``-a``, so that (1) in its row is the balance of its force with the contact forces.

A part that may deform has no reference point: its force and moment are distributed over it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike
from scipy import sparse

from bipot_rs._lib.matrices import rigid_motions
from bipot_rs._lib.messages import instead
from bipot_rs._lib.types import CsrMatrix, Floats, Ints
from bipot_rs._lib.validation import floats
from bipot_rs.fem.bodies.body import Body, Box, NumberedBodies, Quadrature
from bipot_rs.fem.bodies.elasticity import nodal_forces
from bipot_rs.fem.constraints.bolts import Cut
from bipot_rs.fem.constraints.ties import Relations, Ties
from bipot_rs.fem.contact.contact import Contact, Floating, rigid_obstacle

# Directions in which the nodes of a set differ by less than this, relative to their
# largest distance from the point, give no moment arm.
_FLAT = 1e-6
# Where a set turns freely about a point at D times its extent, translation and rotation of
# the point cancel: the stiffness loses D², and at this ratio displacements keep 8 digits.
_FAR = 1e4
# Part of a moment that the extent of the set cannot carry, relative to the moment.
_LOST = 1e-6


@dataclass(frozen=True)
class Remote:
    """A set of nodes that moves with a reference point, or that a force at it acts on.

    A rigid set keeps its shape: its nodes follow the translation and rotation of the point.
    Each of their components is prescribed, or free and loaded by
    `Assembly.reference_force`. With ``distributed`` the set may deform: it has no unknowns of
    its own, and a force and a moment at the point act as nodal forces with the same resultant,
    in proportion to the areas (volumes) of the nodes.

    Parameters
    ----------
    name
        Unique among remotes and floating obstacles.
    body
        Name of the body.
    part
        A surface or a volume; None for all nodes of the body.
    point
        The reference point ``(d,)`` [m]; by default the mean position of the set.
    components
        Prescribed translations, some of 0 to d - 1.
    rotations
        Prescribed rotations: numbers of axes, in the plane only 2.
    distributed
        Whether the set may deform.
    within
        Ranges of coordinates that select nodes.
    """

    name: str
    body: str
    part: str | None = None
    point: ArrayLike | None = None
    components: Sequence[int] = ()
    rotations: Sequence[int] = ()
    distributed: bool = False
    within: Box | None = None


@dataclass(frozen=True)
class Reference:
    """A reference point among the degrees of freedom."""

    name: str  # that of the obstacle or the set
    # `"obstacle"`, `"rigid set"` or `"bolt"`, whose first translation is the shortening.
    kind: str
    point: Floats  # (d,): position [m]
    first: int  # first degree of freedom
    arm: float | None  # length L of the rotations `ψ = L θ` [m]; None for an obstacle
    fixed: Ints  # (m,): prescribed degrees of freedom, ascending
    # components, rotations: prescribed translations and rotations (numbers of axes), except
    # those that are zero.
    components: tuple[int, ...]
    rotations: tuple[int, ...]
    # (k, rotations): rotations that move no node of the set: those about the line of its nodes.
    idle: Floats = field(repr=False)
    # Name of the body whose nodes all belong to the set, or None.
    whole: str | None = None
    share: float = 1.0  # part of a bolt that is modelled

    @property
    def nodes(self) -> int:
        """Number of reference nodes: 1, or 2 with rotations."""
        return 1 if self.arm is None else 2

    @property
    def dofs(self) -> Ints:
        """Degrees of freedom of the translation ``(d,)``."""
        return self.first + np.arange(len(self.point))

    @property
    def turns(self) -> Ints:
        """Degrees of freedom of the rotation: 3 in space, 1 in the plane, 0 for an obstacle."""
        d = len(self.point)
        count = 0 if self.arm is None else 3 if d == 3 else 1
        return self.first + d + np.arange(count)

    def values(self, given: Sequence[float]) -> dict[int, float]:
        """Prescribed value of each of `fixed`: translations [m], then rotations [rad]."""
        components = floats(
            f"values of the reference point {self.name!r}",
            given,
            shape=(len(self.components) + len(self.rotations),),
            finite=self.kind != "bolt",
        ).tolist()
        values_at = dict.fromkeys(self.fixed.tolist(), 0.0)
        moved = len(self.components)
        for k, value in zip(self.components, components[:moved], strict=True):
            values_at[int(self.dofs[k])] = value
        for axis, value in zip(self.rotations, components[moved:], strict=True):
            values_at[self._turn(axis)] = value * (self.arm or 1.0)
        return values_at

    def _turn(self, axis: int) -> int:
        return int(self.turns[axis if len(self.point) == 3 else 0])

    def force(self, force: ArrayLike | None, moment: ArrayLike | None) -> Floats:
        """Loads at `dofs` and `turns` of a force [N] and a moment [N m]."""
        what = f"of the reference point {self.name!r}"
        if moment is not None and self.arm is None:
            raise ValueError(
                f"moment {what} was given, but an obstacle under a force only translates: "
                "leave it out"
            )
        push, couple = read_resultant(what, force, moment, len(self.point))
        if self.arm is None:
            return push
        lost = np.abs(self.idle @ couple).max(initial=0.0)
        if lost > _FLAT * np.abs(couple).max(initial=0.0):
            raise ValueError(
                f"moment {what} has a component of {lost:g} about the line on which all "
                "nodes of the set lie, where it has no arm: add nodes aside, or leave this "
                "component out"
            )
        return np.concatenate([push, couple / self.arm])


def read_resultant(
    what: str, force: ArrayLike | None, moment: ArrayLike | None, d: int
) -> tuple[Floats, Floats]:
    """A force ``(d,)`` and a moment ``(3,)``, in the plane ``(1,)``; zero where None."""
    push = np.zeros(d) if force is None else floats(f"force {what}", force, shape=(d,))
    couple = np.zeros(3 if d == 3 else 1)
    if moment is None:
        return push, couple
    given = np.atleast_1d(floats(f"moment {what}", moment))
    if given.shape != couple.shape:
        raise ValueError(
            f"moment {what} has shape {given.shape}, expected {couple.shape}"
        )
    return push, given


def make_references(
    bodies: NumberedBodies,
    contacts: Sequence[Contact],
    remotes: Sequence[Remote],
    cuts: Sequence[Cut] = (),
) -> tuple[tuple[Reference, ...], list[Relations]]:
    """Number the reference points, and make the relations of rigid sets and bolts.

    Raises `ValueError`: names that repeat or do not exist, wrong components, a set without
    nodes.
    """
    dim, first = bodies.dim, bodies.n
    references: list[Reference] = []
    relations: list[Relations] = []
    for floating in floatings(contacts, dim):
        centre = _obstacle_point(contacts, floating, dim)
        held = [k for k in range(dim) if k not in floating.components]
        references.append(
            Reference(
                name=floating.name,
                kind="obstacle",
                point=centre,
                first=first,
                arm=None,
                fixed=first + np.array(held, np.int64),
                components=(),
                rotations=(),
                idle=np.zeros((0, 0)),
            )
        )
        first += dim
    for remote in remotes:
        _check(remote, dim)
        if remote.distributed:
            continue
        reference, relation = _rigid(bodies, remote, first)
        references.append(reference)
        relations += relation
        first += 2 * dim
    for cut in cuts:
        bolt, section = _make_shortening(bodies, cut, first)
        references.append(bolt)
        relations.append(section)
        first += dim
    names = [point.name for point in references] + [
        r.name for r in remotes if r.distributed
    ]
    if len(set(names)) < len(names):
        raise ValueError(
            f"names of floating obstacles, remotes and bolts repeat: {names}, expected different "
            "names"
        )
    return tuple(references), relations


def floatings(contacts: Sequence[Contact], dim: int) -> list[Floating]:
    """The floating obstacles of contacts, in the order of their first contact."""
    by_name: dict[str, Floating] = {}
    for contact in contacts:
        floating = contact.floating
        if floating is None:
            continue
        if contact.against is not None:
            raise ValueError(
                f"floating of the contact on {contact.surface!r} was given, but "
                f"{'.'.join(contact.against)} is a surface of another body: load that body "
                "instead"
            )
        first = by_name.setdefault(floating.name, floating)
        if tuple(first.components) != tuple(floating.components):
            raise ValueError(
                f"the floating obstacle {floating.name!r} has components "
                f"{list(first.components)} in one contact and "
                f"{list(floating.components)} in another: give all the same"
            )
    dims = range(dim)
    for floating in by_name.values():
        free = list(floating.components)
        if not free or not set(free) <= set(dims) or len(set(free)) < len(free):
            raise ValueError(
                f"components of the floating obstacle {floating.name!r} are {free}, "
                "expected different ones of x, y[, z] as 0, 1[, 2]"
            )
    return list(by_name.values())


def obstacle_columns(
    contacts: Sequence[Contact],
    group: Ints,
    frame: Floats,
    references: Sequence[Reference],
    n: int,
) -> CsrMatrix:
    """Part of B ``(d n_c, n)`` that floating obstacles move: -1 times their frames."""
    count, d = frame.shape[:2]
    first = {point.name: point.first for point in references}
    column = [first[c.floating.name] if c.floating else -1 for c in contacts]
    at = np.array(column, np.int64)[group]
    moved = np.flatnonzero(at >= 0)
    rows = (d * moved[:, None] + np.arange(d))[:, :, None]
    columns = (at[moved][:, None] + np.arange(d))[:, None, :]
    shape = len(moved), d, d
    entries = (
        -frame[moved].ravel(),
        (
            np.broadcast_to(rows, shape).ravel(),
            np.broadcast_to(columns, shape).ravel(),
        ),
    )
    made: CsrMatrix = sparse.csr_array(entries, shape=(d * count, n))
    made.eliminate_zeros()
    return made


def set_of(body: Body, remote: Remote) -> tuple[Ints, Floats]:
    """Nodes of a remote, and its reference point."""
    nodes = body.members(remote.part, remote.within)
    if remote.point is None:
        return nodes, np.asarray(body.points[nodes].mean(axis=0), np.float64)
    point = floats(
        f"point of the remote {remote.name!r}", remote.point, shape=(body.dim,)
    )
    return nodes, point


def with_points(points: Floats, references: Sequence[Reference]) -> Floats:
    """Positions of the nodes and of the reference nodes after them."""
    added = [point.point[None] for point in references for _ in range(point.nodes)]
    return np.concatenate([points, *added])


def rotations(arms: Floats) -> Floats:
    """``e_r × x`` of points ``(m, d)`` for each axis of rotation, ``(m, d, axes)``."""
    return rigid_motions(arms)[:, :, arms.shape[1] :]


def refuse_held_bolts(references: Sequence[Reference], ties: Ties) -> None:
    """Raise if supports prescribe both sides of a section along the axis of its bolt."""
    for point in references:
        if point.kind == "bolt" and ties.given[:, [point.first]].count_nonzero():
            raise ValueError(
                f"section of the bolt {point.name!r}: a support holds its nodes along the axis "
                "of the bolt, so that no force can shorten it; exclude them by within, or "
                "move the section"
            )


def reference_named(references: Sequence[Reference], name: str) -> Reference:
    """The reference point of this name; `ValueError` lists the known names."""
    for point in references:
        if point.name == name:
            return point
    names = [point.name for point in references]
    raise ValueError(
        f"there is no reference point {name!r}"
        + instead(name, names, "the model has no floating obstacle and no rigid set")
    )


def prescribed_values(
    references: Sequence[Reference], given: Mapping[str, Sequence[float]] | None
) -> dict[int, float]:
    """Prescribed value of each fixed degree of freedom of reference points."""
    values = dict(given or {})
    values_at: dict[int, float] = {}
    for point in references:
        count = len(point.components) + len(point.rotations)
        values_at |= point.values(values.pop(point.name, [0.0] * count))
    for name in values:
        reference_named(references, name)
    return values_at


def _check(remote: Remote, dim: int) -> None:
    what = f"of the remote {remote.name!r}"
    axes = range(3) if dim == 3 else range(2, 3)
    for name, given, allowed in (
        ("components", remote.components, range(dim)),
        ("rotations", remote.rotations, axes),
    ):
        if not isinstance(given, Sequence):
            raise TypeError(
                f"{name} {what} is {given!r}, expected a list of some of {list(allowed)}"
            )
        names = list(given)
        if not set(names) <= set(allowed) or len(set(names)) < len(names):
            raise ValueError(
                f"{name} {what} are {names}, expected different ones of {list(allowed)}"
            )
        if names and remote.distributed:
            raise ValueError(
                f"{name} {what} are {names}, but distributed is true: only a rigid set has "
                "a prescribed motion"
            )


def _obstacle_point(
    contacts: Sequence[Contact], floating: Floating, dim: int
) -> Floats:
    """A point of the obstacle for messages: its centre, or that of the first contact."""
    for contact in contacts:
        if contact.floating is not None and contact.floating.name == floating.name:
            obstacle = rigid_obstacle(contact, dim)
            for name in ("centre", "point"):
                point = getattr(obstacle, name, None)
                if point is not None and np.shape(point) == (dim,):
                    return np.asarray(point, np.float64)
    return np.zeros(dim)


def _refuse_far(remote: Remote, extent: float, reach: float) -> None:
    """Refuse a distant point if the set may both translate and turn."""
    if remote.point is None or not reach > _FAR * extent > 0:
        return
    d = np.size(remote.point)
    if len(remote.components) == d or len(remote.rotations) == (3 if d == 3 else 1):
        return
    raise ValueError(
        f"point of the remote {remote.name!r} is {reach:g} from its nodes, which extend over "
        f"{extent:g}: displacements would lose their digits; choose a point near the nodes, "
        "and add the moment of the force about it"
    )


def _make_shortening(
    bodies: NumberedBodies, cut: Cut, first: int
) -> tuple[Reference, Relations]:
    """The shortening of a bolt, and the relations of its section."""
    numbered, d = bodies[cut.bolt.body], bodies.dim
    dofs = np.empty((len(cut.nodes), d, 4), np.int64)
    dofs[:, :, 0], dofs[:, :, 1] = numbered.dofs[cut.copies], numbered.dofs[cut.nodes]
    # The second one is zero in every step: its reaction is the tension, without the force at
    # the first.
    dofs[:, :, 2:] = first, first + 1
    coefficients = np.empty(dofs.shape)
    coefficients[:, :, 0], coefficients[:, :, 1] = 1.0, -1.0
    coefficients[:, :, 2:] = cut.axis[:, None]
    made = Reference(
        name=cut.bolt.name,
        kind="bolt",
        point=cut.centre,
        first=first,
        arm=None,
        fixed=first + np.arange(d),
        components=(0,),
        rotations=(),
        idle=np.zeros((0, 0)),
        share=cut.bolt.share,
    )
    return made, Relations(dofs.reshape(-1, 4), coefficients.reshape(-1, 4))


def _rigid(
    bodies: NumberedBodies, remote: Remote, first: int
) -> tuple[Reference, list[Relations]]:
    """The reference point of a rigid set, and its relations."""
    numbered, d = bodies[remote.body], bodies.dim
    body = numbered.body
    nodes, point = set_of(body, remote)
    arms = body.points[nodes] - point
    reach = float(np.linalg.norm(arms, axis=1).max(initial=0.0))
    _refuse_far(remote, float(np.linalg.norm(np.ptp(arms, axis=0))), reach)
    reach = reach or float(np.ptp(body.points, axis=0).max())
    fields = rotations(arms / reach)
    turning = fields.shape[2]
    # Rotations that move no node.
    _, size, V = np.linalg.svd(
        np.vstack([fields.reshape(-1, turning), np.zeros((turning,) * 2)]),
        full_matrices=False,
    )
    idle = V[size <= _FLAT * np.sqrt(len(nodes))]
    moves, turns = first + np.arange(d), first + d + np.arange(turning)
    dofs = np.empty((len(nodes), d, 2 + turning), np.int64)
    dofs[:, :, 0], dofs[:, :, 1], dofs[:, :, 2:] = numbered.dofs[nodes], moves, turns
    coefficients = np.empty(dofs.shape)
    coefficients[:, :, 0], coefficients[:, :, 1] = 1.0, -1.0
    coefficients[:, :, 2:] = -fields
    relations = [
        Relations(dofs.reshape(-1, 2 + turning), coefficients.reshape(-1, 2 + turning))
    ]
    if len(idle):
        relations.append(Relations(np.tile(turns, (len(idle), 1)), idle))
    held = [moves[k] for k in remote.components]
    held += [turns[k if d == 3 else 0] for k in remote.rotations]
    if d == 2:
        held.append(first + 3)  # the second reference node has one rotation alone
    made = Reference(
        name=remote.name,
        kind="rigid set",
        point=point,
        first=first,
        arm=reach,
        fixed=np.sort(np.array(held, np.int64)),
        components=tuple(remote.components),
        rotations=tuple(remote.rotations),
        idle=idle,
        whole=body.name if len(nodes) == len(body.points) else None,
    )
    return made, relations


def distributed_force(
    body: Body, remote: Remote, force: ArrayLike | None, moment: ArrayLike | None
) -> Floats:
    """Nodal forces ``(dim * nodes,)`` with a given resultant at the reference point.

    The density ``a + b × (x - c)`` per area of a surface or per volume, with the centre c of
    the part, has the resultant force ``a A`` and about c the moment ``J b``; among all
    densities with this resultant it is the smallest in the mean square.

    ``body, remote``: the remote, with ``distributed``, and its body.
    ``force, moment``: at the reference point, ``(d,)`` [N], and ``(3,)`` or in the plane a
    number [N m].
    Raises `ValueError`: a wrong shape, a moment without an arm, or a part without facets or
    cells.
    """
    d = body.dim
    what = f"of the remote {remote.name!r}"
    push, turn = read_resultant(what, force, moment, d)
    points = _part(body, remote)
    weights = body.depth * points.weights.ravel()
    places = points.places.reshape(d, -1).T
    centre = weights @ places / weights.sum()
    lever = set_of(body, remote)[1] - centre
    # The moment about the centre includes that of the force at the point.
    about = turn + rotations(lever[None])[0].T @ push
    density = np.tile(push / weights.sum(), (len(places), 1))
    if about.any():
        fields = rotations(places - centre)
        J = np.einsum("i,ikr,iks->rs", weights, fields, fields)
        b = np.linalg.lstsq(J, about, rcond=_LOST**2)[0]
        if np.abs(J @ b - about).max() > _LOST * np.abs(about).max():
            raise ValueError(
                f"moment {what} has a component about the line on which the whole part "
                "lies, where it has no arm: choose a wider part, or leave it out"
            )
        density = density + fields @ b
    return nodal_forces(body, points, density.T.reshape(points.places.shape))


def _part(body: Body, remote: Remote) -> Quadrature:
    """Quadrature on the facets or cells of the part, those with all nodes selected."""
    if remote.part is not None and remote.part in (body.mesh.boundaries or {}):
        points = body.surface(remote.part)
    else:
        points = body.volume()
        if remote.part is not None:
            points = points.some(body.volume_cells(remote.part))
    nodes = body.members(remote.part, remote.within)
    chosen = np.flatnonzero(np.isin(points.corners, nodes).all(axis=1))
    if not chosen.size:
        raise ValueError(
            f"the remote {remote.name!r} has no facet or cell with all nodes within its "
            "ranges: widen within"
        )
    return points.some(chosen)
