"""Walls with compliant joints: many rigid motions, judged here by the law itself."""

import itertools

import numpy as np
import pytest

import bipot_rs as bp
from bipot_rs.blocks import Block
from support.signorini_coulomb import judge


def build_wall(wide: int, high: int, mu: float) -> bp.blocks.BlockProblem:
    """Bricks in running bond on a ground, pushed a little to the side."""
    blocks = [Block("ground", [[-1, -1], [wide + 1, -1], [wide + 1, 0], [-1, 0]])]
    for layer in range(high):
        shift = 0.5 * (layer % 2)
        cuts = np.unique(np.clip(np.arange(-1, wide + 1) + shift, 0, wide))
        for k, (x, y) in enumerate(itertools.pairwise(cuts)):
            corners = [[x, layer], [y, layer], [y, layer + 1], [x, layer + 1]]
            blocks.append(Block(f"{layer}.{k}", corners))
    return bp.blocks.assemble(
        blocks,
        mu,
        supports=["ground"],
        gravity=[0.1, -1.0],
        stiffness=(1000.0, 400.0),
    )


def measure_miss(given: bp.ReducedProblem, solution: bp.Solution) -> float:
    """Of balance, cones, gaps and friction, by code of its own."""
    R, e = given.rigid
    W, rigid = given.W.toarray(), (R.toarray(), e)
    r, a = solution.reaction, solution.rigid_motion
    return judge(W, given.q, given.mu, r, rigid, a).worst


@pytest.mark.slow_variants("0.6")
@pytest.mark.parametrize("mu", [0.6, 0.25])
def test_a_wall_is_solved_without_dense_motions(mu: float) -> None:
    """In any units, numbering and number of threads, in few Newton steps."""
    wall = build_wall(12, 8, mu)
    (R, e), (n, d) = wall.rigid, wall.q.shape
    assert R.shape[1] == 300
    solution = wall.solve(num_threads=1)
    assert solution.outcome is bp.Outcome.CONVERGED
    # The tolerance times the condition number of R, some hundred.
    assert measure_miss(wall, solution) <= 1e-8
    assert solution.iterations <= 40
    # Nor are they needed to find a, and to ask for existence: friction carries the push.
    assert wall.residual(solution.reaction) <= 1e-12
    assert wall.existence().verdict == "unknown"
    again = wall.solve(num_threads=2)
    np.testing.assert_array_equal(again.reaction, solution.reaction)
    order = np.random.default_rng(1).permutation(n)
    rows = (d * order[:, None] + np.arange(d)).ravel()
    W = wall.W.tocsr()[rows][:, rows]
    for force, length in [(1e6, 1e-6), (1e-6, 1e6)]:
        other = bp.ReducedProblem(
            W * (length / force), wall.q[order] * length, mu, rigid=(R[rows], e * force)
        )
        solution = other.solve()
        assert solution.outcome is bp.Outcome.CONVERGED
        assert measure_miss(other, solution) <= 1e-8


@pytest.mark.parametrize("bricks", [2, pytest.param(3, marks=pytest.mark.slow)])
@pytest.mark.parametrize("lean", [0.0, 0.01, 0.1])
def test_friction_that_nothing_presses_holds_no_overhanging_brick(
    bricks: int, lean: float
) -> None:
    """The last brick overhangs by half, and tips off with any lean to its side.

    Friction on the joint beside it would hold it, and balances the loads. But it tips away from
    that joint: of all combinations of statuses none is a state.
    """
    blocks = [Block("ground", [[-3, -1], [2.5, -1], [2.5, 0], [-3, 0]])]
    for k in range(bricks):
        x = 2 - k
        blocks.append(Block(f"{k}", [[x, 0], [x + 1, 0], [x + 1, 1], [x, 1]]))
    row = bp.blocks.assemble(
        blocks, 0.6, supports=["ground"], gravity=[lean, -1], stiffness=(1000.0, 400.0)
    )
    assert row.equilibrium().verdict == "balanced"
    assert row.existence(exhaust=True).verdict == ("none" if lean else "guaranteed")
    assert row.solve().converged == (lean == 0)
