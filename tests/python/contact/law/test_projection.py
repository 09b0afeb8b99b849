"""`bp.project` satisfies the conditions of the nearest point of the cone."""

import math

import numpy as np
import pytest

import bipot_rs as bp

OPEN, STICK = bp.Status.OPEN, bp.Status.STICK


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("based", [False, True])
def test_projection_is_the_nearest_point(dim: int, based: bool) -> None:
    rng = np.random.default_rng(5)
    n = 400
    mu = np.concatenate([[0.0, 1e8], rng.exponential(size=n - 2)])
    tau = rng.normal(size=(n, dim))
    base = np.zeros((n, dim))
    if based:
        # A start state inside the cone.
        base[:, 0] = rng.exponential(size=n)
        base[:, 1:] = 0.5 * base[:, :1] * np.minimum(mu, 1)[:, None] / math.sqrt(dim)
    t, status = bp.project(tau, mu, base=base if based else None)
    assert t.shape == (n, dim)
    assert status.dtype == np.int8
    total, rest = t + base, tau - t
    size = np.linalg.norm(tau, axis=1) + np.linalg.norm(base, axis=1)
    # Rounding of hypot, a product and a sum; the limit μ t_n scales with μ.
    near = 8 * np.finfo(float).eps * size * (1 + mu)
    sideways = np.linalg.norm(total[:, 1:], axis=1)
    assert np.all(sideways <= mu * total[:, 0] + near)
    # The remainder lies in the polar cone (58) and is orthogonal to the point. With the
    # point in the cone, only the nearest point satisfies this.
    assert np.all(rest[:, 0] + mu * np.linalg.norm(rest[:, 1:], axis=1) <= near)
    assert np.all(np.abs(np.sum(rest * total, axis=1)) <= near * size)
    assert np.all((status == OPEN) == np.all(total == 0, axis=1))
    inside = (sideways < mu * total[:, 0] - near) & (mu > 0)
    assert np.all(status[inside] == STICK)
