"""Elastic bodies that may meet: K, B, gap and loads of (1), (2) from meshes.

Body ``b`` owns a contiguous range of degrees of freedom, ``offset[b] + dim *
node + component``, so that K is block diagonal.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import sparse

from bipot_rs.check import RATIO, floats, friction, number
from bipot_rs.elasticity import (
    FACES,
    Body,
    Box,
    Field,
    Floats,
    Ints,
    Material,
    Quadrature,
    box,
    nodal_forces,
    stiffness,
    vtk_cells,
)
from bipot_rs.problem import ContactProblem

__all__ = [
    "FACES",
    "Body",
    "Contact",
    "Material",
    "Model",
    "Support",
    "box",
    "build",
    "frames",
    "stiffness",
]

# Up to so many pairs of nodes comparing all takes less time than importing a tree.
_ALL_PAIRS = 2**20


@dataclass(frozen=True)
class Support:
    """Prescribed displacement components of a named surface."""

    body: str
    surface: str
    components: Sequence[int]
    within: Box | None = None


@dataclass(frozen=True)
class Contact:
    """Nodes of a named surface that may meet an obstacle.

    The obstacle is a rigid plane, ``plane = (point, normal)`` with the normal
    towards the body, or the surface ``against = (body, surface)`` of another
    body whose nodes lie opposite, one to one. ``clearance`` adds to the gap:
    a number, or a function of the places ``(nodes, d)`` [m]. In space ``mu`` may be
    a pair, friction along the tangents t1 and t2: t1 is then ``axis (d,)``, a direction
    of the material such as its grain, made orthogonal to the normal, and t2 at right
    angles to it; without ``axis``, they are those of `frames`.
    """

    body: str
    surface: str
    mu: float | Sequence[float]
    plane: tuple[ArrayLike, ArrayLike] | None = None
    against: tuple[str, str] | None = None
    clearance: float | Callable[[Floats], ArrayLike] = 0.0
    within: Box | None = None
    axis: ArrayLike | None = None


@dataclass(frozen=True)
class Model:
    """What (1) and (2) need, and how it maps back to the bodies.

    Attributes
    ----------
    K : scipy.sparse.csr_array (n, n)
        Stiffness [N/m], symmetric to the bit.
    B : scipy.sparse.csr_array (d n_c, n)
        ``B u`` is the displacement relative to the obstacle, ``(n, t1[, t2])``.
    gap, area : (n_c,)
        Normal gap [m], tributary area [m²].
    mu : (n_c,) or (n_c, 2)
        Friction coefficient, or those along t1 and t2 where a contact has two.
    points : (n_c, d)
        Contact nodes (those of ``Contact.body``).
    frame : (n_c, d, d)
        Rows n, t1[, t2], n from the obstacle towards the body.
    fixed : (m,)
        Prescribed degrees of freedom, ascending.
    offset : tuple of int
        First degree of freedom of each body.
    contact_dofs : (n_c, 2)
        First degree of freedom of the node and of its partner, -1 for a plane.
    contacts : tuple of Contact
        As given to `build`.
    group : (n_c,)
        Which of them each contact node is of.
    support_dofs : tuple of (len(components), nodes) arrays
        Degrees of freedom of each support.
    nodes : (n / d, d)
        Places of all nodes, body after body.
    """

    bodies: tuple[Body, ...]
    supports: tuple[Support, ...]
    contacts: tuple[Contact, ...]
    offset: tuple[int, ...]
    K: Any
    B: Any
    gap: Floats
    mu: Floats
    area: Floats
    points: Floats
    frame: Floats
    fixed: Ints
    contact_dofs: Ints
    group: Ints
    support_dofs: tuple[Ints, ...]
    dim: int
    nodes: Floats = field(repr=False)

    @property
    def n(self) -> int:
        """Degrees of freedom."""
        return int(self.K.shape[0])

    @property
    def cells(self) -> list[tuple[str, Ints]]:
        """Cells of all bodies, numbered as `nodes`, with corners in the order of VTK."""
        return [
            (kind, corners + first // self.dim)
            for (kind, corners), first in zip(
                map(vtk_cells, self.bodies), self.offset, strict=True
            )
        ]

    def fields(
        self, displacement: Floats, reaction: Floats, status: NDArray[np.integer[Any]]
    ) -> dict[str, NDArray[Any]]:
        """Fields on `nodes`, to look at.

        Parameters
        ----------
        displacement
            ``(n,)`` [m].
        reaction, status
            ``(n_c, d)`` in the frames of the contacts [N], and ``(n_c,)``.

        Returns
        -------
        dict
            ``displacement``, ``contact_pressure`` [Pa], ``contact_shear`` [Pa] (on the
            body that has the node, in global components), and ``contact_status``, -1
            away from contact.
        """
        traction = reaction / self.area[:, None]
        shear = np.einsum("ck,ckd->cd", traction[:, 1:], self.frame[:, 1:])
        fields: dict[str, NDArray[Any]] = {
            "displacement": displacement.reshape(-1, self.dim),
            "contact_pressure": np.zeros(len(self.nodes)),
            "contact_shear": np.zeros_like(self.nodes),
            "contact_status": np.full(len(self.nodes), -1, dtype=np.int8),
        }
        for side, sign in ((0, 1.0), (1, -1.0)):
            has = self.contact_dofs[:, side] >= 0
            node = self.contact_dofs[has, side] // self.dim
            fields["contact_pressure"][node] = traction[has, 0]
            fields["contact_shear"][node] = sign * shear[has]
            fields["contact_status"][node] = status[has]
        return fields

    def problem(
        self,
        *,
        num_threads: int | None = None,
        on_forecast: Callable[[Mapping[str, Any]], object] | None = None,
    ) -> ContactProblem:
        """Condense: the contact problem of these arrays; arguments as there."""
        return ContactProblem(
            self.K,
            self.B,
            gap=self.gap,
            mu=self.mu,
            fixed=self.fixed,
            area=self.area,
            dim=self.dim,
            points=self.points,
            frame=self.frame,
            coordinates=np.repeat(self.nodes, self.dim, axis=0),
            num_threads=num_threads,
            on_forecast=on_forecast,
        )

    def traction(self, body: str, surface: str, value: Field) -> Floats:
        """Consistent nodal forces ``(n,)`` of a surface traction.

        Parameters
        ----------
        body, surface
            Names.
        value
            Force per area ``(d,)`` [Pa], or a function of the places
            ``(d, ...)`` that returns ``(d, ...)``.
        """
        index = _index(self.bodies, body)
        return self._forces(index, self.bodies[index].surface(surface), value)

    def pressure(self, body: str, surface: str, value: float) -> Floats:
        """Consistent nodal forces ``(n,)`` of a pressure, positive inwards [Pa]."""
        number("value", value)
        index = _index(self.bodies, body)
        points = self.bodies[index].surface(surface)
        return self._forces(index, points, -value * np.asarray(points.normals))

    def body_force(self, body: str, value: Field) -> Floats:
        """Consistent nodal forces ``(n,)`` of a force per volume [N/m³], as `traction`."""
        index = _index(self.bodies, body)
        return self._forces(index, self.bodies[index].volume(), value)

    def _forces(self, index: int, points: Quadrature, value: Field) -> Floats:
        f, first = np.zeros(self.n), self.offset[index]
        own = nodal_forces(self.bodies[index], points, value)
        f[first : first + own.size] = own
        return f

    def prescribed(self, values: Sequence[Sequence[float]]) -> Floats:
        """Values of `fixed`, from one number a component of each support [m].

        Raises
        ------
        ValueError
            Two supports give different values to one degree of freedom, or there are
            not as many values as supports and their components.
        """
        if len(values) != len(self.supports):
            raise ValueError(
                f"values are {len(values)}, expected one for each of the "
                f"{len(self.supports)} supports"
            )
        known = [
            floats(f"values of support {i}", given, shape=(len(support.components),))
            for i, (support, given) in enumerate(
                zip(self.supports, values, strict=True)
            )
        ]
        at = np.full(self.n, np.nan)
        for support, dofs, numbers in zip(
            self.supports, self.support_dofs, known, strict=True
        ):
            for row, k, moved in zip(dofs, support.components, numbers, strict=True):
                other = row[~np.isnan(at[row]) & (at[row] != moved)]
                if other.size:
                    place = self.nodes[other[0] // self.dim]
                    raise ValueError(
                        f"supports prescribe both {at[other[0]]:g} and {moved:g} for "
                        f"component {k} of the node at {_place(place)}, the second one "
                        f"on surface {support.surface!r} of body {support.body!r}"
                    )
                at[row] = moved
        return at[self.fixed]


def build(
    bodies: Sequence[Body],
    contacts: Sequence[Contact],
    supports: Sequence[Support] = (),
) -> Model:
    """Assemble K, B and the contact data of elastic bodies.

    A contact node whose tangential displacement is prescribed, on both sides of
    a pair, gets ``mu = 0``: nothing is left for friction to decide there.

    Raises
    ------
    ValueError
        Names that do not exist or repeat, nodes of a pair that do not match,
        a normal of length zero: the message has the name and the place.
    """
    if not bodies:
        raise ValueError("bodies is empty, expected at least one")
    dims = {body.dim for body in bodies}
    if len(dims) > 1:
        raise ValueError("bodies mix two and three dimensions")
    names = [body.name for body in bodies]
    if len(set(names)) < len(names):
        raise ValueError(f"names of bodies repeat: {names}")
    dim = dims.pop()
    ends = np.cumsum([0] + [dim * body.mesh.nvertices for body in bodies])
    offset, n = tuple(int(e) for e in ends[:-1]), int(ends[-1])

    support_dofs = []
    for support in supports:
        b = _index(bodies, support.body)
        if not set(support.components) <= set(range(dim)):
            raise ValueError(
                f"components of the support on {support.surface!r} are "
                f"{list(support.components)}, expected some of {list(range(dim))}"
            )
        nodes = bodies[b].nodes(support.surface, support.within)
        components = np.array(support.components, dtype=np.int64)
        support_dofs.append(offset[b] + dim * nodes + components[:, None])
    flat = [dofs.ravel() for dofs in support_dofs]
    fixed = np.unique(np.concatenate([np.zeros(0, np.int64), *flat]))

    found = [_contact(bodies, offset, contact) for contact in contacts]
    none = (np.zeros((0, dim)), np.zeros((0, dim, dim)), np.zeros(0), np.zeros(0))
    points, frame, gap, area = (
        np.concatenate([empty, *(c[k] for c in found)]) for k, empty in enumerate(none)
    )
    dofs = np.concatenate([np.zeros((0, 2), np.int64), *(c[4] for c in found)])
    group = np.repeat(np.arange(len(contacts)), [len(c[0]) for c in found]).astype(int)
    pairs = np.array([np.broadcast_to(c.mu, 2) for c in contacts], np.float64)
    mu = pairs.reshape(-1, 2)[group]
    if all(np.ndim(c.mu) == 0 for c in contacts):
        mu = mu[:, 0].copy()
    B = _relative_displacement(frame, dofs, n)
    free = np.ones(n)
    free[fixed] = 0.0
    mobile = (abs(B) @ free).reshape(-1, dim)
    mu[~mobile[:, 1:].any(axis=1)] = 0.0

    return Model(
        bodies=tuple(bodies),
        supports=tuple(supports),
        contacts=tuple(contacts),
        offset=offset,
        K=_stacked([stiffness(body) for body in bodies]),
        B=B,
        gap=gap,
        mu=mu,
        area=area,
        points=points,
        frame=frame,
        fixed=fixed,
        contact_dofs=dofs,
        group=group.astype(np.int64),
        support_dofs=tuple(support_dofs),
        dim=dim,
        nodes=np.concatenate([body.points for body in bodies]),
    )


def frames(normals: ArrayLike, axis: ArrayLike | None = None) -> Floats:
    """Orthonormal bases with rows n, t1[, t2], from normals ``(n_c, d)``.

    The tangents are the coordinate axes, in their order, made orthogonal to the
    normal, leaving out the axis nearest to it: with n = z they are x and y. In space
    ``axis (3,)`` may be given: t1 is that direction made orthogonal to the normal, and
    t2 = n × t1.
    """
    n = floats("normals", normals, ndim=2)
    dim = n.shape[1]
    if dim not in (2, 3):
        raise ValueError(f"normals has shape {n.shape}, expected (n_c, 2) or (n_c, 3)")
    length = np.linalg.norm(n, axis=1)
    if not np.all((length > 0) & np.isfinite(length)):
        raise ValueError("a normal has length zero or is not finite")
    n = n / length[:, None]
    nearest = np.argmax(np.abs(n), axis=1)
    frame = np.empty((len(n), dim, dim))
    frame[:, 0] = n
    if axis is not None:
        _along(frame, axis)
        return frame
    for k in range(1, dim):
        # The k-th axis other than the nearest one.
        axis = np.where(k - 1 < nearest, k - 1, k)
        t = np.eye(dim)[axis]
        # Twice: one pass leaves an error of ε over the sine of the angle.
        for _ in range(2):
            for j in range(k):
                t = t - np.sum(t * frame[:, j], axis=1, keepdims=True) * frame[:, j]
        frame[:, k] = t / np.linalg.norm(t, axis=1, keepdims=True)
    return frame


def _along(frame: Floats, axis: ArrayLike) -> None:
    """Fill tangents in behind the normals: the first along ``axis``."""
    if frame.shape[1] != 3:
        raise ValueError("axis was given, in the plane there is one tangent")
    direction = floats("axis", axis, shape=(3,))
    size = np.abs(direction).max()
    if size == 0:
        raise ValueError("axis is zero, expected a direction")
    n, t = frame[:, 0], np.broadcast_to(direction / size, (len(frame), 3))
    for _ in range(2):  # as in `frames`
        t = t - np.sum(t * n, axis=1, keepdims=True) * n
    length = np.linalg.norm(t, axis=1)
    # Below, the direction is the rounding of the normal.
    if (length < 1e-8).any():
        at = int(np.argmin(length))
        raise ValueError(
            f"axis is {direction.tolist()}, expected a direction aside of the normal, "
            f"which is {n[at].tolist()} at contact {at}"
        )
    frame[:, 1] = t / length[:, None]
    frame[:, 2] = np.cross(n, frame[:, 1])


def _contact(
    bodies: Sequence[Body], offset: Sequence[int], contact: Contact
) -> tuple[Floats, Floats, Floats, Floats, Ints]:
    """Points, frames, gaps, areas and first degrees of freedom of one contact."""
    what = f"mu of the contact on {contact.surface!r}"
    if np.ndim(contact.mu) == 1:
        friction(np.asarray(contact.mu)[None], 1, bodies[0].dim, ratio=RATIO)
    elif not 0 <= number(what, contact.mu) < np.inf:
        raise ValueError(
            f"{what} is {contact.mu}, expected a finite number, zero or positive"
        )
    b = _index(bodies, contact.body)
    body = bodies[b]
    nodes = body.nodes(contact.surface, contact.within)
    if not nodes.size:
        raise ValueError(
            f"contact on {contact.surface!r} of body {body.name!r} has no nodes: "
            "within leaves none"
        )
    facets = body.surface(contact.surface)
    area = body.depth * facets.moment(np.ones(facets.weights.shape))[nodes]
    points = body.points[nodes]
    first = offset[b] + body.dim * nodes
    if contact.plane is not None and contact.against is None:
        what = f"plane of the contact on {contact.surface!r}"
        if len(contact.plane) != 2:
            raise ValueError(f"{what} is not a pair of a point and a normal")
        point, normal = (floats(what, a) for a in contact.plane)
        if point.shape != (body.dim,) or normal.shape != (body.dim,):
            raise ValueError(
                f"{what} has shapes {point.shape} and {normal.shape}, expected "
                f"({body.dim},)"
            )
        frame = frames(np.broadcast_to(normal, points.shape), contact.axis)
        partner = np.full(len(nodes), -1, dtype=np.int64)
        distance = points - point
    elif contact.against is not None and contact.plane is None:
        frame = frames(-_normals(facets)[nodes], contact.axis)
        o = _index(bodies, contact.against[0])
        if o == b:
            raise ValueError(f"body {body.name!r} is in contact with itself")
        obstacle, surface = bodies[o], contact.against[1]
        theirs = obstacle.nodes(surface)
        match = _match(points, obstacle.points[theirs], frame, contact)
        partner = offset[o] + obstacle.dim * theirs[match]
        distance = points - obstacle.points[theirs[match]]
    else:
        raise ValueError(
            f"contact on {contact.surface!r} needs one obstacle, plane or against"
        )
    extra = contact.clearance
    what = f"clearance of the contact on {contact.surface!r}"
    clearance = floats(what, extra(points) if callable(extra) else extra)
    if clearance.shape not in ((), (1,), (len(nodes),)):
        raise ValueError(
            f"{what} has shape {clearance.shape}, expected a number or ({len(nodes)},)"
        )
    gap = np.einsum("cd,cd->c", frame[:, 0], distance) + clearance
    return points, frame, gap, area, np.stack([first, partner], axis=1)


def _normals(facets: Quadrature) -> Floats:
    """Outward normals at the nodes of a surface ``(nodes, d)``, by area, not of length 1."""
    normal = np.asarray(facets.normals)
    nodal = np.stack([facets.moment(component) for component in normal], axis=1)
    # A component of rounding size on a coordinate plane would couple B to
    # displacements that the contact does not feel.
    small = 1e-14 * np.abs(nodal).max(axis=1, keepdims=True)
    return np.where(np.abs(nodal) <= small, 0.0, nodal)


def _match(ours: Floats, theirs: Floats, frame: Floats, contact: Contact) -> Ints:
    """Index of the node opposite to each of ours, along the normal."""
    match = _nearest(ours, theirs)
    between = ours - theirs[match]
    along = np.einsum("cd,cd->c", frame[:, 0], between)
    aside = np.linalg.norm(between - along[:, None] * frame[:, 0], axis=1)
    # Nodes of one place written by two meshers differ in their last digits.
    bad = np.flatnonzero(aside > 1e-7 * np.ptp(ours, axis=0).max())
    if bad.size:
        raise ValueError(
            f"surfaces {contact.surface!r} of {contact.body!r} and {contact.against} do "
            f"not match: no node lies opposite to the one at {_place(ours[bad[0]])}, "
            f"the nearest is {aside[bad[0]]:g} aside"
        )
    values, counts = np.unique(match, return_counts=True)
    if np.any(counts > 1):
        raise ValueError(
            f"surfaces {contact.surface!r} of {contact.body!r} and {contact.against} do "
            f"not match: the node at {_place(theirs[values[counts > 1][0]])} lies "
            "opposite to several"
        )
    return np.asarray(match, dtype=np.int64)


def _nearest(ours: Floats, theirs: Floats) -> Ints:
    """Index of the nearest of theirs, ``(ours,)``."""
    if len(ours) * len(theirs) > _ALL_PAIRS:
        from scipy.spatial import cKDTree

        _, match = cKDTree(theirs).query(ours)
        return np.asarray(match, dtype=np.int64)
    distance = np.zeros((len(ours), len(theirs)))
    for mine, other in zip(ours.T, theirs.T, strict=True):
        distance += np.subtract.outer(mine, other) ** 2
    return np.asarray(distance.argmin(axis=1), dtype=np.int64)


def _stacked(blocks: Sequence[Any]) -> Any:
    """CSR with the matrices of the bodies on the diagonal, as they are."""
    if len(blocks) == 1:
        return blocks[0]
    ends = np.cumsum([0] + [block.shape[0] for block in blocks])
    entries = np.cumsum([0] + [block.nnz for block in blocks])
    # One type for all: indices of mixed types are copied at each step.
    wide = np.int64 if max(ends[-1], entries[-1]) >= 2**31 else np.int32
    index = [
        block.indices.astype(wide) + wide(first)
        for block, first in zip(blocks, ends[:-1], strict=True)
    ]
    start = [
        block.indptr[:-1].astype(wide) + wide(first)
        for block, first in zip(blocks, entries[:-1], strict=True)
    ]
    return sparse.csr_array(
        (
            np.concatenate([block.data for block in blocks]),
            np.concatenate(index),
            np.concatenate([*start, np.array(entries[-1:], dtype=wide)]),
        ),
        shape=(int(ends[-1]), int(ends[-1])),
    )


def _relative_displacement(frame: Floats, dofs: Ints, n: int) -> Any:
    """B of (2): node minus partner, in the frame of the contact."""
    count, dim = frame.shape[:2]
    rows = np.arange(dim * count).reshape(count, dim, 1)
    data, row, column = [], [], []
    for side, sign in ((0, 1.0), (1, -1.0)):
        has = dofs[:, side] >= 0
        columns = dofs[has, side, None, None] + np.arange(dim)
        data.append((sign * frame[has]).ravel())
        row.append(np.broadcast_to(rows[has], (has.sum(), dim, dim)).ravel())
        column.append(np.broadcast_to(columns, (has.sum(), dim, dim)).ravel())
    triplets = (np.concatenate(data), (np.concatenate(row), np.concatenate(column)))
    B = sparse.coo_array(triplets, shape=(dim * count, n)).tocsr()
    B.eliminate_zeros()
    return B


def _index(bodies: Sequence[Body], name: str) -> int:
    for index, body in enumerate(bodies):
        if body.name == name:
            return index
    raise ValueError(
        f"there is no body {name!r}, expected one of {[body.name for body in bodies]}"
    )


def _place(x: Floats) -> str:
    return "(" + ", ".join(f"{c:g}" for c in x) + ")"
