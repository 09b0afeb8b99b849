"""What `ContactProblem.wear` takes and returns."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from bipot_rs._lib.messages import count_noun
from bipot_rs._lib.types import Floats, Ints
from bipot_rs._lib.validation import by_contact, integer, logical, number
from bipot_rs.contact import tuning
from bipot_rs.contact.path.contacts import ContactSet
from bipot_rs.contact.path.load_path import PathSolver, find_start
from bipot_rs.contact.results.result import Result
from bipot_rs.contact.results.solution import Step

if TYPE_CHECKING:
    from bipot_rs.contact.results.state import Start


# A jump solves two cycles: over one cycle it gains nothing.
LEAST = 2


@dataclass(frozen=True)
class Jump:
    """An attempt to jump over cycles.

    Attributes
    ----------
    first, cycles
        The first cycle that is jumped over, from 1, and their number.
    estimate
        Estimated error of the depth [length]; NaN if a trial cycle had no solution.
    limit
        The largest estimate that was allowed [length].
    longest
        Bound of ``cycles`` for stability.
    accepted
        Whether the jump was made.
    """

    first: int
    cycles: int
    estimate: float
    limit: float
    longest: float
    accepted: bool


@dataclass(frozen=True)
class CycleEnd:
    """The end of a cycle that was solved."""

    cycle: int  # its number
    worn: Floats  # (n_c,): depth that it wore off
    # (n_c, d - 1): motion of each contact along the surface from its begin to its end.
    drift: Floats


@dataclass(frozen=True)
class WearState:
    """Where a sequence of cycles stands."""

    cycle: int  # number of cycles so far
    depth: Floats  # (n_c,)
    # volume, energy: totals so far.
    volume: float
    energy: float
    # The last load step; None before the first cycle of unloaded bodies.
    at: Step | None
    ends: tuple[CycleEnd, ...]  # of the last two cycles that were solved
    lost: float  # energy dissipated in the last cycle
    # length, longest: length of the next jump to try, and its bound for stability.
    length: float
    longest: float
    spent: float  # allowed error that jumps have taken beyond their shares
    estimate: Floats  # (n_c,): sum of the estimates of all jumps made
    # least_longest, parts, step_error: as `longest`, `parts` and `step_error` of `Wear`.
    least_longest: float = np.inf
    parts: int = 1
    step_error: float | None = None

    @classmethod
    def begin(cls, at: Step | None, contacts: int) -> WearState:
        """Before the first cycle, which follows step ``at``."""
        new = np.zeros(contacts)
        return cls(0, new, 0.0, 0.0, at, (), 0.0, LEAST, np.inf, 0.0, new)


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class Wear:
    """Wear over many cycles. Arrays have a row for each cycle that was solved.

    Attributes
    ----------
    cycle : (m,)
        Numbers of these cycles, ascending from 1; all of them without jumps.
    depth : (m, n_c)
        Depth worn off each contact until the end of the cycle [length]. The gap of a
        contact is its own plus this depth.
    worn : (m, n_c)
        Depth worn off in the cycle [length].
    volume, dissipation : (m,)
        Volume worn off in the cycle, ``Σ area worn`` [length³; in the plane that of the
        thickness of the areas], and energy that friction dissipated in it.
    total_volume, total_dissipation : (m,)
        The same until the end of the cycle, including cycles that were jumped over.
    jumps
        All attempts to jump, also the rejected ones.
    error_estimate
        Largest sum of the estimates of the jumps at a contact, relative to the largest
        depth; 0 without jumps.
    longest
        Bound of a jump for stability, in cycles; the least of those after all cycles. Where it
        is small, load steps are divided.
    parts
        Largest number of parts of a load step. A load step whose wear would make pressures
        overshoot is halved until it does not.
    step_error
        Change of the depth after the first two cycles, or the only one, if their load steps
        are halved, relative to the largest depth: an estimate of the error of their load steps.
        ``None`` if they cannot be divided, because they have frames of their own, the problem
        was made with ``loads``, or the loads of the start are not known.
    paths
        Number of load paths that were solved, with those of the halved load steps.
    result
        `Result` of the last cycle; ``None`` if there is none.
    ends
        `Result` with the last load step of each of these cycles, for pictures and files.
        As in ``result``, ``step.wear`` is the depth at the end of a step.
    success, message
        Whether all cycles were solved, and a sentence about it.
    state
        Where the cycles stand, from which `ContactProblem.wear` continues.
    """

    cycle: Ints
    depth: Floats
    worn: Floats
    volume: Floats
    dissipation: Floats
    total_volume: Floats
    total_dissipation: Floats
    jumps: tuple[Jump, ...]
    error_estimate: float
    longest: float
    parts: int
    step_error: float | None
    paths: int
    result: Result | None
    ends: Result | None
    success: bool
    message: str
    state: WearState

    def __repr__(self) -> str:
        solved = f"{count_noun(len(self.cycle), 'cycle')} solved"
        return f"Wear({self.message}, {solved}, {count_noun(len(self.jumps), 'jump')})"

    @property
    def said(self) -> str:
        """Load paths, jumps and their error, in one sentence."""
        made = sum(jump.cycles for jump in self.jumps if jump.accepted)
        paths = f"{count_noun(self.paths, 'load path')} solved for {self.message}"
        if self.jumps:
            paths += (
                f"; {count_noun(made, 'cycle')} jumped over, "
                f"{count_noun(self.rejected, 'jump')} rejected, estimated error "
                f"{self.error_estimate:.1e} of the largest depth"
            )
        if np.isfinite(self.longest):
            paths += f"; stable jumps have at most {self.longest:.3g} cycles"
        if self.parts > 1:
            paths += (
                f"; load steps were divided into up to {self.parts}, because they wear off "
                "more than the contacts are pressed together"
            )
        if self.step_error is not None:
            paths += (
                f"; halved load steps change the first depths by {self.step_error:.1e}"
            )
            if self.step_error > tuning.COARSE_CYCLE:
                paths += " of the largest: divide the cycle into more load steps"
        return paths

    @property
    def pressure(self) -> Floats:
        """``r_n / area`` at the end of each cycle, ``(m, n_c)``."""
        traction = None if self.ends is None else self.ends.traction
        if traction is None:
            return np.empty_like(self.depth)
        return np.asarray(traction[:, :, 0])

    @property
    def rejected(self) -> int:
        """Number of jumps that were rejected."""
        return sum(not jump.accepted for jump in self.jumps)


@dataclass
class WearRows:
    """Rows of a `Wear` that is being computed."""

    worn: list[Floats] = field(default_factory=list)
    steps: list[Step] = field(default_factory=list)
    dissipation: list[float] = field(default_factory=list)
    totals: list[tuple[float, float]] = field(default_factory=list)
    jumps: list[Jump] = field(default_factory=list)
    paths: int = 0

    def make_wear(
        self,
        state: WearState,
        area: Floats,
        last: PathSolver | None,
        failed: str | None = None,
    ) -> Wear:
        """The `Wear` of these rows.

        ``last`` is the load path of the last cycle, and ``failed`` says why there are no
        more.
        """
        contacts = len(area)

        def stacked(rows: Sequence[Floats | None]) -> Floats:
            return np.array(rows, np.float64).reshape(-1, contacts)

        result = None if last is None else last.result()
        ends = None
        if last is not None:
            ends = last.result()
            ends.steps, ends.start = tuple(self.steps), None

        worn = stacked(self.worn)
        totals = np.array(self.totals, np.float64).reshape(-1, 2)
        deepest = float(state.depth.max(initial=0.0))
        off = float(state.estimate.max(initial=0.0))
        return Wear(
            cycle=np.array([step.cycle for step in self.steps], np.int64),
            depth=stacked([step.wear for step in self.steps]),
            worn=worn,
            volume=worn @ area,
            dissipation=np.array(self.dissipation, np.float64),
            total_volume=totals[:, 0],
            total_dissipation=totals[:, 1],
            jumps=tuple(self.jumps),
            error_estimate=off / deepest if deepest > 0 else 0.0,
            longest=state.least_longest,
            parts=state.parts,
            step_error=state.step_error,
            paths=self.paths,
            result=result,
            ends=ends,
            success=failed is None,
            message=f"{count_noun(state.cycle, 'cycle')}" if failed is None else failed,
            state=state,
        )


@dataclass(frozen=True, eq=False)
class WearArguments:
    """The arguments of `ContactProblem.wear`, checked."""

    contacts: ContactSet  # the contacts, whose areas are known
    # area, coefficient (n_c,): tributary areas, wear coefficients [1/stress].
    area: Floats
    coefficient: Floats
    cycles: int  # number of cycles
    jump: bool  # whether cycles may be jumped over
    rtol: float  # allowed error of the depth, relative to the largest depth
    state: WearState  # where the first cycle starts


def check_wear(
    contacts: ContactSet,
    coefficient: ArrayLike,
    cycles: int,
    jump: bool,
    rtol: float,
    start: Wear | Start | None,
) -> WearArguments:
    """Check the arguments that are about wear.

    Raises `TypeError` or `ValueError`: an argument is wrong, or the areas are not known; the
    message names it.
    """
    if contacts.count == 0:
        raise ValueError("the problem has no contacts, which could wear")
    if contacts.area is None:
        raise ValueError(
            "area is missing: wear needs pressures, so pass area= to ContactProblem"
        )
    for what, values in contacts.law.without_mu().items():
        if values is not None:
            raise ValueError(
                f"{what} is not zero, expected none: wear is not derived for contacts with "
                f"{what}"
            )
    coefficients = by_contact("coefficient", coefficient, contacts.count)
    if (coefficients < 0).any():
        k = int(np.argmax(coefficients < 0))
        raise ValueError(
            f"coefficient of contact {k} is {coefficients[k]:g}, expected zero or a "
            "positive number: depth = coefficient * pressure * slip"
        )
    count = integer("cycles", cycles, least=1)
    logical("jump", jump)
    share = number("rtol", rtol)
    if not 0 < share < 1:
        raise ValueError(f"rtol is {share:g}, expected a number between 0 and 1")
    state = _find_state(start, contacts.shape)
    return WearArguments(
        contacts, contacts.area, coefficients, count, jump, share, state
    )


def _find_state(start: Wear | Start | None, shape: tuple[int, int]) -> WearState:
    """Where the first cycle starts."""
    if not isinstance(start, Wear):
        step = find_start(start, shape)
        if step is not None and step.wear is not None:
            raise ValueError(
                "start is a step of worn contacts: pass the whole Wear to continue it"
            )
        return WearState.begin(step, shape[0])
    state = start.state
    if state.depth.shape != shape[:1]:
        raise ValueError(
            f"start has the wear of {len(state.depth)} contacts, expected {shape[0]}: "
            "continue the Wear of the same problem"
        )
    find_start(state.at, shape)
    return state
