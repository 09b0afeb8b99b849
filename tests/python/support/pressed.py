"""Reduced problems of small bodies; every status occurs in each solution."""

from functools import cache

import numpy as np

import bipot_rs as bp
from support.bodies import block

MU = 0.3


@cache
def cube(turn: float = 0.0) -> bp.ReducedProblem:
    """A cube held at its top, pressed and sheared on a plane that slopes away at a corner."""
    body = block((1.0, 1.0, 1.0), (3, 3, 3), 200.0, 0.3)
    fixed = np.concatenate([body.dofs(2, 1.0, component) for component in range(3)])
    x, y = body.points.T[:2]
    gap = 2e-2 * np.maximum(x + y - 1.2, 0.0)
    problem = bp.ContactProblem(body.K, body.B, gap=gap, mu=MU, fixed=fixed)
    moved = np.array([4e-3 * np.cos(turn), 4e-3 * np.sin(turn), -1e-2])
    return problem.reduced(prescribed=np.repeat(moved, fixed.size // 3))


@cache
def square() -> bp.ReducedProblem:
    """The same problem in the plane."""
    body = block((2.0, 1.0), (6, 3), 100.0, 0.3)
    fixed = np.concatenate([body.dofs(1, 1.0, component) for component in (0, 1)])
    gap = 1e-2 * np.maximum(body.points[:, 0] - 1.2, 0.0)
    problem = bp.ContactProblem(body.K, body.B, gap=gap, mu=MU, fixed=fixed)
    return problem.reduced(prescribed=np.repeat([6e-3, -5e-3], fixed.size // 2))


@cache
def free() -> bp.ReducedProblem:
    """A block on a plane that slopes away, held by contact alone."""
    body = block((2.0, 1.0), (6, 2), 100.0, 0.3)
    gap = 2e-2 * np.maximum(body.points[:, 0] - 1.2, 0.0)
    problem = bp.ContactProblem(body.K, body.B, gap=gap, mu=MU)
    load = body.weight([0.2, -1.0]) + body.traction(0, 2.0, [0.05, 0.0])
    return problem.reduced(load)
