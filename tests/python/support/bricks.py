"""Layers of bricks in space, with a contact at each corner of a common face."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

Array = NDArray[np.float64]


class Bricks(NamedTuple):
    """Rigid motions at the contacts, loads on them, and the number of contacts."""

    R: csr_array
    e: Array
    contacts: int


def lay_bricks(shape: tuple[int, int, int], seed: int, side: float) -> Bricks:
    """Bricks of 2 by 1 by 1, each layer shifted at random, weights from 1 to 2.

    ``side`` is a load to the side, relative to the weights.
    """
    rng = np.random.default_rng(seed)
    places: list[tuple[float, float, int]] = []
    for layer in range(shape[2]):
        odd = layer % 2
        shift = rng.uniform(-0.2, 0.2, 2) + odd * np.array([1.0, 0.5])
        for i in range(shape[0] - odd):
            places += [
                (2 * i + shift[0], j + shift[1], layer) for j in range(shape[1] - odd)
            ]
    bricks = np.array(places)
    entries: list[tuple[int, int, float]] = []
    contacts = 0
    for upper, (x, y, z) in enumerate(bricks):
        near = (np.abs(bricks[:, 0] - x) < 2) & (np.abs(bricks[:, 1] - y) < 1)
        below = np.flatnonzero((bricks[:, 2] == z - 1) & near) if z else [-1]
        for lower in below:
            bx, by = (x, y) if lower < 0 else bricks[lower, :2]
            xs, ys = (max(x, bx), min(x, bx) + 2), (max(y, by), min(y, by) + 1)
            if xs[1] - xs[0] < 0.05 or ys[1] - ys[0] < 0.05:
                continue
            for corner in [(px, py, z) for px in xs for py in ys]:
                for body, sign in ((upper, 1.0), (lower, -1.0)):
                    if body < 0:
                        continue
                    arm = np.array(corner) - bricks[body] - [1, 0.5, 0.5]
                    for k, axis in enumerate(np.eye(3)[[2, 0, 1]]):
                        row = sign * np.concatenate([axis, np.cross(arm, axis)])
                        entries += [
                            (3 * contacts + k, 6 * body + c, row[c])
                            for c in np.flatnonzero(row).tolist()
                        ]
                contacts += 1
    rows, columns, values = zip(*entries, strict=True)
    R = csr_array((values, (rows, columns)), (3 * contacts, 6 * len(bricks)))
    weight = rng.uniform(1, 2, len(bricks))
    e = np.zeros((len(bricks), 6))
    e[:, 2], e[:, 0] = -weight, side * weight
    e[:, :2] += 0.02 * rng.standard_normal((len(bricks), 2)) * weight[:, None]
    return Bricks(R, e.ravel(), contacts)
