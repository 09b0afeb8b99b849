"""Cycles one by one, and jumps over them by Heun's method (29) with its error (30).

``docs/theory.md``, section 15, derives both. The names of the formulas are used here: a cycle
wears off ``g0`` before the last one, ``g1`` at the start of a jump, ``g2`` at the predicted
depth, and ``g3`` after the jump.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from bipot_rs._lib.types import Floats
from bipot_rs.contact import tuning
from bipot_rs.contact.errors import BipotError, NoEquilibriumError, NotConvergedError
from bipot_rs.contact.results.solution import Step, revise
from bipot_rs.contact.wear.cycle import Cycle, Cycles
from bipot_rs.contact.wear.record import LEAST, CycleEnd, Jump, Wear, WearRows


@dataclass(frozen=True)
class JumpTrial:
    """The end of a jump, after the cycle that follows it."""

    cycle: Cycle
    change: Floats
    energy: float
    estimate: Floats


class CycleSolver:
    """Solves cycles, and jumps over others.

    ``cycles``: solves one cycle.
    ``on_cycle``: called as ``on_cycle(number, step)`` with the last step of each cycle that was
    solved.
    """

    def __init__(
        self,
        cycles: Cycles,
        on_cycle: Callable[[int, Step], object] | None = None,
    ) -> None:
        arguments = cycles.arguments
        self._cycles, self._state = cycles, arguments.state
        self._end = arguments.state.cycle + arguments.cycles
        self._rtol, self._jumps = arguments.rtol, arguments.jump
        self._on_cycle = on_cycle
        self._rows = WearRows()
        self._last: Cycle | None = None
        # Cycles to solve before the next attempt to jump, and their number after that.
        self._wait, self._pause = 0, 1

    def solve(self) -> Wear:
        """Solve all cycles.

        Raises `NoEquilibriumError` or `NotConvergedError`: a cycle failed. ``.result`` holds
        its load steps before, ``.wear`` the cycles before.
        """
        while self._state.cycle < self._end:
            over = self._choose_jump()
            if over < LEAST or not self._jump(over):
                self._solve_next()
        return self._make_wear()

    def _choose_jump(self) -> int:
        """Number of cycles to jump over; less than `LEAST` for none."""
        if not self._jumps or self._wait > 0 or len(self._state.ends) < 2:
            return 0
        # The last cycle is always solved.
        left = self._end - self._state.cycle - 1
        return int(min(self._state.length, self._state.longest, left))

    def _solve_next(self) -> None:
        """Solve the next cycle."""
        number = self._state.cycle + 1
        try:
            cycle = self._solve_cycle(self._state.at, self._state.depth, number)
        except BipotError as error:
            error.reason = f"cycle {number}: {error}"
            # The step belongs to the cycle, not to a path that can be continued.
            error.step, error.args = None, (error.reason,)
            error.wear = self._make_wear(error.reason)
            raise
        if number == 2 or number == self._end == 1:
            self._compare_halved_steps(cycle)
        self._wait = max(self._wait - 1, 0)
        self._accept(cycle, 0, np.zeros_like(cycle.worn), 0.0)

    def _compare_halved_steps(self, cycle: Cycle) -> None:
        """Solve the cycles so far with halved load steps, to see what their length changes."""
        state, begin = self._state, self._cycles.arguments.state
        at, depth = begin.at, begin.depth
        if begin.cycle > 0 or not self._cycles.can_divide(at):
            return
        try:
            for number in range(1, state.cycle + 2):
                halved = self._solve_cycle(at, depth, number, parts=2)
                at, depth = halved.last, depth + halved.worn
        except (NoEquilibriumError, NotConvergedError):
            return
        expected = state.depth + cycle.worn
        deepest = float(np.maximum(expected, depth).max())
        change = float(np.abs(depth - expected).max())
        self._state = replace(
            state, step_error=change / deepest if deepest > 0 else 0.0
        )

    def _solve_cycle(
        self, at: Step | None, depth: Floats, number: int, *, parts: int = 1
    ) -> Cycle:
        self._rows.paths += 1
        return self._cycles.solve(at, depth, number, parts=parts)

    def _jump(self, over: int) -> bool:
        """Try to jump over cycles and to solve the one after; whether that worked."""
        state = self._state
        try:
            trial = self._try_jump(over)
        except (NoEquilibriumError, NotConvergedError):
            self._reject(
                Jump(state.cycle + 1, over, np.nan, np.nan, state.longest, False)
            )
            return False
        share, more = self._limits(over, trial.change)
        limit = share + more
        estimate = float(trial.estimate.max())
        accepted = estimate <= limit
        jump = Jump(state.cycle + 1, over, estimate, limit, state.longest, accepted)
        if not accepted:
            self._reject(jump)
            return False
        self._rows.jumps.append(jump)
        factor = tuning.JUMP_GROWTH
        if estimate > 0:
            factor = min(
                tuning.JUMP_GROWTH,
                tuning.JUMP_CAUTION * float(np.cbrt(limit / estimate)),
            )
        spent = state.spent + max(estimate - share, 0.0)
        self._state = replace(
            state, spent=spent, estimate=state.estimate + trial.estimate
        )
        self._wait, self._pause = 0, 1
        self._accept(trial.cycle, over, trial.change, trial.energy)
        self._state = replace(self._state, length=max(over * factor, LEAST))
        return True

    def _limits(self, over: int, change: Floats) -> tuple[float, float]:
        """Error that a jump may have by its share, and in addition."""
        deepest = float((self._state.depth + change).max())
        gained = float(change.max())
        whole = self._rtol / 2
        share = whole / 4 * (gained + over / self._end * deepest)
        return share, (whole / 2 * deepest - self._state.spent) / tuning.JUMP_TAKEN

    def _try_jump(self, over: int) -> JumpTrial:
        state = self._state
        before, last = state.ends
        g0, g1, apart = before.worn, last.worn, last.cycle - before.cycle
        # Slip is counted from the end of the cycle before, whose place changes with the depth.
        at, number = _shift_step(state.at, over * last.drift), state.cycle + over + 1
        predicted = self._solve_cycle(at, state.depth + over * g1, number)
        change = over * (g1 + predicted.worn) / 2
        # The predicted cycle has gone one cycle further.
        at = _shift_step(predicted.last, -last.drift)
        cycle = self._solve_cycle(at, state.depth + change, number)
        g3 = cycle.worn
        slopes = (g3 - g1) / (over + 1), (g1 - g0) / apart
        bend = (slopes[0] - slopes[1]) / (over + 1 + apart)
        estimate = over / 2 * np.abs(g3 - predicted.worn) + over**3 / 2 * np.abs(bend)
        # Error of the places, less what the predicted cycle has corrected.
        astray = over / 2 * (cycle.drift - last.drift) - (predicted.drift - cycle.drift)
        estimate += over / 2 * cycle.rubbed * np.linalg.norm(astray, axis=1)
        # The worn depths are known to the tolerance of the solver.
        estimate += cycle.last.tolerance * float(change.max())
        energy = over * (state.lost + predicted.dissipation) / 2
        return JumpTrial(cycle, change, energy, estimate)

    def _reject(self, jump: Jump) -> None:
        self._rows.jumps.append(jump)
        length = jump.cycles / 2
        if length < LEAST:
            self._wait = self._pause
            self._pause = min(2 * self._pause, tuning.JUMP_PATIENCE)
            length = LEAST
        self._state = replace(self._state, length=length)

    def _accept(self, cycle: Cycle, over: int, change: Floats, energy: float) -> None:
        """Add a cycle, after a jump ``over`` others that changed the depth by ``change``."""
        before, rows = self._state, self._rows
        area = self._cycles.arguments.area
        number = before.cycle + over + 1
        depth = before.depth + change + cycle.worn
        volume = before.volume + float((change + cycle.worn) @ area)
        spent = cycle.dissipation
        total = before.energy + energy + spent
        longest = self._cycles.find_longest(cycle.slid)
        end = CycleEnd(number, cycle.worn, cycle.drift)
        self._state = replace(
            before,
            cycle=number,
            depth=depth,
            volume=volume,
            energy=total,
            lost=spent,
            longest=longest,
            least_longest=min(before.least_longest, longest),
            parts=max(before.parts, cycle.parts),
            at=cycle.last,
            ends=(*before.ends, end)[-2:],
        )
        self._last = cycle
        rows.steps.append(cycle.last)
        rows.worn.append(cycle.worn)
        rows.dissipation.append(spent)
        rows.totals.append((volume, total))
        if self._on_cycle is not None:
            self._on_cycle(number, cycle.last)

    def _make_wear(self, failed: str | None = None) -> Wear:
        last = self._last
        path = None if last is None else last.path
        area = self._cycles.arguments.area
        return self._rows.make_wear(self._state, area, path, failed)


def _shift_step(step: Step | None, by: Floats) -> Step | None:
    """A step whose contacts were at other places along the surface."""
    if step is None:
        return None
    moved = step.relative_displacement.copy()
    moved[:, 1:] += by
    return revise(step, relative_displacement=moved)
