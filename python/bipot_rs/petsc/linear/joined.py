"""The preconditioner of contacts between bodies.

Multigrid for the bodies glued together at all contacts, between two exact solutions on the
interface, which follow the statuses::

    x = P_cc⁻¹ b_c;   x ← x + M (b - P x);   x_c ← x_c + P_cc⁻¹ (b - P x)_c

Where most contacts slip or are open, gluing is far from the truth, and ``M`` is multigrid for
``P``. As `src/primal/preconditioner.rs`.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

import bipot_rs._core as _core
from bipot_rs._lib.types import Bools, Floats, Ints, PetscVec
from bipot_rs.contact.law.status import Status
from bipot_rs.petsc import tuning
from bipot_rs.petsc.linear import options
from bipot_rs.petsc.linear.preconditioner import Hierarchy, Preconditioner
from bipot_rs.petsc.linear.symmetric_part import SymmetricPart
from bipot_rs.petsc.operator import Operator, SlidingSprings


class JoinedBodies(Preconditioner):
    """A preconditioner for bodies that contacts join, as a shell of PETSc."""

    def __init__(self, operator: Operator, part: SymmetricPart, contact: Ints) -> None:
        super().__init__(part)
        self._operator = operator
        self._glued = np.zeros(len(operator.interface.dofs), bool)
        self._glued[contact] = True
        self._filter = _InterfaceFactor(operator, part)
        self._hierarchy = Hierarchy(part.P, options.PREFIX, operator.PETSc)
        self.name = str(self._hierarchy.pc.getType())
        # Whether a solution with the glued bodies was slow in this load step.
        self._slow = False
        # Whether the hierarchy is that of the present statuses; None before there is one.
        self._follows: bool | None = None
        self._tangent: _core.ContactTangent | None = None
        self._springs: SlidingSprings | None = None
        self._left, self._more = operator.K.createVecs()

    def begin(self) -> None:
        """Try the glued bodies again."""
        self._slow = False

    def learn(self, iterations: int) -> None:
        """Let the hierarchy follow the statuses if a solution with glued bodies was slow."""
        if self._follows is False and iterations > tuning.SLOW_ITERATIONS:
            self._slow = True

    def prepare(
        self,
        tangent: _core.ContactTangent,
        statuses: NDArray[np.int8],
        *,
        new: bool,
    ) -> None:
        """Follow the statuses."""
        if not new and not (self._slow and self._follows is False):
            return
        springs = SlidingSprings(tangent, self._part.d)
        self._tangent, self._springs = tangent, springs
        held = tangent.held
        if new:
            self._filter.factor(held, springs)
        loose = np.count_nonzero(statuses != Status.STICK) / max(len(statuses), 1)
        follow = self._slow or bool(loose > tuning.LOOSE_SHARE)
        if follow and (new or not self._follows):
            self._part.set_values(held, springs)
            self.update()
        elif not follow and self._follows is not False:
            self._part.set_values(held | self._glued, None)
            self.update()
        self._held = held if follow else held | self._glued
        self._follows = follow

    def update(self) -> None:
        """Make the hierarchy for the present values of ``P``."""
        self._hierarchy.update()

    def apply(self, _pc: object, b: PetscVec, x: PetscVec, /) -> None:
        """``x ≈ P⁻¹ b``."""
        interface, tangent = self._operator.interface, self._tangent
        assert tangent is not None  # noqa: S101 - set by `prepare`
        x.set(0.0)
        interface.write(self._filter.solve(interface.gather(b)), x)
        self._subtract_product(tangent, b, x)
        self._clear_held(self._left)
        self._hierarchy.pc.apply(self._left, self._more)
        self._clear_held(self._more)
        x.axpy(1.0, self._more)
        self._subtract_product(tangent, b, x)
        at = interface.gather(x) + self._filter.solve(interface.gather(self._left))
        interface.write(at, x)

    def _subtract_product(
        self, tangent: _core.ContactTangent, b: PetscVec, x: PetscVec
    ) -> None:
        """Set what is left to ``b - P x``."""
        self._operator.multiply_newton(tangent, x, self._left, self._springs)
        self._left.aypx(-1.0, b)

    def _clear_held(self, x: PetscVec) -> None:
        """Set the places to zero that the hierarchy holds, and prescribed rows."""
        interface = self._operator.interface
        places = interface.gather(x)
        x.array[self._operator.fixed] = 0.0
        places[self._held] = 0.0
        interface.write(places, x)


class _InterfaceFactor:
    """A factor of ``P_cc``, ``c`` the places that are not held; the same on every rank."""

    def __init__(self, operator: Operator, part: SymmetricPart) -> None:
        parts = operator.comm.allgather(part.around)
        self._row, self._column, self._values = (
            np.concatenate([piece[k] for piece in parts]) for k in range(3)
        )
        self._count = len(operator.interface.dofs)
        self._PETSc = operator.PETSc
        self._free: Ints = np.empty(0, np.int64)

    def factor(self, held: Bools, springs: SlidingSprings) -> None:
        """Factor the part that is not held."""
        from scipy.sparse import coo_array

        added = springs.list_entries()
        row, column, values = (
            np.concatenate(both)
            for both in zip((self._row, self._column, self._values), added, strict=True)
        )
        self._free = np.flatnonzero(~held)
        number = np.full(self._count, -1)
        number[self._free] = np.arange(len(self._free))
        i, j = number[row], number[column]
        kept = (i >= 0) & (j >= 0)
        entries = values[kept], (i[kept], j[kept])
        size = len(self._free)
        P = coo_array(entries, shape=(size, size)).tocsr()
        P.sort_indices()
        PETSc = self._PETSc
        kind = PETSc.IntType
        parts = P.indptr.astype(kind), P.indices.astype(kind), P.data
        alone = PETSc.COMM_SELF
        self._matrix = PETSc.Mat().createAIJ((size, size), csr=parts, comm=alone)
        self._matrix.setOption(PETSc.Mat.Option.SPD, True)
        self._ksp = PETSc.KSP().create(alone)
        self._ksp.setOptionsPrefix(f"{options.PREFIX}interface_")
        self._ksp.setType("preonly")
        self._ksp.setOperators(self._matrix)
        pc = self._ksp.getPC()
        pc.setType("cholesky")
        if PETSc.Sys.hasExternalPackage("mumps"):
            pc.setFactorSolverType("mumps")
        self._ksp.setFromOptions()
        self._b, self._x = self._matrix.createVecs()

    def solve(self, b: Floats) -> Floats:
        """``P_cc⁻¹ b_c`` at all places, zero at held ones."""
        x = np.zeros(self._count)
        if len(self._free):
            self._b.array[:] = b[self._free]
            self._ksp.solve(self._b, self._x)
            x[self._free] = self._x.array_r
        return x
