"""Exact moving states: a stone that slides or tips at a load by hand, and a wall."""

import moving_states as bench
import numpy as np
import pytest
from scipy.sparse import diags_array

import bipot_rs as bp
from bipot_rs.blocks import assemble
from support.masonry import LIMITS, box


def stand(width: float, height: float) -> bench.Wall:
    """A stone on the ground with friction 0.5."""
    ground = box("ground", (-9, -1), (9, 0), support=True)
    return bench.prepare(assemble([ground, box("a", (0, 0), (width, height))], 0.5))


@pytest.mark.parametrize(
    ("width", "height", "load"),
    # It slides at μ, or tips about its corner at width/height.
    [(3.0, 1.0, 0.5), (1.0, 4.0, 0.25)],
)
def test_a_stone_that_moves(width: float, height: float, load: float) -> None:
    wall = stand(width, height)
    state, _ = bench.find_moving(wall, np.full(4, 1e-5))
    for near in (state, *bench.approach(wall, np.ones(4))):
        statuses = bench.sort_contacts(wall, near)
        states = bench.find_range(wall, *statuses)
        assert len(states) == 2
        for end in states:
            # Rounding of a linear programme with 8 unknowns of size 1.
            assert end.load == pytest.approx(load, rel=1e-13)
            assert bench.judge(wall, end) < 1e-13
        # No other mechanism has a smaller load.
        assert bench.descend(wall, states[0], statuses)[0].load == states[0].load


def test_the_judge_finds_each_violation() -> None:
    """Each change of the sliding stone breaks one condition by 0.1 or more."""
    wall = stand(3.0, 1.0)
    # The push of 0.5 at half the height presses the right corner more, by 1/6.
    right, left = 0.5 + 1 / 12, 0.5 - 1 / 12
    r_n = np.where(wall.problem.points[:, 0] > 1, right, left)
    along = np.sign(wall.push[0] * wall.R.toarray()[1::2, 0])
    exact = bench.State(
        np.column_stack([r_n, -0.5 * r_n * along]), np.array([1.0, 0.0, 0.0]), 0.5
    )
    # Sums of four numbers of size 1.
    assert bench.judge(wall, exact) < 1e-15
    upward = np.array([0.0, 0.2, 0.0])
    changed = (
        exact._replace(load=0.7),
        exact._replace(reaction=exact.reaction * [1.0, 1.3]),
        exact._replace(reaction=exact.reaction * [1.0, -1.0]),
        exact._replace(reaction=exact.reaction * [1.0, 0.5]),
        exact._replace(motion=exact.motion - upward),
        exact._replace(motion=exact.motion + upward),
        exact._replace(motion=1.2 * exact.motion),
    )
    for wrong in changed:
        assert bench.judge(wall, wrong) > 0.1


@pytest.mark.quick_variants("1-*")
@pytest.mark.parametrize(("number", "compliance"), [(1, 1e-9), (2, 1e-5), (3, 1e-7)])
def test_an_associated_wall_moves_at_its_static_limit(
    number: int, compliance: float
) -> None:
    """With dilatancy μ the problem is convex: its load falls to λ_a with the compliance."""
    wall = bench.build(number)
    forward = wall.push / (wall.push @ wall.push)
    across = np.linalg.svd(wall.push[None])[2][1:].T
    W = np.full(wall.R.shape[0], compliance)
    q, R = (wall.R @ forward).reshape(-1, 2), wall.R @ across
    loads = []
    for given in (np.diag(W), diags_array(W).tocsr()):
        solution = bp.ReducedProblem(
            given, q, wall.mu, rigid=(R, across.T @ wall.weight), dilatancy=wall.mu
        ).solve()
        assert solution.converged
        r = solution.reaction.ravel()
        loads.append(float(-forward @ (wall.weight + wall.R.T @ r)))
    # The limit is known to six digits; joints of compliance 1 would add some tens.
    assert loads == pytest.approx([LIMITS[number]] * 2, abs=1e-6 + 100 * compliance)
