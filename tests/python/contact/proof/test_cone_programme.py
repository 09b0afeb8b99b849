"""Random programmes over circular cones, also where y = 0 is on a border or just outside."""

import numpy as np
import pytest
from numpy.typing import NDArray

from bipot_rs.contact.proof.cone_programme import Programme

Array = NDArray[np.float64]


def random_programme(rng: np.random.Generator) -> tuple[Array, Array, Array]:
    """G of unit columns, h in the cones to rounding, and a cost of unit length."""
    while True:
        d, m = int(rng.integers(2, 4)), int(rng.integers(1, 9))
        k = int(rng.integers(1, d * m + 1))
        h = rng.normal(size=(m, d))
        length = np.linalg.norm(h[:, 1:], axis=1)
        h[:, 0] = length * (1 + np.where(rng.random(m) < 0.5, 0.0, rng.random(m)))
        G = rng.normal(size=(m, d, k))
        if rng.random() < 0.5:
            # The rounding of a base point; some cones do not depend on y.
            h[:, 0] -= 1e-13 * length * rng.random(m)
            G[rng.random(m) < 0.3] = 0.0
        if np.linalg.matrix_rank(G.reshape(m * d, k)) == k:
            c = rng.normal(size=k)
            return G / np.linalg.norm(G, axis=(0, 1)), h, c / np.linalg.norm(c)


def depth(s: Array) -> float:
    return float((s[:, 0] - np.linalg.norm(s[:, 1:], axis=1)).min())


@pytest.mark.parametrize(
    ("seed", "count"), [(1, 8), pytest.param(2, 500, marks=pytest.mark.slow)]
)
def test_ends_are_points_or_directions(seed: int, count: int) -> None:
    """No warning of a division; what is returned is in the cones and not above zero."""
    rng = np.random.default_rng(seed)
    directions = 0
    for _ in range(count):
        G, h, c = random_programme(rng)
        end = Programme(G, h).minimise(c)
        moved = G @ end.y
        directions += not end.bounded
        size = max(float(np.abs(moved).max()), 1.0)
        # Directions leave the cones by at most 1e-9 of their size, points by less.
        s = h + moved if end.bounded else moved
        assert depth(s) >= -2e-9 * size
        # y = 0 is allowed, except for what h is outside: 1e-13, over the slope of a cone.
        assert c @ end.y <= 1e-9 * size + end.gap
        assert end.bounded or c @ end.y < 0
    assert 0 < directions < count
