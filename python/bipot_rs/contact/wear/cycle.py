"""One cycle of a load path, in which each load step wears the contacts."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from bipot_rs._lib.types import Floats
from bipot_rs.contact.path.load_path import PathSolver
from bipot_rs.contact.path.load_steps import Gap, Totals
from bipot_rs.contact.path.moving_gaps import MovingGaps
from bipot_rs.contact.results.solution import Step
from bipot_rs.contact.wear.arguments import WearArguments


@dataclass(frozen=True)
class Cycle:
    """A cycle that was solved.

    Attributes
    ----------
    path
        Its load steps, and what makes their `Result`.
    worn : (n_c,)
        Depth that it wore off each contact [length].
    slid : (n_c,)
        Length of slip of each contact while closed [length].
    """

    path: PathSolver
    worn: Floats
    slid: Floats

    @property
    def last(self) -> Step:
        """The last load step of the cycle."""
        return self.path.steps[-1]

    @property
    def dissipation(self) -> float:
        """Energy that friction dissipated in it."""
        return sum(step.dissipation for step in self.path.steps)


@dataclass(frozen=True)
class Cycles:
    """Solves cycles of one load path.

    Attributes
    ----------
    begin_path
        Makes a load path that continues from a step, or from the unloaded bodies.
    totals
        Totals of each load step of a cycle.
    arguments
        Contacts and wear coefficients.
    """

    begin_path: Callable[[Step | None], PathSolver]
    totals: Sequence[Totals]
    arguments: WearArguments

    def solve(self, at: Step | None, depth: Floats, number: int) -> Cycle:
        """Solve cycle ``number`` from step ``at`` on, with contacts worn to ``depth (n_c,)``.

        After each load step the normal gaps grow by ``k p ‖slip‖`` with ``p = r_n / area``.

        Raises
        ------
        NoEquilibriumError, NotConvergedError
            A load step failed. ``.result`` holds the load steps of this cycle before it.
        """
        path, arguments = self.begin_path(at), self.arguments
        at_start = arguments.contacts.gap_by_component
        worn, slid = np.zeros_like(depth), np.zeros_like(depth)
        for load, prescribed, gap in self.totals:
            opened = _open_gaps(depth + worn, at_start if gap is None else gap)
            step = path.advance(load, prescribed, opened)
            press = np.maximum(step.reaction[:, 0], 0.0)
            slip = np.linalg.norm(step.slip, axis=1)
            worn += arguments.coefficient * press / arguments.area * slip
            slid += np.where(press > 0, slip, 0.0)
            path.steps[-1] = replace(step, wear=depth + worn, cycle=number)
        return Cycle(path, worn, slid)


def _open_gaps(depth: Floats, gap: Gap) -> Gap:
    """Gaps of one step whose normal parts are larger by ``depth (n_c,)``."""
    if isinstance(gap, MovingGaps):
        return gap.opened(depth)
    opened = gap.copy()
    opened[:, 0] += depth
    return opened
