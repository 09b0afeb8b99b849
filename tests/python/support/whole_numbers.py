"""Rigid contacts in the plane whose balance has whole numbers, judged by a linear programme.

Contacts hold each other without loads, often without an end, and cones often leave no room.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linprog

Array = NDArray[np.float64]


def make_contacts(seed: int) -> tuple[Array, Array, Array]:
    """``R (2 n, k)``, ``e (k,)`` that reactions balance, and ``mu (n,)``."""
    rng = np.random.default_rng(seed)
    n, k = int(rng.integers(2, 5)), int(rng.integers(1, 4))
    R = rng.integers(-2, 3, (2 * n, k)).astype(float)
    mu = rng.choice([0.0, 0.5, 1.0], n)
    normal = rng.integers(0, 4, n)
    r = np.column_stack([normal, mu * normal * rng.integers(-1, 2, n)])
    return R, -R.T @ r.ravel(), mu


def find_end(cost: Array, R: Array, e: Array, live: Array, mu: Array) -> float:
    """The least ``cost·(r, λ)`` with ``Rᵀ r + e + λ live = 0``, ``r`` in the cones, ``λ >= 0``."""
    n = len(mu)
    cones = np.zeros((2 * n, 2 * n + 1))
    for i, sign in np.ndindex(n, 2):
        cones[2 * i + sign, 2 * i : 2 * i + 2] = -mu[i], 2 * sign - 1
    balance = np.column_stack([R.T, live])
    bounds = [(0, None), (None, None)] * n + [(0, None)]
    end = linprog(cost, cones, np.zeros(2 * n), balance, -e, bounds=bounds)
    # HiGHS says with 4 that it cannot decide between no bound and no point, which exists.
    return {0: end.fun, 3: -np.inf, 4: -np.inf}[end.status]
