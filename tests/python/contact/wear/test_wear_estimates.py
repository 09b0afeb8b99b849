"""Two estimates of the error of a jump: by differences of rates, and by exact derivatives.

A jump over N cycles has the error, to leading order, section 16 of ``docs/theory.md``,

    e = N (N + 1) (N + 2)/12 g̈ - N² (N + 1)/4 J J g,

where J is the derivative of the depth that a cycle wears off, and g̈ the second derivative of
g by the number of cycles. `Result.jvp` of the cycle gives J; the differences (30) need nothing.
"""

from typing import Any

import numpy as np
import pytest

from bipot_rs.contact.wear import jumps
from support.worn import COEFFICIENT, PULL, spring, worn_pad


def along(run: Any, depth: np.ndarray, place: np.ndarray) -> np.ndarray:
    """J times a change of the depth and of the places at which a cycle begins.

    A place that changes is a tangential gap. What a load step wears off opens the gaps of the
    steps after it.
    """
    cycles, result = run._cycles, run._last.path.result()
    direction = np.zeros_like(result.relative_displacement)
    direction[:, :, 0], direction[:, :, 1:] = depth, -place
    slip = np.linalg.norm(result.slip, axis=2)
    way = np.divide(
        result.slip, slip[..., None], where=slip[..., None] > 0, out=0 * result.slip
    )
    factor = cycles.arguments.coefficient / cycles.arguments.area
    for _ in range(len(result)):
        tangent = result.jvp(gap=direction)
        slid = (way * tangent.slip).sum(axis=2)
        pressed = tangent.reaction[:, :, 0]
        worn = factor * (pressed * slip + result.reaction[:, :, 0] * slid)
        direction[1:, :, 0] = depth + np.cumsum(worn, axis=0)[:-1]
    return np.asarray(worn.sum(axis=0))


def compared(
    monkeypatch: pytest.MonkeyPatch, solve: Any
) -> tuple[np.ndarray, np.ndarray]:
    """Both estimates of each jump over its true error, where every cycle is solved."""
    trial, rows = jumps.CycleSolver._try_jump, []

    def measured(run: Any, over: int) -> Any:
        trial_cycle, state = trial(run, over), run._state
        before, last = state.ends
        drift = (last.place - before.place) / (last.cycle - before.cycle)
        g1, g2 = last.worn, 2 * trial_cycle.change / over - last.worn
        once = along(run, g1, drift)
        twice = along(run, once, np.zeros_like(drift))
        bend = g2 - g1 - (over + 1) * once + over * (over + 1) / 2 * twice
        bend *= 2 / (over + 1) ** 2
        exact = bend * over * (over + 1) * (over + 2) / 12
        exact -= over**2 * (over + 1) / 4 * twice
        at, depth = state.at, state.depth.copy()
        for _ in range(over):
            cycle = run._cycles.solve(at, depth, 1)
            at, depth = cycle.last, depth + cycle.worn
        true = abs(depth - state.depth - trial_cycle.change).max()
        rows.append([over, abs(exact).max() / true, trial_cycle.estimate.max() / true])
        return trial_cycle

    monkeypatch.setattr(jumps.CycleSolver, "_try_jump", measured)
    solve()
    # Jumps over a few cycles have errors of the first cycles, whose history differs.
    table = np.array([row for row in rows if row[0] >= 6])
    assert len(table) > 8
    return table[:, 1], table[:, 2]


def test_both_estimates_of_an_exponential(monkeypatch: pytest.MonkeyPatch) -> None:
    """The derivative is exact to leading order; the differences add what would cancel."""
    exact, differences = compared(
        monkeypatch, lambda: spring().wear(PULL, coefficient=2.5e-8, cycles=262)
    )
    # Terms of the next order, λ N up to 0.1, and the jump in which a cycle has two steps.
    np.testing.assert_allclose(exact, 1.0, atol=0.15)
    np.testing.assert_allclose(differences, 2.0, atol=0.35)


def test_differences_feel_statuses_that_change(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Why (30) has differences: derivatives at the start do not see contacts that will slip."""
    exact, differences = compared(
        monkeypatch, lambda: worn_pad(coefficient=COEFFICIENT / 2, cycles=200)
    )
    assert exact.min() < 0.25
    assert differences.min() > 1.0
