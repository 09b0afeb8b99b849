"""Linear systems of Newton steps: flexible GMRES of PETSc, and its preconditioner."""

from __future__ import annotations

from types import ModuleType

import numpy as np
from numpy.typing import NDArray

import bipot_rs._core as _core
from bipot_rs._lib.types import PetscVec
from bipot_rs.petsc import options
from bipot_rs.petsc.joined import Joined
from bipot_rs.petsc.one_rank import NAME, NotFactoredError, OneRank
from bipot_rs.petsc.operator import Operator, Springs
from bipot_rs.petsc.preconditioner import Preconditioner
from bipot_rs.petsc.symmetric_part import SymmetricPart


class LinearSolver:
    """Solves ``J x = b`` for the statuses of a Newton step.

    The preconditioner is made for the symmetric part of ``J``. It must follow the statuses:
    one that was made for others costs several times as many iterations. If it fails, a
    factor by Cholesky takes its place, if there is memory for it.

    Attributes
    ----------
    preconditioner
        What is used, for people.
    replaced
        Why a factor took the place of the first preconditioner; empty if it did not.
    """

    def __init__(
        self,
        operator: Operator,
        part: SymmetricPart,
        joined: Joined | None,
        d: int,
        PETSc: ModuleType,
        fits: bool,
        one_rank: OneRank | None = None,
    ) -> None:
        self._operator, self._part, self._joined, self._d = operator, part, joined, d
        self._PETSc, self._fits = PETSc, fits
        self._tangent: _core.ContactTangent | None = None
        self._statuses: NDArray[np.int8] | None = None
        self._transposed = False
        comm = operator.K.comm
        self._J = PETSc.Mat().createPython(operator.K.getSizes(), self, comm=comm)
        self._J.setUp()
        chosen = options.set_defaults(PETSc)
        self.preconditioner = str(chosen["pc_type"])
        self.replaced = ""
        self._alone: Alone | OneRank
        if one_rank is None:
            self._alone = Alone(part, options.PREFIX, PETSc)
        else:
            self._alone, self.preconditioner = one_rank, NAME
        self._ksp = PETSc.KSP().create(comm)
        self._ksp.setOptionsPrefix(options.PREFIX)
        self._ksp.setOperators(self._J, part.P)
        self._ksp.setType("fgmres")
        self._ksp.setPCSide(PETSc.PC.Side.RIGHT)
        self._ksp.setNormType(PETSc.KSP.NormType.UNPRECONDITIONED)
        pc = self._ksp.getPC()
        # The options of the user are those of the preconditioner inside.
        pc.setOptionsPrefix(f"{options.PREFIX}outer_")
        pc.setType("python")
        pc.setPythonContext(self._alone if joined is None else joined)
        self._ksp.setFromOptions()

    def mult(self, _mat: object, x: PetscVec, y: PetscVec) -> None:
        """``y = J x``, or ``Jᵀ x``; PETSc calls it."""
        assert self._tangent is not None  # noqa: S101 - set by `prepare`
        self._operator.masked(self._tangent, x, y, transposed=self._transposed)

    def begin(self) -> None:
        """Forget what was learned in the load step before."""
        if self._joined is not None:
            self._joined.slow = False

    def prepare(
        self, tangent: _core.ContactTangent, statuses: NDArray[np.int8]
    ) -> bool:
        """Make the preconditioner, unless it was made for these statuses.

        Whether there is one.
        """
        self._destroy_garbage()
        self._tangent = tangent
        known = self._statuses is not None and np.array_equal(self._statuses, statuses)
        if known and (self._joined is None or self._joined.ready):
            return True
        springs = Springs(tangent, self._d)
        self._statuses = statuses.copy()
        try:
            if self._joined is None:
                self._alone.prepare(tangent, springs)
            else:
                loose = np.count_nonzero(statuses != _STICK)
                share = loose / max(len(statuses), 1)
                self._joined.prepare(tangent, springs, share, new=not known)
        except (self._PETSc.Error, NotFactoredError) as error:
            self._statuses = None
            return self._replace(f"it cannot be made: {error}") and self.prepare(
                tangent, statuses
            )
        return True

    def _destroy_garbage(self) -> None:
        """Destroy Vecs that nothing refers to; every rank calls this.

        Since 3.18, petsc4py keeps them until then, because ranks must destroy them together.
        """
        if hasattr(self._PETSc, "garbage_cleanup"):
            self._PETSc.garbage_cleanup(self._operator.K.comm)

    def solve(
        self, b: PetscVec, tol: float, *, transposed: bool = False
    ) -> tuple[PetscVec, int, bool]:
        """The solution to a relative residual, the products, and whether it was reached."""
        self._transposed = transposed
        x, products, reached = self._solve(b, tol)
        tangent, statuses = self._tangent, self._statuses
        if (
            not reached
            and tangent is not None
            and statuses is not None
            and self._replace(f"it did not converge in {products} iterations")
        ):
            self._statuses = None
            if self.prepare(tangent, statuses):
                x, more, reached = self._solve(b, tol)
                products += more
        return x, products, reached

    def _solve(self, b: PetscVec, tol: float) -> tuple[PetscVec, int, bool]:
        x = self._operator.zeros()
        if b.norm() == 0.0:
            return x, 0, True
        self._ksp.setTolerances(rtol=tol, atol=0.0, max_it=options.MOST_KRYLOV)
        try:
            self._ksp.solve(b, x)
        except self._PETSc.Error:
            return self._operator.zeros(), self._ksp.getIterationNumber(), False
        products = self._ksp.getIterationNumber()
        if self._joined is not None:
            self._joined.solved_in(products)
        reached = self._ksp.getConvergedReason() > 0 and np.isfinite(x.norm())
        return x, products, reached

    def residual(self, b: PetscVec, x: PetscVec, *, transposed: bool = False) -> float:
        """``‖b - J x‖ / ‖b‖``, or that with ``Jᵀ``."""
        size = float(b.norm())
        self._transposed = transposed
        left = b.copy()
        self.mult(None, x, left)
        left.aypx(-1.0, b)
        return float(left.norm()) / size if size else 0.0

    def apply(self, b: PetscVec) -> PetscVec:
        """One application of the preconditioner."""
        x = self._operator.zeros()
        shell = self._alone if self._joined is None else self._joined
        shell.apply(None, b, x)
        return x

    def _replace(self, reason: str) -> bool:
        """Put a factor in the place of the preconditioner; whether this is possible."""
        if self.replaced or not self._fits:
            return False
        self.replaced = f"{self.preconditioner} was replaced: {reason}"
        mumps = self._PETSc.Sys.hasExternalPackage("mumps")
        if not mumps and self._operator.K.comm.size > 1:
            self.replaced = ""
            return False
        self.preconditioner = "cholesky (MUMPS)" if mumps else "cholesky"
        self._joined = None
        alone = Alone(self._part, f"{options.PREFIX}direct_", self._PETSc)
        alone.factor(mumps)
        self._alone = alone
        self._ksp.getPC().setPythonContext(alone)
        self._statuses = None
        return True


class Alone:
    """A preconditioner of PETSc for the symmetric part, as a shell.

    Multigrid inside a solver of PETSc would use ``J`` in its smoother, which is slower and
    not symmetric.
    """

    def __init__(self, part: SymmetricPart, prefix: str, PETSc: ModuleType) -> None:
        self._part = part
        self._inside = Preconditioner(part.P, prefix, PETSc)

    def factor(self, mumps: bool) -> None:
        """Use a factor by Cholesky."""
        pc = self._inside.pc
        pc.setType("cholesky")
        if mumps:
            pc.setFactorSolverType("mumps")
        pc.setFromOptions()

    def prepare(self, tangent: _core.ContactTangent, springs: Springs) -> None:
        """Make it for the held places and springs."""
        self._part.set(tangent.held, springs)
        self._inside.update()

    def apply(self, _pc: object, b: PetscVec, x: PetscVec) -> None:
        """``x ≈ P⁻¹ b``; PETSc calls it."""
        self._inside.pc.apply(b, x)


_STICK = 2
