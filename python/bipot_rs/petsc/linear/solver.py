"""Linear systems of Newton steps: flexible GMRES of PETSc, and its preconditioner."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

import bipot_rs._core as _core
from bipot_rs._lib.types import PetscVec
from bipot_rs.petsc import tuning
from bipot_rs.petsc.linear import options
from bipot_rs.petsc.linear.preconditioner import (
    ChosenPreconditioner,
    NotFactoredError,
    Preconditioner,
)
from bipot_rs.petsc.linear.symmetric_part import SymmetricPart
from bipot_rs.petsc.operator import Operator


class LinearSolver:
    """Solves ``J x = b`` for the statuses of a Newton step.

    The preconditioner is made for the symmetric part of ``J``. It must follow the statuses:
    one that was made for others costs several times as many iterations. If it fails, a
    factor by Cholesky takes its place, if there is memory for it.

    ``preconditioner``: what approximates the inverse of the symmetric part.
    ``replaced``: why a factor took the place of the first preconditioner; empty if it did not.
    """

    def __init__(
        self,
        operator: Operator,
        part: SymmetricPart,
        preconditioner: Preconditioner,
        factor_fits: bool,
    ) -> None:
        self._operator, self._part, self._fits = operator, part, factor_fits
        self.preconditioner, self.replaced = preconditioner, ""
        # Those that the preconditioner was made for.
        self._tangent: _core.ContactTangent | None = None
        self._statuses: NDArray[np.int8] | None = None
        self._transposed = False
        PETSc, comm = operator.PETSc, operator.K.comm
        self._J = PETSc.Mat().createPython(operator.K.getSizes(), self, comm=comm)
        self._J.setUp()
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
        pc.setPythonContext(preconditioner)
        self._ksp.setFromOptions()

    def mult(self, _mat: object, x: PetscVec, y: PetscVec) -> None:
        """``y = J x``, or ``Jᵀ x``; PETSc calls it."""
        assert self._tangent is not None  # noqa: S101 - set by `prepare`
        self._operator.multiply_newton(self._tangent, x, y, transposed=self._transposed)

    def begin(self) -> None:
        """Begin a load step."""
        self.preconditioner.begin()

    def prepare(
        self, tangent: _core.ContactTangent, statuses: NDArray[np.int8]
    ) -> bool:
        """Make the preconditioner, unless it was made for these statuses.

        Whether there is one.
        """
        # Since 3.18, petsc4py keeps Vecs that nothing refers to until every rank calls this.
        PETSc = self._operator.PETSc
        if hasattr(PETSc, "garbage_cleanup"):
            PETSc.garbage_cleanup(self._operator.K.comm)
        before, self._tangent = self._tangent, tangent
        new = (
            self._statuses is None
            or before is None
            or not np.array_equal(self._statuses, statuses)
            # Cohesion may hold the tangents of an open contact.
            or not np.array_equal(before.held, tangent.held)
        )
        self._statuses = statuses.copy()
        try:
            self.preconditioner.prepare(tangent, statuses, new=new)
        except (self._operator.PETSc.Error, NotFactoredError) as error:
            self._statuses = None
            return self._replace(f"it cannot be made: {error}") and self.prepare(
                tangent, statuses
            )
        return True

    def solve(
        self, b: PetscVec, tol: float, *, transposed: bool = False
    ) -> tuple[PetscVec, int, bool]:
        """The solution to a relative residual, the products, and whether it was reached."""
        self._transposed = transposed
        x, products, reached = self._iterate(b, tol)
        tangent, statuses = self._tangent, self._statuses
        if (
            not reached
            and tangent is not None
            and statuses is not None
            and self._replace(f"it did not converge in {products} iterations")
            and self.prepare(tangent, statuses)
        ):
            x, more, reached = self._iterate(b, tol)
            products += more
        return x, products, reached

    def _iterate(self, b: PetscVec, tol: float) -> tuple[PetscVec, int, bool]:
        x = self._operator.make_zeros()
        if b.norm() == 0.0:
            return x, 0, True
        self._ksp.setTolerances(rtol=tol, atol=0.0, max_it=tuning.MOST_ITERATIONS)
        try:
            self._ksp.solve(b, x)
        except self._operator.PETSc.Error:
            return (
                self._operator.make_zeros(),
                self._ksp.getIterationNumber(),
                False,
            )
        products = self._ksp.getIterationNumber()
        self.preconditioner.learn(products)
        reached = self._ksp.getConvergedReason() > 0 and np.isfinite(x.norm())
        return x, products, reached

    def measure_residual(
        self, b: PetscVec, x: PetscVec, *, transposed: bool = False
    ) -> float:
        """``‖b - J x‖ / ‖b‖``, or that with ``Jᵀ``."""
        size = float(b.norm())
        self._transposed = transposed
        left = b.copy()
        self.mult(None, x, left)
        left.aypx(-1.0, b)
        return float(left.norm()) / size if size else 0.0

    def precondition(self, b: PetscVec) -> PetscVec:
        """One application of the preconditioner."""
        x = self._operator.make_zeros()
        self.preconditioner.apply(None, b, x)
        return x

    def _replace(self, reason: str) -> bool:
        """Put a factor in the place of the preconditioner; whether this is possible."""
        PETSc = self._operator.PETSc
        mumps = PETSc.Sys.hasExternalPackage("mumps")
        alone = self._operator.comm.size == 1
        if self.replaced or not self._fits or not (mumps or alone):
            return False
        self.replaced = f"{self.preconditioner.name} was replaced: {reason}"
        factor = ChosenPreconditioner(self._part, f"{options.PREFIX}direct_", PETSc)
        factor.factor(mumps)
        self.preconditioner = factor
        self._ksp.getPC().setPythonContext(factor)
        self._statuses = None
        return True
