"""Degrees of freedom without stiffness, such as those of a rigid obstacle under a force.

Contact alone holds them. The iterative engine needs a positive diagonal of K; here it gets one
by springs whose force vanishes. With springs k at the displacements a of these degrees of
freedom, and the load ``f + k a⁰``, a solution with ``a = a⁰`` is a solution without springs. The
iteration ``a⁰ ← a``, the proximal point method, converges by a factor of ``k / (k + s)`` with the
stiffness s of the bodies under the obstacle.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

import bipot_rs._core as _core
from bipot_rs._lib.types import Floats, Ints
from bipot_rs._lib.validation import Parts
from bipot_rs.contact import tuning
from bipot_rs.contact.law.status import Outcome
from bipot_rs.contact.results.solution import Step


@dataclass(frozen=True)
class Loose:
    """The free degrees of freedom without stiffness, and a spring for each.

    Attributes
    ----------
    dofs : (m,)
        Their numbers, ascending.
    spring
        Stiffness k.
    """

    dofs: Ints
    spring: float

    @classmethod
    def find(cls, parts: Parts, fixed: Ints, num_threads: int | None = None) -> Loose:
        """The degrees of freedom of K, by rows, that no spring of K holds."""
        start, _, value = parts
        # The largest entry of a positive semidefinite matrix is on its diagonal, and a row
        # with a zero there is zero.
        diagonal = _core.diagonal(parts, num_threads)
        bare = diagonal == 0.0
        bare[fixed] = False
        dofs = [
            i for i in np.flatnonzero(bare) if not value[start[i] : start[i + 1]].any()
        ]
        largest = float(diagonal.max(initial=0.0))
        return cls(np.array(dofs, np.int64), tuning.LOOSE_SPRING * largest)

    def add_springs(self, parts: Parts) -> Parts:
        """K with the springs."""
        if not self.dofs.size:
            return parts
        from scipy.sparse import csr_array

        n = len(parts[0]) - 1
        K = csr_array(parts[::-1], shape=(n, n))
        values = np.full(len(self.dofs), self.spring)
        stiffened = csr_array(
            K + csr_array((values, (self.dofs, self.dofs)), shape=(n, n))
        )
        stiffened.sort_indices()
        start, column, _ = parts
        return (
            stiffened.indptr.astype(start.dtype),
            stiffened.indices.astype(column.dtype),
            stiffened.data,
        )

    def solve(
        self,
        step: Callable[[Floats], tuple[Step, str]],
        load: Floats,
        at: Floats,
        tol: float,
    ) -> tuple[Step, str]:
        """Iterate until the springs carry no force, relative to ``tol``.

        Parameters
        ----------
        step
            Solves the load step with the springs, for a load. It returns the step, and
            why it stalled if it did.
        load
            ``(n,)``.
        at
            Displacements of `dofs` to start from.
        """
        for _ in range(tuning.LOOSE_ITERATIONS):
            stretched = load.copy()
            stretched[self.dofs] += self.spring * at
            solved, reason = step(stretched)
            if not solved.converged:
                return solved, reason
            moved = solved.displacement[self.dofs]
            left = self.spring * np.abs(moved - at).max()
            size = max(np.abs(load).max(), np.abs(solved.reaction).max(initial=0.0))
            if left <= tol * size:
                return solved, reason
            at = moved
        stalled = replace(solved, outcome=Outcome.STALLED)
        return stalled, "the position of an obstacle under a force does not settle"
