"""The preconditioner of contacts between bodies.

Multigrid for the bodies glued together at all contacts, between two exact solutions on the
interface, which follow the statuses::

    x = P_cc⁻¹ b_c;   x ← x + M (b - P x);   x_c ← x_c + P_cc⁻¹ (b - P x)_c

Where most contacts slip or are open, gluing is far from the truth, and ``M`` is multigrid for
``P``. As `src/primal/preconditioner.rs`.
"""

from __future__ import annotations

from types import ModuleType
from typing import Any

import numpy as np

import bipot_rs._core as _core
from bipot_rs._lib.types import Bools, Floats, Ints, PetscVec
from bipot_rs.petsc import options
from bipot_rs.petsc.operator import Operator, Springs
from bipot_rs.petsc.preconditioner import Preconditioner
from bipot_rs.petsc.symmetric_part import SymmetricPart

# Share of slipping and open contacts, and iterations of one linear system, above which the
# hierarchy follows the statuses.
_LOOSE = 0.6
_SLOW = 30


class Joined:
    """A shell preconditioner of PETSc.

    Attributes
    ----------
    slow
        Whether a solution with the glued bodies was slow in this load step.
    follows
        Whether the hierarchy is that of the present statuses; ``None`` before there is one.
    """

    def __init__(
        self,
        operator: Operator,
        part: SymmetricPart,
        contact: Ints,
        d: int,
        PETSc: ModuleType,
    ) -> None:
        self._operator, self._part, self._d = operator, part, d
        self._PETSc = PETSc
        self._glued = np.zeros(len(operator.interface.dofs), bool)
        self._glued[contact] = True
        self._filter = _Filter(operator, part, PETSc)
        options.set_defaults(PETSc)
        self._bodies = Preconditioner(part.P, options.PREFIX, PETSc)
        self.slow = False
        self.follows: bool | None = None
        self._tangent: _core.ContactTangent | None = None
        self._springs: Springs | None = None
        self._left, self._more = operator.K.createVecs()

    @property
    def ready(self) -> bool:
        """Whether the hierarchy is that which the last solution asked for."""
        return not (self.slow and self.follows is False)

    def prepare(
        self,
        tangent: _core.ContactTangent,
        springs: Springs,
        loose: float,
        *,
        new: bool,
    ) -> None:
        """Follow the statuses, of which a share is loose."""
        self._tangent, self._springs = tangent, springs
        held = tangent.held
        if new:
            self._filter.prepare(held, springs)
        follow = loose > _LOOSE or self.slow
        if follow and (new or not self.follows):
            self._part.set(held, springs)
            self._bodies.update()
        elif not follow and self.follows is not False:
            self._part.set(held | self._glued, None)
            self._bodies.update()
        self._held = held if follow else held | self._glued
        self.follows = follow

    def solved_in(self, iterations: int) -> None:
        """Learn from the iterations of a linear system."""
        if self.follows is False and iterations > _SLOW:
            self.slow = True

    def apply(self, _pc: object, b: PetscVec, x: PetscVec) -> None:
        """``x ≈ P⁻¹ b``; PETSc calls it."""
        interface, tangent = self._operator.interface, self._tangent
        assert tangent is not None  # noqa: S101 - set by `prepare`
        whole = interface.gather(b)
        x.set(0.0)
        first = self._filter.solve(whole)
        interface.write(first, x)
        self._residual(tangent, b, x)
        self._clear(self._left)
        self._bodies.pc.apply(self._left, self._more)
        self._clear(self._more)
        x.axpy(1.0, self._more)
        self._residual(tangent, b, x)
        at = interface.gather(x) + self._filter.solve(interface.gather(self._left))
        interface.write(at, x)

    def _residual(
        self, tangent: _core.ContactTangent, b: PetscVec, x: PetscVec
    ) -> None:
        """``b - P x``."""
        self._operator.masked(tangent, x, self._left, self._springs)
        self._left.aypx(-1.0, b)

    def _clear(self, x: PetscVec) -> None:
        """Set the places to zero that the hierarchy holds."""
        interface = self._operator.interface
        x.array[self._operator.fixed] = 0.0
        places = interface.gather(x)
        places[self._held] = 0.0
        interface.write(places, x)


class _Filter:
    """A factor of ``P_cc``, ``c`` the places that are not held; the same on every rank."""

    def __init__(
        self, operator: Operator, part: SymmetricPart, PETSc: ModuleType
    ) -> None:
        comm = operator.K.comm.tompi4py()
        parts = comm.allgather(part.around)
        self._row, self._column, self._values = (
            np.concatenate([piece[k] for piece in parts]) for k in range(3)
        )
        self._count = len(operator.interface.dofs)
        self._PETSc = PETSc
        self._free: Ints = np.empty(0, np.int64)
        self._ksp: Any = None

    def prepare(self, held: Bools, springs: Springs) -> None:
        """Factor the part that is not held."""
        from scipy.sparse import coo_array

        d = springs.places.shape[1]
        row = [self._row, np.repeat(springs.places, d, axis=1).ravel()]
        column = [self._column, np.tile(springs.places, (1, d)).ravel()]
        values = [self._values, springs.blocks.ravel()]
        self._free = np.flatnonzero(~held)
        number = np.full(self._count, -1)
        number[self._free] = np.arange(len(self._free))
        i, j = number[np.concatenate(row)], number[np.concatenate(column)]
        kept = (i >= 0) & (j >= 0)
        entries = np.concatenate(values)[kept], (i[kept], j[kept])
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
        found = np.zeros(self._count)
        if len(self._free):
            self._b.array[:] = b[self._free]
            self._ksp.solve(self._b, self._x)
            found[self._free] = self._x.array_r
        return found
