"""The oracle for any number of contacts: a smoothed law whose smoothing goes to zero."""

import numpy as np

from support.oracle import (
    OPEN,
    SLIP,
    STICK,
    Answer,
    Array,
    Law,
    Problem,
    fails,
    known,
    newton,
)


def smooth(p: Problem, eps: float) -> Law:
    """Fischer–Burmeister for (6), `r_t s + μ r_n v_t = 0`, s² = |v_t|² + ε², for (8)."""

    def law(r: Array, v: Array) -> tuple[Array, Array, Array]:
        root = np.sqrt(r[:, 0] ** 2 + v[:, 0] ** 2 + 2 * eps**2)
        s = np.sqrt(np.sum(v[:, 1:] ** 2, axis=1) + eps**2)[:, None]
        eye, limit = np.eye(p.d - 1), (p.mu * r[:, 0])[:, None]
        by_r, by_v = np.zeros((2, p.n, p.d, p.d))
        by_r[:, 0, 0], by_v[:, 0, 0] = 1 - r[:, 0] / root, 1 - v[:, 0] / root
        by_r[:, 1:, 1:], by_r[:, 1:, 0] = s[:, :, None] * eye, p.mu[:, None] * v[:, 1:]
        by_v[:, 1:, 1:] = r[:, 1:, None] * (v[:, 1:] / s)[:, None]
        by_v[:, 1:, 1:] += limit[:, :, None] * eye
        normal = (r[:, 0] + v[:, 0] - root)[:, None]
        return np.hstack([normal, r[:, 1:] * s + limit * v[:, 1:]]), by_r, by_v

    return law


def follow(p: Problem, tolerance: float = 1e-12) -> Answer:
    """One solution for any number of contacts, by smoothing continuation."""
    r, a, eps = np.eye(1, p.d) * np.ones((p.n, 1)), np.zeros(p.e.size), 1.0
    while eps > 1e-9:
        r, a = newton(p, smooth(p, eps), r, a, 50)
        eps *= 0.5
    v = p.displacement(r, a)
    # A sticking v_t is of the order of ε and in proportion to the load; slip is not.
    sliding = np.where(np.linalg.norm(v[:, 1:], axis=1) > 1e3 * eps, SLIP, STICK)
    status = np.where(r[:, 0] < v[:, 0], OPEN, sliding).tolist()
    r, a = newton(p, known(p, status), r, a, 30)
    if (error := fails(p, r, a)) > tolerance:
        raise AssertionError(f"the oracle found no answer: {error:.1e}")
    return p.in_units(r, a, status)
