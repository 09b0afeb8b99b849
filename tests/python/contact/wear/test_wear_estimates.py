"""Two estimates of the error of a jump: by differences of rates, and by exact derivatives.

A jump over N cycles has the error, to leading order, section 15 of ``docs/theory.md``,

    e = N (N + 1) (N + 2)/12 g̈ - N² (N + 1)/4 J J g,

where J is the derivative of the depth that a cycle wears off, and g̈ the second derivative of
g by the number of cycles. `Result.jvp` of the cycle gives J; the differences (30) need nothing.
"""

import numpy as np
import pytest

import bipot_rs as bp
from support.bodies import block
from support.worn import random_pad


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
