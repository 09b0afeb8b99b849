"""Preconditioners of the symmetric part of a Newton step, as PETSc calls them.

That of small problems is a factor of the core, on the first rank.
"""

from __future__ import annotations

from collections.abc import Sequence
from types import ModuleType

import numpy as np
from numpy.typing import NDArray

import bipot_rs._core as _core
from bipot_rs._lib.types import Bools, Floats, Integers, Ints, PetscMat, PetscVec
from bipot_rs._lib.validation import csr, indices
from bipot_rs.contact.errors import FloatingBodyError
from bipot_rs.contact.law.contact_law import ContactLaw
from bipot_rs.contact.law.status import Status
from bipot_rs.petsc import tuning
from bipot_rs.petsc.linear import options
from bipot_rs.petsc.linear.symmetric_part import SymmetricPart
from bipot_rs.petsc.operator import Operator, SlidingSprings
from bipot_rs.petsc.own_rows import OwnRows


class Preconditioner:
    """What approximates ``P⁻¹``, for the statuses of a Newton step; a shell of PETSc."""

    name: str  # what it is, for people

    def __init__(self, part: SymmetricPart) -> None:
        self._part = part

    def begin(self) -> None:
        """Forget what was learned in the load step before."""

    def prepare(
        self, tangent: _core.ContactTangent, _: NDArray[np.int8], *, new: bool
    ) -> None:
        """Make it for these statuses; ``new`` says whether they have changed."""
        if new:
            self._part.set_values(tangent.held, SlidingSprings(tangent, self._part.d))
            self.update()

    def update(self) -> None:
        """Make it for the present values of ``P``."""

    def apply(self, pc: object, b: PetscVec, x: PetscVec, /) -> None:
        """``x ≈ P⁻¹ b``; PETSc calls it."""

    def learn(self, iterations: int) -> None:
        """Take notice of the iterations of a linear system."""


class Hierarchy:
    """What the options of PETSc choose for a matrix whose values change: as a rule multigrid.

    On the finest grid its smoother inverts the block of each node, which saves a third of the
    iterations. Coarser blocks may be singular: an aggregate may have fewer motions than
    columns.
    """

    def __init__(self, P: PetscMat, prefix: str, PETSc: ModuleType) -> None:
        self._P, self._prefix, self._PETSc = P, prefix, PETSc
        self.pc = PETSc.PC().create(P.comm)
        self.pc.setOptionsPrefix(prefix)
        self.pc.setOperators(P, P)
        self.pc.setFromOptions()
        self._smoothed = False

    def update(self) -> None:
        """Make it for the present values of the matrix."""
        self.pc.setUp()
        if not self._smoothed:
            self._smoothed = True
            if self.pc.getType() == "gamg" and options.smoother_is_ours(self._PETSc):
                self._smooth_by_nodes()

    def _smooth_by_nodes(self) -> None:
        """Let the smoother of the finest grid invert the block of each node."""
        level = self.pc.getMGLevels() - 1
        if level < 1:
            return
        largest = self._estimate_largest_eigenvalue()
        if not np.isfinite(largest) or largest <= 0.0:
            return
        # The spectrum changes little with the statuses: one estimate serves all of them.
        interval = f"{tuning.SMOOTHED_FROM * largest},{tuning.SMOOTHED_TO * largest}"
        chosen = {"pc_type": "pbjacobi", "ksp_chebyshev_eigenvalues": interval}
        database = self._PETSc.Options(self._prefix)
        names = {f"mg_levels_{level}_{name}": value for name, value in chosen.items()}
        # `hasName` would find those of all levels, too.
        if not names.keys().isdisjoint(database.getAll()):
            return
        for name, value in names.items():
            database.setValue(name, value)
        try:
            self.pc.getMGSmoother(level).setFromOptions()
        finally:
            # In another problem this level may be a coarse one.
            for name in names:
                database.delValue(name)

    def _estimate_largest_eigenvalue(self) -> float:
        """Largest eigenvalue of the matrix with the blocks of its nodes inverted."""
        b, x = self._P.createVecs()
        first, last = b.getOwnershipRange()
        # A quasi-random sequence: the same numbers for any number of ranks.
        b.array[:] = np.modf(np.arange(first, last) * 0.6180339887498949)[0] - 0.5
        solver = self._PETSc.KSP().create(self._P.comm)
        solver.setOperators(self._P)
        solver.setType("cg")
        solver.getPC().setType("pbjacobi")
        solver.setComputeEigenvalues(True)
        solver.setTolerances(rtol=1e-12, atol=0.0, max_it=tuning.EIGENVALUE_ITERATIONS)
        solver.setUp()
        solver.solve(b, x)
        return float(np.max(np.real(solver.computeEigenvalues()), initial=0.0))


class ChosenPreconditioner(Preconditioner):
    """A `Hierarchy` for the symmetric part, as a shell.

    Multigrid inside a solver of PETSc would use ``J`` in its smoother, which is slower and
    not symmetric.
    """

    def __init__(self, part: SymmetricPart, prefix: str, PETSc: ModuleType) -> None:
        super().__init__(part)
        self._inside = Hierarchy(part.P, prefix, PETSc)
        self.name = str(self._inside.pc.getType())

    def factor(self, mumps: bool) -> None:
        """Use a factor by Cholesky instead of what the options choose."""
        pc = self._inside.pc
        pc.setType("cholesky")
        if mumps:
            pc.setFactorSolverType("mumps")
        pc.setFromOptions()
        self.name = "cholesky (MUMPS)" if mumps else "cholesky"

    def update(self) -> None:
        """Make it for the present values of ``P``."""
        self._inside.update()

    def apply(self, _pc: object, b: PetscVec, x: PetscVec, /) -> None:
        """``x ≈ P⁻¹ b``."""
        self._inside.pc.apply(b, x)


class NotFactoredError(Exception):
    """The core cannot factor the symmetric part; all ranks raise it."""


class OneRankFactor(Preconditioner):
    """``P⁻¹`` for the symmetric part ``P`` of a Newton step, as a shell of PETSc.

    The first rank holds all of ``P`` and its factor. A product takes one message from each
    other rank and one to it, where multigrid takes some for each of its levels.
    """

    name = "factor on the first rank"

    def __init__(self, part: SymmetricPart) -> None:
        super().__init__(part)
        self._comm = part.P.comm.tompi4py()
        self._sizes = np.diff(part.P.getOwnershipRanges()).tolist()
        # Of the first rank.
        self._factor: _core.Condensed | None = None

    def update(self) -> None:
        """Factor the symmetric part.

        Raises `NotFactoredError`: it cannot be factored.
        """
        rows = OwnRows.of(self._part.P)
        arrays = rows.pointer, rows.column, rows.values
        every = self._comm.gather(arrays, root=0)
        reason = None if every is None else self._factor_rows(every)
        reason = self._comm.bcast(reason, root=0)
        if reason is not None:
            raise NotFactoredError(reason)

    def _factor_rows(
        self, parts: Sequence[tuple[Integers, Integers, Floats]]
    ) -> str | None:
        """Factor the rows of all ranks; the reason if that is not possible."""
        from scipy.sparse import csr_array, vstack

        n, d = sum(self._sizes), self._part.d
        rows = [
            csr_array((values, column, pointer), shape=(len(pointer) - 1, n))
            for pointer, column, values in parts
        ]
        stiffness = csr("P", vstack(rows).tocsr())
        # No contacts: those of the problem are springs and held places in P.
        none = csr("B", csr_array((0, n)))
        gap, law = np.zeros((0, d)), ContactLaw(np.zeros(0))
        fixed = indices("fixed", None, n)
        try:
            self._factor = _core.Condensed(
                stiffness.parts, none.parts, gap, law, fixed, None
            )
        except (FloatingBodyError, ValueError) as error:
            return str(error)
        return None

    def apply(self, _pc: object, b: PetscVec, x: PetscVec, /) -> None:
        """``x = P⁻¹ b``; PETSc calls it."""
        factor = self._factor
        first = self._comm.rank == 0
        whole = np.empty(sum(self._sizes) if first else 0)
        pieces = [whole, self._sizes] if first else None
        self._comm.Gatherv(np.ascontiguousarray(b.array_r), pieces, root=0)
        if factor is not None:
            none = np.zeros(0)
            state = whole, none, np.zeros((0, self._part.d)), none
            pieces = [
                np.ascontiguousarray(factor.displacements([state])[0]),
                self._sizes,
            ]
        part = np.empty(b.getLocalSize())
        self._comm.Scatterv(pieces, part, root=0)
        x.array[:] = part


class JoinedBodies(Preconditioner):
    """A preconditioner for bodies that contacts join, as a shell of PETSc.

    Multigrid for the bodies glued together at all contacts, between two exact solutions on the
    interface, which follow the statuses::

        x = P_cc⁻¹ b_c;   x ← x + M (b - P x);   x_c ← x_c + P_cc⁻¹ (b - P x)_c

    Where most contacts slip or are open, gluing is far from the truth, and ``M`` is multigrid
    for ``P``. As `src/primal/preconditioner.rs`.
    """

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
