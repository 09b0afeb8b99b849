"""Reference solutions of the law with cohesion and dilatancy, for a few contacts.

The law is ``0 <= r_n ⊥ v_n - beta |v_t| >= 0`` with friction of the limit ``c + mu r_n``, as in
textbooks. In the plane every choice of statuses gives linear equations; in space one contact
has one unknown angle, which is scanned. Nothing is shared with the package: no projection, no
fixed point, no Newton's method.
"""

import itertools
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class Law(NamedTuple):
    """The numbers of each contact."""

    mu: Array
    c: Array
    beta: Array


def violation(r: Array, v: Array, law: Law, force: float, length: float) -> float:
    """Largest violation, with forces and displacements relative to these."""
    slip, shear = (np.linalg.norm(x[:, 1:], axis=1) for x in (v, r))
    opening, limit = v[:, 0] - law.beta * slip, law.c + law.mu * r[:, 0]
    work = limit * slip + (r[:, 1:] * v[:, 1:]).sum(axis=1)
    return float(
        max(
            (-r[:, 0]).max() / force,
            (shear - limit).max() / force,
            (-opening).max() / length,
            np.abs(r[:, 0] * opening).max() / force / length,
            # Of a contact that sticks, slip that is rounding works against all of its limit.
            (np.abs(work) / np.maximum(force, limit)).max() / length,
        )
    )


def list_plane_answers(W: Array, q: Array, law: Law) -> list[Array]:
    """Reactions of all solutions in the plane, of a problem with numbers of order one.

    A contact is closed or open, and its friction sticks or slides one way or the other. These
    are two linear equations of ``r`` and ``v = W r + q`` for each contact.
    """
    n, answers = len(q), []
    for choice in itertools.product(itertools.product((0, 1), (0, 1, -1)), repeat=n):
        rows, right = np.zeros((2 * n, 2 * n)), np.zeros(2 * n)
        for i, (closed, way) in enumerate(choice):
            k = 2 * i
            if closed:
                # v_n - beta |v_t| = 0, where |v_t| = way v_t.
                rows[k] = W[k] - law.beta[i] * way * W[k + 1]
                right[k] = -q[i, 0] + law.beta[i] * way * q[i, 1]
            else:
                rows[k, k] = 1.0
            if way:
                rows[k + 1, k + 1], rows[k + 1, k] = 1.0, way * law.mu[i]
                right[k + 1] = -way * law.c[i]
            else:
                rows[k + 1], right[k + 1] = W[k + 1], -q[i, 1]
        if abs(np.linalg.det(rows)) < 1e-12:
            continue
        r = np.linalg.solve(rows, right).reshape(n, 2)
        v = (W @ r.ravel()).reshape(n, 2) + q
        if violation(r, v, law, 1.0, 1.0) < 1e-9 and not any(
            np.abs(r - other).max() < 1e-7 for other in answers
        ):
            answers.append(r)
    return answers


def find_angles(W: Array, q: Array, law: Law, closed: bool) -> list[Array]:
    """Sliding reactions of one contact in space, by the sign of an equation of the angle."""
    mu, c, beta = (float(x[0]) for x in law)

    def slide(angle: float) -> tuple[float, Array]:
        t = np.array([np.cos(angle), np.sin(angle)])
        across = np.array([-t[1], t[0]])
        # r = (r_n, -(c + mu r_n) t), v = (beta s, s t): two equations of r_n and s.
        pushed, fixed = W @ [1.0, *(-mu * t)], W @ [0.0, *(-c * t)] + q[0]
        # Cramer's rule; at a pole of r_n nothing passes for a solution.
        det = beta * (t @ pushed[1:]) - pushed[0]
        r_n = (fixed[0] - beta * (t @ fixed[1:])) / (det or np.nan) if closed else 0.0
        r = np.array([r_n, *(-(c + mu * r_n) * t)])
        return float(across @ (W @ r + q[0])[1:]), r

    grid = np.linspace(0.0, 2.0 * np.pi, 721)
    values = [slide(angle)[0] for angle in grid]
    solutions = []
    for k in range(720):
        if values[k] * values[k + 1] > 0:
            continue
        low, high = grid[k], grid[k + 1]
        for _ in range(60):
            middle = 0.5 * (low + high)
            if slide(middle)[0] * values[k] > 0:
                low = middle
            else:
                high = middle
        solutions.append(slide(0.5 * (low + high))[1])
    return solutions


def list_answers_of_one(W: Array, q: Array, law: Law) -> list[Array]:
    """Reactions of all solutions of one contact in space, ``(1, 3)`` each."""
    candidates = [np.linalg.solve(W, -q[0])]
    shear = np.linalg.solve(W[1:, 1:], -q[0, 1:])
    candidates.append(np.array([0.0, *shear]))
    for closed in (False, True):
        candidates += find_angles(W, q, law, closed)
    answers: list[Array] = []
    for r in candidates:
        v = W @ r + q[0]
        if violation(r[None], v[None], law, 1.0, 1.0) < 1e-8 and not any(
            np.abs(r - other).max() < 1e-6 for other in answers
        ):
            answers.append(r)
    return [r[None] for r in answers]
