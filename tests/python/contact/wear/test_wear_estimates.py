"""Two estimates of the error of a jump: by differences of rates, and by exact derivatives.

A jump over N cycles has the error, to leading order, section 15 of ``docs/theory.md``,

    e = N (N + 1) (N + 2)/12 g̈ - N² (N + 1)/4 J J g,

where J is the derivative of the depth that a cycle wears off, and g̈ the second derivative of
g by the number of cycles. `Result.jvp` of the cycle gives J; the differences (30) need nothing.
"""

from typing import Any

import numpy as np
import pytest

import bipot_rs as bp
from bipot_rs.contact.wear import jumps
from support.bodies import block
from support.worn import COEFFICIENT, PULL, random_pad, spring, worn_pad


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
        last = state.ends[-1]
        drift = last.drift
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
    np.testing.assert_allclose(differences, 3.0, atol=0.5)


def test_differences_feel_statuses_that_change(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Why (30) has differences: derivatives at the start do not see contacts that will slip."""
    exact, differences = compared(
        monkeypatch, lambda: worn_pad(coefficient=COEFFICIENT / 2, cycles=150, rtol=0.1)
    )
    assert exact.min() < 0.25
    assert differences.min() > 1.0


@pytest.mark.parametrize(
    "seeds", [range(2), pytest.param(range(2, 120), marks=pytest.mark.slow)]
)
def test_random_pads(seeds: range) -> None:
    """The error of jumps is at most `rtol`, and not above its estimate by much."""
    jumped = 0
    for seed in seeds:
        problem, path = random_pad(seed)
        rtol = 10 ** np.random.default_rng(seed).uniform(-3, -1.3)
        every = problem.wear(**path, jump=False)
        wear = problem.wear(**path, rtol=rtol)
        error = abs(wear.depth[-1] - every.depth[-1]).max() / every.depth[-1].max()
        jumped += wear.paths < every.paths
        assert error <= rtol, seed
        # It holds the leading terms, and one change of status within a jump.
        assert error <= 1.5 * wear.error_estimate, seed
    assert jumped >= len(seeds) / 2


def test_history_that_settles_is_not_extrapolated() -> None:
    """A pad whose places still settle when the first jumps are made.

    Its stick zone remembers them. With the mean drift over each jump in place of that of a cycle,
    the error was 75 times the estimate.
    """
    body = block([1.8, 1.0], [7, 4], 1e3, 0.3)
    fixed = np.concatenate([body.dofs(1, 1.0, k) for k in range(2)])
    x = body.points[:, 0] - 0.9
    gap = 1.6e-3 * (1 + np.sin(1.7 * x + 1.85))
    problem = bp.ContactProblem(
        body.K, body.B, gap=gap, mu=0.75, fixed=fixed, area=body.area
    )
    m = len(fixed) // 2
    cycle = np.repeat([[0.0238, -0.0099], [-0.0238, -0.0135]], m, axis=1)
    given = {"prescribed": cycle, "coefficient": 1.4e-5, "cycles": 154, "tol": 1e-12}
    every, wear = problem.wear(**given, jump=False), problem.wear(**given, rtol=0.0145)
    error = abs(wear.depth[-1] - every.depth[-1]).max() / every.depth[-1].max()
    assert wear.paths < 60
    assert error <= wear.error_estimate <= 0.0145 / 2
    # The places at the end: those of every cycle.
    ends = [w.ends[-1].relative_displacement[:, 1] for w in (wear, every)]
    moved = abs(
        np.diff([e.relative_displacement[:, 1] for e in every.ends[:6]], axis=0)
    )
    assert abs(ends[0] - ends[1]).max() <= 0.1 * moved[-1].max()
