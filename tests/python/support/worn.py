"""Problems with wear: a point on springs, and a pad in partial slip."""

from functools import cache
from typing import Any

import numpy as np

import bipot_rs as bp
from support.bodies import block

# Reactions are solved to η = 1e-13.
TOL = 1e-13
# Of `pad`: wear evens out pressures of neighbours in about 100 cycles.
COEFFICIENT = 1e-3


def spring(**changed: Any) -> bp.ContactProblem:
    """A point on two springs, which presses on a wall by 10 N."""
    arguments = {"gap": [-0.01], "mu": 0.0, "area": [1e-4]} | changed
    return bp.ContactProblem(1e3 * np.eye(2), np.eye(2), **arguments)


# Forces that move the point by 4 mm to and fro: 8 mm of slip a load step.
PULL = np.array([[0.0, 4.0], [0.0, -4.0]])


@cache
def pad(
    d: int = 2, n: int = 8, curve: float = 0.01, two: bool = False
) -> tuple[Any, bp.ContactProblem, np.ndarray]:
    """A block held at its top on a curved plane, its problem, and a cycle in partial slip.

    With ``two`` friction coefficients if asked for.
    """
    body = block(
        [2.0, 1.0] if d == 2 else [1.0] * 3, [2 * n, n][:d] + [n] * (d - 2), 1e3, 0.3
    )
    fixed = np.concatenate([body.dofs(d - 1, 1.0, k) for k in range(d)])
    gap = curve * (body.points[:, 0] - np.ptp(body.points[:, 0]) / 2) ** 2
    mu = np.tile([0.3, 0.2], (len(gap), 1)) if two else 0.3
    problem = bp.ContactProblem(
        body.K, body.B, gap=gap, mu=mu, fixed=fixed, area=body.area
    )
    ways = np.zeros((4, d))
    ways[:, -1] = -0.01
    ways[:, 0] = 7.5e-3 * np.array([1.0, 0.0, -1.0, 0.0])
    cycle = np.repeat(ways.T, len(fixed) // d, axis=0).reshape(len(fixed), 4).T
    return body, problem, np.ascontiguousarray(cycle)


def worn_pad(**more: Any) -> Any:
    _, problem, cycle = pad()
    arguments = {"coefficient": COEFFICIENT, "cycles": 60, "tol": TOL} | more
    return problem.wear(prescribed=cycle, **arguments)


def random_pad(seed: int) -> tuple[bp.ContactProblem, dict[str, Any]]:
    """A pad of random shape, friction, cycle and wear, and the arguments of its wear."""
    rng = np.random.default_rng([seed, 16])
    cells, length = int(rng.integers(2, 5)), rng.uniform(0.7, 3.0)
    body = block([length, 1.0], [max(3, int(length * cells)), cells], 1e3, 0.3)
    fixed = np.concatenate([body.dofs(1, 1.0, k) for k in range(2)])
    x = body.points[:, 0] - length / 2
    wave = 1 + np.sin(rng.uniform(1, 9) * x + rng.uniform(0, 6))
    shapes = 0.02 * x**2, 0.01 * abs(x), 0.003 * wave
    gap = rng.uniform() * shapes[rng.integers(3)]
    problem = bp.ContactProblem(
        body.K, body.B, gap=gap, mu=rng.uniform(0.1, 0.8), fixed=fixed, area=body.area
    )
    ways = ([1, 0, -1, 0], [1, -1], [1, 1, -1, -1])[rng.integers(3)]
    press = 10 ** rng.uniform(-2.5, -1.7)
    varies = 0.3 * rng.uniform(-1, 1, len(ways)) * (rng.uniform() < 0.5)
    places = press * np.stack(
        [rng.uniform(0.2, 2.5) * np.array(ways, float), -1 - varies], axis=1
    )
    path = {
        "prescribed": np.repeat(places, len(fixed) // 2, axis=1),
        "coefficient": 10 ** rng.uniform(-5, -2.5),
        "cycles": int(rng.integers(30, 120)),
        "tol": 1e-12,
    }
    return problem, path
