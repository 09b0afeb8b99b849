"""The solution of a load step with known statuses, in doubled precision: an oracle.

With the statuses, equilibrium and the law are equations in ``u`` and ``r``, which Newton solves
with residuals in doubled precision. Their condition limits no digit.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.linalg import splu

import bipot_rs as bp
from support.twice import add, exactly, product

Array = NDArray[np.float64]


class Exact(NamedTuple):
    """Reactions, relative displacements and displacements."""

    reaction: Array
    relative_displacement: Array
    displacement: Array


def solve_exactly(
    problem: dict[str, Any], load: Array, prescribed: Array, step: bp.Step
) -> Exact:
    """The first load step of ``problem`` with the statuses of ``step``, the start value.

    ``problem`` has the arguments ``K``, ``B``, ``gap`` (normal), ``mu`` and ``fixed``.
    """
    K, B = (sparse.csr_array(problem[name]) for name in ("K", "B"))
    contacts, d = step.reaction.shape
    gap = np.zeros((contacts, d))
    gap[:, 0] = problem["gap"]
    free = np.setdiff1d(np.arange(K.shape[0]), problem["fixed"])
    stiff = float(K.diagonal().max())
    u, r = exactly(step.displacement.copy()), exactly(step.reaction.ravel().copy())
    u[0][problem["fixed"]] = prescribed
    transposed = sparse.csr_array(B.T)
    for _ in range(40):
        Ku, Br = product(K, _column(u)), product(transposed, _column(r))
        forces = add(add(Ku, (-Br[0], -Br[1])), exactly(-load[:, None]))
        v = add(product(B, _column(u)), exactly(gap.reshape(-1, 1)))
        law, by_r, by_v = _linearise(
            _join(r, d), stiff * _join(v, d), step.status, problem["mu"]
        )
        J = sparse.block_array(
            [[K[free][:, free], -transposed[free]], [stiff * by_v @ B[:, free], by_r]]
        )
        left = np.concatenate([(forces[0] + forces[1])[free, 0], law])
        change = -splu(sparse.csc_array(J)).solve(left)
        du, dr = np.zeros(len(u[0])), change[len(free) :]
        du[free] = change[: len(free)]
        u, r = add(u, exactly(du)), add(r, exactly(dr))
        moved, pressed = np.abs(u[0]).max(), np.abs(r[0]).max()
        if np.abs(du).max() <= 1e-17 * moved and np.abs(dr).max() <= 1e-17 * pressed:
            return Exact(r[0].reshape(-1, d), v[0].reshape(-1, d), u[0])
    raise ArithmeticError("Newton does not converge")


def _column(pair: tuple[Array, Array]) -> tuple[Array, Array]:
    return pair[0][:, None], pair[1][:, None]


def _join(pair: tuple[Array, Array], d: int) -> Any:
    """A pair as numbers of extended precision, a row for each contact."""
    return (pair[0].astype(np.longdouble) + pair[1]).reshape(-1, d)


def _linearise(
    r: Any, v: Any, statuses: Any, mu: Any
) -> tuple[Array, sparse.csr_array, sparse.csr_array]:
    """Residual of the law of each contact, in units of force, and its derivatives."""
    contacts, d = r.shape
    left = np.zeros((contacts, d), np.longdouble)
    by_r, by_v = (np.zeros((contacts, d, d)) for _ in range(2))
    for i, friction in enumerate(np.broadcast_to(mu, contacts)):
        slip = np.sqrt((v[i, 1:] ** 2).sum())
        if statuses[i] == bp.Status.OPEN:
            left[i], by_r[i] = r[i], np.eye(d)
        elif statuses[i] == bp.Status.STICK or (friction > 0 and slip == 0):
            left[i], by_v[i] = v[i], np.eye(d)
        else:
            left[i, 0], by_v[i, 0, 0] = v[i, 0], 1.0
            left[i, 1:], by_r[i, 1:, 1:] = r[i, 1:], np.eye(d - 1)
            if friction > 0:
                t = v[i, 1:] / slip
                left[i, 1:] += friction * r[i, 0] * t
                by_r[i, 1:, 0] = friction * t
                across = np.eye(d - 1) - np.outer(t, t).astype(float)
                by_v[i, 1:, 1:] = friction * float(r[i, 0] / slip) * across
    blocks = (sparse.csr_array(sparse.block_diag(list(b))) for b in (by_r, by_v))
    return left.ravel().astype(float), *blocks
