"""A bridge of two spans, a dry wall with an opening, a dome: verdicts with exact proofs."""

import itertools
from collections.abc import Callable, Sequence

import numpy as np
import pytest
from numpy.typing import NDArray

from bipot_rs.blocks import Block, BlockProblem, assemble
from support.masonry import box, find_balance, rotate
from support.rational import excludes_balance

Array = NDArray[np.float64]


def build_bridge(thickness: float) -> list[Block]:
    """Two half circles with an inner radius of 1, on three piers."""
    stones = 12
    angle = np.linspace(0, np.pi, stones + 1)
    direction = np.column_stack([np.cos(angle), np.sin(angle)])
    inner, outer = direction, (1 + thickness) * direction
    blocks = [box("ground", (-9, -3), (9, -2), support=True)]
    for span, side in (("left", -1), ("right", 1)):
        middle = np.array([side * (1 + thickness), 0.0])
        for k in range(stones):
            outline = np.array([inner[k], outer[k], outer[k + 1], inner[k + 1]])
            blocks.append(Block(f"{span} stone {k}", outline + middle))
    reach = 2 * (1 + thickness)
    for name, low, high in (
        ("left pier", -reach - 0.5, -reach + thickness),
        ("middle pier", -thickness, thickness),
        ("right pier", reach - thickness, reach + 0.5),
    ):
        blocks.append(box(name, (low, -2), (high, 0)))
    return blocks


def lay_wall(lintel: float) -> list[Block]:
    """Courses of stones of random lengths beside an opening of width 1, and a lintel.

    ``lintel`` is the length that lies on each side.
    """
    rng = np.random.default_rng(3)
    blocks = [box("ground", (-1, -1), (7, 0), support=True)]
    for course in range(8):
        y = 0.25 * course
        if course == 5:
            low, high = 2.5 - lintel, 3.5 + lintel
            blocks.append(box("lintel", (low, y), (high, y + 0.25)))
            sides = [(0.0, low), (high, 6.0)]
        else:
            sides = [(0.0, 2.5), (3.5, 6.0)] if course < 5 else [(0.0, 6.0)]
        for start, end in sides:
            cuts = [start]
            while end - cuts[-1] > 0.9:
                cuts.append(cuts[-1] + rng.uniform(0.35, 0.6))
            cuts.append(end)
            for x, far in itertools.pairwise(cuts):
                blocks.append(box(f"{course}, {x:.3f}", (x, y), (far, y + 0.25)))
    return blocks


def build_dome(thickness: float) -> list[Block]:
    """Half a sphere of radius 1 with an eye, of stones between meridians and cones."""
    rings, sides = 6, 12
    up = np.linspace(0, np.pi / 2 - 0.15, rings + 1)
    around = 2 * np.pi * np.arange(sides + 1) / sides
    corners = np.empty((rings + 1, sides + 1, 3))
    corners[..., 0] = np.outer(np.cos(up), np.cos(around))
    corners[..., 1] = np.outer(np.cos(up), np.sin(around))
    corners[..., 2] = np.sin(up)[:, None]
    faces = box("", (0, 0, 0), (1, 1, 1)).faces
    blocks = [box("ground", (-3, -3, -1), (3, 3, 0), support=True)]
    for i in range(rings):
        for j in range(sides):
            sheet = corners[i : i + 2, j : j + 2].swapaxes(0, 1).reshape(4, 3)
            shell = [(1 + s * thickness / 2) * sheet for s in (-1, 1)]
            blocks.append(Block(f"ring {i}, {j}", np.concatenate(shell), faces))
    return blocks


def check(problem: BlockProblem) -> str:
    """The verdict, after its proof has been checked."""
    found = problem.equilibrium()
    R, e = problem.rigid
    d = problem.q.shape[1]
    if found.motion is not None:
        assert np.isinf(found.excluded)
        assert excludes_balance(R, e, problem.mu, found.motion, d)
    else:
        # The smallest change that balances without rounding leaves no cone.
        r = found.reaction
        missing = R.T @ r.ravel() + e
        change = np.linalg.lstsq(R.T.toarray(), missing)[0].reshape(r.shape)
        spare = problem.mu * r[:, 0] - np.linalg.norm(r[:, 1:], axis=1)
        needed = problem.mu * np.abs(change[:, 0])
        needed += np.linalg.norm(change[:, 1:], axis=1)
        # Rounding of this change itself is another 1e-16 of it.
        assert (spare > 2 * needed).all()
    return found.verdict


TURN = np.array([[0.6, 0.64, 0.48], [-0.8, 0.48, 0.36], [0.0, -0.6, 0.8]])


@pytest.mark.parametrize(
    ("build", "mu", "verdict"),
    [
        (lambda: build_bridge(0.2), 0.6, "balanced"),
        (lambda: build_bridge(0.1), 0.6, "none"),
        (lambda: build_bridge(0.2), 0.2, "none"),
        (lambda: lay_wall(0.3), 0.6, "balanced"),
        (lambda: build_dome(0.1), 0.6, "balanced"),
        (lambda: build_dome(0.05), 0.6, "balanced"),
        (lambda: build_dome(0.02), 0.6, "none"),
        (lambda: build_dome(0.05), 0.2, "none"),
    ],
    ids=lambda x: x if isinstance(x, str) else None,
)
@pytest.mark.parametrize("turned", [False, pytest.param(True, marks=pytest.mark.slow)])
@pytest.mark.slow_variants("*-balanced2")
def test_an_assembly_is_decided(
    build: Callable[[], Sequence[Block]], mu: float, verdict: str, turned: bool
) -> None:
    blocks = build()
    d = blocks[0].points.shape[1]
    gravity = -np.eye(d)[-1]
    if turned:
        turn = TURN if d == 3 else np.array([[0.6, -0.8], [0.8, 0.6]])
        blocks, gravity = rotate(blocks, turn), turn @ gravity
    problem = assemble(blocks, mu, gravity=gravity)
    assert check(problem) == verdict
    if d == 2:
        # A linear programme of other code is exact in the plane.
        assert find_balance(problem)[0] == (verdict == "balanced")


@pytest.mark.parametrize("build", [lambda: build_bridge(0.2), lambda: lay_wall(0.3)])
def test_a_push_is_decided_on_both_sides_of_its_limit(
    build: Callable[[], Sequence[Block]],
) -> None:
    blocks = build()
    upright = assemble(blocks, 0.6)
    dead, live = upright.body_force([0, -1]), upright.body_force([1, 0])
    limit = upright.limit_multiplier(dead, live).upper
    # Both programmes end at 1e-7 or better.
    assert limit == pytest.approx(find_balance(upright, live)[1], rel=2e-7)
    for share, verdict in ((1 - 1e-6, "balanced"), (1 + 1e-6, "none")):
        assert check(assemble(blocks, 0.6, gravity=[share * limit, -1.0])) == verdict
