"""Preconditioners of the symmetric part of a Newton step, as PETSc calls them.

That of small problems is a factor of the core, on the first rank.
"""

from __future__ import annotations

from collections.abc import Sequence
from types import ModuleType

import numpy as np
from numpy.typing import NDArray

import bipot_rs._core as _core
from bipot_rs._lib.types import Floats, Integers, PetscMat, PetscVec
from bipot_rs._lib.validation import csr, indices
from bipot_rs.contact.errors import FloatingBodyError
from bipot_rs.contact.law.contact_law import ContactLaw
from bipot_rs.petsc import tuning
from bipot_rs.petsc.linear import options
from bipot_rs.petsc.linear.symmetric_part import SymmetricPart
from bipot_rs.petsc.operator import SlidingSprings
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
