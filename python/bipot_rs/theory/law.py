"""Every form of the contact law in the paper, as a residual in units of force.

[dSF91] writes one law in nine ways: by inclusions (51), (55), (57), (63), by the sliding
rule (60) and the normal (61), by the bipotential (54), by one projection (79) and by two
projections (82), (83). Each function takes `materials.Coulomb`, which contains the start
state, and the increments ``Δu`` and ``Δt`` of a step, ``(n_c, d)``. It returns a residual
``(n_c,)`` in units of force: zero if and only if the pair is on the law. Displacements are
converted to forces by a step ``rho`` [N/m], one number or one for each contact, as in (11);
``d/tr W_ii``, from the compliance of the contact, is suitable.

An inclusion in a subdifferential has jumps: with a gap of 1e-17 a contact is open and must
have no reaction. Rounded numbers would never satisfy it. Residuals of inclusions are
therefore distances to their *graphs*: the largest of the distances of their parts.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from itertools import pairwise
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from bipot_rs._lib.matrices import direction, length
from bipot_rs._lib.types import Bools, Floats
from bipot_rs._lib.validation import by_contact, floats, integer, number, vectors
from bipot_rs.contact.law.contact_law import project
from bipot_rs.contact.results.result import Result
from bipot_rs.theory.convex import (
    dot,
    project_ball,
    project_cone,
    shrink,
)
from bipot_rs.theory.materials import Coulomb, Start, gap


def normal_and_gap(
    body: ArrayLike, obstacle: ArrayLike, normal: ArrayLike | None = None
) -> tuple[Floats, Floats]:
    """Normal and initial gap of pairs of points, (48).

    Parameters
    ----------
    body, obstacle
        ``x_A`` and ``x_B``, ``(n_c, d)`` [m].
    normal
        Unit vectors from the obstacle towards the body, ``(n_c, d)``, to 1e-6. If missing,
        the direction between the points is used, as (48) is printed: it does not exist for
        coincident points, and is reversed for points that penetrate. With a given normal
        ``h₀ = (x_A - x_B)·n`` may be zero or negative.

    Returns
    -------
    normal, gap
        ``n (n_c, d)`` and ``h₀ (n_c,)``.

    Raises
    ------
    ValueError
        The points of a pair coincide up to rounding, and no normal is given.
    """
    x_a = vectors("body", body)
    x_b = floats("obstacle", obstacle, shape=x_a.shape)
    between = x_a - x_b
    if normal is not None:
        n = floats("normal", normal, shape=x_a.shape)
        lengths = length(n)
        wrong = ~(np.abs(lengths - 1) <= 1e-6)
        if wrong.any():
            at = int(np.argmax(wrong))
            raise ValueError(
                f"normal of pair {at} has length {lengths[at]}, expected 1"
            )
        return n, dot(between, n)
    distance = length(between)
    # The direction of a difference is meaningless if the difference is only rounding.
    eps = float(np.finfo(np.float64).eps)
    touching = distance <= 4 * eps * np.maximum(length(x_a), length(x_b))
    if touching.any():
        at = int(np.argmax(touching))
        raise ValueError(
            f"body and obstacle coincide at pair {at}: coincident points do not determine "
            "a normal; give normal="
        )
    return direction(between), distance


class _Pair(NamedTuple):
    """State at the end of the step; displacements are multiplied by rho."""

    r: Floats
    r_n: Floats
    r_t: Floats
    v_n: Floats
    v_t: Floats
    mu: Floats

    @property
    def limit(self) -> Floats:
        return np.asarray(self.mu * np.maximum(self.r_n, 0.0))

    @property
    def corrected(self) -> Floats:
        """``ρ ṽ``, (9)."""
        return np.column_stack([self.v_n + self.mu * length(self.v_t), self.v_t])


def _pair(law: Coulomb, du: ArrayLike, dt: ArrayLike, rho: ArrayLike) -> _Pair:
    moved, pressed = law.start.vectors("du", du), law.start.vectors("dt", dt)
    step = _steps(law, rho)
    r = law.start.total_reaction(pressed)
    v_n = step * (moved[:, 0] + law.start.opening)
    return _Pair(r, r[:, 0], r[:, 1:], v_n, step[:, None] * moved[:, 1:], law.mu)


def _steps(law: Coulomb, rho: ArrayLike) -> Floats:
    steps = by_contact("rho", rho, len(law.mu))
    if not (steps > 0).all():
        raise ValueError(f"rho is {float(steps.min())}, expected positive numbers")
    return steps


def _worst(*parts: Floats) -> Floats:
    """Largest of several violations, or zero."""
    return np.asarray(np.maximum.reduce([np.zeros_like(parts[0]), *parts]))


def _least(*cases: Floats) -> Floats:
    return np.asarray(np.minimum.reduce(cases))


def by_case(law: Coulomb, du: ArrayLike, dt: ArrayLike, rho: ArrayLike) -> Floats:
    """Residual of Signorini's and Coulomb's law, status by status, (47) and (50).

    Open: no reaction and no penetration. Stick: no relative displacement, reaction in
    the cone. Slip: closed, friction at its limit and opposite to the slip.
    """
    p = _pair(law, du, dt, rho)
    slip = length(p.v_t)
    opened = _worst(length(p.r), -p.v_n)
    stuck = _worst(np.abs(p.v_n), slip, -p.r_n, length(p.r_t) - p.limit)
    against = length(p.r_t + p.limit[:, None] * direction(p.v_t))
    slid = np.where(slip > 0, _worst(np.abs(p.v_n), -p.r_n, against), np.inf)
    return _least(opened, stuck, slid)


def in_rates(law: Coulomb, du: ArrayLike, dt: ArrayLike, rho: ArrayLike) -> Floats:
    """Residual of (51) at the end of the step; the rate of slip is ``Δu_t`` over any time.

    ``t_n ∈ -∂Ψ(u_n + h₀ >= 0)`` and ``t_t ∈ -μ t_n ∂|u̇_t|``, as fixed points of the proximal
    maps of the two functions: the projection onto a half-line, and shrinkage.
    """
    p = _pair(law, du, dt, rho)
    normal = np.abs(p.v_n - np.maximum(p.v_n - p.r_n, 0.0))
    tangent = length(p.v_t - shrink(p.v_t - p.r_t, p.limit))
    return _worst(normal, tangent)


def by_displacements(
    law: Coulomb, du: ArrayLike, dt: ArrayLike, rho: ArrayLike
) -> Floats:
    """Residual of (55): ``Δt`` is in the subdifferential of ``b`` with respect to ``-Δu``.

    (55a): ``-Δt_n - t_n⁰`` is 0 if open and not positive if closed. (55b):
    ``-Δt_t - t_t⁰`` is ``μ t_n`` times the direction of slip or, without slip, any vector
    of at most that length.
    """
    p = _pair(law, du, dt, rho)
    opened = np.hypot(np.minimum(p.v_n, 0.0), p.r_n)
    closed = np.hypot(p.v_n, np.minimum(p.r_n, 0.0))
    slip = length(p.v_t)
    along = length(p.r_t + p.limit[:, None] * direction(p.v_t))
    along = np.where(slip > 0, along, np.inf)
    still = _worst(slip, length(p.r_t) - p.limit)
    return _worst(_least(opened, closed), _least(along, still))


def _to_normals(p: _Pair, w: Floats) -> Floats:
    """Distance of ``(t, w)`` from the graph of normals ``w ∈ ∂Ψ_{K_μ}(t)``, (56).

    The normals are: inside the cone only 0; on its surface the ray of
    ``(-μ, t_t/|t_t|)``; at the vertex the polar cone.
    """
    height, radial = project_cone(p.r_n, p.r_t, p.mu)
    outside = length(p.r - np.column_stack([height, radial]))
    inside = _worst(outside, length(w))
    side = np.column_stack([-p.mu, direction(p.r_t)])
    along = np.maximum(dot(w, side), 0.0) / (1 + p.mu**2)
    across = length(w - along[:, None] * side)
    border = np.abs(length(p.r_t) - p.mu * p.r_n)
    surface = _worst(border, -p.r_n, across)
    # Without friction the cone is a half-line: every tangential vector is normal to it.
    line = _worst(length(p.r_t), -p.r_n, np.abs(w[:, 0]))
    axis = length(p.r_t) == 0
    surface = np.where(p.mu > 0, np.where(axis, np.inf, surface), line)
    # The distance to a polar cone is the length of the projection onto the cone.
    height, radial = project_cone(w[:, 0], w[:, 1:], p.mu)
    vertex = _worst(length(p.r), np.hypot(height, length(radial)))
    return _least(inside, surface, vertex)


def by_normals(law: Coulomb, du: ArrayLike, dt: ArrayLike, rho: ArrayLike) -> Floats:
    """Residual of (57): ``-(Δu_n + u_n⁰ + h₀ + μ|Δu_t|, Δu_t)`` is normal to ``ΔK_μ`` at Δt."""
    p = _pair(law, du, dt, rho)
    return _to_normals(p, -p.corrected)


def polar_lack(law: Coulomb, du: ArrayLike, dt: ArrayLike, rho: ArrayLike) -> Floats:
    """Residual ``(μ|Δv_t| + Δv_n)₊`` of the polar cone (58), with Δv from (57).

    (58) is necessary, not sufficient; with (57) the residual equals `penetration`.
    """
    p = _pair(law, du, dt, rho)
    w = -p.corrected
    return _worst(p.mu * length(w[:, 1:]) + w[:, 0])


def penetration(law: Coulomb, du: ArrayLike, dt: ArrayLike, rho: ArrayLike) -> Floats:
    """Residual ``(Δu_n + u_n⁰ + h₀)₋`` of (59), which is necessary, not sufficient."""
    return _worst(-_pair(law, du, dt, rho).v_n)


def by_sliding(law: Coulomb, du: ArrayLike, dt: ArrayLike, rho: ArrayLike) -> Floats:
    """Residual of the sliding rule (60).

    At the vertex only (59) is required. Otherwise the contact is closed,
    ``Δu_t = -Δλ t_t/|t_t|``, ``Δλ >= 0``, and ``Δλ (μ t_n - |t_t|) = 0``, which (60) leaves
    to (53). With μ = 0, ``t_t`` has no direction and every slip is allowed.
    """
    p = _pair(law, du, dt, rho)
    vertex = _worst(length(p.r), -p.v_n)
    back = direction(p.r_t)
    multiplier = np.maximum(-dot(p.v_t, back), 0.0)
    off = length(p.v_t + multiplier[:, None] * back)
    reserve = p.mu * p.r_n - length(p.r_t)
    works = np.minimum(multiplier, np.abs(reserve))
    off, works = (np.where(p.mu > 0, x, 0.0) for x in (off, works))
    return _least(vertex, _worst(np.abs(p.v_n), -p.r_n, -reserve, off, works))


def by_sliding_normal(
    law: Coulomb, du: ArrayLike, dt: ArrayLike, rho: ArrayLike
) -> Floats:
    """Residual of (61), sign corrected: ``(-μ|Δu_t|, -Δu_t)`` is normal to ``ΔK_μ`` at Δt.

    The contact is closed. At the vertex only (59) is required.
    """
    p = _pair(law, du, dt, rho)
    vertex = _worst(length(p.r), -p.v_n)
    w = np.column_stack([-p.mu * length(p.v_t), -p.v_t])
    return _least(vertex, _worst(np.abs(p.v_n), -p.r_n, _to_normals(p, w)))


def by_reactions(law: Coulomb, du: ArrayLike, dt: ArrayLike, rho: ArrayLike) -> Floats:
    """Residual of (63): ``Δu`` is in the normal cones of half-line (``t_n``) and disc (``t_t``).

    The disc is ``ΔK_μ(Δt_n)`` of (76), fixed while the normal is taken: the form of an
    explicit material that is not standard.
    """
    p = _pair(law, du, dt, rho)
    both = np.abs(p.r_n) + np.abs(p.v_n)
    work = np.abs(p.r_n * p.v_n)
    work = np.divide(work, both, out=np.zeros_like(work), where=both > 0)
    normal = _worst(-p.r_n, -p.v_n, work)
    friction, back = length(p.r_t), direction(p.r_t)
    inside = _worst(friction - p.limit, length(p.v_t))
    multiplier = np.maximum(-dot(p.v_t, back), 0.0)
    across = length(p.v_t + multiplier[:, None] * back)
    border = np.where(friction > 0, _worst(np.abs(friction - p.limit), across), np.inf)
    # A disc of radius zero is a point, and every vector is normal to it.
    point = _worst(friction, p.limit)
    return _worst(normal, _least(inside, border, point))


def by_bipotential(
    law: Coulomb, du: ArrayLike, dt: ArrayLike, rho: ArrayLike
) -> Floats:
    """Residual of (8) with (54): ``b(-Δu, Δt) + Δu·Δt = 0``, converted to a force.

    The gap, an energy, is computed at the nearest admissible pair and divided by
    ``|ṽ| + |t|/ρ``; the residual is at least the distance to that pair.
    An error in the direction of slip enters squared.
    """
    p = _pair(law, du, dt, rho)
    steps = _steps(law, rho)
    height, radial = project_cone(p.r_n, p.r_t, p.mu)
    r = np.column_stack([height, radial])
    lack = np.hypot(length(p.r - r), np.minimum(p.v_n, 0.0))
    moved = law.start.vectors("du", du)
    moved[:, 0] = np.maximum(p.v_n, 0.0) / steps - law.start.opening
    energy = np.maximum(gap(law, -moved, r - law.start.reaction), 0.0)
    sizes = length(p._replace(v_n=np.maximum(p.v_n, 0.0)).corrected) + length(r)
    value = np.divide(steps * energy, sizes, out=np.zeros_like(energy), where=sizes > 0)
    return _worst(lack, value)


def by_projection(law: Coulomb, du: ArrayLike, dt: ArrayLike, rho: ArrayLike) -> Floats:
    """Residual of (79), ``|Δt - proj(Δt - ρ (Δu + (u_n⁰ + h₀ + μ|Δu_t|) n), ΔK_μ)|``.

    It is (11). Call the residual F. For ``t`` in the cone and ``v_n >= 0``,
    ``F² <= ρ t·ṽ <= F (ρ|ṽ| + |t| + F)``: F and the gap of the bipotential bound each other.
    """
    p = _pair(law, du, dt, rho)
    increments = law.start.vectors("dt", dt)
    tau = increments - p.corrected
    return length(increments - project(tau, law.mu, base=law.start.reaction)[0])


def by_two_projections(
    law: Coulomb, du: ArrayLike, dt: ArrayLike, rho: ArrayLike
) -> Floats:
    """Residual of the projections (82) onto ``[-t_n⁰, ∞[`` and (83) onto ``ΔK_μ(Δt_n)``."""
    p = _pair(law, du, dt, rho)
    normal = np.abs(p.r_n - np.maximum(p.r_n - p.v_n, 0.0))
    tangent = length(p.r_t - project_ball(p.r_t - p.v_t, p.limit))
    return _worst(normal, tangent)


Form = Callable[[Coulomb, ArrayLike, ArrayLike, ArrayLike], Floats]

FORMS: Mapping[str, Form] = MappingProxyType(
    {
        "by case": by_case,
        "(51)": in_rates,
        "(54)": by_bipotential,
        "(55)": by_displacements,
        "(57)": by_normals,
        "(60)": by_sliding,
        "(61)": by_sliding_normal,
        "(63)": by_reactions,
        "(79)": by_projection,
        "(82), (83)": by_two_projections,
    }
)
"""Every complete form of the law, by its number in [dSF91]."""


def size(law: Coulomb, du: ArrayLike, dt: ArrayLike, rho: ArrayLike) -> Floats:
    """Sum of reactions, and of displacements times ρ, start state included, ``(n_c,)`` [N].

    It is the scale of tolerances: a residual has a few units of rounding of this size.
    """
    moved, pressed = law.start.vectors("du", du), law.start.vectors("dt", dt)
    terms = np.abs(law.start.displacement[:, 0]) + np.abs(law.start.gap)
    forces = length(law.start.reaction) + length(pressed)
    return np.asarray(
        forces + _steps(law, rho) * (terms + (1 + law.mu) * length(moved))
    )


def verdicts(
    law: Coulomb, du: ArrayLike, dt: ArrayLike, rho: ArrayLike, tol: float = 1e-9
) -> dict[str, Bools]:
    """Decide for each contact whether it is on the law, by each of `FORMS`.

    ``tol`` is relative to `size`.
    """
    tol = number("tol", tol)
    if not tol > 0:
        raise ValueError(f"tol is {tol}, expected a positive number")
    limit = tol * size(law, du, dt, rho)
    return {name: form(law, du, dt, rho) <= limit for name, form in FORMS.items()}


def explicit_path(W: ArrayLike, q: ArrayLike, mu: float) -> Floats:
    """Reactions of one contact by explicit integration of (51), which drifts from the cone.

    Status and direction of slip, ``m = t_t/‖t_t‖``, are those at the start of a step, and
    the cone is replaced by its tangent there. A contact that is open stays open in the step;
    otherwise it ends closed, ``v_n = 0``, with ``t_n < 0`` if necessary, and then opens in
    the next one. On the border of the cone or outside it slides, ``Δv_t = -λ m``,
    ``m·Δt_t = μ Δt_n``; with ``λ < 0`` it sticks.

    Parameters
    ----------
    W, q
        ``v = W t + q``: ``(d, d)``, nonsingular, and ``(steps + 1, d)`` from the state
        without reaction on.
    mu
        Friction coefficient, positive.

    Returns
    -------
    t
        At the end of each step, ``(steps, d)``. `bipot_rs.ContactProblem` keeps to the cone.
    """
    free = floats("q", q, ndim=2)
    d = free.shape[1]
    compliance = floats("W", W, shape=(d, d))
    path = [np.zeros(d)]
    for start, end in pairwise(free):
        t, dt = path[-1], -path[-1]
        v, force, moved = compliance @ t + start, length(t[1:]), start - end
        moved[0] -= v[0]
        if t[0] > 0 or (t[0] == 0 and v[0] <= 0):
            dt = np.linalg.solve(compliance, moved)
            if force > 0 and force >= mu * t[0]:
                m = np.r_[0.0, t[1:] / force]
                tangent = m - mu * np.eye(d)[0]
                system = np.block([[compliance, m[:, None]], [tangent, np.zeros(1)]])
                *slides, rate = np.linalg.solve(system, np.r_[moved, 0.0])
                dt = np.array(slides) if rate >= 0 else dt
        path.append(t + dt)
    return np.array(path[1:])


def step_of(result: Result, k: int) -> tuple[Coulomb, Floats, Floats]:
    """Law with its start state, and increments, of one step of a solved path.

    Parameters
    ----------
    result
        The result of `ContactProblem.solve`, whose ``contacts`` have ``gap`` and ``mu``.
    k
        Index of the step, from 0. The first step starts from the unloaded state, unless the
        path continues from another state.

    Returns
    -------
    law, du, dt
        `Coulomb`, and the increments of relative displacement and of reaction, ``(n_c, d)``.
        The tangential part of ``du`` is the slip of the step.
    """
    k = integer("k", k, least=0, most=max(len(result) - 1, 0))
    mu, gaps = _read_contacts(result, "mu"), _read_contacts(result, "gap")
    height = gaps if gaps.ndim == 1 else gaps[:, 0]
    now = result[k]
    before = result[k - 1] if k else result.start
    if now.frame is not None or (before is not None and before.frame is not None):
        raise ValueError(
            f"step {k} of result, or the step before it, has frames of its own: increments of "
            "its vectors need the same frames"
        )
    if before is None:
        start = Start.unloaded(height, now.reaction.shape[1])
    else:
        moved = before.relative_displacement.copy()
        moved[:, 0] -= height
        start = Start(before.reaction, moved, height)
    du = np.column_stack([now.relative_displacement[:, 0] - start.opening, now.slip])
    return Coulomb(mu, start), du, now.reaction - start.reaction


def _read_contacts(result: Result, name: str) -> Floats:
    values: Floats | None = result.contacts.get(name)
    if values is None:
        raise ValueError(
            f"result.contacts has no {name!r}: give the result of ContactProblem.solve"
        )
    return values
