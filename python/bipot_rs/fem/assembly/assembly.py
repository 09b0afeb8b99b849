"""Assembly of K, B, gap and loads of (1) and (2) from the meshes of elastic bodies.

Body ``b`` has a contiguous range of degrees of freedom, ``offset[b] + dim *
node + component``, so that K is block diagonal.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import sparse

from bipot_rs._lib.machine import available
from bipot_rs._lib.matrices import diagonal_matrix, rigid_motions
from bipot_rs._lib.messages import count_noun, place
from bipot_rs._lib.records import short_repr
from bipot_rs._lib.types import (
    AnyArray,
    Bools,
    CsrMatrix,
    Floats,
    Integers,
    Ints,
    OpenRecord,
)
from bipot_rs._lib.validation import floats
from bipot_rs.contact.errors import (
    NotIterativeError,
    describe_contact,
    with_message,
    with_reason,
)
from bipot_rs.contact.law.contact_law import BESIDE_MU
from bipot_rs.contact.law.frames import turn_operator
from bipot_rs.contact.path.choice import choose_engine
from bipot_rs.contact.path.mesh_stiffness import MeshStiffness
from bipot_rs.contact.path.moving_gaps import (
    MovingGaps,
    drop_equal_frames,
    join_steps,
)
from bipot_rs.contact.problem import ContactProblem
from bipot_rs.fem.assembly.system_stiffness import system_stiffness
from bipot_rs.fem.bodies.body import Body, Box, Field, NumberedBodies
from bipot_rs.fem.bodies.boundary import Load, PointLoad, Spring
from bipot_rs.fem.bodies.elasticity import vtk_cells
from bipot_rs.fem.bodies.stress_recovery import Initial
from bipot_rs.fem.constraints.references import (
    Reference,
    Remote,
    distributed_force,
    prescribed_values,
    reference_named,
    with_points,
)
from bipot_rs.fem.constraints.ties import Planes, Ties
from bipot_rs.fem.contact.contact import Contact, ContactSurface
from bipot_rs.fem.contact.meeting import follow_obstacle, frames_of_steps
from bipot_rs.obstacle.motion import Motion

if TYPE_CHECKING:
    from bipot_rs.contact.results.derivatives import Gradient
    from bipot_rs.contact.results.solution import Step
    from bipot_rs.fem.constraints.repetition import Images
    from bipot_rs.fem.gradients.parameter_gradient import ParameterGradient

# Nodes whose rows of K are assembled at a time, an eighth of all within these bounds: some 8 kB
# each, and those of cells at the borders are integrated twice.
_LEAST_PART, _MOST_PART = 1 << 13, 1 << 16


@dataclass(frozen=True)
class Support:
    """Prescribed displacement components of a part of a body.

    ``surface`` is the name of a surface or of a volume; None is the whole body. ``within``
    selects nodes by ranges of coordinates, ``at`` only the node nearest to a position
    (`Body.members`): so also nodes inside the body can be held.
    """

    body: str
    surface: str | None
    components: Sequence[int]
    within: Box | None = None
    at: ArrayLike | None = None


class _NodalFields(NamedTuple):
    """Contact fields at the nodes of a model: `Assembly.fields` fills these arrays."""

    pressure: Floats
    shear: Floats
    status: NDArray[np.int8]


@dataclass(frozen=True)
class Assembly:
    """The arrays of (1) and (2), and their relation to the bodies.

    Attributes
    ----------
    K : scipy.sparse.csr_array (n, n) or None
        Stiffness [N/m], bitwise symmetric; None if `assemble` left it out.
    B : scipy.sparse.csr_array (d n_c, n)
        ``B u`` is the displacement relative to the obstacle, ``(n, t1[, t2])``.
    gap, area : (n_c,)
        Normal gap [m], tributary area [m²].
    mu : (n_c,) or (n_c, 2)
        Friction coefficient; if a contact has two, along t1 and t2.
    cohesion, dilatancy : (n_c,)
        Cohesion [N], and dilatancy.
    points : (n_c, d)
        Positions of the contact nodes, on ``Contact.body`` [m].
    frame : (n_c, d, d)
        Rows n, t1[, t2] at the start, n from the obstacle towards the body.
    fixed : (m,)
        Prescribed degrees of freedom, ascending; among them the dependent ones of `ties`,
        whose displacement follows from the others.
    numbered : bipot_rs.fem.bodies.body.NumberedBodies
        The bodies by name, with their degrees of freedom.
    contact_dofs : (n_c, 2)
        First degree of freedom of the node and of its partner; -1 without a single
        partner: for a rigid obstacle, and for meshes that do not match.
    contacts : tuple of Contact
        As passed to `assemble`.
    group : (n_c,)
        Index in ``contacts`` of each contact node.
    support_dofs : tuple of (len(components), nodes) arrays
        Degrees of freedom of each support.
    nodes : (nodes, d)
        Positions of all nodes, body after body [m]. Without reference points n is d times
        their number.
    supports
        As passed, followed by one for each plane of symmetry normal to an axis, and for each
        body with nodes on the axis of revolution.
    symmetries : int
        Number of these that follow.
    springs : tuple of Spring
        Elastic foundations; K contains their stiffness.
    moving : (steps, n_c, d), bipot_rs.MovingGaps or None
        Gaps of each load step, if obstacles move; see `gaps`.
    inclined : bipot_rs.fem.constraints.ties.Planes or None
        Planes of symmetry that are not normal to an axis, which `ties` contain.
    remotes : tuple of Remote
        As passed to `assemble`.
    references : tuple of bipot_rs.fem.constraints.references.Reference
        Floating obstacles, rigid sets and bolts: their degrees of freedom follow those of
        the nodes.
    ties : bipot_rs.fem.constraints.ties.Ties or None
        Relations of inclined planes of symmetry, rigid sets, repetitions and bolts. K, B, the
        loads made here and `problem` include them. A `ContactProblem` made directly needs
        ``ties.load(f)`` as the load instead of f, and its displacements are
        ``ties.displacement(u)``.
    images : tuple of bipot_rs.fem.constraints.repetition.Images
        The nodes of the cuts of cyclic symmetries and periodicities.
    """

    numbered: NumberedBodies
    supports: tuple[Support, ...]
    contacts: tuple[Contact, ...]
    K: Any
    B: CsrMatrix
    gap: Floats
    mu: Floats
    cohesion: Floats
    dilatancy: Floats
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
    moving: Floats | MovingGaps | None = field(default=None, repr=False)
    inclined: Planes | None = None
    remotes: tuple[Remote, ...] = ()
    references: tuple[Reference, ...] = ()
    ties: Ties | None = None
    images: tuple[Images, ...] = ()
    _bare: CsrMatrix | None = field(default=None, repr=False)
    _path: MovingGaps | None = field(default=None, repr=False)
    # The terms of each row of K over its entries, where ties sum rows.
    _loss: Floats | None = field(default=None, repr=False)

    __repr__ = short_repr

    @property
    def bodies(self) -> tuple[Body, ...]:
        """The bodies as passed to `assemble`."""
        return tuple(numbered.body for numbered in self.numbered.values())

    @property
    def law(self) -> OpenRecord:
        """The numbers of the law of each contact, as arguments of a problem."""
        return {name: getattr(self, name) for name in ("mu", *BESIDE_MU)}

    @property
    def bolts(self) -> tuple[Reference, ...]:
        """The bolts among `references`."""
        return tuple(point for point in self.references if point.kind == "bolt")

    @property
    def offset(self) -> tuple[int, ...]:
        """First degree of freedom of each body."""
        return tuple(self.numbered.first_dofs.values())

    @property
    def n(self) -> int:
        """Number of degrees of freedom."""
        references = sum(point.nodes for point in self.references)
        return int(self.nodes.size) + self.dim * references

    def stiffness(self) -> CsrMatrix:
        """K, assembled once more, with the same bits."""
        made: CsrMatrix = self.with_stiffness().K
        return made

    def with_stiffness(self) -> Assembly:
        """The same with K."""
        if self.ties is None:
            return replace(self, K=system_stiffness(self.numbered, self.springs))
        rigid = {point.whole for point in self.references if point.whole is not None}
        whole = system_stiffness(self.numbered, self.springs, rigid=rigid)
        K = self.ties.stiffness(whole)
        return replace(self, K=K, _loss=self.ties.measure_loss(whole, K))

    def reads_parts(self, engine: str, steps: int | None) -> bool:
        """Whether `problem` can do without K: the iterative engine reads it in parts."""
        if self.dim == 2 or self.ties is not None:
            return False
        free, contacts = self.n - len(self.fixed), len(self.gap)
        name, _ = choose_engine(engine, self.dim, free, contacts, steps, available())
        return name == "iterative"

    def _read_stiffness(
        self, engine: str, steps: int | None, num_threads: int | None
    ) -> CsrMatrix | MeshStiffness:
        """K in parts, if the engine reads it so."""
        at = self._coordinates() if self.reads_parts(engine, steps) else None
        read = None
        if at is not None:
            count = len(self.nodes)
            size = min(max(count // 8, _LEAST_PART), _MOST_PART)
            nodes = np.array_split(np.arange(count), -(-count // size))
            parts = map(self.stiffness_rows, nodes)
            read = MeshStiffness.read(
                parts, at, self.fixed, num_threads, self.stiffness
            )
        return self.stiffness() if read is None else read

    def released(self, problem: ContactProblem) -> Assembly:
        """The same without K, which ``problem``, made from it, may not need any more.

        The iterative engine has a copy of its own. If it stalls, the direct engine has K
        assembled once more.
        """
        bare = replace(self, K=None)
        return bare if problem.stiffness.release(bare.stiffness) else self

    def stiffness_rows(self, nodes: Ints) -> CsrMatrix:
        """Rows of K of some nodes, CSR ``(d m, n)``, with the bits of `assemble` without ties.

        Only the cells that touch these nodes, or nodes tied to them, are integrated: processes
        that share the nodes assemble K in parts.

        Parameters
        ----------
        nodes
            Ascending numbers of nodes, the reference nodes after the others, ``(m,)``.
        """
        rigid = {point.whole for point in self.references if point.whole is not None}

        def read(wanted: Ints) -> CsrMatrix:
            return system_stiffness(self.numbered, self.springs, wanted, rigid)

        if self.ties is None:
            return read(nodes)
        return self.ties.stiffness_rows(read, nodes, len(self.nodes))

    def in_step(self, step: Step) -> Assembly:
        """The same with frames and B of a load step, if these change along the path."""
        frame: Floats | None = getattr(step, "frame", None)
        if frame is None:
            return self
        turned = turn_operator(frame, self.frame, self.B)
        bare = self._bare
        if bare is not None:
            bare = turn_operator(frame, self.frame, bare)
        return replace(self, frame=frame, B=turned, _bare=bare)

    @cached_property
    def cells(self) -> list[tuple[str, Ints]]:
        """Cells of all bodies, with indices into `nodes`, in the node order of VTK."""
        return [
            (kind, corners + first // self.dim)
            for (kind, corners), first in zip(
                map(vtk_cells, self.bodies), self.offset, strict=True
            )
        ]

    def fields(
        self, displacement: Floats, reaction: Floats, status: Integers
    ) -> dict[str, AnyArray]:
        """Fields at `nodes`, for plots and ParaView.

        Parameters
        ----------
        displacement
            ``(n,)`` [m].
        reaction, status
            ``(n_c, d)`` in the frames of the contacts [N], and ``(n_c,)``.

        Returns
        -------
        dict
            ``displacement``, ``contact_pressure`` [Pa], ``contact_shear`` [Pa] (acting
            on the body of the node, in global components), and ``contact_status``, -1
            at nodes without contact. At a node of several contacts their tractions are
            added, and the status is the largest: stick, then slip, then open. If meshes
            do not match, tractions on both bodies are the nodal forces Bᵀ r over the
            nodes' contact areas, and the status is that of the contact with the largest
            weight.
        """
        traction = reaction / self.area[:, None]
        shear = np.einsum("ck,ckd->cd", traction[:, 1:], self.frame[:, 1:])
        fields = _NodalFields(
            np.zeros(len(self.nodes)),
            np.zeros_like(self.nodes),
            np.full(len(self.nodes), -1, dtype=np.int8),
        )
        opposite = np.array([c.pairing == "match" for c in self.contacts], np.bool_)
        for side, sign in ((0, 1.0), (1, -1.0)):
            has = (self.contact_dofs[:, side] >= 0) & opposite[self.group]
            node = self.contact_dofs[has, side] // self.dim
            # Added: a node in a corner has two contacts.
            np.add.at(fields.pressure, node, traction[has, 0])
            np.add.at(fields.shear, node, sign * shear[has])
            np.maximum.at(fields.status, node, status[has])
        for group, contact in enumerate(self.contacts):
            if contact.pairing != "match":
                at = np.flatnonzero(self.group == group)
                self._spread(fields, at, traction[at, 0], shear[at], status[at])
        for pairs in self.images:
            self._repeat(fields, pairs)
        return {
            "displacement": displacement[: self.nodes.size].reshape(-1, self.dim),
            "contact_pressure": fields.pressure,
            "contact_shear": fields.shear,
            "contact_status": fields.status,
        }

    def _repeat(self, fields: _NodalFields, pairs: Images) -> None:
        """Contact fields of the second cut, whose contacts were joined to their images."""
        on, onto = pairs.on // self.dim, pairs.onto // self.dim
        status = fields.status
        bare = (status[onto] < 0) & (status[on] >= 0)
        on, onto = on[bare], onto[bare]
        status[onto] = status[on]
        fields.pressure[onto] = fields.pressure[on]
        fields.shear[onto] = fields.shear[on] @ pairs.turn.T

    def _spread(
        self,
        fields: _NodalFields,
        contacts: Ints,
        pressure: Floats,
        shear: Floats,
        status: Integers,
    ) -> None:
        """Contact fields of two surfaces whose meshes do not match.

        With the weights w of the contacts on a body, node j has the area ``Σ w_ij a_i``
        and the force ``Σ w_ij a_i t_i``; with ``|w_ij|`` where the signs are mixed.
        """
        slave = self.numbered[self.contacts[self.group[contacts[0]]].body]
        weights = self._weights(contacts)
        node = np.flatnonzero(np.diff(weights.indptr))
        weights = weights[node]
        dofs, span = self.dim * node, slave.span
        sign = np.where((dofs >= span.start) & (dofs < span.stop), 1.0, -1.0)
        scaled = weights.multiply(sign[:, None]).tocsr().multiply(self.area[contacts])
        scaled = scaled.tocsr()
        # Weights of quadratic facets have both signs, and their sum may be near zero.
        # The mean by |w| stays within the values of the contacts.
        size = abs(scaled)
        mixed = np.abs(scaled.sum(axis=1)) < (1 - 1e-9) * size.sum(axis=1)
        scaled = diagonal_matrix((~mixed).astype(float)) @ scaled
        scaled = scaled + diagonal_matrix(mixed.astype(float)) @ size
        area = scaled.sum(axis=1)
        fields.pressure[node] += (scaled @ pressure) / area
        fields.shear[node] += sign[:, None] * (scaled @ shear) / area[:, None]
        rows = np.repeat(np.arange(len(node)), np.diff(size.indptr))
        order = np.lexsort([size.data, rows])
        largest = order[np.cumsum(np.diff(size.indptr)) - 1]
        before = fields.status[node]
        fields.status[node] = np.maximum(before, status[size.indices[largest]])

    def _weights(self, contacts: Ints) -> CsrMatrix:
        """Scalar weights w of B, ``(nodes, contacts)``; its blocks are w_ij frame_i."""
        d = self.dim
        rows = (d * contacts[:, None] + np.arange(d)).ravel()
        # w_ij from the first components, by the first row of frameᵀ frame = 1.
        along = sparse.csr_array(
            (
                self.frame[contacts, :, 0].ravel(),
                (np.arange(rows.size), np.repeat(np.arange(len(contacts)), d)),
            )
        )
        B = self.B if self._bare is None else self._bare
        first = B[rows].tocsc()[:, ::d]
        made: CsrMatrix = sparse.csr_array(first.T @ along)
        return made

    def problem(
        self,
        *,
        num_threads: int | None = None,
        on_forecast: Callable[[Mapping[str, object]], object] | None = None,
        engine: str = "auto",
        steps: int | None = None,
    ) -> ContactProblem:
        """Make the `ContactProblem` of these arrays, with moving obstacles.

        ``engine="auto"`` chooses for ``steps`` load steps, or for each load path.
        """
        first_dofs = self.numbered.first_dofs
        for point in self.references:
            first_dofs[f"{point.kind} {point.name}"] = point.first
        try:
            K = (
                self._read_stiffness(engine, steps, num_threads)
                if self.K is None
                else self.K
            )
            return ContactProblem(
                K,
                self.B,
                gap=self.gap,
                **self.law,
                fixed=self.fixed,
                area=self.area,
                dim=self.dim,
                points=self.points,
                frame=self.frame,
                coordinates=self._coordinates(),
                num_threads=num_threads,
                gaps=self.moving,
                on_forecast=on_forecast,
                engine=engine,
                _held=self.ties,
                _steps=steps,
                _kinematics=self.find_kinematics(),
                _latches=self.find_latches(),
                _interference=self.find_interference(),
                bodies=first_dofs,
            )
        except ValueError as error:
            raise self.name_cause(error) from None

    def name_cause(self, error: ValueError, engine: str = "iterative") -> ValueError:
        """The error of a problem with the support, the body and the cells that caused it."""
        # Only for a failure: SciPy's solvers take longer to import than a small job.
        from bipot_rs.contact.stiffness.digits import describe_soft
        from bipot_rs.mesh.quality import find_most_slender

        if isinstance(error, NotIterativeError):
            contact = error.contact
            if contact is None:
                return error
            of = self.contacts[int(self.group[contact])]
            where = f" of '{of.body}.{of.surface}' at {place(self.points[contact])}"
            rows = self.dim * contact + np.arange(self.dim)
            support = self._name_support(self.B[rows].indices)
            return with_reason(error, describe_contact(error, where, support), engine)
        dof = getattr(error, "dof", None)
        if getattr(error, "kind", "") != "few_digits" or dof is None:
            return error
        for point in self.references:
            if dof in point.dofs or dof in point.turns:
                whose = f"{point.kind} {point.name!r}"
                return with_message(error, describe_soft(whose, "motion"))
        b = int(np.searchsorted(self.offset, dof, side="right")) - 1
        body, (node, axis) = self.bodies[b], divmod(dof, self.dim)
        cell, ratio = find_most_slender(body.points[body.cells], body.kind)
        at = place(body.points[body.cells[cell]].mean(axis=0))
        motion = f"motion along {'xyz'[axis]} at {place(self.nodes[node])}"
        cells = f" (the most slender is at {at}, {ratio:.0f} times as long as thick)"
        reason = describe_soft(f"body {body.name!r}", motion, cells)
        return with_message(error, reason)

    def find_interference(self) -> Bools:
        """Contacts that a negative clearance asks to penetrate at the start, ``(n_c,)``."""
        asked = np.zeros(len(self.gap), np.bool_)
        for group, contact in enumerate(self.contacts):
            at, added = self.group == group, contact.clearance
            if callable(added):
                added = added(self.points[at])
            asked[at] = np.any(np.asarray(added) < 0)
        return asked

    def find_latches(self) -> tuple[Ints, Floats] | None:
        """Degrees of freedom of the shortenings of bolts, and the part of each force here."""
        if not self.bolts:
            return None
        dofs = np.array([bolt.first for bolt in self.bolts], np.int64)
        return dofs, np.array([bolt.share for bolt in self.bolts])

    def _name_support(self, dofs: Integers) -> str:
        """``support 'body.surface'`` for what holds one of some degrees of freedom."""
        if self.inclined is not None and self.inclined.normals[dofs].nnz:
            return "a plane of symmetry that is not normal to an axis"
        for support, held in zip(self.supports, self.support_dofs, strict=True):
            if np.isin(held, dofs).any():
                surface = "" if support.surface is None else f".{support.surface}"
                return f"support '{support.body}{surface}'"
        return "a support"

    def _coordinates(self) -> Floats | None:
        """Position of each degree of freedom; None if one is an unknown rotation."""
        for point in self.references:
            if not np.isin(point.turns, self.fixed).all():
                return None
        return np.repeat(with_points(self.nodes, self.references), self.dim, axis=0)

    def find_kinematics(self) -> tuple[Floats, Floats, Floats] | None:
        """What K and coordinates do not tell of ties, reference points and axisymmetry."""
        if self.ties is None and not self.numbered.axisymmetric:
            return None
        d, centre = self.dim, self.nodes.mean(axis=0)
        reach = float(np.abs(self.nodes - centre).max())
        places = np.zeros((self.n, 3))
        points = with_points(self.nodes, self.references)
        places[:, :d] = np.repeat(points, d, axis=0)
        motions = rigid_motions(points - centre, reach).reshape(self.n, -1)
        for point in self.references:
            if point.kind == "bolt":
                motions[point.dofs] = 0.0
            elif point.arm is not None:
                motions[point.first + d : point.first + 2 * d] = 0.0
                # About the line of its nodes, a rigid set does not turn with the body.
                turns = np.eye(len(point.turns)) - point.idle.T @ point.idle
                motions[point.turns, d:] = point.arm / reach * turns
        if self.numbered.axisymmetric:
            motions[:, [0, 2]] = (
                0.0  # a body of revolution translates along its axis only
            )
        return places, motions, np.ones(self.n) if self._loss is None else self._loss

    def gradient(
        self, gradient: Gradient, loads: Sequence[Load] = ()
    ) -> ParameterGradient:
        """The gradient of a result with respect to materials, shape and obstacles.

        Parameters
        ----------
        gradient
            What ``result.vjp(...)`` returned for a result of `problem`.
        loads
            The loads of the path, whose nodal forces change with the parameters. Without
            loads the nodal forces are held constant.
        """
        from bipot_rs.fem.gradients.parameter_gradient import of_gradient

        return of_gradient(self, gradient, loads)

    def gaps(self, steps: int) -> Floats | MovingGaps | None:
        """Gaps of a load path, as ``gap`` of `ContactProblem.solve`.

        `problem` uses them without being asked.

        Returns
        -------
        (steps, n_c, d), bipot_rs.MovingGaps or None
            By component [m]: along the normal the distance of the moved obstacle, along
            the tangents minus the displacement of its surface under the node. With frames
            of each step if a normal changes. None if no obstacle moves.

        Raises
        ------
        ValueError
            The motion of the obstacles has a different number of steps.
        """
        if self.moving is not None and len(self.moving) != steps:
            raise ValueError(
                f"the motion of the obstacles has {count_noun(len(self.moving), 'step')}, but "
                f"the load path has {steps}: give both the same number of steps"
            )
        return self.moving

    def gaps_at(
        self,
        ends: Floats,
        steps: int,
        move: Callable[[int, float], Sequence[Motion | None]],
    ) -> Floats | MovingGaps | None:
        """Gaps at any ends of steps, in the form of `gaps`.

        Those at the end of a load step are known. Within a load step, obstacles move on
        from the end of the load step before, whatever steps are taken in between.

        Parameters
        ----------
        ends
            From 0 to ``steps``, the number of load steps; load step k ends at k + 1.
        move
            Function of the number of completed load steps and an end, which returns the
            motion of each contact's obstacle in these two states; None for one at rest.
        """
        if self.gaps(steps) is None or self._path is None:
            return None
        gaps_of_ends = []
        for end in ends:
            before = int(end)
            if before == end and before > 0:
                gaps_of_ends.append(self._path[before - 1])
            else:
                gaps_of_ends.append(self._move_on(before, move(before, float(end))))
        return drop_equal_frames(join_steps(gaps_of_ends), self.frame)

    def _move_on(self, before: int, motions: Sequence[Motion | None]) -> MovingGaps:
        """Gaps after a motion in two states, the first that after some load steps."""
        gap, frame = self.gap.copy(), self.frame.copy()
        drag: Floats = np.zeros_like(self.points)
        if before and self._path is not None:
            last = self._path[before - 1]
            gap, frame, drag = last.gap.copy(), last.frame.copy(), last.drag.copy()
        for group, motion in enumerate(motions):
            if motion is not None:
                at, contact = self.group == group, self.contacts[group]
                numbered = self.numbered[contact.body]
                side = ContactSurface(numbered.body, contact.surface, contact.within)
                nodes = numbered.nodes_at(self.contact_dofs[at, 0])
                met = follow_obstacle(side, contact, motion, nodes, since=1)
                turned = self.inclined is not None
                gap[at] = met.distance[1]
                drag[at] += met.drag[1]
                turns = frames_of_steps(contact, frame[at], met.normal[1:], turned)
                frame[at] = turns[0]
        return MovingGaps(gap, frame, drag)

    def nodal_forces(self, load: Load | PointLoad) -> Floats:
        """Nodal forces ``(n,)`` of a load for a factor of 1 [N].

        Raises
        ------
        ValueError
            A name does not exist, or a moment has no arm.
        """
        if isinstance(load, PointLoad):
            return self._point_forces(load)
        numbered, forces = self.numbered[load.body], np.zeros(self.n)
        forces[numbered.span] = load.forces(numbered.body)
        return self._drop_constrained(forces)

    def _point_forces(self, load: PointLoad) -> Floats:
        forces = np.zeros(self.n)
        for remote in self.remotes:
            if remote.name == load.name and remote.distributed:
                numbered = self.numbered[remote.body]
                forces[numbered.span] = distributed_force(
                    numbered.body, remote, load.force, load.moment
                )
                return self._drop_constrained(forces)
        point = reference_named(self.references, load.name)
        dofs = np.concatenate([point.dofs, point.turns])
        forces[dofs] = point.force(load.force, load.moment)
        # A dependent degree of freedom of the point passes its load on.
        return forces if self.ties is None else self.ties.load(forces)

    def _drop_constrained(self, forces: Floats) -> Floats:
        """Forces without the part that inclined supports and ties take."""
        return forces if self.ties is None else self.ties.load(forces)

    def traction(self, body: str, surface: str, value: Field) -> Floats:
        """Consistent nodal forces ``(n,)`` of a surface traction.

        Parameters
        ----------
        body, surface
            Names.
        value
            Force per area ``(d,)`` [Pa], or a function of the positions
            ``(d, ...)`` that returns ``(d, ...)``.
        """
        return self.nodal_forces(Load(body, surface, traction=value))

    def pressure(self, body: str, surface: str, value: float) -> Floats:
        """Consistent nodal forces ``(n,)`` of a pressure, positive inwards [Pa]."""
        return self.nodal_forces(Load(body, surface, pressure=value))

    def body_force(self, body: str, value: Field) -> Floats:
        """Consistent nodal forces ``(n,)`` of a force per volume [N/m³], as `traction`."""
        return self.nodal_forces(Load(body, force=value))

    def initial_strain(self, body: str, strain: Initial) -> Floats:
        """Nodal forces ``(n,)`` equivalent to an initial strain, such as heating [N].

        Parameters
        ----------
        body
            Name of the body.
        strain
            Strain that the body would have without stress: a tensor ``(d, d)`` or
            ``(3, 3)``, a function of the positions, `thermal`, or a mapping from volume
            names to these (`bipot_rs.fem.bodies.stress_recovery`). `stress` takes it as
            ``initial``.
        """
        return self.nodal_forces(Load(body, strain=strain))

    def displacement_of(self, body: str, displacement: ArrayLike) -> Floats:
        """Displacement ``(nodes, d)`` of one body, from that of all bodies, ``(n,)``."""
        span = self.numbered[body].span
        u = floats("displacement", displacement, shape=(self.n,))
        return u[span].reshape(-1, self.dim)

    def reference_force(
        self, name: str, force: ArrayLike | None = None, moment: ArrayLike | None = None
    ) -> Floats:
        """Nodal forces ``(n,)`` of a `PointLoad`."""
        return self.nodal_forces(PointLoad(name, force, moment))

    def reference_motion(
        self, name: str, displacement: ArrayLike
    ) -> tuple[Floats, Floats]:
        """Translation ``(..., d)`` [m] and rotation ``(..., 3)`` [rad] of a reference point.

        Parameters
        ----------
        name
            A floating obstacle, whose rotation has no components, or a rigid set; in the
            plane the rotation has one component.
        displacement
            Of one step ``(n,)`` or of several ``(steps, n)``.
        """
        point = reference_named(self.references, name)
        u = floats("displacement", displacement)
        if u.shape[-1:] != (self.n,):
            raise ValueError(
                f"displacement has shape {u.shape}, expected ({self.n},) or "
                f"(steps, {self.n})"
            )
        return u[..., point.dofs], u[..., point.turns] / (point.arm or 1.0)

    def prescribed(
        self,
        values: Sequence[Sequence[float]],
        references: Mapping[str, Sequence[float]] | None = None,
    ) -> Floats:
        """Values at `fixed`, from one number for each component of each support [m].

        Planes of symmetry have the value zero and are not listed. ``references`` are the
        prescribed components of rigid sets by their names, translations [m] and then
        rotations [rad]; the default is zero.

        Raises
        ------
        ValueError
            Two supports give different values to one degree of freedom, or the number of
            values is not that of the supports and their components.
        """
        count = len(self.supports) - self.symmetries
        if len(values) != count:
            raise ValueError(
                f"values has {len(values)} entries, expected one for each of the {count} "
                "supports"
            )
        of_supports = [
            floats(f"values of support {i}", given, shape=(len(support.components),))
            for i, (support, given) in enumerate(
                zip(self.supports[:count], values, strict=True)
            )
        ]
        of_supports += [np.zeros(1)] * self.symmetries
        at = np.full(self.n, np.nan)
        for support, dofs, numbers in zip(
            self.supports, self.support_dofs, of_supports, strict=True
        ):
            for row, k, moved in zip(dofs, support.components, numbers, strict=True):
                other = row[~np.isnan(at[row]) & (at[row] != moved)]
                if other.size:
                    where = place(self.nodes[other[0] // self.dim])
                    part = (
                        f"surface {support.surface!r}" if support.surface else "nodes"
                    )
                    raise ValueError(
                        f"supports prescribe both {at[other[0]]:g} and {moved:g} for "
                        f"component {k} of the node at {where}, the second one on {part} of body "
                        f"{support.body!r}: give both the same value"
                    )
                at[row] = moved
        known_points = prescribed_values(self.references, references)
        at[list(known_points)] = list(known_points.values())
        if self.ties is not None:
            at[self.ties.dependent] = 0.0
            self.ties.prescribed(at[self.fixed])
            self._refuse_far(at)
        return at[self.fixed]

    def _refuse_far(self, at: Floats) -> None:
        """Refuse a component prescribed across an inclined plane that is nearly normal to it."""
        if self.inclined is None or self.ties is None:
            return
        given = np.where(np.isnan(at), 0.0, at)
        # What rigid sets and bolts move is another thing.
        given[self.nodes.size :] = 0.0
        given, moved = (
            u[: self.nodes.size].reshape(-1, self.dim)
            for u in (given, self.ties.displacement(given))
        )
        node = self.inclined.find_far(given, moved)
        if node is None:
            return
        k = int(np.argmax(np.abs(given[node])))
        dof = np.array([self.dim * node + k])
        raise ValueError(
            f"{self._name_support(dof)} moves the node at "
            f"{place(self.nodes[node])} by {given[node, k]:g} along {'xyz'[k]}, and a plane of "
            f"symmetry there is almost normal to {'xyz'[k]}: the node would move by "
            f"{np.linalg.norm(moved[node]):.3g} along the plane; exclude the nodes of the plane "
            "from the support by within, or leave this component out"
        )
