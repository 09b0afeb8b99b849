"""One cycle of a load path, in which each load step wears the contacts, and its stability."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from scipy import sparse
from scipy.sparse import linalg

from bipot_rs._lib.matrices import diagonal_matrix
from bipot_rs._lib.types import CsrMatrix, Floats, Ints
from bipot_rs._lib.validation import Csr, Parts
from bipot_rs.contact import tuning
from bipot_rs.contact.errors import NoEquilibriumError, NotConvergedError
from bipot_rs.contact.path.load_path import PathSolver
from bipot_rs.contact.path.load_steps import Gap, Totals
from bipot_rs.contact.path.moving_gaps import MovingGaps
from bipot_rs.contact.results.solution import Step, revise
from bipot_rs.contact.wear.record import WearArguments

# A cycle, a part of a load step and a jump may have this rate per cycle. With twice as much wear
# would be stable; with this, not even the predicted pressure overshoots.
STABLE = 1.0


class Stability:
    """Bounds the fastest rate, per cycle, at which wear evens out a pressure (31), (32).

    It needs neither ``W`` nor a factor of ``K``.

    ``stiffness``: row pointers, columns and values of K.
    ``contact``: B, checked.
    ``fixed``: prescribed degrees of freedom.
    ``d``: components of a contact.
    """

    def __init__(self, stiffness: Parts, contact: Csr, fixed: Ints, d: int) -> None:
        n = contact.shape[1]
        K = sparse.csr_array(stiffness[::-1], shape=(n, n))
        B = sparse.csr_array(contact.parts[::-1], shape=contact.shape)
        normal = B[::d]
        diagonal = K.diagonal()
        free = diagonal > 0
        free[fixed] = False
        compliance = np.divide(1.0, diagonal, out=np.zeros_like(diagonal), where=free)
        softened = normal @ diagonal_matrix(compliance)
        meeting = sparse.csr_array(softened @ normal.T)
        # A contact without a free degree of freedom has no determined pressure.
        self._own = np.flatnonzero(meeting.diagonal() > 0)
        self._energy = sparse.csr_array(softened @ K @ softened.T)[self._own]
        self._energy = self._energy[:, self._own]
        self._solve = _factor_meeting(
            sparse.csc_array(meeting[self._own][:, self._own])
        )
        self._whole: Floats | None = None
        count = len(self._own)
        if self._solve is not None and count <= tuning.DENSE_BOUND:
            whole = np.reshape([self._apply(e) for e in np.eye(count)], (count, count))
            self._whole = (whole + whole.T) / 2

    def _apply(self, v: Floats) -> Floats:
        """``X K Xᵀ v``."""
        product: Floats = self._solve(self._energy @ self._solve(v))
        return product

    @cached_property
    def largest(self) -> float:
        """Bound of the rate if a unit force wears off a unit depth at each contact."""
        count = int(self._own.max(initial=-1)) + 1
        # Three digits.
        return 1.01 * self.rate(np.ones(count))

    def rate(self, worn_by_force: Floats) -> float:
        """Largest eigenvalue of ``Σ X K Xᵀ`` (32), without unit, to three digits.

        More digits would depend on the number of threads.

        ``worn_by_force``: diagonal of ``Σ``: ``k slid / area``, the depth that a unit force
        wears off each contact in a cycle, ``(n_c,)`` [length/force].
        """
        root = np.sqrt(worn_by_force[self._own])
        if not root.any():
            return 0.0
        if self._solve is None:
            # Contacts move the same degree of freedom in the same way.
            return np.inf
        if self._whole is not None:
            values = np.linalg.eigvalsh(root[:, None] * self._whole * root)
            return float(f"{values[-1]:.3g}")
        n = len(root)
        operator = linalg.LinearOperator(
            (n, n), matvec=lambda v: root * self._apply(root * v.ravel()), dtype=float
        )
        start = np.random.default_rng(0).standard_normal(n)
        (rate,) = linalg.eigsh(
            operator,
            k=1,
            which="LA",
            v0=start,
            tol=tuning.BOUND_RTOL,
            return_eigenvectors=False,
        )
        # Lanczos approaches the eigenvalue from below.
        return float(f"{rate * (1 + tuning.BOUND_RTOL):.3g}")


def _factor_meeting(meeting: CsrMatrix) -> Any:
    """Function that solves with ``B_n D⁻¹ B_nᵀ``; None if it is singular."""
    if meeting.nnz == meeting.shape[0]:
        # Each degree of freedom meets one contact.
        inverse = 1.0 / meeting.diagonal()
        return lambda v: inverse * v
    try:
        return linalg.splu(meeting).solve
    except RuntimeError:
        return None


# A smaller rate is far from `STABLE`, also if it is divided by two.
SMALL_RATE = STABLE / 4


class Cycle:
    """A cycle that is being solved, or was.

    ``path``: its load steps, and what makes their `Result`.
    ``worn (n_c,)``: depth that it wore off each contact [length].
    ``slid (n_c,)``: length of slip of each contact while closed [length].
    ``rubbed (n_c,)``: depth that it would wear off by a slip of one in each load step.
    ``parts``: largest number of parts of a load step.
    """

    def __init__(self, path: PathSolver, contacts: int) -> None:
        self.path = path
        self.worn, self.slid = np.zeros(contacts), np.zeros(contacts)
        self.rubbed = np.zeros(contacts)
        self.parts = 1

    @property
    def last(self) -> Step:
        """Its last load step."""
        return self.path.steps[-1]

    @property
    def dissipation(self) -> float:
        """Energy that friction dissipated in it."""
        return sum(step.dissipation for step in self.path.steps)

    @property
    def drift(self) -> Floats:
        """Motion of each contact along the surface from its begin to its end, ``(n_c, d - 1)``."""
        begin, end = self.path.before, self.last.relative_displacement[:, 1:]
        if begin is None:
            return np.array(end)
        return np.asarray(end - begin.relative_displacement[:, 1:], np.float64)


@dataclass(frozen=True)
class Cycles:
    """Solves cycles of one load path.

    A load step that wears off so much that the pressure would overshoot is halved.
    """

    # Makes a load path that continues from a step, or from the unloaded bodies.
    begin_path: Callable[[Step | None], PathSolver]
    totals: Sequence[Totals]  # totals of each load step of a cycle
    arguments: WearArguments  # contacts and wear coefficients
    stability: Stability  # bounds the part of a pressure that a load step may wear off
    divisible: bool = True  # whether load steps can be divided: any loads can be solved

    def solve(
        self, at: Step | None, depth: Floats, number: int, *, parts: int = 1
    ) -> Cycle:
        """Solve cycle ``number`` from step ``at`` on, with contacts worn to ``depth (n_c,)``.

        After each load step the normal gaps grow by ``k p ‖slip‖`` with ``p = r_n / area``.
        Each load step is divided into ``parts``, and so is the largest part that is stable.

        Raises `NoEquilibriumError` or `NotConvergedError`: a load step failed, or wears off too
        much and cannot be divided. ``.result`` holds the load steps of this cycle before it.
        """
        cycle = Cycle(self.begin_path(at), len(depth))
        before = self._find_totals(at)
        for totals in self.totals:
            self._solve_step(cycle, before, totals, depth, number, parts)
            before = totals
        return cycle

    def can_divide(self, at: Step | None) -> bool:
        """Whether the load steps of a cycle from ``at`` on can be divided."""
        return self.divisible and self._find_totals(at) is not None

    def find_longest(self, slid: Floats) -> float:
        """Longest stable jump over cycles in which contacts slide by ``slid (n_c,)``."""
        rate = self.stability.rate(self._find_wear_by_force(slid))
        return STABLE / rate if rate > 0 else np.inf

    def _find_wear_by_force(self, slid: Floats) -> Floats:
        return self.arguments.coefficient * slid / self.arguments.area

    def _solve_step(
        self,
        cycle: Cycle,
        before: Totals | None,
        after: Totals,
        depth: Floats,
        number: int,
        parts: int,
    ) -> None:
        """Solve a load step in parts, each of which is halved until its wear is stable."""
        path, arguments = cycle.path, self.arguments
        # Ends of the parts that are left, as shares of the step; the next one is the last.
        done, ends = 0.0, [1.0 - part / parts for part in range(parts)]
        while ends:
            load, prescribed, gap = self._find_part(before, after, ends[-1])
            opened = _open_gaps(depth + cycle.worn, gap)
            step = _attempt(path, load, prescribed, opened)
            press = np.maximum(step.reaction[:, 0], 0.0)
            slip = np.linalg.norm(step.slip, axis=1)
            slid = np.where(press > 0, slip, 0.0)
            share = ends[-1] - done
            excess = parts * self._find_rate(slid) / STABLE
            if excess > 1.0:
                self._check_divisible(path, before, share, excess)
                path.rewind()
                ends.append(done + share / 2)
                continue
            rubbed = arguments.coefficient * press / arguments.area
            cycle.worn += rubbed * slip
            cycle.slid += slid
            cycle.rubbed += share * rubbed
            cycle.parts = max(cycle.parts, round(1.0 / share))
            path.accept(revise(step, wear=depth + cycle.worn, cycle=number))
            done = ends.pop()

    def _find_rate(self, slid: Floats) -> float:
        """Rate of `Stability` of a part of a load step; 0 if it is small, or has no bound."""
        by_force = self._find_wear_by_force(slid)
        if float(by_force.max()) * self.stability.largest <= SMALL_RATE:
            return 0.0
        rate = self.stability.rate(by_force)
        return rate if np.isfinite(rate) else 0.0

    def _check_divisible(
        self, path: PathSolver, before: Totals | None, share: float, excess: float
    ) -> None:
        """Raise if a load step cannot be divided further.

        Raises `NotConvergedError`.
        """
        remedy = "use a smaller coefficient"
        if self.divisible and before is not None:
            if share * tuning.MOST_PARTS > 1.0:
                return
            where = f", also in {tuning.MOST_PARTS} parts of the load step"
        else:
            wanted = 2 ** math.ceil(math.log2(excess))
            where, remedy = "", f"divide the load step into {wanted}, or {remedy}"
        raise path.add_steps(
            NotConvergedError(
                f"the contacts wear by more than they are pressed together{where}, so that "
                f"pressures would overshoot; {remedy}"
            )
        )

    def _find_totals(self, at: Step | None) -> Totals | None:
        """The totals at which a cycle begins; None if they are not known."""
        start = self.arguments.contacts.gap_by_component
        load, prescribed, gap = self.totals[-1]
        if at is None:
            return np.zeros_like(load), np.zeros_like(prescribed), start
        if at.cycle is None:
            if at.load is None or at.prescribed is None:
                return None
            # NaN where a bolt was tightened, which is over.
            moved = np.nan_to_num(at.prescribed)
            return at.load, moved, start if at.gap is None else at.gap
        return load, prescribed, start if gap is None else gap

    def _find_part(
        self, before: Totals | None, after: Totals, share: float
    ) -> tuple[Floats, Floats, Gap]:
        """The totals after a share of a load step."""
        load, prescribed, moved = after
        gap: Gap = self.arguments.contacts.gap_by_component if moved is None else moved
        if share == 1.0 or before is None:
            return load, prescribed, gap
        old_load, old_prescribed, old_gap = before
        if isinstance(gap, MovingGaps) or isinstance(old_gap, MovingGaps):
            raise TypeError("load steps with frames of their own are not divided")
        if old_gap is None:
            old_gap = self.arguments.contacts.gap_by_component
        return (
            old_load + share * (load - old_load),
            old_prescribed + share * (prescribed - old_prescribed),
            old_gap + share * (gap - old_gap),
        )


def _attempt(path: PathSolver, load: Floats, prescribed: Floats, gap: Gap) -> Step:
    """A load step that converged, and is not yet part of the path."""
    try:
        step = path.attempt(load, prescribed, gap)
    except NoEquilibriumError as error:
        raise path.add_steps(error) from None
    if not step.converged:
        raise path.make_failure(step)
    return step


def _open_gaps(depth: Floats, gap: Gap) -> Gap:
    """Gaps of one step whose normal parts are larger by ``depth (n_c,)``."""
    if isinstance(gap, MovingGaps):
        return gap.opened(depth)
    opened = gap.copy()
    opened[:, 0] += depth
    return opened
