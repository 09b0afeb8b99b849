"""Explicit and implicit standard materials, sections II and IV of [dSF91].

A material relates a generalised strain ``x`` and a generalised stress ``y``, vectors along
the last axis of arrays. An *explicit* material has two conjugate potentials, with
``V(x) + W(y) >= x·y`` and equality on the law (3)–(7). An *implicit* material has a
bipotential, convex in each argument, with ``b(x, y) >= x·y`` and equality on the law
(8)–(13). Explicit materials are implicit with ``b = V + W`` (10); `implicit` converts them.

Contact is a material whose strain is minus the increment of relative displacement,
``x = -Δu``, and whose stress is the increment of reaction, ``y = Δt`` (21). Both have the
shape ``(n_c, d)``, normal first. Energies are given for each contact.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol, TypeAlias, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike

from bipot_rs._lib.matrices import length
from bipot_rs._lib.types import Bools, Floats
from bipot_rs._lib.validation import by_contact, coulomb, floats, positive, vectors
from bipot_rs.contact.law.contact_law import project
from bipot_rs.theory.convex import (
    dot,
    indicator,
    project_ball,
    support_ball,
    within,
)


@runtime_checkable
class ExplicitMaterial(Protocol):
    """Two conjugate potentials, (3)–(7)."""

    def energy(self, x: ArrayLike, /) -> Floats:
        """``V(x)``; ``+inf`` outside its domain."""
        ...

    def complementary_energy(self, y: ArrayLike, /) -> Floats:
        """``W(y) = sup_x [x·y - V(x)]``; ``+inf`` outside its domain."""
        ...

    def prox(self, predictor: ArrayLike, r: ArrayLike, /) -> Floats:
        """The ``y`` that minimises ``r W(y) + ½|y - predictor|²``, (40)."""
        ...


@runtime_checkable
class ImplicitMaterial(Protocol):
    """A bipotential and its partial conjugates, (8)–(18)."""

    def bipotential(self, x: ArrayLike, y: ArrayLike, /) -> Floats:
        """``b(x, y)``; ``+inf`` outside its domain."""
        ...

    def left_dual(self, z: ArrayLike, y: ArrayLike, /) -> Floats:
        """``b_l*(z, y) = sup_x [z·x - b(x, y)]``, (14); ``-inf`` where b(·, y) has no domain."""
        ...

    def right_dual(self, x: ArrayLike, u: ArrayLike, /) -> Floats:
        """``b_r*(x, u) = sup_y [u·y - b(x, y)]``, (17); ``-inf`` where b(x, ·) has no domain."""
        ...

    def prox_at(self, predictor: ArrayLike, x: ArrayLike, r: ArrayLike, /) -> Floats:
        """The ``y`` that minimises ``r b(x, y) + ½|y - predictor|²``, (44).

        Terms in ``x`` alone do not change it. It is therefore defined for every ``x``, even
        where these terms are infinite.
        """
        ...


Material: TypeAlias = ExplicitMaterial | ImplicitMaterial


@dataclass(frozen=True)
class Separable:
    """Explicit material as an implicit one, ``b(x, y) = V(x) + W(y)``, (10).

    Its duals follow from ``V* = W`` and ``W* = V``.
    """

    explicit: ExplicitMaterial

    def bipotential(self, x: ArrayLike, y: ArrayLike) -> Floats:
        """``V(x) + W(y)``."""
        return self.explicit.energy(x) + self.explicit.complementary_energy(y)

    def left_dual(self, z: ArrayLike, y: ArrayLike) -> Floats:
        """``W(z) - W(y)``."""
        return _subtract(
            self.explicit.complementary_energy(z), self.explicit.complementary_energy(y)
        )

    def right_dual(self, x: ArrayLike, u: ArrayLike) -> Floats:
        """``V(u) - V(x)``."""
        return _subtract(self.explicit.energy(u), self.explicit.energy(x))

    def prox_at(self, predictor: ArrayLike, x: ArrayLike, r: ArrayLike) -> Floats:  # noqa: ARG002 - V(x) does not change it
        """Proximal point of ``r W``, for every ``x``."""
        return self.explicit.prox(predictor, r)


def _subtract(value: Floats, taken: Floats) -> Floats:
    """``value - taken``; ``-inf``, the supremum of an empty set, where ``taken`` is ``+inf``."""
    nothing = np.isposinf(taken)
    return np.where(nothing, -np.inf, value - np.where(nothing, 0.0, taken))


def implicit(material: Material) -> ImplicitMaterial:
    """Return the material as an implicit material, with a bipotential."""
    return Separable(material) if isinstance(material, ExplicitMaterial) else material


def fenchel_gap(material: ExplicitMaterial, x: ArrayLike, y: ArrayLike) -> Floats:
    """``V(x) + W(y) - x·y >= 0``, zero exactly on the law, (3) and (5)."""
    return gap(Separable(material), x, y)


def gap(material: Material, x: ArrayLike, y: ArrayLike) -> Floats:
    """``b(x, y) - x·y >= 0``, zero exactly on the law, (8) and (11)."""
    work = dot(floats("x", x), floats("y", y))
    return implicit(material).bipotential(x, y) - work


def left_gap(material: Material, x: ArrayLike, y: ArrayLike) -> Floats:
    """Residual of (13a), ``y ∈ ∂_x b(x, y)``, as an energy.

    ``b(x, y) + b_l*(y, y) - x·y`` is not negative, by Fenchel's inequality for the first
    argument. It is zero if and only if (13a) holds, and ``+inf`` outside the domain.
    """
    material = implicit(material)
    return _sum(gap(material, x, y), material.left_dual(y, y))


def right_gap(material: Material, x: ArrayLike, y: ArrayLike) -> Floats:
    """Residual of (13b), ``x ∈ ∂_y b(x, y)``: ``b(x, y) + b_r*(x, x) - x·y``, as `left_gap`."""
    material = implicit(material)
    return _sum(gap(material, x, y), material.right_dual(x, x))


def _sum(lack: Floats, dual: Floats) -> Floats:
    """``lack + dual``; ``+inf`` where ``lack`` is, for every ``dual``."""
    inside = np.isfinite(lack)
    return np.where(inside, lack + np.where(inside, dual, 0.0), np.inf)


def uzawa(
    material: Material,
    strain: Callable[[Floats], Floats],
    start: ArrayLike,
    r: ArrayLike,
    iterations: int,
) -> Floats:
    """Uzawa's iterates of a structure and a material, (41)–(42) and (45)–(46).

    Predictor ``y + r x``, corrector ``prox(·, r b(x, ·))``, where ``x`` is the strain of
    the structure under the stress ``y``. A fixed point is on the law, for every ``r > 0``;
    convergence depends on ``r``.

    Parameters
    ----------
    material
        Explicit or implicit.
    strain
        The structure, ``y ↦ x``: a decreasing affine map. For contact it is ``x = -Δu``,
        with ``Δu`` the elastic solution under ``y = Δt``, (73a).
    start
        The first stress.
    r
        Positive coefficient [stress/strain]; for contact one number or one for each contact.
    iterations
        Number of iterations.

    Returns
    -------
    iterates
        ``(iterations + 1, *start.shape)``, from the start on.

    Raises
    ------
    ValueError
        An argument is wrong, or ``strain`` returns a wrong shape or numbers that are not
        finite, for example after many iterations that diverge.
    """
    material = implicit(material)
    step = positive_step(r)
    y = floats("start", start)
    iterates = [y]
    for _ in range(positive("iterations", iterations)):
        x = floats("strain(y)", strain(y), shape=y.shape)
        y = material.prox_at(y + (step[..., None] if step.ndim else step) * x, x, step)
        iterates.append(y)
    return np.array(iterates)


def positive_step(r: ArrayLike) -> Floats:
    """Check a coefficient of (39)–(46): positive numbers."""
    step = floats("r", r)
    if not (step > 0).all():
        raise ValueError(f"r is {float(step.min())}, expected positive numbers")
    return step


@dataclass(frozen=True)
class LinearElastic:
    """``V = ½ x·D x``, ``W = ½ y·D⁻¹ y``, (64).

    Parameters
    ----------
    stiffness
        ``D``, symmetric positive definite ``(m, m)``, [stress/strain]; strains and
        stresses are ``(..., m)``.
    """

    stiffness: Floats

    def __init__(self, stiffness: ArrayLike) -> None:
        matrix = floats("stiffness", stiffness, ndim=2)
        if matrix.shape[0] != matrix.shape[1]:
            raise ValueError(
                f"stiffness has shape {matrix.shape}, expected a square matrix"
            )
        # Asymmetry of the size of rounding is allowed.
        if (np.abs(matrix - matrix.T) > 1e-12 * np.abs(matrix).max(initial=0.0)).any():
            raise ValueError(
                "stiffness is not symmetric, expected a symmetric positive definite matrix"
            )
        lowest = float(np.linalg.eigvalsh(matrix)[0]) if matrix.size else 0.0
        if not lowest > 0:
            raise ValueError(
                f"stiffness has the eigenvalue {lowest}, expected a positive definite matrix"
            )
        object.__setattr__(self, "stiffness", matrix)

    def _vectors(self, what: str, value: ArrayLike) -> Floats:
        rows = floats(what, value)
        m = len(self.stiffness)
        if rows.ndim == 0 or rows.shape[-1] != m:
            raise ValueError(f"{what} has shape {rows.shape}, expected (..., {m})")
        return rows

    def stress(self, x: ArrayLike) -> Floats:
        """``y = D x``, (4)."""
        return self._vectors("x", x) @ self.stiffness

    def strain(self, y: ArrayLike) -> Floats:
        """``x = D⁻¹ y``, (4)."""
        return _solve_step(self.stiffness, self._vectors("y", y))

    def energy(self, x: ArrayLike) -> Floats:
        """``½ x·D x``."""
        return 0.5 * dot(self._vectors("x", x), self.stress(x))

    def complementary_energy(self, y: ArrayLike) -> Floats:
        """``½ y·D⁻¹ y``."""
        return 0.5 * dot(self._vectors("y", y), self.strain(y))

    def prox(self, predictor: ArrayLike, r: ArrayLike) -> Floats:
        """Solution of ``(D + r I) y = D ŷ``, which is (40) without the inverse of ``D``."""
        step = floats("r", r, shape=())
        shifted = self.stiffness + positive_step(step) * np.eye(len(self.stiffness))
        return _solve_step(shifted, self.stress(self._vectors("predictor", predictor)))


def _solve_step(matrix: Floats, vectors: Floats) -> Floats:
    flat = vectors.reshape(-1, vectors.shape[-1])
    return np.asarray(np.linalg.solve(matrix, flat.T).T.reshape(vectors.shape))


@dataclass(frozen=True)
class Start:
    """State of contacts at the start of a step: ``t⁰``, ``u⁰``, ``h₀``.

    All values are allowed: the laws below also hold from states that are not on the law.

    Parameters
    ----------
    reaction
        ``t⁰ (n_c, d)``, normal first [N].
    displacement
        ``u⁰ (n_c, d)``, relative displacement without the gap [m]. Only its normal part is
        used, because slip is counted from the start of the step.
    gap
        ``h₀ (n_c,)``, initial gap, open when positive [m].
    """

    reaction: Floats
    displacement: Floats
    gap: Floats

    def __init__(
        self, reaction: ArrayLike, displacement: ArrayLike, gap: ArrayLike
    ) -> None:
        reactions = vectors("reaction", reaction)
        object.__setattr__(self, "reaction", reactions)
        shape = reactions.shape
        moved = floats("displacement", displacement, shape=shape)
        object.__setattr__(self, "displacement", moved)
        object.__setattr__(self, "gap", floats("gap", gap, shape=shape[:1]))

    @classmethod
    def unloaded(cls, gap: ArrayLike, d: int) -> Start:
        """State with the gap and without reactions and displacements."""
        height = floats("gap", gap, ndim=1)
        rest = np.zeros((len(height), d))
        return cls(rest, rest, height)

    @property
    def opening(self) -> Floats:
        """``u_n⁰ + h₀ (n_c,)`` [m]."""
        return np.asarray(self.displacement[:, 0] + self.gap)

    @property
    def product(self) -> Floats:
        """``t_n⁰ (u_n⁰ + h₀) (n_c,)`` [J]: zero for a complementary state."""
        return np.asarray(self.reaction[:, 0] * self.opening)

    def vectors(self, what: str, value: ArrayLike) -> Floats:
        """Check an increment with one row for each contact."""
        return floats(what, value, shape=self.reaction.shape)

    def total_reaction(self, dt: Floats) -> Floats:
        """``t = t⁰ + Δt``."""
        return np.asarray(self.reaction + dt)

    def separated(self, du: Floats) -> Bools:
        """Whether ``Δu_n + u_n⁰ + h₀ >= 0``, (59), up to rounding of its terms."""
        terms = np.abs(du[:, 0]) + np.abs(self.displacement[:, 0]) + np.abs(self.gap)
        return within(-(du[:, 0] + self.opening), terms)

    def pressed(self, dt: Floats) -> Bools:
        """Whether ``t_n⁰ + Δt_n >= 0``, (66), up to rounding of its terms."""
        terms = np.abs(self.reaction[:, 0]) + np.abs(dt[:, 0])
        return within(-self.total_reaction(dt)[:, 0], terms)

    def held(self, dt: Floats, limit: Floats, size: Floats) -> Bools:
        """Whether ``|t_t⁰ + Δt_t| <= limit``, the disc of (76), up to rounding.

        ``size`` is the size of the terms of ``limit``.
        """
        terms = length(self.reaction[:, 1:]) + length(dt[:, 1:]) + size
        lack = length(self.total_reaction(dt)[:, 1:]) - limit
        return within(lack, terms)


@dataclass(frozen=True)
class Tresca:
    """Unilateral contact with a friction limit that does not depend on the pressure.

    It is an explicit standard material, with ``x = -Δu``, ``y = Δt`` and

    ``V = t⁰·Δu + s |Δu_t| + Ψ(Δu_n + u_n⁰ + h₀ >= 0)``,
    ``W = (t_n⁰ + Δt_n)(u_n⁰ + h₀) + Ψ(t_n⁰ + Δt_n >= 0) + Ψ(|t_t⁰ + Δt_t| <= s)``.

    Parameters
    ----------
    limit
        ``s >= 0``, a number or ``(n_c,)`` [N].
    start
        State at the start of the step.
    """

    limit: Floats
    start: Start

    def __init__(self, limit: ArrayLike, start: Start) -> None:
        limits = by_contact("limit", limit, len(start.gap))
        if (limits < 0).any():
            at = int(np.argmax(limits < 0))
            raise ValueError(
                f"limit of contact {at} is {limits[at]}, expected zero or positive"
            )
        object.__setattr__(self, "limit", limits)
        object.__setattr__(self, "start", start)

    def energy(self, x: ArrayLike) -> Floats:
        """``V(-Δu)`` of each contact ``(n_c,)`` [J]."""
        du = -self.start.vectors("x", x)
        work = dot(self.start.reaction, du) + support_ball(du[:, 1:], self.limit)
        return work + indicator(self.start.separated(du))

    def complementary_energy(self, y: ArrayLike) -> Floats:
        """``W(Δt)`` of each contact ``(n_c,)`` [J]."""
        dt = self.start.vectors("y", y)
        t_n = self.start.total_reaction(dt)[:, 0]
        inside = self.start.pressed(dt) & self.start.held(dt, self.limit, self.limit)
        return np.asarray(t_n * self.start.opening + indicator(inside))

    def prox(self, predictor: ArrayLike, r: ArrayLike) -> Floats:
        """(40): project ``t_n`` onto the half-line, ``t_t`` onto the disc of radius ``s``."""
        t = self.start.total_reaction(self.start.vectors("predictor", predictor))
        t_n = np.maximum(t[:, 0] - positive_step(r) * self.start.opening, 0.0)
        t_t = project_ball(t[:, 1:], self.limit)
        return np.column_stack([t_n, t_t]) - self.start.reaction


def frictionless(start: Start) -> Tresca:
    """Unilateral contact without friction: `Tresca` with the limit 0."""
    return Tresca(0.0, start)


@dataclass(frozen=True)
class Coulomb:
    """Unilateral contact with Coulomb friction, the bipotential of (54).

    With ``x = -Δu``, ``y = Δt`` and ``t = t⁰ + Δt``,

    ``b = t⁰·Δu + t_n (u_n⁰ + h₀) + μ t_n |Δu_t| + Ψ(t ∈ K_μ) + Ψ(Δu_n + u_n⁰ + h₀ >= 0)``,

    This is (54) with the constant ``t_n⁰ (u_n⁰ + h₀)``, which the paper omits. Without it
    ``b = x·y`` is false on the law if the start state is not complementary
    (docs/theory.md, section 4). ``b - x·y = t·ṽ``, the gap of (10).

    Parameters
    ----------
    mu
        Friction coefficient, a number or ``(n_c,)``.
    start
        State at the start of the step.
    """

    mu: Floats
    start: Start

    def __init__(self, mu: ArrayLike, start: Start) -> None:
        object.__setattr__(self, "mu", coulomb(mu, len(start.gap)))
        object.__setattr__(self, "start", start)

    def admissible(self, dt: ArrayLike) -> Bools:
        """Whether ``Δt ∈ ΔK_μ``, (53), and ``t_n >= 0``, which (53) implies only for μ > 0."""
        increment = self.start.vectors("dt", dt)
        t_n = self.start.total_reaction(increment)[:, 0]
        size = np.abs(self.start.reaction[:, 0]) + np.abs(increment[:, 0])
        held = self.start.held(increment, self.mu * t_n, self.mu * size)
        return self.start.pressed(increment) & held

    def bipotential(self, x: ArrayLike, y: ArrayLike) -> Floats:
        """``b(-Δu, Δt)`` of each contact ``(n_c,)`` [J]."""
        du, dt = -self.start.vectors("x", x), self.start.vectors("y", y)
        t_n = self.start.total_reaction(dt)[:, 0]
        work = dot(self.start.reaction, du) + t_n * self.start.opening
        lost = support_ball(du[:, 1:], self.mu * t_n)
        inside = self.admissible(dt) & self.start.separated(du)
        return work + lost + indicator(inside)

    def left_dual(self, z: ArrayLike, y: ArrayLike) -> Floats:
        """``b_l*(Δt̄, Δt)``, (62), corrected: the disc has the radius ``μ t_n`` of ``Δt``.

        ``(Δt̄_n - Δt_n)(u_n⁰ + h₀) + Ψ(t_n⁰ + Δt̄_n >= 0) + Ψ(|t_t⁰ + Δt̄_t| <= μ t_n)
        - Ψ(Δt ∈ ΔK_μ)``: the conjugate of ``b(·, Δt)``, which is Tresca friction with
        the limit ``μ t_n``.
        """
        bar, dt = self.start.vectors("z", z), self.start.vectors("y", y)
        t_n = self.start.total_reaction(dt)[:, 0]
        size = self.mu * (np.abs(self.start.reaction[:, 0]) + np.abs(dt[:, 0]))
        inside = self.start.pressed(bar) & self.start.held(bar, self.mu * t_n, size)
        value = (bar[:, 0] - dt[:, 0]) * self.start.opening + indicator(inside)
        return _subtract(value, indicator(self.admissible(dt)))

    def right_dual(self, x: ArrayLike, u: ArrayLike) -> Floats:
        """``b_r*(-Δu, -Δw)`` of each contact [J].

        ``t⁰·(Δw - Δu) + Ψ(Δw_n + u_n⁰ + h₀ + μ|Δu_t| >= μ|Δw_t|)
        - Ψ(Δu_n + u_n⁰ + h₀ >= 0)``: the supremum over the cone is the indicator of its dual.
        """
        du, dw = -self.start.vectors("x", x), -self.start.vectors("u", u)
        kept, moved = self.mu * length(du[:, 1:]), self.mu * length(dw[:, 1:])
        terms = np.abs(self.start.displacement[:, 0]) + np.abs(self.start.gap)
        lack = moved - kept - dw[:, 0] - self.start.opening
        inside = within(lack, np.abs(dw[:, 0]) + terms + kept + moved)
        value = dot(self.start.reaction, dw - du) + indicator(inside)
        return _subtract(value, indicator(self.start.separated(du)))

    def prox_at(self, predictor: ArrayLike, x: ArrayLike, r: ArrayLike) -> Floats:
        """(44): the projection of ``ŷ - r (u_n⁰ + h₀ + μ|Δu_t|) n`` onto ``ΔK_μ``.

        With ``ŷ = Δt - r Δu`` this is the corrector of (79).
        """
        tau = self.start.vectors("predictor", predictor)
        du = -self.start.vectors("x", x)
        corrected = self.start.opening + self.mu * length(du[:, 1:])
        tau[:, 0] -= positive_step(r) * corrected
        return project(tau, self.mu, base=self.start.reaction)[0]

    def frozen(self, dt: ArrayLike) -> Tresca:
        """Explicit material with the potential ``b(·, Δt)``: Tresca friction, ``s = μ t_n``."""
        t = self.start.total_reaction(self.start.vectors("dt", dt))
        return Tresca(self.mu * np.maximum(t[:, 0], 0.0), self.start)


def elastic_strain(
    compliance: ArrayLike, free: ArrayLike
) -> Callable[[Floats], Floats]:
    """The structure of `uzawa` for contact: ``Δt ↦ x = -(W Δt + Δq)``, (73a).

    Parameters
    ----------
    compliance
        ``W (d n_c, d n_c)`` [m/N].
    free
        ``Δq (n_c, d)``: the increment of relative displacement for ``Δt = 0`` [m].
    """
    rest = floats("free", free, ndim=2)
    W = floats("compliance", compliance, shape=(rest.size, rest.size))

    def strain(dt: Floats) -> Floats:
        return np.asarray(-(W @ dt.ravel()).reshape(rest.shape) - rest)

    return strain
