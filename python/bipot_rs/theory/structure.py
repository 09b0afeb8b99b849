"""Bodies and soils in frictional contact: the boundary-value problem (19)–(23) of [dSF91].

A structure has elastic bodies, plastic points (`points`), such as those of soils, and
contacts with friction. The bipotential of the body β and that of the contacts b are
laws of one kind, ``‖r_t‖ <= c + μ r_n`` with their own numbers. For increments ``Δu`` of a
step, (23) is

    ``B = ∫ β(ε(Δu), σ) dΩ + Σ b(-v, r) - f·Δu - s·Δū``,    s the forces of the supports,

and for admissible fields it is the sum of what all points and contacts lack from their laws,
none of which is negative: ``∫ [β - σ:ε] dΩ + Σ [b(-v, r) + r·v]``.

All is dense or factored as a whole: structures of some 20,000 degrees of freedom.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
from numpy.typing import ArrayLike
from scipy import sparse
from scipy.sparse.linalg import splu

import bipot_rs._core as _core
from bipot_rs._lib.matrices import rigid_motions
from bipot_rs._lib.messages import make_type_error, place
from bipot_rs._lib.records import short_repr
from bipot_rs._lib.types import Bools, CsrMatrix, Floats, MatrixLike
from bipot_rs._lib.validation import (
    csr,
    floats,
    indices,
    integer,
    loads,
    number,
    one_of,
)
from bipot_rs._lib.validation import gap as gap_by_component
from bipot_rs.contact.path.bond import Bond
from bipot_rs.contact.path.contacts import ContactSet
from bipot_rs.fem.bodies.body import Body, Field
from bipot_rs.fem.bodies.elasticity import dofs_of, stiffness
from bipot_rs.theory.limit_load import refuse_step
from bipot_rs.theory.points import PlasticPoints, PointLaw
from bipot_rs.theory.soil_body import Soil
from bipot_rs.theory.structure_state import StructureState, StructureStep
from bipot_rs.theory.structure_step import StepSolver

if TYPE_CHECKING:
    from bipot_rs.fem.assembly.assembly import Assembly

METHODS = ("newton", "displacements", "uzawa")
# What has plastic points.
Inelastic: TypeAlias = Soil | PlasticPoints


@dataclass(frozen=True, eq=False)
class Contacts:
    """Contacts of a structure, as the arguments of a `bp.ContactProblem`.

    Attributes
    ----------
    B
        ``(d n_c, n)``, rows normal first.
    gap
        ``(n_c,)``, or all components ``(n_c, d)`` [m].
    mu, cohesion, dilatancy
        Friction coefficients, c [N] and β.
    """

    B: MatrixLike
    gap: ArrayLike
    mu: ArrayLike
    cohesion: ArrayLike | None = None
    dilatancy: ArrayLike | None = None

    __repr__ = short_repr


class Structure:
    """Elastic bodies, plastic points and contacts.

    Parameters
    ----------
    bodies
        Elastic bodies: a `fem.Body`, or any stiffness matrix, symmetric and positive
        semidefinite.
    soils
        Bodies of `soil_body.Soil`; also `PlasticPoints`, which have no degrees of freedom
        of their own.
    contacts
        `Contacts`, a `fem.Assembly` of the bodies and of the bodies of the soils, or None.
    fixed
        Degrees of freedom with prescribed displacement. With the contacts they must stop all
        rigid motions. Degrees of freedom are numbered as by `fem.assemble`: body after
        body, then soil after soil, ``dim * node + component``.

    Attributes
    ----------
    n
        Number of degrees of freedom.
    K
        Stiffness of the elastic bodies, CSR ``(n, n)`` [N/m].
    points
        Plastic points of each of the soils.
    first
        First degree of freedom of each body, then of each soil.
    contacts, matrix
        The contacts, and their B.
    law
        Law of the contacts before any breaks, in components in which friction is isotropic.
    springs
        ρ of the augmented law of the contacts, ``(n_c,)`` [N/m].
    guided
        Whether supports prescribe the slip of a contact, ``(n_c,)``.

    Raises
    ------
    TypeError, ValueError
        A wrong argument; a motion that nothing stops.
    """

    def __init__(
        self,
        bodies: Sequence[Body | MatrixLike] = (),
        soils: Sequence[Inelastic] = (),
        contacts: Contacts | Assembly | ContactSet | None = None,
        fixed: ArrayLike = (),
    ) -> None:
        for what, parts in (("bodies", bodies), ("soils", soils)):
            if not isinstance(parts, Sequence):
                raise make_type_error(what, parts, "a list")
        matrices = [
            stiffness(body) if isinstance(body, Body) else _read_stiffness(body)
            for body in bodies
        ]
        for soil in soils:
            if not isinstance(soil, Soil | PlasticPoints):
                raise make_type_error("soil", soil, "a Soil or PlasticPoints")
        sizes = [len(matrix.indptr) - 1 for matrix in matrices]
        sizes += [soil.body.points.size for soil in soils if isinstance(soil, Soil)]
        self.first = np.concatenate([[0], np.cumsum(sizes)]).astype(int).tolist()
        self.soils = tuple(soils)
        self.n = n = self.first.pop() or _count_columns(self.soils)
        of_bodies = sum(sizes[: len(matrices)])
        blocks = sparse.block_diag(
            [*matrices, sparse.csr_array((n - of_bodies, n - of_bodies))]
        )
        self.K: CsrMatrix = sparse.csr_array(blocks)
        starts = iter(self.first[len(matrices) :])
        self._placed = [(s, next(starts)) for s in self.soils if isinstance(s, Soil)]
        made = iter([soil.make_points(n, first) for soil, first in self._placed])
        self.points = tuple(
            next(made) if isinstance(soil, Soil) else soil for soil in self.soils
        )
        for group in self.points:
            if group.strain.shape[1] != n:
                raise ValueError(
                    f"strain has {group.strain.shape[1]} columns, expected {n}, one for each "
                    "degree of freedom of the structure"
                )
        self.fixed = indices("fixed", fixed, n)
        self.free = np.setdiff1d(np.arange(n), self.fixed)
        self.weight = np.zeros(n)
        for soil, first in self._placed:
            self.weight[first : first + soil.body.points.size] += soil.load
        self._read_contacts(contacts)
        self._check_supports()
        total = self.K + sum(
            (group.stiffness_matrix() for group in self.points),
            sparse.csr_array((n, n)),
        )
        self.elastic: CsrMatrix = sparse.csr_array(total)
        self._factor_elastic()

    def _read_contacts(self, given: Contacts | Assembly | ContactSet | None) -> None:
        """B, gap and law in the components in which friction is isotropic."""
        if given is None:
            given = Contacts(sparse.csr_array((0, self.n)), np.zeros((0, 2)), 0.0)
        if not isinstance(given, ContactSet):
            if not all(hasattr(given, name) for name in ("B", "gap", "mu")):
                raise make_type_error("contacts", given, "Contacts or a fem.Assembly")
            given = ContactSet.check(
                csr("B", given.B),
                gap=given.gap,
                mu=given.mu,
                cohesion=getattr(given, "cohesion", None),
                dilatancy=getattr(given, "dilatancy", None),
                points=getattr(given, "x", None),
            )
        B, law = given.operator.matrix, given.law
        if B.shape[1] != self.n:
            raise ValueError(f"B has {B.shape[1]} columns, expected {self.n}")
        self.by, coulomb = _core.isotropic(law.mu, given.d)
        zero = np.zeros(given.count)
        beta, c = (zero if x is None else x for x in (law.dilatancy, law.cohesion))
        self.law = PointLaw(coulomb, beta, c)
        self.B: CsrMatrix = sparse.csr_array(sparse.diags_array(self.by.ravel()) @ B)
        self.contacts, self.matrix, self.gap = given, B, given.gap_by_component

    def weaken(self, broken: Bools | None) -> PointLaw:
        """Law of the contacts with the cohesion of those that are not broken."""
        if broken is None:
            return self.law
        return replace(self.law, cohesion=np.where(broken, 0.0, self.law.cohesion))

    @property
    def shape(self) -> tuple[int, int]:
        """``(n_c, d)`` of the contacts."""
        return self.gap.shape

    def _factor_elastic(self) -> None:
        """K̂, and ρ: with D the diagonal of the elastic stiffness, ``1/ρ = b D⁻¹ bᵀ``."""
        diagonal = self.elastic.diagonal()
        moves = np.zeros(self.n)
        held = diagonal[self.free]
        moves[self.free] = np.divide(
            1, held, out=np.zeros_like(held), where=held > 1e-12 * diagonal.max()
        )
        compliance = self.B.multiply(self.B) @ moves
        rows = compliance.reshape(self.shape)
        # A contact whose nodes are all prescribed has any spring.
        soft = 1 / diagonal.max() if diagonal.max() > 0 else 1.0
        least = max(float(rows.max(initial=0.0)), soft) * 1e-6
        self.springs: Floats = 1 / np.maximum(rows.mean(axis=1), least)
        # Contacts that supports hold along the surface.
        self.guided = (rows[:, 1:] == 0).all(axis=1)
        rho = sparse.diags_array(np.repeat(self.springs, self.shape[1]))
        stiff = self.elastic + self.B.T @ (rho @ self.B)
        if not len(self.free):
            return
        failed = False
        try:
            self._factor = splu(
                stiff[self.free][:, self.free].tocsc(),
                permc_spec="MMD_AT_PLUS_A",
                diag_pivot_thresh=0.0,
                options={"SymmetricMode": True},
            )
            pivots = self._factor.U.diagonal()
            failed = bool(np.abs(pivots).min() < 1e-13 * np.abs(pivots).max())
        except RuntimeError:
            failed = True
        if failed:
            raise ValueError(
                "a body can move without strain: fix more degrees of freedom, or add contacts"
            )
        if (pivots < 0).any():
            raise ValueError("K is indefinite, expected positive semidefinite")

    def solve_elastic(self, rest: Floats) -> Floats:
        """Displacement of the free degrees of freedom under forces on them, with K̂."""
        if not len(self.free):
            return np.zeros(0)
        return np.asarray(self._factor.solve(rest))

    def at_rest(self, stress: Sequence[Field | None] = ()) -> StructureState:
        """State without displacement, with initial stresses of the soils.

        Parameters
        ----------
        stress
            One for each of the soils: as of `Soil.read_stress`, ``(m, d)`` for
            `PlasticPoints`, or None for zero. It need not balance a load: the first step
            brings it into equilibrium.

        Raises
        ------
        ValueError
            A stress has a wrong shape or violates the criterion.
        """
        if len(stress) > len(self.points):
            raise ValueError(
                f"stress has {len(stress)} fields, expected at most {len(self.points)}"
            )
        given = [*stress, *[None] * (len(self.points) - len(stress))]
        fields = []
        for soil, group, value in zip(self.soils, self.points, given, strict=True):
            shape = (*group.shape, group.components.shape[1])
            if value is None:
                fields.append(np.zeros(shape))
            elif isinstance(soil, Soil):
                fields.append(soil.read_stress(value))
            else:
                fields.append(floats("stress", value, shape=shape))
        # The gap of an unloaded state has no tangential part.
        gap = self.gap * (np.arange(self.shape[1]) == 0)
        start = StructureState(
            displacement=np.zeros(self.n),
            reaction=np.zeros(self.shape),
            stress=tuple(fields),
            plastic_strain=tuple(np.zeros_like(field) for field in fields),
            gap=gap,
        )
        return self.check_state("start", start, admissible=True)

    def solve(
        self,
        load: ArrayLike | None = None,
        prescribed: ArrayLike | None = None,
        *,
        gap: ArrayLike | None = None,
        start: StructureState | None = None,
        method: str = "newton",
        tol: float = 1e-10,
        max_iterations: int | None = None,
    ) -> tuple[StructureStep, ...]:
        """Solve load steps, each from the end of the one before.

        ``"newton"`` solves equilibrium with both laws for displacements and reactions.
        ``"displacements"`` is (37), (38): each pass minimises ``B(·, σ_i)``, with the limits
        of friction of ``σ_i`` and ``r_i`` in all points and contacts. ``"uzawa"`` is (80),
        (81) for both: an elastic solution, then one projection at each point and contact.
        All are judged alike, see `StructureStep`.

        Parameters
        ----------
        load, prescribed
            Totals at the end of each step, ``(steps, n)`` [N] besides the weight, and
            ``(steps, len(fixed))`` [m]; one without steps serves for all; default zero.
        gap
            Gaps of obstacles that move, ``(steps, n_c)`` or ``(steps, n_c, d)`` [m].
        start
            State at the start, from `at_rest` or a `StructureStep`; default unloaded.
        method
            ``"newton"``, ``"displacements"`` or ``"uzawa"``.
        tol
            Largest gaps and imbalance.
        max_iterations
            Largest number of passes, or of iterations of ``"uzawa"``, of a step; default 200
            or 20,000.

        Raises
        ------
        LimitLoadError
            No stress and reactions that satisfy the laws balance the load.
        StepNotConvergedError
            A step did not reach the tolerance. Both carry the steps before.
        TypeError, ValueError
            A wrong argument.
        """
        one_of("method", method, METHODS)
        tol = number("tol", tol)
        if not 0 < tol < 1:
            raise ValueError(f"tol is {tol}, expected a number between 0 and 1")
        most = 20_000 if method == "uzawa" else 200
        if max_iterations is not None:
            most = integer("max_iterations", max_iterations, least=1)
        state = self.at_rest() if start is None else start
        state = self.check_state("start", state, admissible=True)
        pairs = loads(load, prescribed, self.n, len(self.fixed))
        gaps = self._read_gaps(gap, len(pairs))
        if len(pairs) == 1:
            pairs = pairs * len(gaps)
        steps: list[StructureStep] = []
        bond = replace(
            Bond.begin(self.contacts, None),
            broken=state.broken,
            dilation=state.dilation,
        )
        for (force, moved), at in zip(pairs, gaps, strict=True):
            # All that opened break together, and the step is solved again.
            while True:
                solver = StepSolver(
                    self, state, force + self.weight, moved, at, tol, bond
                )
                step = solver.solve(method, most)
                if not step.converged:
                    refuse_step(self, tuple(steps), step, tol)
                before, bond = bond, bond.break_opened(step)
                if bond is before:
                    break
            dilation, _ = bond.lift(step)
            bond = replace(bond, dilation=dilation)
            state = replace(step, dilation=dilation)
            steps.append(state)
        return tuple(steps)

    def _read_gaps(self, gap: ArrayLike | None, steps: int) -> list[Floats]:
        """Gaps of each step, in all components."""
        if gap is None:
            return [self.gap] * steps
        given = floats("gap", gap)
        if given.ndim < 2:
            given = given[None]
        if steps not in (1, len(given)):
            raise ValueError(f"gap has {len(given)} steps, expected {steps}")
        return [gap_by_component(gaps, *self.shape) for gaps in given]

    def check_state(
        self, what: str, state: StructureState, *, admissible: bool = False
    ) -> StructureState:
        """Refuse a state of another shape, or with a stress outside the criterion."""
        if not isinstance(state, StructureState):
            raise make_type_error(what, state, "a StructureState")
        fields: dict[str, tuple[Floats, ...]] = {}
        for name in ("stress", "plastic_strain"):
            values = getattr(state, name)
            if len(values) != len(self.points):
                raise ValueError(
                    f"{name} of {what} has {len(values)} fields, expected {len(self.points)}"
                )
            fields[name] = tuple(
                floats(f"{name} of {what}", value, shape=(*group.shape, width))
                for group, value in zip(self.points, values, strict=True)
                for width in (group.components.shape[1],)
            )
        bond, contacts = Bond.begin(self.contacts, None), self.shape[:1]
        broken, dilation = bond.broken, bond.dilation
        if broken is not None and state.broken is not None:
            broken = np.asarray(state.broken, np.bool_)
            if broken.shape != contacts:
                raise ValueError(
                    f"broken of {what} has shape {broken.shape}, expected {contacts}"
                )
        if dilation is not None and state.dilation is not None:
            dilation = floats(f"dilation of {what}", state.dilation, shape=contacts)
        if admissible:
            for group, value in zip(self.points, fields["stress"], strict=True):
                _check_criterion(what, group, value)
        return StructureState(
            displacement=floats(
                f"displacement of {what}", state.displacement, shape=(self.n,)
            ),
            reaction=floats(f"reaction of {what}", state.reaction, shape=self.shape),
            gap=floats(f"gap of {what}", state.gap, shape=self.shape),
            stress=fields["stress"],
            plastic_strain=fields["plastic_strain"],
            broken=broken,
            dilation=dilation,
        )

    def _check_supports(self) -> None:
        """Refuse supports that leave a rigid motion of a soil, or of a part of it, free."""
        for body, first in ((soil.body, first) for soil, first in self._placed):
            cells, (nodes, d) = body.cells, body.points.shape
            ends = np.repeat(cells[:, 0], cells.shape[1])
            part_of = _core.connected(nodes, ends, cells.ravel())
            for part in range(part_of.max() + 1):
                inside = np.flatnonzero(part_of == part)
                centre = body.points[inside].mean(axis=0)
                arm = body.points[inside] - centre
                moved = rigid_motions(arm, float(np.abs(arm).max()))
                whole = np.zeros((self.n, moved.shape[2]))
                whole[first + dofs_of(inside, d)] = moved.reshape(-1, moved.shape[2])
                rows = np.vstack([whole[self.fixed], self.B @ whole])
                if len(_core.free_motions(rows)):
                    raise ValueError(
                        f"fixed leaves a rigid motion of body {body.name!r} free, of the "
                        f"part with its centre at {place(centre)}: fix more of its degrees "
                        "of freedom"
                    )


def _count_columns(soils: tuple[Inelastic, ...]) -> int:
    """Degrees of freedom of a structure that has none but those of strain matrices."""
    columns = [s.strain.shape[1] for s in soils if isinstance(s, PlasticPoints)]
    if not columns:
        raise ValueError("a structure has no body and no soil: give one of them")
    return int(columns[0])


def _read_stiffness(K: MatrixLike) -> CsrMatrix:
    """K of a body, which must be square and symmetric to rounding."""
    matrix = csr("K", K).matrix
    if matrix.shape[0] != matrix.shape[1]:
        raise ValueError(f"K has shape {matrix.shape}, expected a square matrix")
    # In units of the diagonal, so that no change of units decides.
    size = np.sqrt(np.abs(matrix.diagonal()))
    inverse = sparse.diags_array(np.divide(1, size, out=size.copy(), where=size > 0))
    off = sparse.coo_array(inverse @ (matrix - matrix.T) @ inverse)
    # As of a problem of contact: rounding of an assembly.
    if off.nnz and np.abs(off.data).max() > 1e-10:
        at = int(np.argmax(np.abs(off.data)))
        raise ValueError(
            f"K is not symmetric at row {off.coords[0][at]}, column {off.coords[1][at]}"
        )
    return matrix


def _check_criterion(what: str, group: PlasticPoints, stress: Floats) -> None:
    """Refuse a stress outside the criterion."""
    r = group.from_tensors(stress)
    law = group.law
    size = np.linalg.norm(r, axis=1) + law.cohesion + law.mu * np.abs(r[:, 0])
    over = np.maximum(law.overload(r), -r[:, 0])
    if (over > 1e-12 * size).any():
        at = int(np.argmax(over))
        where = np.unravel_index(at, group.shape)
        named = (
            f"point {where[-1]} of cell {where[0]}" if len(where) > 1 else f"point {at}"
        )
        raise ValueError(
            f"stress of {what} violates the criterion at {named} by {over[at]:g}: start from "
            "an admissible stress"
        )
