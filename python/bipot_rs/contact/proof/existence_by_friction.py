"""Decide whether friction holds bodies on planes for every distribution of pressure.

The theorems are proved in ``docs/paper/6-contact-principles.md``.
"""

from __future__ import annotations

import numpy as np

import bipot_rs._core as _core
from bipot_rs._lib.types import Floats
from bipot_rs.contact.proof.equilibrium import make_cone_set

# A smaller component of a rigid motion of length 1 is rounding.
_FLAT = 1e-9
# Above the tolerance of linear programmes, 1e-7.
_MARGIN = 1e-6


def is_held(R: Floats, e: Floats, mu: Floats) -> bool:
    """Whether friction dissipates more on every sliding motion than the loads supply.

    Each rigid motion must be a sum of a sliding and a lift. A sliding moves no contact
    along its normal; a lift moves no contact with friction along its tangents. The
    pressures that balance the loads on lifts must be bounded. Otherwise the result is False.

    ``R, e``: rigid motions ``(d n_c, k)`` and the loads on them, ``(k,)``.
    ``mu``: friction coefficients, ``(n_c,)``.
    """
    from scipy.optimize import nnls

    Q, T = np.linalg.qr(R)
    e = np.linalg.solve(T.T, e)
    by_contact = Q.reshape(len(mu), -1, Q.shape[1])
    normal, tangents = by_contact[:, 0], by_contact[:, 1:] * (mu > 0)[:, None, None]
    slides, lifts = (
        _find_null_space(normal),
        _find_null_space(tangents.reshape(-1, Q.shape[1])),
    )
    whole = np.hstack([slides, lifts])
    if whole.shape[1] != Q.shape[1] or not slides.shape[1]:
        return False
    if np.linalg.svd(whole, compute_uv=False)[-1] < _FLAT:
        return False
    press, load = normal @ lifts, -lifts.T @ e
    size = float(np.abs(load).max(initial=0.0))
    closed = np.vstack([press.T, np.ones(len(mu))])
    unit = np.append(np.zeros(lifts.shape[1]), 1.0)
    # Bounded: every sum of pressures works on some lift.
    if not size or np.linalg.norm(closed @ nnls(closed, unit)[0] - unit) < _MARGIN:
        return False
    load, pull = load / size, slides.T @ e / size
    if not _is_within(press.T, load):
        return False
    moves = tangents @ slides
    return _share_friction(press, load, moves, pull, mu) or _find_limit(
        press, load, moves, pull, mu
    )


def _find_limit(
    press: Floats, load: Floats, moves: Floats, pull: Floats, mu: Floats
) -> bool:
    """Whether the pull is below the least friction of all pressures that balance the loads.

    Only for one sliding, or for translations, where all contacts slide in the same way.
    """
    from scipy.optimize import linprog

    # If all contacts can press a little, the loads work against every lift.
    if not _is_within(press.T, load - _MARGIN * press.sum(axis=0)):
        return False
    grams = np.einsum("ija,ijb->iab", moves, moves)
    reach = np.sqrt(np.trace(grams, axis1=1, axis2=2))
    alike = grams[reach > _FLAT]
    if not len(alike):
        return False
    # Each contact slides by its reach times a matrix that is the same for all.
    alike = alike / np.trace(alike, axis1=1, axis2=2)[:, None, None]
    if np.abs(alike - alike[0]).max() > _FLAT:
        return False
    if np.linalg.eigvalsh(alike[0])[0] <= _FLAT:
        return False
    drawn = float(np.sqrt(pull @ np.linalg.solve(alike[0], pull)))
    least = linprog(mu * reach, A_eq=press.T, b_eq=load)
    return least.fun is not None and bool(drawn < (1 - _MARGIN) * least.fun)


def _share_friction(
    press: Floats, load: Floats, moves: Floats, pull: Floats, mu: Floats
) -> bool:
    """Whether friction in proportion to pressure balances the pull, for all pressures.

    It looks for ``g_i`` with ``‖g_i‖ < μ_i`` and a matrix ``Y`` with ``T_iᵀ g_i = Y A_i`` and
    ``Y load = -pull``. Then the friction ``r_n,i g_i`` works on slidings by ``Y`` times the
    work of ``r_n,i`` on lifts.
    """
    from scipy.linalg import block_diag

    contacts, tangential, slides = moves.shape
    # Scale the rows: the sizes depend on the stiffness of each contact.
    sizes = np.linalg.norm(press, axis=1) + np.linalg.norm(moves, axis=(1, 2))
    sizes[sizes == 0] = 1.0
    press, moves = press / sizes[:, None], moves / sizes[:, None, None]
    # Unknowns: g, columns of Y.
    balance, each = block_diag(*moves.transpose(0, 2, 1)), np.eye(slides)
    last = np.kron(load[None], each)
    A = np.block(
        [[balance, -np.kron(press, each)], [np.zeros((slides, balance.shape[1])), last]]
    )
    b = np.append(np.zeros(len(balance)), -pull)
    # All solutions of the equations, to rounding; the programme chooses one.
    x0 = np.linalg.lstsq(A, b, rcond=None)[0]
    most = max(1.0, float(np.linalg.norm(pull)))
    if np.linalg.norm(A @ x0 - b) > _core.least_work * most:
        return False
    ways = _find_null_space(A / max(1.0, float(np.linalg.norm(A, 2))))
    free = contacts * tangential
    start = x0[:free].reshape(contacts, -1)
    change = ways[:free].reshape(contacts, tangential, -1)
    # The least t with (t mu_i, g_i) in a circular cone.
    rows = np.zeros((contacts, 1 + tangential, ways.shape[1] + 1))
    rows[:, 0, -1], rows[:, 1:, :-1] = mu, change
    cones = make_cone_set(
        rows.reshape(-1, rows.shape[2]), np.pad(start, [(0, 0), (1, 0)])
    )
    y, _, gap = cones.minimise(np.append(np.zeros(ways.shape[1]), 1.0))
    length = np.linalg.norm(start + change @ y[:-1], axis=1)
    inside = (length <= (1 - _MARGIN) * mu)[mu > 0].all()
    return bool(np.isfinite(gap) and inside)


def _is_within(columns: Floats, load: Floats) -> bool:
    """Whether the load is a sum of the columns with non-negative amounts."""
    from scipy.optimize import nnls

    return bool(
        np.linalg.norm(columns @ nnls(columns, load)[0] - load) <= _core.least_work
    )


def _find_null_space(A: Floats) -> Floats:
    """Orthonormal columns of the null space of a matrix with a norm of about 1."""
    _, values, rows = np.linalg.svd(A)
    rank = int((values > _FLAT).sum())
    return np.asarray(rows[rank:].T, np.float64)
