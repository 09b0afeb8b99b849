"""The variational inequalities of contact, [dSF91, 73-78], with their worst test fields.

Each inequality requires that a linear function of the test field is nowhere negative. Its
minimum is computed exactly for each contact. The negative part of the minimum is the
residual, in units of work: it is zero if and only if the inequality holds. Test fields are
bounded by a given size. It scales a violation, but does not change whether there is one.

Tractions, displacements and test fields are totals: ``t = t0 + Δt``,
``v = Δu + (u_n0 + h0, 0)``, and likewise ``t*``, ``v*``. Their differences equal those of
the increments in the paper, and the sets ``ΔK_μ`` are shifted by the start state.
Reactions are nodal forces, so that integrals are sums.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from bipot_rs._lib.matrices import direction
from bipot_rs._lib.messages import make_type_error
from bipot_rs._lib.types import Floats
from bipot_rs._lib.validation import coulomb, floats, number, vectors
from bipot_rs.contact.proof.existence import make_dense
from bipot_rs.contact.reduced import ReducedProblem


class Verdict(NamedTuple):
    """Violation of an inequality, and its worst test field.

    Attributes
    ----------
    residual
        Violation at each contact, ``(n_c,)``, in units of work; never negative.
    worst
        The test field with the largest violation, ``(n_c, d)``.
    """

    residual: Floats
    worst: Floats

    @property
    def total(self) -> float:
        """Violation of the inequality: the sum over all contacts."""
        return float(self.residual.sum())


def coupled(t: ArrayLike, v: ArrayLike, mu: ArrayLike, size: float) -> Verdict:
    """Residual of the single inequality (74): ``Σ ṽ·(t* - t) >= 0`` for all ``t*`` in the cones.

    ``ṽ = (v_n + μ ‖v_t‖, v_t)`` as in (57). The minimum of ``ṽ·t*`` over the cone with
    ``t_n* <= size`` lies on the edge opposite to the slip, where it is ``t_n* v_n``, or at
    the vertex. The residual is ``ṽ·t + size max(-v_n, 0)``.

    Parameters
    ----------
    t, v
        Reactions and relative displacements, ``(n_c, d)``, normal first.
    mu
        Friction coefficient, a number or ``(n_c,)``.
    size
        Largest normal force of a test field; at least the largest normal force of ``t``.

    Raises
    ------
    TypeError, ValueError
        A wrong argument; ``size`` is smaller than a normal reaction; ``t`` is outside the
        cones by more than rounding.
    """
    t, v, mu, worst = _press(t, v, mu, size)
    worst[:, 1:] = -(mu * worst[:, 0])[:, None] * direction(v[:, 1:])
    corrected = v.copy()
    corrected[:, 0] += mu * np.linalg.norm(v[:, 1:], axis=1)
    least = np.sum(corrected * (worst - t), axis=1)
    return Verdict(np.maximum(-least, 0.0), worst)


def displacements(t: ArrayLike, v: ArrayLike, mu: ArrayLike, size: float) -> Verdict:
    """Sum of the residuals of the two inequalities (75).

    ``Σ t_n (v_n* - v_n) >= 0`` for all ``v_n* >= 0``, and
    ``Σ t_t·(v_t* - v_t) + μ t_n (‖v_t*‖ - ‖v_t‖) >= 0`` for all ``v_t*``. The worst field
    opens a contact with ``t_n < 0`` by ``size``, and slips by ``size`` opposite to ``t_t``
    where friction exceeds its limit. The residuals are ``t_n v_n + size max(-t_n, 0)`` and
    ``t_t·v_t + μ t_n ‖v_t‖ + size max(‖t_t‖ - μ t_n, 0)``.

    Parameters
    ----------
    t, v, mu
        As in `coupled`; ``v`` must not penetrate.
    size
        Largest opening and slip of a test field; at least the largest of ``v``.

    Raises
    ------
    TypeError, ValueError
        A wrong argument; ``size`` is smaller than an opening or a slip; ``v`` penetrates by
        more than rounding.
    """
    t, v, mu = _pair(t, v, mu)
    slip = np.linalg.norm(v[:, 1:], axis=1)
    far = max(float(slip.max(initial=0.0)), float(v[:, 0].max(initial=0.0)))
    limit = _check_bound("size", size, far, "opening or slip")
    deep = v[:, 0] < -_ROUNDING * limit
    if deep.any():
        at = int(np.argmax(deep))
        raise ValueError(
            f"v of contact {at} penetrates by {-v[at, 0]}, expected v_n >= 0, which "
            "inequality (75) assumes"
        )
    drag = np.linalg.norm(t[:, 1:], axis=1)
    worst = np.zeros_like(v)
    worst[:, 0] = np.where(t[:, 0] < 0, limit, 0.0)
    # With t_n < 0 the friction limit is negative: without friction any direction serves.
    away = direction(t[:, 1:])
    away[(drag == 0) & (t[:, 0] < 0), :1] = 1.0
    worst[:, 1:] = -np.where(drag > mu * t[:, 0], limit, 0.0)[:, None] * away
    normal = t[:, 0] * (worst[:, 0] - v[:, 0])
    tangential = np.sum(t[:, 1:] * (worst[:, 1:] - v[:, 1:]), axis=1)
    reached = np.linalg.norm(worst[:, 1:], axis=1)
    tangential += mu * t[:, 0] * (reached - slip)
    return Verdict(np.maximum(-normal, 0.0) + np.maximum(-tangential, 0.0), worst)


def alternated(t: ArrayLike, v: ArrayLike, mu: ArrayLike, size: float) -> Verdict:
    """Sum of the residuals of the two inequalities (76)-(78) of the explicit form.

    ``Σ v_n (t_n* - t_n) >= 0`` for all ``t_n* >= 0``, and ``Σ v_t·(t_t* - t_t) >= 0`` for
    all ``t_t*`` in the disc of radius ``μ t_n``. The residuals are
    ``v_n t_n + size max(-v_n, 0)`` and ``v_t·t_t + μ t_n ‖v_t‖``. Their sum equals the
    residual of `coupled`, although the test fields form a cylinder instead of a cone.

    Parameters
    ----------
    t, v, mu, size
        As in `coupled`.

    Raises
    ------
    TypeError, ValueError
        As `coupled`.
    """
    t, v, mu, worst = _press(t, v, mu, size)
    worst[:, 1:] = -(mu * t[:, 0])[:, None] * direction(v[:, 1:])
    normal = v[:, 0] * (worst[:, 0] - t[:, 0])
    tangential = np.sum(v[:, 1:] * (worst[:, 1:] - t[:, 1:]), axis=1)
    return Verdict(np.maximum(-normal, 0.0) + np.maximum(-tangential, 0.0), worst)


class Response:
    """The operators (73): ``E`` from increments of reaction to displacement, and its inverse.

    Both are affine, by equilibrium under the loads of the step:
    ``E(Δt) = W (t0 + Δt) + q - offset``.

    Parameters
    ----------
    problem
        The step, from `ContactProblem.reduced`: ``W``, ``q`` with the loads, and the rigid
        motions that supports leave free.
    reaction, offset
        ``t0`` and ``(u_n0 + h0, 0)`` of the start state, ``(n_c, d)``. The default is zero;
        increments are then totals.

    Attributes
    ----------
    monotonicity
        The largest ``c`` with ``(E(t) - E(t'))·(t - t') >= c ‖t - t'‖²``: the least
        computed eigenvalue of the symmetric part of ``W`` [length/force].
    inverse_monotonicity
        The same constant of ``E⁻¹`` [force/length]. It is zero if supports leave rigid
        motions free, and ``None`` if ``E⁻¹`` does not exist.
    """

    def __init__(
        self,
        problem: ReducedProblem,
        *,
        reaction: ArrayLike | None = None,
        offset: ArrayLike | None = None,
    ) -> None:
        if not isinstance(problem, ReducedProblem):
            raise make_type_error("problem", problem, "a ReducedProblem")
        self.problem = problem
        shape = problem.q.shape
        zero = np.zeros(shape)
        self.reaction = (
            zero if reaction is None else floats("reaction", reaction, shape=shape)
        )
        self.offset = zero if offset is None else floats("offset", offset, shape=shape)
        self._W = make_dense(problem.W)
        size = self._W.shape[0]
        self._R, self._e = np.empty((size, 0)), np.empty(0)
        if problem.rigid is not None:
            self._R, self._e = problem.rigid
        self.monotonicity = _least(self._W)
        self._inverse: Floats | None = None
        self.inverse_monotonicity: float | None = None
        self._invert()

    def displacement(self, dt: ArrayLike, rigid: ArrayLike | None = None) -> Floats:
        """``E(Δt) = Δû``, (73a), ``(n_c, d)``.

        Reactions do not determine the rigid motions that supports leave free: give their
        amounts ``rigid (k,)``. ``Δt`` should balance the loads on these motions.

        Raises
        ------
        ValueError
            ``rigid`` is missing, or an argument has a wrong shape.
        """
        increment = floats("dt", dt, shape=self.problem.q.shape)
        count = len(self._e)
        if rigid is None and count:
            raise ValueError(
                f"rigid is missing, expected shape ({count},): supports leave {count} rigid "
                "motions free, and reactions do not determine their amounts"
            )
        a = np.zeros(0) if rigid is None else floats("rigid", rigid, shape=(count,))
        moved = self._W @ (self.reaction + increment).ravel() + self._R @ a
        return (
            np.asarray(moved.reshape(self.offset.shape) + self.problem.q) - self.offset
        )

    def traction(self, du: ArrayLike) -> Floats:
        """``E⁻¹(Δu) = Δt̂``, (73b), ``(n_c, d)``; it balances the loads on free rigid motions.

        Raises
        ------
        ValueError
            ``W``, bordered by rigid motions, is singular: ``E⁻¹`` does not exist.
        """
        increment = floats("du", du, shape=self.problem.q.shape)
        if self._inverse is None:
            raise ValueError(
                "the compliance W of problem is singular: displacements do not determine "
                "the reactions; remove redundant contacts, or use inequality_74"
            )
        moved = (increment + self.offset - self.problem.q).ravel()
        m = len(moved)
        right = np.concatenate([moved, -self._e])
        total = self._inverse[:m] @ right
        return np.asarray(total.reshape(self.offset.shape)) - self.reaction

    def sizes(self) -> tuple[float, float]:
        """Estimate the largest force and displacement, to choose the size of test fields.

        The displacement is the largest in ``q``. The force is the largest that reduces ``q``
        to zero at one contact, or that balances the loads on a rigid motion.
        """
        q = self.problem.q
        moved = np.linalg.norm(q, axis=1)
        stiff = np.diag(self._W).reshape(q.shape).mean(axis=1)
        force = np.divide(moved, stiff, where=stiff > 0, out=np.zeros(len(q)))
        length = float(moved.max(initial=0.0))
        largest = float(force.max(initial=0.0))
        if len(self._e):
            lever = np.linalg.norm(self._R, axis=0)
            largest = max(largest, float((np.abs(self._e) / lever).max()))
        return largest, length

    def _invert(self) -> None:
        m, k = self._R.shape
        # Bordered matrix [W R; Rᵀ 0], scaled to the entries of W.
        alpha = np.sqrt(np.trace(self._W) / m) if m else 1.0
        lengths = np.linalg.norm(self._R, axis=0)
        border = self._R / lengths * alpha**2
        whole = np.block([[self._W, border], [border.T, np.zeros((k, k))]])
        if not m or np.linalg.cond(whole) > 1e14:
            return
        scale = np.concatenate([np.ones(m), alpha**2 / lengths])
        self._inverse = np.linalg.inv(whole) * scale
        # Rigid motions need no force: the least eigenvalue is zero up to rounding.
        least = _least(self._inverse[:m, :m])
        self.inverse_monotonicity = 0.0 if k else least


def inequality_74(response: Response, dt: ArrayLike, size: float) -> Verdict:
    """Residual of (74) for increments ``Δt``, with ``Δû = E(Δt)`` and the worst ``Δt*``.

    Parameters
    ----------
    response
        ``E``, with the start state.
    dt
        Increments in ``ΔK_μ``, ``(n_c, d)``.
    size
        As in `coupled`.

    Raises
    ------
    TypeError, ValueError
        As `coupled`; supports leave rigid motions free, so that ``E`` is not a function.
    """
    total = response.reaction + floats("dt", dt, shape=response.reaction.shape)
    v = response.displacement(dt) + response.offset
    sup = coupled(total, v, response.problem.mu, size)
    return Verdict(sup.residual, sup.worst - response.reaction)


def inequality_75(response: Response, du: ArrayLike, size: float) -> Verdict:
    """Residual of (75) for increments ``Δu``, with ``Δt̂ = E⁻¹(Δu)`` and the worst ``Δu*``.

    Parameters
    ----------
    response
        ``E⁻¹``, with the start state.
    du
        Increments that do not penetrate, ``(n_c, d)``.
    size
        As in `displacements`.

    Raises
    ------
    TypeError, ValueError
        As `displacements`; ``E⁻¹`` does not exist.
    """
    v = response.offset + floats("du", du, shape=response.offset.shape)
    total = response.traction(du) + response.reaction
    sup = displacements(total, v, response.problem.mu, size)
    return Verdict(sup.residual, sup.worst - response.offset)


def inequality_78(response: Response, dt: ArrayLike, size: float) -> Verdict:
    """Residual of (76)-(78) for increments ``Δt``; otherwise as `inequality_74`."""
    total = response.reaction + floats("dt", dt, shape=response.reaction.shape)
    v = response.displacement(dt) + response.offset
    sup = alternated(total, v, response.problem.mu, size)
    return Verdict(sup.residual, sup.worst - response.reaction)


# Tolerance for membership in a set, relative to the size of test fields: a computed
# solution lies in the cone up to the tolerance of the solver only.
_ROUNDING = 1e-8


def _pair(t: ArrayLike, v: ArrayLike, mu: ArrayLike) -> tuple[Floats, Floats, Floats]:
    force = vectors("t", t)
    moved = floats("v", v, shape=force.shape)
    return force, moved, coulomb(mu, len(force))


def _press(
    t: ArrayLike, v: ArrayLike, mu: ArrayLike, size: float
) -> tuple[Floats, Floats, Floats, Floats]:
    """The arguments of `coupled`, checked, and the worst normal forces without friction."""
    t, v, mu = _pair(t, v, mu)
    limit = _check_bound(
        "size", size, float(t[:, 0].max(initial=0.0)), "normal reaction"
    )
    _in_cone(t, mu)
    worst = np.zeros_like(t)
    worst[:, 0] = np.where(v[:, 0] < 0, limit, 0.0)
    return t, v, mu, worst


def _check_bound(what: str, value: float, least: float, of: str) -> float:
    size = number(what, value)
    if not (np.isfinite(size) and size >= least and size > 0):
        raise ValueError(
            f"{what} is {size}, expected a positive number of at least {least}, the "
            f"largest {of}"
        )
    return size


def _in_cone(t: Floats, mu: Floats) -> None:
    largest = np.linalg.norm(t, axis=1).max(initial=0.0)
    over = np.linalg.norm(t[:, 1:], axis=1) - mu * np.maximum(t[:, 0], 0.0)
    lack = np.maximum(over, -t[:, 0])
    if (lack > _ROUNDING * largest).any():
        at = int(np.argmax(lack))
        raise ValueError(
            f"t of contact {at} is outside the friction cone by {lack[at]}, expected a "
            "reaction inside, which the inequality assumes"
        )


def _least(A: Floats) -> float:
    if not len(A):
        return 0.0
    return float(np.linalg.eigvalsh((A + A.T) / 2)[0])
