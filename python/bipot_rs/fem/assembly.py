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

from bipot_rs._lib.messages import counted, place
from bipot_rs._lib.types import Bools, Floats, Ints
from bipot_rs._lib.validation import floats, number
from bipot_rs.contact.frames import frames
from bipot_rs.contact.problem import ContactProblem
from bipot_rs.fem.body import Body, Box, Field, Quadrature
from bipot_rs.fem.boundary import (
    Spring,
    Symmetry,
    plane_of,
    spring_stiffness,
    surface,
    with_surfaces,
)
from bipot_rs.fem.contact import (
    Contact,
    body_index,
    gaps_of_steps,
    gaps_onwards,
    meet,
    relative_displacement,
)
from bipot_rs.fem.elasticity import nodal_forces, stiffness, vtk_cells
from bipot_rs.fem.inclined_supports import HeldNodes, Planes, planes
from bipot_rs.fem.materials import Material, Orthotropic
from bipot_rs.fem.stress_recovery import (
    Initial,
    initial_forces,
    stress,
    thermal,
    von_mises,
)
from bipot_rs.mesh.boxes import FACES, box
from bipot_rs.mesh.elements import second_order
from bipot_rs.mesh.quality import check_mesh
from bipot_rs.mesh.readers import read_mesh, read_meshes
from bipot_rs.obstacle.motion import Motion

__all__ = [
    "FACES",
    "Assembly",
    "Body",
    "Contact",
    "Material",
    "Orthotropic",
    "Spring",
    "Support",
    "Symmetry",
    "assemble",
    "box",
    "check_mesh",
    "frames",
    "read_mesh",
    "read_meshes",
    "second_order",
    "stiffness",
    "stress",
    "surface",
    "thermal",
    "von_mises",
    "with_surfaces",
]


# Of a tangential row of B: what the digits of a normal leave of one that is held.
_NO_WAY = 1e-6


@dataclass(frozen=True)
class Support:
    """Prescribed displacement components of a named surface."""

    body: str
    surface: str
    components: Sequence[int]
    within: Box | None = None


@dataclass(frozen=True)
class Assembly:
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
        First degree of freedom of the node and of its partner, -1 where there is no one
        partner: for a rigid obstacle, and for meshes that do not match.
    contacts : tuple of Contact
        As given to `build`.
    group : (n_c,)
        Which of them each contact node is of.
    support_dofs : tuple of (len(components), nodes) arrays
        Degrees of freedom of each support.
    nodes : (n / d, d)
        Places of all nodes, body after body.
    supports
        Those given, and behind them one for each plane of symmetry normal to an axis.
    symmetries : int
        How many these are.
    springs : tuple of Spring
        Whose stiffness is in K.
    moving : (steps, n_c, d) or None
        Gaps of each load step by component, where obstacles move; `gaps` gives them.
    inclined : bipot_rs.fem.inclined_supports.Planes or None
        Planes of symmetry that no axis is normal to. K, B and all loads made here know
        them, and so does `problem`; a `ContactProblem` made otherwise is to be given
        ``inclined.within @ f`` of a load f.
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
    symmetries: int = 0
    springs: tuple[Spring, ...] = ()
    moving: Floats | None = field(default=None, repr=False)
    inclined: Planes | None = None
    _bare: Any = field(default=None, repr=False)

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
            away from contact. At a node of several contacts their tractions add, and
            the status is the firmest. Where meshes do not match, both bodies have the nodal
            forces Bᵀ r over the nodes' own areas of contact, and the status of the
            contact that weighs most.
        """
        traction = reaction / self.area[:, None]
        shear = np.einsum("ck,ckd->cd", traction[:, 1:], self.frame[:, 1:])
        fields: dict[str, NDArray[Any]] = {
            "displacement": displacement.reshape(-1, self.dim),
            "contact_pressure": np.zeros(len(self.nodes)),
            "contact_shear": np.zeros_like(self.nodes),
            "contact_status": np.full(len(self.nodes), -1, dtype=np.int8),
        }
        opposite = np.array([c.pairing == "match" for c in self.contacts], np.bool_)
        for side, sign in ((0, 1.0), (1, -1.0)):
            has = (self.contact_dofs[:, side] >= 0) & opposite[self.group]
            node = self.contact_dofs[has, side] // self.dim
            # Added: a node in a corner has two contacts.
            np.add.at(fields["contact_pressure"], node, traction[has, 0])
            np.add.at(fields["contact_shear"], node, sign * shear[has])
            np.maximum.at(fields["contact_status"], node, status[has])
        for group, contact in enumerate(self.contacts):
            if contact.pairing != "match":
                own = np.flatnonzero(self.group == group)
                self._spread(fields, own, traction[own, 0], shear[own], status[own])
        return fields

    def _spread(
        self,
        fields: dict[str, NDArray[Any]],
        contacts: Ints,
        pressure: Floats,
        shear: Floats,
        status: NDArray[np.integer[Any]],
    ) -> None:
        """Contact fields of a pair of surfaces whose meshes do not match.

        With the weights w of the contacts on a body, node j has the area ``Σ w_ij a_i``
        and the force ``Σ w_ij a_i t_i``; where these have both signs, ``|w_ij|``.
        """
        slave = body_index(self.bodies, self.contacts[self.group[contacts[0]]].body)
        weights = self._weights(contacts)
        node = np.flatnonzero(np.diff(weights.indptr))
        weights = weights[node]
        first = self.offset[slave] // self.dim
        count = len(self.bodies[slave].points)
        sign = np.where((node >= first) & (node < first + count), 1.0, -1.0)
        scaled = weights.multiply(sign[:, None]).tocsr().multiply(self.area[contacts])
        scaled = scaled.tocsr()
        # Weights of quadratic facets have both signs, and sums near zero: of such the
        # mean by size, which has no value beyond those of the contacts.
        size = abs(scaled)
        mixed = np.abs(scaled.sum(axis=1)) < (1 - 1e-9) * size.sum(axis=1)
        scaled = sparse.diags_array((~mixed).astype(float)) @ scaled
        scaled = scaled + sparse.diags_array(mixed.astype(float)) @ size
        area = scaled.sum(axis=1)
        fields["contact_pressure"][node] += (scaled @ pressure) / area
        fields["contact_shear"][node] += (
            sign[:, None] * (scaled @ shear) / area[:, None]
        )
        rows = np.repeat(np.arange(len(node)), np.diff(size.indptr))
        order = np.lexsort([size.data, rows])
        largest = order[np.cumsum(np.diff(size.indptr)) - 1]
        known = fields["contact_status"][node]
        fields["contact_status"][node] = np.maximum(
            known, status[size.indices[largest]]
        )

    def _weights(self, contacts: Ints) -> Any:
        """Scalar weights behind rows of B, ``(nodes, contacts)``: blocks are w_ij frame_i."""
        d = self.dim
        rows = (d * contacts[:, None] + np.arange(d)).ravel()
        # The first row of frameᵀ frame = 1, in the first component of each node.
        along = sparse.csr_array(
            (
                self.frame[contacts, :, 0].ravel(),
                (np.arange(rows.size), np.repeat(np.arange(len(contacts)), d)),
            )
        )
        B = self.B if self._bare is None else self._bare
        first = B[rows].tocsc()[:, ::d]
        return sparse.csr_array(first.T @ along)

    def problem(
        self,
        *,
        num_threads: int | None = None,
        on_forecast: Callable[[Mapping[str, Any]], object] | None = None,
    ) -> ContactProblem:
        """Condense: the contact problem of these arrays, its obstacles moving as asked."""
        held = (
            None
            if self.inclined is None
            else HeldNodes(self.inclined, self.fixed, self.nodes)
        )
        return ContactProblem._on_inclined_supports(
            held,
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
            gaps=self.moving,
            on_forecast=on_forecast,
            bodies=dict(
                zip((body.name for body in self.bodies), self.offset, strict=True)
            ),
        )

    def gaps(self, steps: int) -> Floats | None:
        """Gaps of a load path, ``gap`` of `ContactProblem.solve`; `problem` knows them.

        Returns
        -------
        (steps, n_c, d) or None
            By component [m]: along the normal the distance of the obstacle as it then
            stands, along the tangents less the way its surface has gone under the node.
            None where nothing moves.

        Raises
        ------
        ValueError
            The obstacles move through another number of steps.
        """
        if self.moving is not None and len(self.moving) != steps:
            raise ValueError(
                f"obstacles move through {counted(len(self.moving), 'step')}, the load "
                f"path has {steps}"
            )
        return self.moving

    def gaps_between(
        self, before: int, motions: Sequence[Motion | None]
    ) -> Floats | None:
        """Gaps after a part of a load step, as those of `gaps`.

        Parameters
        ----------
        before
            Load steps that are over, the state that the part begins with.
        motions
            Of each contact the motion of its obstacle in two states, the first that of
            ``before``; None for one at rest.

        Returns
        -------
        (n_c, d) or None
            None where nothing moves. A function of where the part ends alone: it does
            not depend on how the load step is divided.
        """
        if self.moving is None:
            return None
        gaps: Floats = np.zeros_like(self.moving[0])
        gaps[:, 0] = self.gap
        if before:
            gaps = self.moving[before - 1].copy()
        for group, motion in enumerate(motions):
            if motion is not None:
                at = self.group == group
                gaps[at] = gaps_onwards(
                    *(self.bodies, self.contacts[group], motion),
                    *(self.points[at], self.frame[at], gaps[at]),
                )
        return gaps

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
        index = body_index(self.bodies, body)
        return self._forces(index, self.bodies[index].surface(surface), value)

    def pressure(self, body: str, surface: str, value: float) -> Floats:
        """Consistent nodal forces ``(n,)`` of a pressure, positive inwards [Pa]."""
        number("value", value)
        index = body_index(self.bodies, body)
        points = self.bodies[index].surface(surface)
        return self._forces(index, points, -value * np.asarray(points.normals))

    def body_force(self, body: str, value: Field) -> Floats:
        """Consistent nodal forces ``(n,)`` of a force per volume [N/m³], as `traction`."""
        index = body_index(self.bodies, body)
        return self._forces(index, self.bodies[index].volume(), value)

    def initial_strain(self, body: str, strain: Initial) -> Floats:
        """Nodal forces ``(n,)`` by which an initial strain, such as heat, acts [N].

        Parameters
        ----------
        body
            Its name.
        strain
            What the body would do if nothing held it: a tensor ``(d, d)`` or ``(3, 3)``,
            a function of the places, `thermal`, or a mapping of volumes of the body to
            these (`bipot_rs.fem.stress_recovery`). `stress` takes it as ``initial``.
        """
        index = body_index(self.bodies, body)
        return self._at(index, initial_forces(self.bodies[index], strain))

    def displacement_of(self, body: str, displacement: ArrayLike) -> Floats:
        """Displacement of one body, ``(nodes, d)``, out of that of all, ``(n,)``."""
        index = body_index(self.bodies, body)
        u = floats("displacement", displacement, shape=(self.n,))
        first = self.offset[index]
        size = self.bodies[index].points.size
        return u[first : first + size].reshape(-1, self.dim)

    def _at(self, index: int, own: Floats) -> Floats:
        f, first = np.zeros(self.n), self.offset[index]
        f[first : first + own.size] = own
        return f if self.inclined is None else self.inclined.within @ f

    def _forces(self, index: int, points: Quadrature, value: Field) -> Floats:
        return self._at(index, nodal_forces(self.bodies[index], points, value))

    def prescribed(self, values: Sequence[Sequence[float]]) -> Floats:
        """Values of `fixed`, from one number a component of each support [m].

        Planes of symmetry are held at zero and take none.

        Raises
        ------
        ValueError
            Two supports give different values to one degree of freedom, or there are
            not as many values as supports and their components.
        """
        count = len(self.supports) - self.symmetries
        if len(values) != count:
            raise ValueError(
                f"values are {len(values)}, expected one for each of the {count} supports"
            )
        known = [
            floats(f"values of support {i}", given, shape=(len(support.components),))
            for i, (support, given) in enumerate(
                zip(self.supports[:count], values, strict=True)
            )
        ]
        known += [np.zeros(1)] * self.symmetries
        at = np.full(self.n, np.nan)
        for support, dofs, numbers in zip(
            self.supports, self.support_dofs, known, strict=True
        ):
            for row, k, moved in zip(dofs, support.components, numbers, strict=True):
                other = row[~np.isnan(at[row]) & (at[row] != moved)]
                if other.size:
                    where = place(self.nodes[other[0] // self.dim])
                    raise ValueError(
                        f"supports prescribe both {at[other[0]]:g} and {moved:g} for "
                        f"component {k} of the node at {where}, the second one "
                        f"on surface {support.surface!r} of body {support.body!r}"
                    )
                at[row] = moved
        if self.inclined is not None:
            self.inclined.refuse(np.nan_to_num(at), self.nodes)
        return at[self.fixed]


def assemble(
    bodies: Sequence[Body],
    contacts: Sequence[Contact],
    supports: Sequence[Support] = (),
    *,
    symmetries: Sequence[Symmetry] = (),
    springs: Sequence[Spring] = (),
) -> Assembly:
    """Assemble K, B and the contact data of elastic bodies.

    Parameters
    ----------
    bodies, contacts
        What meets.
    supports
        Prescribed displacements; their values are those of `Assembly.prescribed`.
    symmetries
        Planes that cut the bodies in two alike halves, of which the bodies are one, in
        any direction (`bipot_rs.fem.inclined_supports`).
    springs
        Elastic foundations.

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
    ends = np.cumsum([0] + [dim * len(body.points) for body in bodies])
    offset, n = tuple(int(e) for e in ends[:-1]), int(ends[-1])
    mirrors = [(s, plane_of(bodies[body_index(bodies, s.body)], s)) for s in symmetries]
    straight = [
        Support(s.body, s.surface, (k,)) for s, (k, _) in mirrors if k is not None
    ]
    supports = [*supports, *straight]
    matrices = [stiffness(body) for body in bodies]
    for spring in springs:
        b = body_index(bodies, spring.body)
        matrices[b] = matrices[b] + spring_stiffness(bodies[b], spring)

    support_dofs = []
    for support in supports:
        b = body_index(bodies, support.body)
        if not set(support.components) <= set(range(dim)):
            raise ValueError(
                f"components of the support on {support.surface!r} are "
                f"{list(support.components)}, expected some of {list(range(dim))}"
            )
        nodes = bodies[b].nodes(support.surface, support.within)
        if not nodes.size:
            raise ValueError(
                f"support on {support.surface!r} of body {support.body!r} has no nodes: "
                "within leaves none"
            )
        components = np.array(support.components, dtype=np.int64)
        support_dofs.append(offset[b] + dim * nodes + components[:, None])
    flat = [dofs.ravel() for dofs in support_dofs]
    fixed = np.unique(np.concatenate([np.zeros(0, np.int64), *flat]))

    found = [meet(bodies, offset, n, contact) for contact in contacts]

    def stacked(name: str, *shape: int) -> Floats:
        return np.concatenate(
            [np.zeros((0, *shape)), *(getattr(m, name) for m in found)]
        )

    gap, frame = stacked("gap"), stacked("frame", dim, dim)
    dofs = np.concatenate([np.zeros((0, 2), np.int64), *(m.dofs for m in found)])
    group = np.repeat(np.arange(len(contacts)), [len(m.gap) for m in found]).astype(int)
    pairs = np.array([np.broadcast_to(c.mu, 2) for c in contacts], np.float64)
    mu = pairs.reshape(-1, 2)[group]
    if all(np.ndim(c.mu) == 0 for c in contacts):
        mu = mu[:, 0].copy()
    B, K = relative_displacement(found, n), _stacked(matrices)
    free = np.ones(n)
    free[fixed] = 0.0
    inclined, bare = _inclined(bodies, offset, mirrors, free == 0), None
    moving = gaps_of_steps(found, dim)
    if inclined is not None:
        if dim == 3:
            # Friction by direction has tangents of its own.
            plain = np.array([np.ndim(c.mu) == 0 for c in contacts], np.bool_)[group]
            turned = inclined.tangents(frame, dofs[:, 0], plain)
            B, moving = _in_frames(turned, frame, B, moving)
            frame = turned
        bare = B
        B, K = inclined.relative(B), inclined.stiffness(K)
    left = (abs(B) @ free).reshape(-1, dim)[:, 1:]
    whole = abs(B if bare is None else bare).sum(axis=1).reshape(-1, dim)[:, 1:]
    # Rounding of a normal is no way to slip.
    mu[(left <= _NO_WAY * whole).all(axis=1)] = 0.0

    return Assembly(
        bodies=tuple(bodies),
        supports=tuple(supports),
        contacts=tuple(contacts),
        offset=offset,
        K=K,
        B=B,
        gap=gap,
        mu=mu,
        area=stacked("area"),
        points=stacked("points", dim),
        frame=frame,
        fixed=fixed,
        contact_dofs=dofs,
        group=group.astype(np.int64),
        support_dofs=tuple(support_dofs),
        dim=dim,
        moving=moving,
        nodes=np.concatenate([body.points for body in bodies]),
        symmetries=len(straight),
        springs=tuple(springs),
        inclined=inclined,
        _bare=bare,
    )


def _in_frames(
    turned: Floats, frame: Floats, B: Any, moving: Floats | None
) -> tuple[Any, Floats | None]:
    """B and the gaps of steps by the components of other frames."""
    rotation = np.einsum("cki,cli->ckl", turned, frame)
    same = (turned == frame).all(axis=(1, 2))
    if same.all():
        return B, moving
    rotation[same] = np.eye(turned.shape[1])
    blocks = sparse.bsr_array(
        (rotation, np.arange(len(frame)), np.arange(len(frame) + 1))
    )
    if moving is not None:
        moving = np.where(
            same[:, None], moving, np.einsum("ckl,scl->sck", rotation, moving)
        )
    return sparse.csr_array(blocks.tocsr() @ B), moving


def _inclined(
    bodies: Sequence[Body],
    offset: Sequence[int],
    mirrors: Sequence[tuple[Symmetry, tuple[int | None, Floats]]],
    fixed: Bools,
) -> Planes | None:
    """Planes of symmetry that no axis is normal to."""
    groups = []
    for symmetry, (axis, normal) in mirrors:
        if axis is None:
            b = body_index(bodies, symmetry.body)
            nodes = bodies[b].nodes(symmetry.surface)
            groups.append((offset[b] + bodies[b].dim * nodes, normal))
    return planes(groups, fixed, bodies[0].dim)


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


# The names before 0.2, which go on working.
Model = Assembly
build = assemble
