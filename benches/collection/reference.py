"""Reference answer near an approximate one, in twice the precision of a float64.

With the statuses of the approximate answer the law is a system of polynomials:

    open     r = 0
    stick    u = 0
    slip     u_n = 0,   r_t·r_t = μ² r_n²,   r_t1 u_t2 = r_t2 u_t1

in the plane r_t = ± μ r_n, and r_t = 0 without friction. Newton's method solves it together
with the linear equations of `system`: factors in float64, residuals in twice the precision.
Then the inequalities of the law are tested. Where they fail, the statuses are changed. No
solver of the package works in this way.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import linalg, sparse
from scipy.sparse.linalg import splu

from bipot_rs._lib.types import Floats
from bipot_rs.contact.law.status import Status
from collection.doubled import Pair, add, exactly, minus, times
from collection.system import System

Statuses = NDArray[np.int8]
# Last correction of Newton's method and violation of an inequality, relative to the largest
# reaction or displacement. The error after a correction is at least a thousand times
# smaller, so that rounding to float64 gives the nearest float.
CONVERGED = 1e-20
# Redundant reactions are not unique; those of the solver satisfy the law to its residual.
REDUNDANT = 1e-13
# Matrices with more than this share of entries are factored as dense ones.
_DENSE = 0.2
# Singular values below this, relative to the largest, belong to redundant reactions.
_RANK = 1e-11
_STEPS, _CHANGES = 25, 30


class Reference(NamedTuple):
    """The answer, rounded to float64.

    Attributes
    ----------
    u, r
        Relative displacement and reaction ``(n_c, d)``; zeros of the law are exact.
    y
        Amplitudes or displacements ``(k,)`` of `System`.
    status
        ``(n_c,)``.
    correction
        Last correction of u and of r, relative to the largest of each; of u alone if
        reactions are redundant.
    margin
        Distance from a change of status: the least of r_n and μ r_n − ‖r_t‖ relative to
        the largest reaction, and of u_n and ‖u_t‖ relative to the largest displacement.
    """

    u: Floats
    r: Floats
    y: Floats
    status: Statuses
    correction: float
    margin: float


def refine(
    p: System, r: Floats, y: Floats, status: Statuses, *, redundant: bool = False
) -> Reference:
    """Reference answer near ``r (n_c, d)``, ``y (k,)`` with its statuses.

    Raises
    ------
    ArithmeticError
        Newton's method does not converge, or no statuses satisfy the law.
    """
    status, point = status.copy(), (exactly(r.ravel()), exactly(y))
    for _ in range(_CHANGES):
        point, u, correction = _newton(p, *point, status, redundant)
        changed = _violated(p, *point, u, status, redundant)
        if (changed == status).all():
            return _rounded(p, point, u, status, correction)
        status = changed
    raise ArithmeticError("no statuses satisfy the law near the approximate answer")


def _newton(
    p: System, r: Pair, y: Pair, status: Statuses, redundant: bool
) -> tuple[tuple[Pair, Pair], Pair, float]:
    """Solution of the equations of given statuses, its u, and the last correction."""
    closed = np.flatnonzero(status != Status.OPEN)
    rows = (p.d * closed[:, None] + np.arange(p.d)).ravel()
    r = _only(r, rows)
    u, solve, before, correction = p.displacement(r, y), None, np.inf, np.inf
    for _ in range(_STEPS):
        # Factors are used again while each step gains three digits.
        if solve is None or correction > 1e-3 * before:
            solve = _solver(_jacobian(p, r[0], u[0], status, rows), redundant)
        law = _law(p, r, u, status, closed)
        value = np.append(law[0], p.imbalance(r, y)[0])
        step = -solve(value)
        before, moved = correction, step[: len(rows)]
        change = np.zeros(len(p.q))
        change[rows] = moved
        r, y = add(r, exactly(change)), add(y, exactly(step[len(rows) :]))
        last, u = u, p.displacement(r, y)
        moved_u = add(u, minus(last))[0]
        correction = _largest(moved_u) / p.length(r[0], y[0], u[0])
        if not redundant:
            correction = max(correction, _largest(moved) / (_largest(r[0]) or 1.0))
        if correction <= CONVERGED:
            return (r, y), u, correction
    raise ArithmeticError(f"the last correction of Newton's method is {correction:.0e}")


def _only(a: Pair, rows: NDArray[np.int64]) -> Pair:
    """A pair with zeros outside some rows."""
    kept = exactly(np.zeros_like(a[0]))
    for new, old in zip(kept, a, strict=True):
        new[rows] = old[rows]
    return kept


def _largest(a: Floats) -> float:
    return float(np.abs(a).max(initial=0.0))


def _components(p: System, a: Pair, closed: NDArray[np.int64]) -> list[Pair]:
    """Components ``n, t1[, t2]`` of some contacts."""
    high, low = (part.reshape(-1, p.d)[closed] for part in a)
    return [(high[:, k], low[:, k]) for k in range(p.d)]


def _law(p: System, r: Pair, u: Pair, status: Statuses, closed: Any) -> Pair:
    """Left sides of the equations of closed contacts, ``(d closed,)``."""
    (r_n, *r_t), (u_n, *u_t) = _components(p, r, closed), _components(p, u, closed)
    mu = exactly(p.mu[closed])
    limit = times(mu, r_n)
    if p.d == 2:
        sign = exactly(-np.sign(r_t[0][0]))
        slip = [add(r_t[0], times(sign, limit))]
    else:
        along = add(times(r_t[0], u_t[1]), minus(times(r_t[1], u_t[0])))
        square = add(times(r_t[0], r_t[0]), times(r_t[1], r_t[1]))
        slip = [along, add(square, minus(times(limit, limit)))]
    free, sticks = mu[0] == 0, status[closed] == Status.STICK
    branches = [u_n]
    for of_slip, of_stick, force in zip(slip, u_t, r_t, strict=True):
        parts = zip(of_slip, of_stick, force, strict=True)
        high, low = (
            np.where(sticks, stick, np.where(free, push, slide))
            for slide, stick, push in parts
        )
        branches.append((high, low))
    return (
        np.stack([high for high, _ in branches], axis=1).ravel(),
        np.stack([low for _, low in branches], axis=1).ravel(),
    )


def _jacobian(p: System, r: Floats, u: Floats, status: Statuses, rows: Any) -> Any:
    """Derivative of the equations by the reactions of closed contacts and by y."""
    closed = rows[:: p.d] // p.d
    count = len(closed)
    by_r, by_u = np.zeros((2, count, p.d, p.d))
    r, u = r.reshape(-1, p.d)[closed], u.reshape(-1, p.d)[closed]
    mu, sticks = p.mu[closed], status[closed] == Status.STICK
    by_u[:, 0, 0] = 1
    if p.d == 2:
        by_r[:, 1, 0], by_r[:, 1, 1] = -np.sign(r[:, 1]) * mu, 1
    else:
        by_r[:, 1, 1], by_r[:, 1, 2] = u[:, 2], -u[:, 1]
        by_u[:, 1, 1], by_u[:, 1, 2] = -r[:, 2], r[:, 1]
        by_r[:, 2, 0] = -2 * mu**2 * r[:, 0]
        by_r[:, 2, 1:] = 2 * r[:, 1:]
    free = (mu == 0) & ~sticks
    # u_n = 0 and r_t = 0.
    normal = np.diag(np.eye(p.d)[0])
    by_r[free], by_u[free] = np.eye(p.d) - normal, normal
    by_r[sticks], by_u[sticks] = 0, np.eye(p.d)
    A_r, A_u = _blocks(by_r), _blocks(by_u)
    E = p.E[rows]
    law = A_r + A_u @ p.W[rows][:, rows]
    return sparse.csr_array(sparse.bmat([[law, A_u @ E], [E.T, -p.M]]))


def _blocks(of: Floats) -> Any:
    count, d = of.shape[:2]
    pattern = np.arange(count), np.arange(count + 1)
    return sparse.bsr_array((of, *pattern), shape=(d * count, d * count)).tocsr()


def _solver(J: Any, redundant: bool) -> Callable[[Floats], Floats]:
    """Solve with J in float64, rows and columns scaled by powers of two."""
    if not J.shape[0]:
        return lambda value: value
    left = _scale(abs(J).max(axis=1).toarray())
    J = sparse.csr_array(J.multiply(left[:, None]))
    right = _scale(abs(J).max(axis=0).toarray())
    J = sparse.csc_array(J.multiply(right))
    if redundant:
        inverse = linalg.pinv(J.toarray(), rtol=_RANK)
        return lambda value: right * (inverse @ (left * value))
    if J.nnz > _DENSE * J.shape[0] ** 2:
        factors = linalg.lu_factor(J.toarray())
        return lambda value: right * linalg.lu_solve(factors, left * value)
    lu = splu(J)
    return lambda value: right * lu.solve(left * value)


def _scale(largest: Floats) -> Floats:
    largest = largest.ravel()
    powers = np.round(np.log2(np.where(largest > 0, largest, 1.0)))
    return np.asarray(np.ldexp(1.0, -powers.astype(int)), np.float64)


def _violated(
    p: System, r: Pair, y: Pair, u: Pair, status: Statuses, redundant: bool
) -> Statuses:
    """Statuses with those changed that violate an inequality of the law."""
    allowed = REDUNDANT if redundant else CONVERGED
    every = np.arange(len(status))
    (r_n, *r_t), (u_n, *u_t) = _components(p, r, every), _components(p, u, every)
    force, length = _largest(r[0]), p.length(r[0], y[0], u[0])
    limit = times(exactly(p.mu), r_n)
    beyond = minus(times(limit, limit))
    power = exactly(np.zeros(len(status)))
    for along, moved in zip(r_t, u_t, strict=True):
        beyond, power = (
            add(beyond, times(along, along)),
            add(power, times(along, moved)),
        )
    new = status.copy()
    new[(status == Status.OPEN) & (u_n[0] < -CONVERGED * length)] = Status.STICK
    sticks, slips = status == Status.STICK, status == Status.SLIP
    new[sticks & (beyond[0] > allowed * force**2)] = Status.SLIP
    new[slips & (p.mu > 0) & (power[0] > allowed * force * length)] = Status.STICK
    new[(status != Status.OPEN) & (r_n[0] < -allowed * force)] = Status.OPEN
    # A pressed contact without friction has the status slip.
    new[(new == Status.STICK) & (p.mu == 0)] = Status.SLIP
    return new


def _rounded(
    p: System, point: tuple[Pair, Pair], u: Pair, status: Statuses, correction: float
) -> Reference:
    shape = (-1, p.d)
    length = p.length(point[0][0], point[1][0], u[0])
    r, v = _floats(point[0][0]).reshape(shape), _floats(u[0]).reshape(shape)
    opened, sticks = status == Status.OPEN, status == Status.STICK
    # A redundant contact may touch without a force, to the last of twice the digits.
    r[opened | (r[:, 0] <= 0)], v[sticks] = 0.0, 0.0
    # An open contact may touch, too.
    v[~opened | (v[:, 0] <= 0), 0] = 0.0
    force = _largest(r) or 1.0
    tangential = np.linalg.norm(r[:, 1:], axis=1)
    slips = (status == Status.SLIP) & (p.mu > 0)
    distances = (
        r[~opened, 0] / force,
        (p.mu * r[:, 0] - tangential)[sticks] / force,
        v[opened, 0] / length,
        np.linalg.norm(v[slips, 1:], axis=1) / length,
    )
    margin = max(min(float(x.min(initial=1.0)) for x in distances), 0.0)
    return Reference(v, r, _floats(point[1][0]), status, correction, margin)


def _floats(a: Floats) -> Floats:
    """Numbers as multiples of 2⁻⁷⁵ of the largest.

    What symmetry makes nearly zero would otherwise show the order of sums in the factors,
    which depends on the number of threads.
    """
    unit = np.ldexp(1.0, int(np.frexp(_largest(a))[1]) - 75)
    rounded = np.round(a / unit) * unit
    # Larger numbers are multiples already. Adding zero leaves no -0.
    return np.asarray(
        np.where(np.abs(a) < unit * 2.0**53, rounded, a) + 0.0, np.float64
    )
