"""Dense reference solver of `v = W r + R a + q`, `Rᵀ r + e = 0` under Coulomb's law.

It shares no algorithm with the package: no projection, no sweep over nodes, no fixed
point. `follow` lets the smoothing of a smoothed law go to zero, which gives the statuses; their
equations are solved by Newton's method, and the solution passes `violation`, the law (6), (8)
as in textbooks. All solutions of a few contacts in the plane: `cohesive_oracle`.
"""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from support.conditions import violation

Array = NDArray[np.float64]
# Residual (n, d) of all contacts and its derivatives by r and by v, (n, d, d).
Law = Callable[[Array, Array], tuple[Array, Array, Array]]
Rigid = tuple[Array, Array]
OPEN, SLIP, STICK = 0, 1, 2


class Answer(NamedTuple):
    r: Array
    v: Array
    a: Array
    status: tuple[int, ...]


class Problem:
    """A small dense problem, made dimensionless; `rigid` holds R and e."""

    def __init__(
        self, W: NDArray[Any], q: Array, mu: Array | float, rigid: Rigid | None = None
    ) -> None:
        self.n, self.d = q.shape
        self.mu = np.broadcast_to(np.asarray(mu, float), self.n)
        R, e = rigid or (np.zeros((q.size, 0)), np.zeros(0))
        compliance = float(np.trace(W)) / max(q.size, 1) or 1.0
        sizes = np.abs(q).max(initial=0.0) / compliance, np.abs(e).max(initial=0.0)
        self.force = float(max(sizes)) or 1.0
        self.length = self.force * compliance
        self.W, self.q = W / compliance, q / self.length
        self.R, self.e = R, e / self.force

    def displacement(self, r: Array, a: Array) -> Array:
        # Extended precision, because the residuals of Newton's last steps are rounding errors.
        exact = np.hstack([self.W, self.R]).astype(np.longdouble) @ [*r.ravel(), *a]
        return np.asarray(exact.reshape(r.shape) + self.q, float)

    def in_units(self, r: Array, a: Array, status: Sequence[int]) -> Answer:
        v = self.displacement(r, a)
        return Answer(r * self.force, v * self.length, a * self.length, tuple(status))


def fails(p: Problem, r: Array, a: Array) -> float:
    """Largest violation of the law and of balance by a dimensionless solution."""
    balance = float(np.abs(p.R.T @ r.ravel() + p.e).max(initial=0.0))
    v = p.displacement(r, a)
    # Relative to the deformation, not to v: v of a body that slides away may be anything.
    return max(violation(r, v, p.mu, np.ones(1), p.W @ r.ravel(), p.q), balance)


def newton(p: Problem, law: Law, r: Array, a: Array, steps: int) -> tuple[Array, Array]:
    """Damped Newton on `law(r, v(r)) = 0`, `Rᵀ r + e = 0`."""
    m, k = r.size, p.e.size

    def value(r: Array, a: Array) -> Array:
        law_value = law(r, p.displacement(r, a))[0]
        return np.append(law_value.ravel(), p.R.T @ r.ravel() + p.e)

    now = value(r, a)
    for _ in range(steps):
        _, by_r, by_v = law(r, p.displacement(r, a))
        full = np.hstack([p.W, p.R]).reshape(p.n, p.d, m + k)
        rows = np.einsum("nij,njm->nim", by_v, full).reshape(m, m + k)
        for i in range(p.n):
            rows[p.d * i : p.d * (i + 1), p.d * i : p.d * (i + 1)] += by_r[i]
        matrix = np.vstack([rows, np.hstack([p.R.T, np.zeros((k, k))])])
        # Least squares, because redundant supports determine v but not r.
        step = np.linalg.lstsq(matrix, -now, rcond=1e-13)[0]
        for part in 0.5 ** np.arange(12):
            r_new, a_new = r + part * step[:m].reshape(r.shape), a + part * step[m:]
            new = value(r_new, a_new)
            if np.linalg.norm(new) <= (1 - 0.1 * part) * np.linalg.norm(now):
                break
        if not np.linalg.norm(new) < np.linalg.norm(now):
            break
        r, a, now = r_new, a_new, new
    return r, a


def known(p: Problem, status: Sequence[int]) -> Law:
    """Equations for given statuses; slip is along v_t."""
    kind, eye = np.array(status)[:, None], np.eye(p.d)

    def law(r: Array, v: Array) -> tuple[Array, Array, Array]:
        speed = np.maximum(np.linalg.norm(v[:, 1:], axis=1, keepdims=True), 1e-300)
        t = v[:, 1:] / speed
        limit = (p.mu * r[:, 0])[:, None]
        slip = np.hstack([v[:, :1], r[:, 1:] + limit * t])
        by_r, by_v = np.zeros((2, p.n, p.d, p.d))
        by_r[:, 1:, 1:], by_r[:, 1:, 0] = eye[1:, 1:], p.mu[:, None] * t
        by_v[:, 0, 0] = 1
        across = eye[1:, 1:] - t[:, :, None] * t[:, None, :]
        by_v[:, 1:, 1:] = (limit / speed)[:, :, None] * across
        value = np.where(kind == SLIP, slip, np.where(kind == STICK, v, r))
        sliding, fixed = kind[:, None] == SLIP, kind[:, None] == STICK
        by_r = np.where(sliding, by_r, eye * ~fixed)
        return value, by_r, np.where(sliding, by_v, eye * fixed)

    return law


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


def follow(p: Problem) -> Answer:
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
    if (error := fails(p, r, a)) > 1e-12:
        raise AssertionError(f"the oracle found no answer: {error:.1e}")
    return p.in_units(r, a, status)
