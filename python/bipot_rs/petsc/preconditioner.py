"""A preconditioner of PETSc for a symmetric matrix whose values change."""

from __future__ import annotations

from types import ModuleType

import numpy as np

from bipot_rs._lib.types import PetscMat
from bipot_rs.petsc import options

# Iterations that estimate the largest eigenvalue, and the interval of Chebyshev polynomials
# relative to it: an estimate from below, and what a coarser grid does not see.
_ITERATIONS = 10
_LEAST, _LARGEST = 0.1, 1.1


class Preconditioner:
    """The preconditioner that the options choose, as a rule multigrid.

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
            if self.pc.getType() == "gamg" and options.smoother_is_ours():
                self._smooth_by_nodes()

    def _smooth_by_nodes(self) -> None:
        """Let the smoother of the finest grid invert the block of each node."""
        level = self.pc.getMGLevels() - 1
        if level < 1:
            return
        largest = self._largest_eigenvalue()
        if not np.isfinite(largest) or largest <= 0.0:
            return
        # The spectrum changes little with the statuses: one estimate serves all of them.
        chosen = {
            "pc_type": "pbjacobi",
            "ksp_chebyshev_eigenvalues": f"{_LEAST * largest},{_LARGEST * largest}",
        }
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

    def _largest_eigenvalue(self) -> float:
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
        solver.setTolerances(rtol=1e-12, atol=0.0, max_it=_ITERATIONS)
        solver.setUp()
        solver.solve(b, x)
        found = np.real(solver.computeEigenvalues())
        return float(np.max(found, initial=0.0))
