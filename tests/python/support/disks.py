"""A wall of rigid disks, each above one disk and next to others."""

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

Array = NDArray[np.float64]


def wall(n: int, seed: int = 0) -> tuple[sparse.csr_array, sparse.csr_array, Array]:
    """M, B and load of n by n disks of radius 1 with three unknowns (x, y, θ) each.

    Each disk touches the disk or floor below and the disk on its left. There are fewer
    unknowns than rows of B, so the reactions are not determined.
    """
    rng = np.random.default_rng(seed)
    rows: list[Array] = []

    def meet(first: int | None, second: int, normal: tuple[float, float]) -> None:
        x, y = normal
        for direction in ((x, y), (-y, x)):
            row = np.zeros(3 * n * n)
            for body, sign in ((first, -1.0), (second, 1.0)):
                if body is not None:
                    # The lever arm from the centre to the contact, and its moment.
                    arm = (-sign * x, -sign * y)
                    turn = arm[0] * direction[1] - arm[1] * direction[0]
                    row[3 * body : 3 * body + 3] = sign * np.array([*direction, turn])
            rows.append(row)

    for i in range(n):
        for j in range(n):
            meet((i - 1) * n + j if i else None, i * n + j, (0.0, 1.0))
            if j:
                meet(i * n + j - 1, i * n + j, (1.0, 0.0))
    mass = 1 + rng.random(n * n)
    M = sparse.diags_array(np.outer(mass, (1.0, 1.0, 0.5)).ravel()).tocsr()
    push = np.zeros((n * n, 3))
    push[:, 0], push[:, 1] = rng.normal(size=n * n), -10 * mass
    return M, sparse.csr_array(np.array(rows)), push.ravel()
