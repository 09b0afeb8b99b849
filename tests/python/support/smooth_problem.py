"""A stand-in for a contact problem whose results are sums of squares of its arguments."""

from types import SimpleNamespace
from typing import Any

import numpy as np

N, CONTACTS, DIM, STEPS = 5, 3, 2, 2
SHAPES = {
    "reaction": (STEPS, CONTACTS, DIM),
    "displacement": (STEPS, N),
    "relative_displacement": (STEPS, CONTACTS, DIM),
    "slip": (STEPS, CONTACTS, DIM - 1),
}
RNG = np.random.default_rng(1)
MAPS = {
    (out, name): RNG.normal(size=(int(np.prod(SHAPES[out])), size))
    for out in SHAPES
    for name, size in (
        ("load", STEPS * N),
        ("prescribed", STEPS * 2),
        ("gap", STEPS * CONTACTS * DIM),
        ("mu", CONTACTS),
    )
}


class Smooth:
    """Results are sums of squares of the arguments."""

    _shape = (N, CONTACTS, DIM)

    def __init__(self) -> None:
        self.solved = 0

    def solve_many(self, cases: Any) -> Any:
        self.solved += len(cases)
        return [Answer(case) for case in cases]


class Answer:
    success = True

    def __init__(self, case: Any) -> None:
        gap = np.zeros((STEPS, CONTACTS, DIM))
        gap[:, :, 0] = case["gap"]
        self.whole = {
            "load": np.broadcast_to(case["load"], (STEPS, N)),
            "prescribed": np.broadcast_to(case["prescribed"], (STEPS, 2)),
            "gap": gap,
            "mu": np.broadcast_to(case["mu"], (CONTACTS,)),
        }
        for out, shape in SHAPES.items():
            total = sum(MAPS[out, k] @ v.ravel() ** 2 for k, v in self.whole.items())
            setattr(self, out, total.reshape(shape))

    def __len__(self) -> int:
        return STEPS

    def jvp(self, **along: Any) -> Any:
        derivatives = {
            out: sum(
                MAPS[out, k] @ (2 * self.whole[k] * along[k]).ravel() for k in along
            ).reshape(shape)
            for out, shape in SHAPES.items()
        }
        return SimpleNamespace(**derivatives)

    def vjp(self, **cots: Any) -> Any:
        derivatives = {
            k: 2
            * v
            * sum(MAPS[o, k].T @ c.ravel() for o, c in cots.items()).reshape(v.shape)
            for k, v in self.whole.items()
        }
        return SimpleNamespace(**derivatives)


def arguments(single: bool) -> list[Any]:
    """With one row for all steps, and a number for mu; or with all values."""
    rng = np.random.default_rng(2)
    rows = () if single else (STEPS,)
    shapes = [(STEPS, N), (*rows, 2), (*rows, CONTACTS), () if single else (CONTACTS,)]
    return [rng.normal(size=shape) for shape in shapes]
