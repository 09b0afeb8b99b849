"""Independent check: Signorini's and Coulomb's laws as inequalities, contact by contact.

It shares nothing with the package's certificate: no cone, no projection, no corrected
displacement. It takes W, q, R, e as NumPy arrays, sums v in extended precision, and
returns the violation of each inequality in units that do not depend on the problem.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Rigid = tuple[Array, Array]


class Missed(NamedTuple):
    """Largest violation of each part of (6), (8) and of the balance.

    Displacements and forces of a contact are divided by the root of its compliance
    `√(tr W_ii/d)` and by the inverse root, which gives both one unit. They are then divided
    by the largest of reactions, penetration and displacement without reactions. A value of 1
    means a completely wrong solution.
    """

    penetration: float
    pull: float
    open_and_pressed: float
    beyond_the_limit: float
    slip_not_opposed: float
    imbalance: float

    @property
    def worst(self) -> float:
        return max(self)


def displacement(
    W: Array, q: Array, r: Array, rigid: Rigid | None = None, a: Array | None = None
) -> Array:
    """v = W r + R a + q in extended precision, rounded once."""
    v = W.astype(np.longdouble) @ r.ravel() + q.ravel()
    if rigid is not None and a is not None:
        v = v + rigid[0].astype(np.longdouble) @ a
    return np.asarray(v.reshape(q.shape), float)


def judge(
    W: Array,
    q: Array,
    mu: Array | float,
    r: Array,
    rigid: Rigid | None = None,
    a: Array | None = None,
) -> Missed:
    """Violations by `r`, and by `a` of bodies held by contact alone."""
    v = displacement(W, q, r, rigid, a)
    free = q if rigid is None or a is None else q + (rigid[0] @ a).reshape(q.shape)
    blocks = np.asarray(W.diagonal()).reshape(q.shape).mean(axis=1)
    missed = inequalities(r, v, mu, blocks, free)
    if rigid is None:
        return missed
    # A motion is measured by the displacement that it causes; its loads are then forces.
    R, e = rigid
    length = np.linalg.norm(R, axis=0)
    loads = np.abs(e / length).max(initial=0.0)
    rest = np.abs((R.T @ r.ravel() + e) / length).max(initial=0.0)
    return missed._replace(imbalance=float(rest / (loads or 1.0)))


def inequalities(
    r: Array, v: Array, mu: Array | float, compliance: Array, free: Array
) -> Missed:
    """Violation of the law alone, for r, v and the displacement without reactions, (n_c, d)."""
    mu = np.broadcast_to(np.asarray(mu, float), len(r))
    # A contact without compliance uses the units of the softest contact.
    soft = np.where(compliance > 0, compliance, compliance.max(initial=0.0) or 1.0)
    root = np.sqrt(soft)[:, None]
    r, v, free = r * root, v / root, free / root
    pressed = (r != 0).any(axis=1)
    to_undo = np.abs(free[pressed]).max(initial=0.0)
    size = max(np.abs(r).max(initial=0.0), to_undo, -free[:, 0].min(initial=0.0))
    size = size or 1.0
    push, gap = r[:, 0], v[:, 0]
    friction, slip = np.linalg.norm(r[:, 1:], axis=1), np.linalg.norm(v[:, 1:], axis=1)
    way = v[:, 1:] / np.where(slip > 0, slip, 1.0)[:, None]
    # Slip, and friction's distance from its limit against the slip: one of them is 0. If the
    # slip is small compared with the force, a wrong direction shows only by the slip itself.
    lacks = np.linalg.norm(r[:, 1:] + (mu * push)[:, None] * way, axis=1)
    whole = slip + lacks + friction
    part = np.divide(lacks, whole, out=np.zeros_like(lacks), where=whole > 0)
    each = (
        -gap,
        -push,
        np.minimum(push, gap),
        friction - mu * push,
        slip * part,
    )
    return Missed(*(max(float(x.max(initial=0.0)), 0.0) / size for x in each), 0.0)
