"""Latches: displacements that are free in some load steps, and keep in others what they reached.

The shortening of a bolt is one: a force determines it in the steps that tighten, and later steps
prescribe it. In the prescribed displacements of a step, NaN stands for a free latch; a number is
its change since it was last free, or since a start without loads. Each set of free latches has a
K of its own, prepared once.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from bipot_rs._lib.types import Bools, CsrMatrix, Floats, Ints
from bipot_rs.contact.results.solution import Step


@dataclass(frozen=True, eq=False)
class Latches:
    """The latches of a problem."""

    dofs: Ints  # (m,): their degrees of freedom, among the prescribed ones
    share: Floats  # (m,): part of each force that the model contains
    fixed: Ints  # (fixed,): all prescribed degrees of freedom
    # Sparse (m, n): rows of K of the degrees of freedom after them, which are zero in all
    # steps; their reactions are the tensions.
    rows: CsrMatrix
    # Makes vectors of all degrees of freedom arrays, which those of PETSc are not.
    whole: Callable[[Floats], Floats] = np.asarray

    @property
    def at(self) -> Ints:
        """Their places among the prescribed degrees of freedom."""
        order = np.argsort(self.fixed)
        return order[np.searchsorted(self.fixed, self.dofs, sorter=order)]

    def find_free(self, prescribed: Floats) -> Bools:
        """Which are free in a step, ``(m,)``."""
        return np.isnan(prescribed[self.at])

    def fill(self, prescribed: Floats, before: Step | None) -> Floats:
        """Prescribed displacements with what the latches keep, of which free ones ignore theirs."""
        filled = prescribed.copy()
        filled[self.at] = np.nan_to_num(prescribed[self.at])
        if before is not None and before.shortening is not None:
            filled[self.at] += before.shortening
            if before.prescribed is not None:
                filled[self.at] -= np.nan_to_num(before.prescribed[self.at])
        return filled

    def drop_free(self, prescribed: Floats, free: Bools) -> Floats:
        """The displacements that stay prescribed while some latches are free."""
        return np.delete(prescribed, self.at[free])

    def check_start(self, start: Step | None) -> None:
        """Refuse a start that does not say what the latches have reached."""
        if start is None:
            return
        kept = start.shortening
        if kept is None or kept.shape != self.dofs.shape:
            raise ValueError(
                f"start has {'no' if kept is None else len(kept)} shortenings of bolts, "
                f"expected {len(self.dofs)}: pass a result of this problem, or "
                "State(shortening=...) with one for each bolt"
            )

    def complete(self, step: Step, pushed: Floats, free: Bools) -> Step:
        """A step with the shortening and the force of each bolt.

        ``pushed (n,)`` are the forces of the contacts, ``Bᵀ r``.
        """
        u, load = self.whole(step.displacement), step.load
        force = self.rows @ u - pushed[self.dofs + 1]
        if load is not None:
            load = self.whole(load)
            force -= load[self.dofs + 1]
            force[free] = (load[self.dofs] - load[self.dofs + 1])[free]
        return replace(
            step,
            shortening=u[self.dofs],
            bolt_force=force / self.share,
            tightened=free,
        )
