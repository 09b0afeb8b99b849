"""From blocks to a reduced problem: closed forms, invariances, messages."""

import re

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import bipot_rs as bp
from bipot_rs.blocks import Block
from bipot_rs.blocks.interfaces import refuse_overlap
from support.masonry import arch, assemble, box, find_balance, rotate

TURN = Rotation.from_rotvec([0.3, -1.1, 0.7]).as_matrix()


def stone(width: float, height: float, *, space: bool) -> list[Block]:
    """A block on a large one."""
    if space:
        ground = box("ground", (-9, -9, -1), (9, 9, 0), support=True)
        return [ground, box("stone", (0, 0, 0), (width, width, height))]
    ground = box("ground", (-9, -1), (9, 0), support=True)
    return [ground, box("stone", (0, 0), (width, height))]


@pytest.mark.parametrize("space", [False, True])
@pytest.mark.parametrize(("width", "height", "mu"), [(2, 1, 0.4), (1, 2, 0.8)])
def test_a_block_on_an_incline(
    width: float, height: float, mu: float, space: bool
) -> None:
    """It slides at mu, or topples at width / height, whichever is less."""
    blocks = stone(width, height, space=space)
    limit = min(mu, width / height)
    for slope, stands in ((limit * (1 - 1e-6), True), (limit * (1 + 1e-6), False)):
        gravity = [slope, 0.0, -1.0] if space else [slope, -1.0]
        # The direction of the slope is an edge of the cones of the programme.
        assert find_balance(assemble(blocks, mu, gravity))[0] == stands


@pytest.mark.parametrize("space", [False, True])
@pytest.mark.parametrize(
    ("slope", "words"),
    [
        # The search ends at ratios of 1.005; it topples from a slope of 2 on.
        (0.4, "with mu = 0.3; contact could balance the loads from mu = 0.4 on"),
        (2.4, "with mu = 0.3; no friction could balance the loads"),
    ],
)
def test_the_friction_that_could_hold(slope: float, words: str, space: bool) -> None:
    gravity = [slope, 0.0, -1.0] if space else [slope, -1.0]
    problem = assemble(stone(2, 1, space=space), 0.3, gravity)
    assert problem.equilibrium().reason.endswith(words)
    assert problem.existence().reason.endswith(words)
    solution = problem.solve()
    assert solution.outcome == "no_equilibrium"
    assert f"{words}; add a support" in solution.message


@pytest.mark.parametrize(
    ("mu", "words"),
    [
        # By hand, 0.4 times the normal force of the floor; the wall bears nothing.
        ([1e-6, 1e-6], r"contact could balance the loads from mu = 0\.40\d? on"),
        # Friction of the floor could, but it has none that can grow.
        (
            [0.0, 0.3],
            "no more friction at contacts that have some could balance the loa",
        ),
    ],
)
def test_friction_that_is_missing_is_not_called_useless(
    mu: list[float], words: str
) -> None:
    """A point on a floor, pulled off a wall."""
    R = [[0.0, 1.0], [1.0, 0.0], [1.0, 0.0], [0.0, 1.0]]
    problem = bp.ReducedProblem(
        np.zeros((4, 4)), np.zeros((2, 2)), mu, rigid=(R, [0.4, -1.0])
    )
    assert re.search(words, problem.equilibrium().reason)


def test_the_weight_is_density_times_volume() -> None:
    ground, block = stone(2, 3, space=True)
    block = Block("stone", block.points, block.faces, density=7.0)
    problem = bp.blocks.assemble([ground, block], 0.5, gravity=[0, 0, -2.0])
    assert np.abs(problem.rigid[1] - [0, 0, -2 * 7 * 12, 0, 0, 0]).max() < 1e-12
    assert problem.names == ("ground", "stone")


def test_corbels_reach_the_harmonic_sums() -> None:
    """Bricks of length 1 stand with overhangs 1/2, 1/4, 1/6 from the top, and no more."""
    for more, stands in ((-1e-6, True), (1e-6, False)):
        places = np.cumsum([0, 1 / 6 + more, 1 / 4 + more, 1 / 2 + more])
        blocks = [box("base", (0, -1), (1, 0), support=True)]
        blocks += [
            box(f"{k}", (places[k], k - 1.0), (places[k] + 1, float(k)))
            for k in range(1, 4)
        ]
        assert find_balance(assemble(blocks, 0.5))[0] == stands


def test_friction_carries_a_torque() -> None:
    """A square of side 1 under its weight G resists the torque mu G times half a diagonal.

    The pressure may be at its corners alone, all at the same distance from the axis.
    """
    problem = assemble(stone(1, 1, space=True), 0.5)
    twist = problem.load("stone", [0, 1, 0], [1.5, 0.5, 0.5])
    twist -= problem.load("stone", [0, 1, 0], [0.5, 0.5, 0.5])
    _, limit = find_balance(problem, twist)
    # Directions of slip, the tangents at the corners, are edges of the cones with 32 sides.
    assert limit == pytest.approx(0.5 * np.sqrt(0.5), rel=1e-9)


def test_a_force_at_a_point_has_a_moment() -> None:
    problem = assemble(stone(2, 2, space=False), 0.5)
    assert problem.load("stone", [0, 3], [2, 0]).tolist() == [0, 3, 3]
    assert problem.load("stone", [4, 0]).tolist() == [4, 0, 0]
    with pytest.raises(ValueError, match="'ground' is a support"):
        problem.load("ground", [0, 1])
    with pytest.raises(ValueError, match=r"no block 'ston', expected one of .*'stone'"):
        problem.load("ston", [0, 1])


@pytest.mark.parametrize("mu", [0.7, 0.9])
def test_an_arch_stands_by_its_thickness(mu: float) -> None:
    assert find_balance(assemble(arch(0.1075), mu))[0]
    assert not find_balance(assemble(arch(0.105), mu))[0]


def test_motions_of_the_contacts() -> None:
    """R a is the difference of the motions of both blocks, in the frames."""
    blocks = rotate(
        [
            box("ground", (-2, -2, -1), (4, 4, 0), support=True),
            box("a", (0, 0, 0), (2, 2, 1)),
            box("b", (1, 0, 1), (3, 1, 2)),
        ],
        TURN,
    )
    problem = assemble(blocks, 0.5)
    a = np.random.default_rng(5).normal(size=12)
    moved = np.asarray(problem.rigid[0] @ a).reshape(-1, 3)
    rows = problem.moves(a)
    for c, k in enumerate(problem.interface):
        one, x = problem.interfaces[k], problem.points[c]
        first, second = (
            rows[b, :3] + np.cross(rows[b, 3:], x - problem.blocks[b].centre)
            for b in (one.first, one.second)
        )
        assert np.abs(problem.frame[c] @ (second - first) - moved[c]).max() < 1e-12
    n = np.array([one.normal for one in problem.interfaces])[problem.interface]
    assert np.abs(problem.frame[:, 0] - n).max() < 1e-15


def test_the_solution_holds_the_weight() -> None:
    """With joints of stone: reactions of a column are the weights above."""
    blocks = [box("ground", (-1, -1), (2, 0), support=True)]
    blocks += [box(f"{k}", (0, k), (1, k + 1)) for k in range(4)]
    problem = bp.blocks.assemble(blocks, 0.5, stiffness=(1e3, 5e2))
    solution = problem.solve()
    assert solution.converged
    carried = {
        problem.interfaces[one.interface].second: one
        for one in problem.resultants(solution.reaction)
    }
    for k in range(4):
        assert np.abs(carried[k + 1].force - [0, 4.0 - k]).max() < 1e-9
        assert np.abs(carried[k + 1].point - [0.5, k]).max() < 1e-9
    # The joint below the column closes by force over stiffness and area, with sign.
    assert problem.W.diagonal()[:2] == pytest.approx([2e-3, 4e-3])
    sunk = problem.moves(solution.rigid_motion)[1]
    assert sunk[1] == pytest.approx(-4.0 / 1e3, rel=1e-8)


def test_ranges_of_a_block_between_walls() -> None:
    """The walls may clamp it with any force, and carry nothing, all or a part of the weight."""
    blocks = [
        box("ground", (-1, -1), (2, 0), support=True),
        box("left", (-1, 0), (0, 1), support=True),
        box("right", (1, 0), (2, 1), support=True),
        box("a", (0, 0), (1, 1)),
    ]
    problem = assemble(blocks, 0.5)
    for k, joint in enumerate(problem.interfaces):
        least, largest = problem.normal_range(k)
        below = problem.names[joint.first] == "ground"
        assert least == pytest.approx(0.0, abs=1e-6)
        assert largest == np.inf or below
    # Pushed down by the friction of the walls, which clamp it.
    ground = [problem.names[one.first] for one in problem.interfaces].index("ground")
    assert problem.normal_range(ground)[1] == np.inf
    elastic = bp.blocks.assemble(blocks, 0.5, stiffness=(1.0, 1.0))
    with pytest.raises(ValueError, match="joints have a stiffness"):
        elastic.normal_range(0)
    with pytest.raises(ValueError, match="interface is 9, expected"):
        problem.normal_range(9)
    falling = assemble(stone(2, 1, space=False), 0.3, gravity=[0.4, -1.0])
    with pytest.raises(bp.NoEquilibriumError, match="block 'stone' moves"):
        falling.normal_range(0)


def test_friction_by_pairs() -> None:
    blocks = [
        box("ground", (-9, -1), (9, 0), support=True),
        box("a", (0, 0), (3, 1)),
        box("b", (0, 1), (3, 2)),
    ]
    mu = {("a", "ground"): 0.2, ("a", "b"): 0.6}
    problem = bp.blocks.assemble(blocks, mu)
    assert problem.mu.tolist() == [0.2, 0.2, 0.6, 0.6]
    _, limit = find_balance(problem, problem.body_force([1.0, 0.0]))
    assert limit == pytest.approx(0.2, rel=1e-9)
    with pytest.raises(ValueError, match="mu has no number for the blocks 'a' and 'b'"):
        bp.blocks.assemble(blocks, {("ground", "a"): 0.2})


def test_words_for_a_motion() -> None:
    blocks = [box("ground", (-9, -1), (9, 0), support=True)]
    blocks += [box("a", (0, 0), (2, 2)), box("b", (3, 0), (5, 2))]
    problem = assemble(blocks, 0.3)
    assert problem.describe([0, -2, 0, 1, 0, 0]) == (
        "block 'a' moves down by 1 while block 'b' moves along x by 0.5"
    )
    # A corner moves by the root of 2 for a rotation by 1.
    assert problem.describe([0, 0, 0, 0, 0, 1]) == "block 'b' turns by 0.707"
    assert problem.describe(np.zeros(6)) == "nothing moves"


def test_no_support_is_an_error() -> None:
    blocks = [box("a", (0, 0), (1, 1)), box("b", (0, 1), (1, 2))]
    with pytest.raises(ValueError, match="no block is a support"):
        bp.blocks.assemble(blocks, 0.5)
    problem = bp.blocks.assemble(blocks, 0.5, supports=["a"])
    assert [block.support for block in problem.blocks] == [True, False]
    # The blocks that were given stay as they were.
    assert not blocks[0].support


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"supports": ["c"]}, "there is no block 'c'"),
        ({"supports": ["a", "b"]}, "all blocks are supports"),
        ({"tolerance": -1e-4}, "tolerance is -0.0001, expected a positive number"),
        ({"stiffness": (1.0, 0.0)}, "expected positive numbers"),
        ({"gravity": [0, 0, -1]}, r"gravity has shape \(3,\), expected \(2,\)"),
    ],
)
def test_refused_arguments(change: dict[str, object], message: str) -> None:
    blocks = [box("a", (0, 0), (1, 1)), box("b", (0, 1), (1, 2))]
    with pytest.raises(ValueError, match=message):
        bp.blocks.assemble(blocks, 0.5, **({"supports": ["a"]} | change))  # type: ignore[arg-type]


def test_blocks_that_cannot_be_assembled() -> None:
    ground = box("ground", (0, 0), (1, 1), support=True)
    with pytest.raises(
        bp.FloatingBodyError, match="block 'far' touches no other block"
    ):
        bp.blocks.assemble([ground, box("far", (0, 3), (1, 4))], 0.5)
    with pytest.raises(ValueError, match="two blocks have the name 'ground'"):
        bp.blocks.assemble([ground, ground], 0.5)
    with pytest.raises(ValueError, match="some blocks lie in the plane"):
        bp.blocks.assemble([ground, box("b", (0, 0, 0), (1, 1, 1))], 0.5)
    with pytest.raises(TypeError, match="blocks is 1, expected Blocks"):
        bp.blocks.assemble(1, 0.5)  # type: ignore[arg-type]
    for density in (np.nan, np.inf, -1.0):
        with pytest.raises(ValueError, match="density of block 'stone' is"):
            bp.blocks.Block("stone", [[0, 0], [1, 0], [0, 1]], density=density)
    with pytest.raises(TypeError, match="blocks has a str, expected Blocks"):
        bp.blocks.assemble(["ground"], 0.5)  # type: ignore[list-item]
    # A name is not taken for the names of its letters.
    with pytest.raises(
        TypeError, match="supports is 'ground', expected names of block"
    ):
        bp.blocks.assemble([ground], 0.5, supports="ground")
    with pytest.raises(
        TypeError, match="support of block 'b' is 'no', expected a bool"
    ):
        Block("b", ground.points, support="no")  # type: ignore[arg-type]


@pytest.mark.parametrize("space", [False, True])
@pytest.mark.parametrize("depth", [0.2, 1e-3, -0.1])
def test_blocks_that_overlap_are_refused(depth: float, space: bool) -> None:
    """By more than a hundredth of the smaller block: corners may be inexact."""
    low = (0, 0, -depth) if space else (0, -depth)
    pair = [stone(2, 1, space=space)[0], box("stone", low, (2, 2, 1)[3 - len(low) :])]
    if depth > 0.1:
        with pytest.raises(ValueError, match=r"'(stone|ground)' overlap near \["):
            refuse_overlap(pair)
    else:
        refuse_overlap(pair)
