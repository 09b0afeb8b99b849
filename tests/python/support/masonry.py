"""Walls, arches and boxes of rigid blocks, and linear programmes that judge them."""

import itertools
from collections.abc import Sequence

import numpy as np
from moving_states import WALLS
from numpy.typing import NDArray
from scipy.optimize import linprog
from scipy.sparse import coo_array, csc_array, hstack

import bipot_rs as bp
from bipot_rs.blocks import Block, BlockProblem

Array = NDArray[np.float64]


def box(
    name: str, low: Sequence[float], high: Sequence[float], *, support: bool = False
) -> Block:
    """A rectangle, or a box in space."""
    sides = np.column_stack([low, high]).astype(float)
    if len(sides) == 2:
        (a, b), (c, d) = sides
        outline = [[a, c], [b, c], [b, d], [a, d]]
        return Block(name, outline, support=support)
    points = np.array(list(itertools.product(*sides)))
    faces = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6]]
    faces += [[0, 2, 6, 4], [1, 5, 7, 3]]
    return Block(name, points, faces, support=support)


def arch(thickness: float, *, radius: float = 1.0, voussoirs: int = 30) -> list[Block]:
    """Half a circle of voussoirs, of this thickness, on the ground."""
    angle = np.linspace(0, np.pi, voussoirs + 1)
    direction = np.column_stack([np.cos(angle), np.sin(angle)])
    inner, outer = ((radius + side * thickness / 2) * direction for side in (-1.0, 1.0))
    stones = [
        Block(f"voussoir {k}", [inner[k], outer[k], outer[k + 1], inner[k + 1]])
        for k in range(voussoirs)
    ]
    ground = box("ground", (-2 * radius, -radius), (2 * radius, 0), support=True)
    return [ground, *stones]


# Largest horizontal load as a multiple of the weight, to the digits of a linear programme
# of another assembly of these walls.
LIMITS = {1: 0.642859, 2: 0.579999, 3: 0.403694, 4: 0.331948, 6: 0.347825}


def wall(number: int) -> list[Block]:
    """Bricks of 0.4 m by 0.175 m on the ground; for friction 0.65.

    Walls 1 to 4 and 6 of Ferris and Tin-Loi (2001), with the geometry of a public example
    of HybriDFEM.
    """
    long, high = 0.4, 0.175
    blocks = [box("ground", (-1, -1), (5, 0), support=True)]
    for k, row in enumerate(WALLS[number]):
        x = 0.0
        for length in row:
            if length > 0:
                low, top = (x * long, k * high), ((x + length) * long, (k + 1) * high)
                blocks.append(box(f"{k}.{x:g}", low, top))
            x += abs(length)
    return blocks


def rotate(blocks: Sequence[Block], turn: Array) -> list[Block]:
    """The blocks, turned about the origin."""
    return [
        Block(
            block.name,
            block.points @ turn.T,
            None if len(turn) == 2 else block.faces,
            density=block.density,
            support=block.support,
        )
        for block in blocks
    ]


def find_balance(
    problem: BlockProblem, live: Array | None = None, sides: int = 32
) -> tuple[bool, float]:
    """Whether reactions in the cones, with ``sides`` in space, balance the loads.

    Also the largest multiplier of ``live``, by a linear programme over the edges of the
    cones: exact in the plane, an inner bound in space.
    """
    R, e = problem.rigid
    R = csc_array(R)
    count, d = problem.q.shape
    if d == 2:
        edges = [[1.0, 1.0], [1.0, -1.0]]
    else:
        angles = 2 * np.pi * np.arange(sides) / sides
        edges = [[1.0, np.cos(a), np.sin(a)] for a in angles]
    rows = np.arange(count * d)
    columns = np.repeat(np.arange(count), d)
    parts = []
    for edge in edges:
        values = np.tile(edge, (count, 1))
        values[:, 1:] *= problem.mu[:, None]
        parts.append(coo_array((values.ravel(), (rows, columns)), (count * d, count)))
    A = R.T @ hstack(parts)
    push = np.zeros(len(e)) if live is None else live
    scale = np.abs(e).max()
    A = hstack([A, coo_array(push[:, None] / scale)]).tocsc()
    cost = np.zeros(A.shape[1])
    cost[-1] = -1.0 if live is not None else 0.0
    answer = linprog(cost, A_eq=A, b_eq=-e / scale, method="highs")
    return answer.status == 0, float(answer.x[-1]) if answer.status == 0 else np.nan


def assemble(
    blocks: Sequence[Block], mu: float, gravity: Sequence[float] | None = None
) -> BlockProblem:
    """`bp.blocks.assemble` with blocks that are supports already."""
    return bp.blocks.assemble(blocks, mu, gravity=gravity)
