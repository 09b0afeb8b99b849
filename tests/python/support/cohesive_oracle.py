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
