"""Least value of a linear function over a product of circular cones.

``min c·y`` with ``s = h + G y`` in ``L``, where each row of ``s (m, d)`` lies in the cone
``s_0 >= |(s_1, ..)|``; a half-line is a row whose other components are zero. The dual is
``max -h·z`` with ``z`` in ``L`` and ``Gᵀ z = c``. Both are solved together, by Newton steps
on the homogeneous self-dual embedding with the scaling of Nesterov and Todd (Andersen,
Roos, Terlaky, *Math. Program.* 95, 2003). It also proves that there is no least value, by a
direction ``y`` with ``G y`` in ``L`` and ``c·y < 0``.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from bipot_rs._lib.types import Floats
from bipot_rs.contact import tuning

# Relative residuals and gap at which steps end: far below 1e-9, far above rounding. Where
# they were near and rise by the factor _WORSE, rounding prevails: the best point is taken.
_ENOUGH = 1e-12
_NEAR, _WORSE = 1e-7, 1e2
# Shorter steps only add rounding.
_SHORT = 1e-8
# A direction leaves the cones by at most this share of its size.
_RAY = 1e-9
# The largest share of y = 0 in a point: more would be no correction of rounding. Where
# y = 0 itself is on the border of a cone, there is no such share.
_SHRINK = 1e-10

# Orthonormal columns across those of G, and the pseudoinverse of G.
Across: TypeAlias = tuple[Floats, Floats] | None


@dataclass(frozen=True)
class Optimum:
    """The end of a search.

    Attributes
    ----------
    y
        The point, or the direction along which ``c·y`` falls without bound.
    bounded
        Whether ``y`` is a point.
    gap
        Difference from the bound of the dual, with all residuals; not negative.
    """

    y: Floats
    bounded: bool
    gap: float


@dataclass
class _Point:
    """A point of the embedding."""

    y: Floats
    s: Floats
    z: Floats
    tau: float
    kappa: float


class Programme:
    """The set ``h + G y`` in ``L``, over which many functions are minimised.

    Parameters
    ----------
    G, h
        Matrix ``(m, d, k)`` with independent columns, and ``(m, d)`` in the cones, so that
        ``y = 0`` is allowed. ``h`` is of the order of one, columns are of unit length.
    """

    def __init__(self, G: Floats, h: Floats) -> None:
        self.h = h
        self.G = G.reshape(h.size, G.shape[2])
        k = self.G.shape[1]
        # Newton steps factor G, or what is across its columns if that is smaller.
        few = h.size - k < k
        self.across: Across = None
        if few:
            U, size, V = np.linalg.svd(self.G, full_matrices=True)
            self.across = U[:, k:], (V.T / size) @ U[:, :k].T

    def minimise(self, c: Floats) -> Optimum:
        """Find the least ``c·y`` (``c`` of unit length), or a direction without one."""
        if self.h.shape[1] == 2:
            minimum = self._minimise_in_the_plane(c)
            if minimum is not None:
                return minimum
        m, d = self.h.shape
        unit = np.zeros((m, d))
        unit[:, 0] = 1.0
        best = _Point(np.zeros(len(c)), unit, unit, 1.0, 1.0)
        if self.across is not None:
            best = self._follow(best, c, self.across)
        # Where what is across lost digits, G itself has more.
        best = self._follow(best, c, None)
        return _find_end(best, c, self.G, self.h)

    def _follow(self, p: _Point, c: Floats, across: Across) -> _Point:
        """The best point of at most so many steps."""
        best, least = p, np.inf
        for _ in range(tuning.PROGRAMME_STEPS):
            merit = _measure_merit(p, c, self.G, self.h)
            if merit < least:
                best, least = p, merit
            if merit <= _ENOUGH or (least < _NEAR and merit > _WORSE * least):
                break
            after = _move_by(p, c, self, across)
            if after is None:
                break
            p = after
        return best

    def _minimise_in_the_plane(self, c: Floats) -> Optimum | None:
        """A vertex, to rounding, since the cones are angles; None without a least value."""
        from scipy.optimize import linprog

        G, h = self.G.reshape(*self.h.shape, -1), self.h
        # s_0 >= |s_1| is two inequalities; a half-line gives its own twice.
        A = np.concatenate([G[:, 0] + G[:, 1], G[:, 0] - G[:, 1]])
        b = np.concatenate([h[:, 0] + h[:, 1], h[:, 0] - h[:, 1]])
        optimum = linprog(c, A_ub=-A, b_ub=b, bounds=(None, None), method="highs-ds")
        if optimum.x is None:
            return None
        up, down = np.split(-optimum.ineqlin.marginals, 2)
        z = np.stack([up + down, up - down], axis=1)
        return _find_bounded(optimum.x, z, c, self.G, h)


def _measure_merit(p: _Point, c: Floats, G: Floats, h: Floats) -> float:
    """The largest relative residual of an optimum or of a direction, the smaller one."""
    # Near a direction τ goes to zero, and the point may leave the range of doubles.
    with np.errstate(over="ignore", invalid="ignore"):
        y, s, z = p.y / p.tau, p.s / p.tau, p.z / p.tau
        primal = np.linalg.norm(h.ravel() + G @ y - s.ravel()) / (1 + np.linalg.norm(h))
        dual = np.linalg.norm(G.T @ z.ravel() - c) / (1 + np.linalg.norm(c))
        gap = np.vdot(s, z) / (1 + abs(c @ y))
    falls = -float(c @ p.y)
    ray = np.inf
    if falls > 0:
        ray = float(np.linalg.norm(G @ p.y - p.s.ravel())) / falls
    return float(np.fmin(np.max([primal, dual, gap]), ray))


def _move_by(p: _Point, c: Floats, over: Programme, across: Across) -> _Point | None:
    """Take a step, a predictor with its corrector; None if rounding ends them."""
    with np.errstate(all="ignore"):
        try:
            newton = _Newton(p, c, over, across)
        except np.linalg.LinAlgError:
            return None
        lam = newton.lam
        product = p.tau * p.kappa
        mean = float(np.vdot(p.s, p.z) + product) / (len(p.s) + 1)
        towards = -_multiply(lam, lam)
        predicted = newton.step(1.0, towards, -product)
        share = (1 - min(1.0, _find_longest(p, lam, predicted))) ** 3
        towards -= _multiply(predicted.s, predicted.z)
        towards[:, 0] += share * mean
        edge = share * mean - product - predicted.tau * predicted.kappa
        move = newton.step(1 - share, towards, edge)
        length = min(1.0, tuning.PROGRAMME_SHARE * _find_longest(p, lam, move))
        after = _Point(
            p.y + length * move.y,
            p.s + length * newton.scaling.times(move.s),
            p.z + length * newton.scaling.inverse(move.z),
            p.tau + length * move.tau,
            p.kappa + length * move.kappa,
        )
        inside = (
            min(
                _measure_depth(after.s), _measure_depth(after.z), after.tau, after.kappa
            )
            > 0
        )
    # The embedding is homogeneous: no number grows.
    size = max(after.tau, after.kappa, float(np.abs(after.y).max(initial=0.0)))
    if not (inside and length > _SHORT and np.isfinite(size)):
        return None
    return _Point(
        after.y / size,
        after.s / size,
        after.z / size,
        after.tau / size,
        after.kappa / size,
    )


class _Newton:
    """The Newton system of a point; ``s`` and ``z`` of its steps are scaled."""

    def __init__(self, p: _Point, c: Floats, over: Programme, across: Across) -> None:
        self.p, self.c, self.across = p, c, across
        G, h = over.G, over.h
        self.scaling = _Scaling(p.s, p.z)
        self.lam = self.scaling.times(p.z)
        if self.across is None:
            factored = self.scaling.inverse(G.reshape(*h.shape, -1))
        else:
            # Gᵀ D = 0: the columns of w D are across those of w⁻¹ G.
            factored = self.scaling.times(self.across[0].reshape(*h.shape, -1))
        self.Q, self.T = np.linalg.qr(factored.reshape(h.size, -1))
        self.h = self.scaling.inverse(h)
        self.dual = G.T @ p.z.ravel() - c * p.tau
        self.primal = self.scaling.inverse((G @ p.y).reshape(h.shape) + h * p.tau - p.s)
        self.last = p.kappa + c @ p.y + np.vdot(h, p.z)
        self.along = self._solve(c, -self.h)
        self.slope = c @ self.along[0] + np.vdot(self.h, self.along[1])

    def _solve(self, a: Floats, b: Floats) -> tuple[Floats, Floats]:
        """Solve ``Ĝᵀ z = a``, ``Ĝ y + z = b`` with the scaled ``Ĝ = w⁻¹ G``."""
        if self.across is not None:
            some = self.scaling.times((a @ self.across[1]).reshape(b.shape))
            z = some + (self.Q @ (self.Q.T @ (b - some).ravel())).reshape(b.shape)
            return self.across[1] @ self.scaling.times(b - z).ravel(), z
        part = np.linalg.solve(self.T.T, a)
        image = self.Q.T @ b.ravel()
        y = np.linalg.solve(self.T, image - part)
        return y, b + (self.Q @ (part - image)).reshape(b.shape)

    def step(self, share: float, towards: Floats, edge: float) -> _Point:
        """The step that removes a share of the residuals and changes the products."""
        p = self.p
        bent = _divide(self.lam, towards)
        y, z = self._solve(-share * self.dual, bent - share * self.primal)
        over = -share * self.last - edge / p.tau - self.c @ y - np.vdot(self.h, z)
        tau = float(over / (self.slope - p.kappa / p.tau))
        y, z = y + tau * self.along[0], z + tau * self.along[1]
        return _Point(y, bent - z, z, tau, (edge - p.kappa * tau) / p.tau)


class _Scaling:
    """The symmetric matrix ``w`` of each cone with ``w z = w⁻¹ s``."""

    def __init__(self, s: Floats, z: Floats) -> None:
        depth_s, depth_z = np.sqrt(_square(s)), np.sqrt(_square(z))
        s, z = s / depth_s[:, None], z / depth_z[:, None]
        mean = s + z * _make_signs(s.shape[1])
        self.axis = mean / np.sqrt(2 * (1 + np.sum(s * z, axis=1)))[:, None]
        self.size = np.sqrt(depth_s / depth_z)

    def times(self, x: Floats) -> Floats:
        """``w x``, of vectors ``(m, d)`` or matrices ``(m, d, k)``."""
        return self._act(x, self.axis, self.size)

    def inverse(self, x: Floats) -> Floats:
        """``w⁻¹ x``, of vectors ``(m, d)`` or matrices ``(m, d, k)``."""
        return self._act(x, self.axis * _make_signs(x.shape[1]), 1 / self.size)

    def _act(self, x: Floats, axis: Floats, size: Floats) -> Floats:
        if x.ndim == 2:
            return self._act(x[..., None], axis, size)[..., 0]
        along = np.einsum("md,mdk->mk", axis[:, 1:], x[:, 1:])
        first = axis[:, :1] * x[:, 0] + along
        part = x[:, 0] + along / (1 + axis[:, :1])
        rest = x[:, 1:] + axis[:, 1:, None] * part[:, None]
        return np.concatenate([first[:, None], rest], axis=1) * size[:, None, None]


def _make_signs(d: int) -> Floats:
    return np.array([1.0] + [-1.0] * (d - 1))


def _square(x: Floats) -> Floats:
    """``x_0² - |x_t|²`` of each row, without cancellation of the squares."""
    length = np.linalg.norm(x[:, 1:], axis=1)
    return np.asarray((x[:, 0] - length) * (x[:, 0] + length))


def _measure_depths(x: Floats) -> Floats:
    """``x_0 - |x_t|`` of each row: negative outside of the cone."""
    return np.asarray(x[:, 0] - np.linalg.norm(x[:, 1:], axis=1))


def _measure_depth(x: Floats) -> float:
    """The least of `_measure_depths`."""
    return float(_measure_depths(x).min(initial=np.inf))


def _multiply(x: Floats, y: Floats) -> Floats:
    """Jordan product of each row."""
    product = x[:, :1] * y + y[:, :1] * x
    product[:, 0] = np.sum(x * y, axis=1)
    return product


def _divide(x: Floats, y: Floats) -> Floats:
    """The ``u`` with the Jordan product ``x u = y``."""
    first = (x[:, 0] * y[:, 0] - np.sum(x[:, 1:] * y[:, 1:], axis=1)) / _square(x)
    rest = (y[:, 1:] - first[:, None] * x[:, 1:]) / x[:, :1]
    return np.concatenate([first[:, None], rest], axis=1)


def _find_longest(p: _Point, lam: Floats, move: _Point) -> float:
    """The longest step from the scaled point that stays in all cones."""
    limits = [
        -value / change
        for value, change in ((p.tau, move.tau), (p.kappa, move.kappa))
        if change < 0
    ]
    # In the frame of λ: the least eigenvalue of the change relative to λ.
    depth = np.sqrt(_square(lam))
    unit = lam / depth[:, None]
    for change in (move.s, move.z):
        first = unit[:, 0] * change[:, 0] - np.sum(unit[:, 1:] * change[:, 1:], axis=1)
        part = (first + change[:, 0]) / (1 + unit[:, 0])
        rest = change[:, 1:] - part[:, None] * unit[:, 1:]
        least = (first - np.linalg.norm(rest, axis=1)) / depth
        lowest = float(least.min(initial=0.0))
        if lowest < 0:
            limits.append(-1 / lowest)
    return min(limits, default=np.inf)


def _find_end(p: _Point, c: Floats, G: Floats, h: Floats) -> Optimum:
    """The point with its gap, or the direction."""
    falls = -float(c @ p.y)
    if falls > 0:
        y = p.y / falls
        outside = -_measure_depth((G @ y).reshape(h.shape))
        if outside <= _RAY * float(np.abs(G @ y).max()) and p.tau < p.kappa:
            return Optimum(y, False, 0.0)
    return _find_bounded(p.y / p.tau, p.z / p.tau, c, G, h)


def _find_bounded(y: Floats, z: Floats, c: Floats, G: Floats, h: Floats) -> Optimum:
    """A point with the gap that its multipliers prove."""
    # A share of y = 0, which is in the cones, removes what rounding left outside. Rounding
    # may also leave y = 0 outside of a cone; where it is no nearer, it removes nothing.
    s = h + (G @ y).reshape(h.shape)
    lack = _measure_depths(s)
    nearer = _measure_depths(h) - lack
    share = np.divide(
        -lack, nearer, out=np.zeros(len(h)), where=(lack < 0) & (nearer > 0)
    )
    y = y * (1 - float(share[share <= _SHRINK].max(initial=0.0)))
    missing = c - G.T @ z.ravel()
    z = z + (np.linalg.lstsq(G.T, missing, rcond=None)[0]).reshape(z.shape)
    short = max(-_measure_depth(z), 0.0)
    s = h + (G @ y).reshape(h.shape)
    wide = max(-_measure_depth(s), 0.0)
    reach = float(np.abs(s[:, 0]).sum()) + float(np.abs(h[:, 0]).sum())
    gap = float(c @ y + np.vdot(h, z))
    rest = short * reach + wide * float(np.abs(z[:, 0]).sum())
    return Optimum(y, True, max(gap, 0.0) + rest)
