"""The engine of a load path: what the Newton loop of the core calls, on Vecs of PETSc."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

import bipot_rs._core as _core
from bipot_rs._lib.types import Floats, Ints, PetscMat, PetscVec
from bipot_rs.contact.law.contact_law import ContactLaw
from bipot_rs.contact.path.contacts import ContactSet
from bipot_rs.contact.path.engine import StepData
from bipot_rs.contact.path.iterative import UncondensedStep
from bipot_rs.contact.path.springs import Springs
from bipot_rs.contact.results.solution import Step as WholeStep
from bipot_rs.contact.results.solution import make_newton_step
from bipot_rs.petsc.linear.solver import LinearSolver
from bipot_rs.petsc.operator import Operator, SharedPlaces
from bipot_rs.petsc.result import Step


class VectorOperations:
    """Long vectors and linear systems, as `src/primal/engine.rs` wants them.

    Vectors are never changed: each method returns a new one.
    """

    def __init__(self, engine: PetscEngine) -> None:
        self._operator, self._solver = engine.operator, engine.solver
        self._soft = engine.soft

    def may_be_soft(self) -> bool:
        """Whether a motion may be too soft for the preconditioner."""
        return self._soft

    def product(self, y: PetscVec) -> PetscVec:
        """``A y``."""
        return self._operator.multiply(y)

    def add(self, y: PetscVec, s: float, x: PetscVec) -> PetscVec:
        """``y + s x``."""
        total = y.copy()
        total.axpy(s, x)
        return total

    def at_places(self, y: PetscVec) -> Floats:
        """Values at the places of the interface."""
        return self._operator.interface.gather(y)

    def norm(self, y: PetscVec) -> float:
        """Euclidean norm."""
        return float(y.norm())

    def largest(self, y: PetscVec) -> float:
        """Largest magnitude."""
        return float(y.norm(self._operator.PETSc.NormType.NORM_INFINITY))

    def imbalance(self, e: PetscVec, forces: Floats) -> float:
        """Norm of ``e`` after forces at the places are subtracted."""
        left = e.copy()
        interface = self._operator.interface
        left.array[interface.rows] -= forces[interface.own]
        return float(left.norm())

    def terms(self, y: PetscVec) -> tuple[float, Floats]:
        """Sizes of the terms of ``A y``: their norm, and those at the places."""
        return self._operator.measure_terms(y)

    def correction(
        self,
        tangent: _core.ContactTangent,
        statuses: NDArray[np.int8],
        e: PetscVec,
        tol: float,
    ) -> tuple[PetscVec, int, bool] | None:
        """A Newton correction with its known part; None without a preconditioner."""
        if not self._solver.prepare(tangent, statuses):
            return None
        right = self._operator.make_right_side(tangent, e)
        x, products, reached = self._solver.solve(right, tol)
        self._operator.set_known(tangent, x)
        return x, products, reached

    def estimate(
        self, tangent: _core.ContactTangent, statuses: NDArray[np.int8], e: PetscVec
    ) -> PetscVec | None:
        """The correction by one application of the preconditioner."""
        if not self._solver.prepare(tangent, statuses):
            return None
        x = self._solver.precondition(self._operator.make_right_side(tangent, e))
        self._operator.set_known(tangent, x)
        return x

    def agreed(self, decision: bool) -> bool:
        """The decision of the first rank."""
        return bool(self._operator.comm.bcast(decision, root=0))


@dataclass
class SolverCounts:
    """What the engine did, of all load paths of a problem."""

    newton: int = 0
    krylov: int = 0
    # Why the last step stalled; empty if it did not.
    reason: str = ""


@dataclass(frozen=True)
class _Inquiry(UncondensedStep):
    """Answers about a step, and why it stalled."""

    reason: str = ""

    def diagnosis(self, step: WholeStep, /) -> str:
        """Why the solve failed."""
        if not self.reason:
            return ""
        return (
            f"not converged: {self.reason} (residual {step.residual:.1e}, limit "
            f"{step.tolerance:.1e}); try other options of PETSc, as -bipot_pc_type hypre, "
            "or engine='direct' on one process"
        )


# Said before any work.
NO_FRAMES = (
    "an obstacle turns, or is curved and moves: load steps have frames of their own, which "
    "engine='petsc' cannot solve: use engine='direct' or 'iterative'"
)


@dataclass(frozen=True)
class Copies:
    """Copies of the displacements of sides of contacts, which are the last rows of the last rank.

    `places` are those of the contacts in ``K``, and `all_places` have those of the copies too.
    """

    springs: Springs
    K: PetscMat  # that of the caller
    places: SharedPlaces
    all_places: SharedPlaces

    def add_copies(self, operator: Operator, vector: PetscVec) -> PetscVec:
        """A Vec with zeros at the copies."""
        longer = operator.make_zeros()
        longer.array[: vector.getLocalSize()] = vector.array_r
        return longer

    def drop_copies(self, vector: PetscVec) -> PetscVec:
        """A Vec without the copies."""
        shorter = self.K.createVecRight()
        shorter.array[:] = vector.array_r[: shorter.getLocalSize()]
        return shorter


@dataclass(frozen=True)
class PetscEngine:
    """Solves in the displacements with ``K`` distributed over the ranks."""

    operator: Operator
    solver: LinearSolver
    fixed: Ints  # all prescribed degrees of freedom, in the order of the caller
    soft: bool  # whether a motion may be too soft for the preconditioner
    # The law of the contacts, if it is not that of `operator`.
    law: ContactLaw | None = None
    record: SolverCounts = field(default_factory=SolverCounts)
    copies: Copies | None = None  # those that `operator` has beside the K of the caller
    name = "petsc"

    @property
    def stiffness(self) -> PetscMat:
        """The stiffness of the caller."""
        return self.operator.K if self.copies is None else self.copies.K

    @property
    def stats(self) -> Mapping[str, object]:
        """Counts so far: Newton steps, iterations, products with K and gathers."""
        return {
            "newton": self.record.newton,
            "krylov": self.record.krylov,
            "products": self.operator.products,
            "gathers": self.operator.interface.gathers,
            "preconditioner": self.solver.preconditioner.name,
        }

    def with_law(self, law: ContactLaw, /) -> PetscEngine:
        """The same problem with another law of its contacts."""
        return replace(self, law=law)

    def with_rotation(self, _rotation: Floats, /) -> PetscEngine:
        """Not available: the frames of a problem of PETSc are those of its B."""
        raise ValueError(NO_FRAMES)

    def replacement(self, _why: str = "", /) -> PetscEngine:
        """Nothing replaces this engine."""
        return self

    def path(self, at: WholeStep | None) -> PetscPath:
        """A load path that starts from a step, or from the unloaded bodies."""
        return PetscPath(self, at)

    def from_step(self, at: WholeStep | None) -> _core.ContactPath:
        """The path of the core that starts from a step."""
        variables = self.operator.variables
        if self.law is not None:
            variables = variables.with_law(self.law)
        if at is None:
            return _core.ContactPath(variables)
        state = at.reaction, at.relative_displacement, at.status
        return _core.ContactPath(variables, state)

    def recovery(self, _seconds: dict[str, float], _contacts: ContactSet, /) -> None:
        """Steps of this engine have their displacements already."""

    def inquiry(self, data: StepData) -> UncondensedStep:
        """What answers questions about the last step."""
        return _Inquiry(data, self.record.reason)

    def make_prescribed(self, values: Floats) -> tuple[PetscVec, Ints]:
        """Prescribed displacements as a Vec, and the own rows of these."""
        u = self.operator.make_zeros()
        first, last = u.getOwnershipRange()
        ours = (self.fixed >= first) & (self.fixed < last)
        rows = self.fixed[ours] - first
        u.array[rows] = values[ours]
        return u, rows

    def make_force(self, load: Any, prescribed: Floats) -> PetscVec:
        """``Tᵀ (f - K u_p)`` without the prescribed rows."""
        u, _ = self.make_prescribed(prescribed)
        f = self.operator.make_zeros()
        self.operator.K.mult(u, f)
        f.scale(-1.0)
        f.axpy(1.0, load)
        self.operator.to_local_forces(f)
        return f

    def make_displacement(self, y: PetscVec, prescribed: Floats) -> PetscVec:
        """All displacements."""
        u = self.operator.to_displacements(y)
        displacement, rows = self.make_prescribed(prescribed)
        u.array[rows] = displacement.array_r[rows]
        return u


class PetscPath:
    """A load path in progress."""

    def __init__(self, engine: PetscEngine, at: WholeStep | None) -> None:
        self.engine = engine
        self._core = engine.from_step(at)
        self._last = at
        self._operations = VectorOperations(engine)

    def step(
        self,
        load: Any,
        prescribed: Floats,
        gap: Floats | None,
        settings: _core.Settings,
    ) -> Step:
        """Make a step to the total loads; the path moves on only if it converges."""
        u: Any = None if self._last is None else self._last.computed.displacement
        asked = prescribed, gap, settings
        copies = self.engine.copies
        if copies is None:
            step = self._solve(load, u, *asked)
        else:
            step = self._solve_with_copies(copies, load, u, *asked)
        if step.converged:
            self._last = step
        return step

    def _solve(
        self,
        load: PetscVec,
        u: Any,
        prescribed: Floats,
        gap: Floats | None,
        settings: _core.Settings,
        near: bool = False,
        draft: bool = False,
    ) -> Step:
        """One step of the core, which starts from the displacements ``u``."""
        engine = self.engine
        operator = engine.operator
        engine.solver.begin()
        y = operator.make_zeros() if u is None else operator.to_unknowns(u)
        force = engine.make_force(load, prescribed)
        asked = force, prescribed, gap, settings
        core, y = self._core.step(self._operations, y, *asked, near, draft)
        engine.record.newton += core.newton
        engine.record.krylov += core.krylov
        engine.record.reason = core.reason or ""
        displacement = engine.make_displacement(y, prescribed)
        return make_newton_step(core, displacement, Step)  # type: ignore[arg-type]

    def _solve_with_copies(
        self,
        copies: Copies,
        load: PetscVec,
        u: Any,
        prescribed: Floats,
        gap: Floats | None,
        settings: _core.Settings,
    ) -> Step:
        """A step with copies on springs, from the last state each time."""
        operator, record = self.engine.operator, self.engine.record
        springs, places = copies.springs, copies.all_places
        if u is not None:
            spread = springs.spread(copies.places.gather(u))
            u = copies.add_copies(operator, u)
            places.write(spread, u)

        def step(added: Floats, *how: bool) -> tuple[WholeStep, str]:
            nonlocal u
            force = copies.add_copies(operator, load)
            force.array[places.rows] += added[places.own]
            self._core = self.engine.from_step(self._last)
            solved = self._solve(force, u, prescribed, gap, settings, *how)
            u = solved.displacement
            computed = replace(solved.computed, displacement=places.gather(u))
            return replace(solved, computed=computed), record.reason

        solved, record.reason = springs.solve(
            step,
            np.zeros(len(springs.place)),
            None if self._last is None else self._last.reaction,
            None,
            settings.tol,
            operator.comm.bcast,
        )
        u = copies.drop_copies(u)
        computed = replace(solved.computed, displacement=u)
        return replace(solved, computed=computed)  # type: ignore[return-value]
