"""Reference solution near an approximate one, by a method that no solver uses.

The statuses of the approximate solution turn the law into a system of equations: open
r = 0, stick v = 0, slip v_n = 0 and r_t = μ r_n t with t along r_t − v_t, which points
against the slip. Newton's method solves it with factors in double precision and residuals
in extended precision, or in exact integers if W has lost too many digits for that.
Then (6) and (8) are tested in their textbook form. Where they fail, the statuses are
determined again. Extended precision is `numpy.longdouble` with 64 bits or more; where it is
a plain double, no solution is trusted.

If several solutions exist, this finds the one near the approximate solution.
"""

from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from problems import Array, Problem
from scipy.linalg import LinAlgError, lu_factor, lu_solve

Long = NDArray[np.longdouble]
OPEN, SLIP, STICK = 0, 1, 2
# Limit of Newton's last relative correction and of the violation of the law. Newton
# converges quadratically, so the solution is at least as accurate.
ACCURACY = 1e-15
# Redundant reactions may leave their cones by the error of the approximate solution;
# then only v is used, which does not depend on them.
REDUNDANT = 1e-8
# Bits after the binary point of exact numbers: scaled W has no smaller bits.
BITS = 200


class Exact(NamedTuple):
    """Reactions and relative displacements ``(n_c, d)``, and whether to trust them."""

    r: Long
    v: Long
    trusted: bool


class Scaled:
    """Problem in node-scaled variables; scaled by powers of two, which changes no bit."""

    def __init__(self, problem: Problem) -> None:
        self.n, self.d = problem.q.shape
        trace = problem.W.diagonal().reshape(self.n, self.d).sum(1) / self.d
        # A contact with every component prescribed has no compliance of its own.
        trace = np.where(trace > 0, trace, trace.max(initial=0.0) or 1.0)
        self.to_v = 2.0 ** np.round(np.log2(trace) / -2)[:, None]
        each = np.repeat(self.to_v[:, 0], self.d)
        self.W = problem.W * each[:, None] * each
        self.q = problem.q * self.to_v
        self.mu, self.full_rank = problem.mu, problem.full_rank
        R, e = problem.rigid or (np.zeros((len(each), 0)), np.zeros(0))
        self.R, self.e = R * each[:, None], e

    @cached_property
    def _long(self) -> Long:
        return np.hstack([self.W, self.R]).astype(np.longdouble)

    @cached_property
    def _integers(self) -> tuple[NDArray[Any], NDArray[Any]]:
        return _fixed_point(np.hstack([self.W, self.R])), _fixed_point(self.q.ravel())

    def displacement(self, r: Long, a: Long, *, exact: bool) -> Long:
        """``v = W r + R a + q``, in extended precision, or exact and rounded once."""
        x = np.append(r.ravel(), a)
        if not exact:
            return (self._long @ x).reshape(r.shape) + self.q
        high = x.astype(float)
        low = (x - high).astype(float)
        matrix, q = self._integers
        v = matrix @ (_fixed_point(high) + _fixed_point(low)) + (q << BITS)
        # Two doubles hold more digits than their sum in extended precision.
        high = np.array([_float(i, 2 * BITS) for i in v])
        low = v - (_fixed_point(high) << BITS)
        low = np.array([_float(i, 2 * BITS) for i in low])
        return (high.astype(np.longdouble) + low).reshape(r.shape)


def _fixed_point(x: Array) -> NDArray[Any]:
    """``x 2^BITS`` as integers, truncated."""
    mantissa, exponent = np.frexp(x)
    whole = (mantissa * 2.0**53).astype(np.int64).astype(object)
    shift = exponent.astype(int).astype(object) + (BITS - 53)
    left, right = np.maximum(shift, 0), np.maximum(-shift, 0)
    return (whole << left) >> right


def _float(i: int, bits: int) -> float:
    return i / (1 << bits)  # Python rounds the division of integers once


def refine(
    problem: Problem, reaction: Array, motion: Array | None, status: NDArray[np.int8]
) -> Exact:
    """Solution with the given statuses, or with those that Newton finds near them.

    Parameters
    ----------
    problem
        The problem.
    reaction, motion, status
        Of an approximate solution: ``(n_c, d)``, ``(k,)`` or ``None``, ``(n_c,)``.

    Returns
    -------
    Exact
        Solution in the units of the problem.
    """
    p = Scaled(problem)
    enough = np.finfo(np.longdouble).nmant >= 63
    r = (reaction / p.to_v).astype(np.longdouble)
    a = np.zeros(len(p.e), np.longdouble) + (0 if motion is None else motion)
    allowed = ACCURACY if p.full_rank else REDUNDANT
    trusted, exact, correction = False, False, np.inf
    v = p.displacement(r, a, exact=exact)
    for _ in range(60):
        try:
            dr, da = _newton_step(p, r, v, status)
        except (LinAlgError, ValueError):  # singular, or overflow
            break
        r, a, before, start = r + dr, a + da, correction, v
        v = p.displacement(r, a, exact=exact)
        if p.full_rank:
            correction = _largest(dr) / (_largest(r) or 1.0)
        else:
            correction = _largest(v - start) / (_largest(p.q) or 1.0)
        law_holds = _violation(p, r, v) <= allowed
        trusted = enough and correction <= ACCURACY and law_holds
        if trusted:
            break
        if correction > 0.5 * before and correction < 1e-9 and not exact:
            exact, correction = True, np.inf
        elif correction > min(0.5 * before, 1e-3) or not law_holds:
            status = _statuses(p, r, v)
    return Exact(r * p.to_v, v / p.to_v, trusted)


def _largest(x: Any) -> float:
    return float(np.abs(x).max(initial=0))


def _statuses(p: Scaled, r: Long, v: Long) -> NDArray[np.int8]:
    """Statuses of the projection of r − v."""
    x = r - v
    length = np.linalg.norm(x[:, 1:].astype(float), axis=1)
    sticks = (length <= p.mu * x[:, 0]) & (p.mu > 0)
    return np.where(x[:, 0] <= 0, OPEN, np.where(sticks, STICK, SLIP)).astype(np.int8)


def _newton_step(
    p: Scaled, r: Long, v: Long, status: NDArray[np.int8]
) -> tuple[Long, Long]:
    """Newton's correction for the equations of the law with given statuses."""
    closed = np.flatnonzero(status != OPEN)
    n, d = len(closed), p.d
    rows = (d * closed[:, None] + np.arange(d)).ravel()
    slip = (status[closed] == SLIP)[:, None]
    r_c, v_c, mu = r[closed], v[closed], p.mu[closed][:, None]
    x = r_c[:, 1:] - v_c[:, 1:]
    length = np.sqrt((x * x).sum(1, keepdims=True))
    t = x / np.where(length > 0, length, 1)
    limit = mu * r_c[:, :1]
    sliding = np.hstack([v_c[:, :1], r_c[:, 1:] - limit * t])
    value = np.where(slip, sliding, v_c).ravel()

    # Derivatives with respect to r and v; t changes with x.
    t, length = t.astype(float), np.where(length > 0, length, 1).astype(float)
    across = np.eye(d - 1) - t[:, :, None] * t[:, None, :]
    turn = (limit.astype(float) / length)[:, :, None] * across
    by_r, by_v = np.zeros((2, n, d, d))
    by_r[:, 1:, 1:], by_r[:, 1:, 0] = np.eye(d - 1) - turn, -mu * t
    by_v[:, 0, 0], by_v[:, 1:, 1:] = 1, turn
    by_r = np.where(slip[:, None], by_r, 0.0)
    by_v = np.where(slip[:, None], by_v, np.eye(d))

    k, R = len(p.e), p.R[rows]
    compliance = np.hstack([p.W[np.ix_(rows, rows)], R]).reshape(n, d, n * d + k)
    law = np.einsum("nij,njm->nim", by_v, compliance).reshape(n * d, n * d + k)
    at = (d * np.arange(n)[:, None] + np.arange(d))[:, :, None]
    law[at, np.swapaxes(at, 1, 2)] += by_r
    matrix = np.vstack([law, np.hstack([R.T, np.zeros((k, k))])])
    balance = R.T.astype(np.longdouble) @ r_c.ravel() + p.e
    step = _solve(matrix, -np.append(value, balance), full_rank=p.full_rank)
    dr = -r  # open contacts get r = 0
    dr[closed] = step[: n * d].reshape(n, d)
    return dr, step[n * d :]


def _solve(matrix: Array, right: Long, *, full_rank: bool) -> Long:
    """Solve with a double factorisation, refined by residuals in extended precision."""
    if not full_rank:
        # Redundant supports determine v, not r: the smallest change of r is enough.
        step = np.linalg.lstsq(matrix, right.astype(float), rcond=1e-12)[0]
        return step.astype(np.longdouble)
    step = np.zeros(len(right), np.longdouble)
    if not len(right):
        return step
    lu, exact = lu_factor(matrix), matrix.astype(np.longdouble)
    for _ in range(3):
        step += lu_solve(lu, (right - exact @ step).astype(float))
    return step


def _violation(p: Scaled, r: Long, v: Long) -> float:
    """Largest violation of (6) and (8), relative to the sizes of r and of v or q."""
    force = np.abs(r).max(initial=0) or np.longdouble(1)
    length = max(np.abs(v).max(initial=0), np.abs(p.q).max(initial=0)) or 1
    r_n, v_n = r[:, 0] / force, v[:, 0] / length
    r_t = np.sqrt(((r[:, 1:] / force) ** 2).sum(1))
    v_t = np.sqrt(((v[:, 1:] / length) ** 2).sum(1))
    power = (r[:, 1:] * v[:, 1:]).sum(1) / (force * length) + p.mu * r_n * v_t
    balance = p.R.T.astype(np.longdouble) @ r.ravel() + p.e
    largest = np.abs(p.R).max(initial=0) * force or 1
    parts = [-r_n, -v_n, r_t - p.mu * r_n, np.abs(r_n * v_n), np.abs(power)]
    worst = max(float(x.max(initial=0)) for x in parts)
    return max(worst, float(np.abs(balance / largest).max(initial=0)))
