"""Plastic points: the law of a contact in strain space, at many points of a structure.

A point has the strain ``x`` and the stress ``r`` of the law of a contact: normal first,

    ``r = (a - σ_m, s)``,    ``x = (ε_v, -e)``,    ``r = r0 - M (x - v)``,

with the stress ``r0`` at the start of a step, springs ``M`` and the flow ``v = (p_v, -p_e)``.
Stress and flow obey ``‖r_t‖ <= c + μ r_n``, ``r_n >= 0``, ``v_n >= β‖v_t‖``, and the
bipotential of the law is ``b(-v, r) = (c + (μ - β) r_n)‖v_t‖`` on this domain:

    ``b + r·v = r_n (v_n - β‖v_t‖) + ((c + μ r_n)‖v_t‖ + r_t·v_t) >= 0``.

The elastic energies and ``b`` are the bipotential β(ε, σ) of (22): its value minus ``σ·ε`` is
``½ d·M d + b + r·v`` with ``d = x - v + (r - r0)/M``, and zero on the law only. It is convex
in ``(x, v)`` and in ``r``; its minimum over ``v`` is convex in ``r`` if and only if
``M_n (μ - β)² <= M_t``.

With the tangent ``C`` of the law, a strain may gather in a band with the normal ``n`` where
``det Q(n) <= 0``, ``Q_ik = n_j C_ijkl n_l``. For flow that is not associated the tangent is
not symmetric, and the perfectly plastic point of Mohr and Coulomb has such directions. The
hardening above which it has none is

    ``H = G (sin φ - sin ψ)² / (8 (1 - ν))``.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

import bipot_rs._core as _core
from bipot_rs._lib.matrices import block_diagonal, length
from bipot_rs._lib.types import CsrMatrix, Floats, MatrixLike
from bipot_rs._lib.validation import csr, floats, number
from bipot_rs.theory.convex import dot, within


class PointEnd(NamedTuple):
    """End of a step of points with given strains.

    Attributes
    ----------
    stress, flow
        r and v on the law, ``(m, d)``.
    jacobian
        Derivative of r by the stress without flow, ``(m, d, d)``: one side at a kink.
    """

    stress: Floats
    flow: Floats
    jacobian: Floats


class Rate(NamedTuple):
    """Friction that grows with slip, ``hardening (‖v_t‖ - before)``, each ``(m,)``."""

    hardening: Floats
    before: Floats


@dataclass(frozen=True, eq=False)
class PointLaw:
    """The numbers of the law of many points or contacts, each ``(m,)``.

    Attributes
    ----------
    mu, dilatancy, cohesion
        μ, β from 0 to μ, and c >= 0.
    """

    mu: Floats
    dilatancy: Floats
    cohesion: Floats

    @property
    def associated(self) -> bool:
        """Whether the flow is normal to the criterion: an explicit standard material."""
        return bool((self.dilatancy == self.mu).all())

    def respond(
        self,
        tau: Floats,
        stiffness: Floats,
        *,
        frozen: Floats | None = None,
        rate: Rate | None = None,
    ) -> PointEnd:
        """Stress and flow on the law, ``r = τ + M v`` with springs ``(m, 2)``.

        With ``frozen`` limits this is (38): the explicit law with the potential
        ``b(·, r')``, in which ``r'`` is present through `limit` only.
        """
        points = np.zeros((len(tau), 7))
        points[:, :2] = stiffness
        points[:, 2] = self.mu if frozen is None else self.dilatancy
        points[:, 3] = self.cohesion if frozen is None else frozen
        points[:, 4] = self.dilatancy
        if rate is not None:
            points[:, 5], points[:, 6] = rate
        stress, flow, jacobian = _core.respond_points(tau, points)
        d = tau.shape[1]
        return PointEnd(stress, flow, jacobian.reshape(-1, d, d))

    def limit(self, stress: Floats) -> Floats:
        """``c + (μ - β) r_n``: the part of the limit of ``‖r_t‖`` that (37) freezes."""
        excess = self.mu - self.dilatancy
        return np.asarray(self.cohesion + excess * np.maximum(stress[:, 0], 0.0))

    def clip(self, stress: Floats) -> Floats:
        """Stresses within the criterion; those inside stay bit by bit."""
        inside = stress.copy()
        inside[:, 0] = np.maximum(stress[:, 0], 0.0)
        bound, size = self.cohesion + self.mu * inside[:, 0], length(stress[:, 1:])
        ratio = np.divide(bound, size, out=np.ones_like(size), where=size > bound)
        inside[:, 1:] *= ratio[:, None]
        return inside

    def gap(self, flow: Floats, stress: Floats) -> Floats:
        """``b(-v, r) + r·v`` of each point, from terms that are not negative [J/m³]."""
        slip, normal = length(flow[:, 1:]), stress[:, 0]
        opens = normal * (flow[:, 0] - self.dilatancy * slip)
        slides = (self.cohesion + self.mu * normal) * slip
        return np.asarray(opens + (slides + dot(stress[:, 1:], flow[:, 1:])))

    def lift(self, flow: Floats) -> Floats:
        """``β‖v_t‖``, the least normal flow."""
        return np.asarray(self.dilatancy * length(flow[:, 1:]))

    def overload(self, stress: Floats) -> Floats:
        """``‖r_t‖ - c - μ r_n``, not positive for an admissible stress [Pa]."""
        return np.asarray(
            length(stress[:, 1:]) - self.cohesion - self.mu * stress[:, 0]
        )


class PlasticPoints:
    """Points of an implicit standard material in a structure.

    Parameters
    ----------
    strain
        ``x = strain u`` of all points, ``(m d, n)``, d = 2, 3, 4 or 6.
    weights
        Volumes that the points stand for, ``(m,)``.
    stiffness
        Springs ``(M_n, M_t)``, ``(m, 2)`` [Pa].
    mu, dilatancy, cohesion
        μ, β from 0 to μ, and c >= 0 [Pa], numbers or ``(m,)``.
    apex
        ``a``, the normal component of a point without stress [Pa].
    components
        X of the strains ``x = X ε`` of tensors as vectors ``(k,)``, ``(d, k)``; default 1.
    poisson
        ν where the stress across the plane is elastic, as with Mohr and Coulomb.
    shape
        Leading shape of fields, such as ``(cells, points)``; default ``(m,)``.
    """

    def __init__(
        self,
        strain: MatrixLike,
        weights: ArrayLike,
        stiffness: ArrayLike,
        *,
        mu: ArrayLike = 0.0,
        dilatancy: ArrayLike = 0.0,
        cohesion: ArrayLike = 0.0,
        apex: ArrayLike = 0.0,
        components: Floats | None = None,
        poisson: Floats | None = None,
        shape: tuple[int, ...] | None = None,
    ) -> None:
        volume = floats("weights", weights, ndim=1)
        m = len(volume)
        matrix = csr("strain", strain).matrix
        d = matrix.shape[0] // max(m, 1)
        if m == 0 or matrix.shape[0] != d * m or d not in (2, 3, 4, 6):
            raise ValueError(
                f"strain has {matrix.shape[0]} rows, expected 2, 3, 4 or 6 for each of the "
                f"{m} points of weights"
            )
        springs = floats("stiffness", stiffness, shape=(m, 2))
        if not (springs > 0).all() or not (volume > 0).all():
            raise ValueError("stiffness and weights must be positive")
        values = {}
        for name, value in (
            ("mu", mu),
            ("dilatancy", dilatancy),
            ("cohesion", cohesion),
            ("apex", apex),
        ):
            values[name] = np.broadcast_to(floats(name, value), (m,))
            if (values[name] < 0).any():
                raise ValueError(
                    f"{name} is {values[name].min():g}, expected zero or positive"
                )
        law = PointLaw(values["mu"], values["dilatancy"], values["cohesion"])
        if (law.dilatancy > law.mu).any():
            at = int(np.argmax(law.dilatancy - law.mu))
            raise ValueError(
                f"dilatancy of point {at} is {law.dilatancy[at]:g}, expected 0 to mu = "
                f"{law.mu[at]:g}: outside this range the law has no bipotential of this form"
            )
        self.strain, self.weights, self.stiffness = matrix, volume, springs
        self.law, self.apex, self.poisson = law, values["apex"], poisson
        self.components = np.eye(d) if components is None else components
        self.shape = (m,) if shape is None else shape

    @property
    def d(self) -> int:
        """Number of components of a point."""
        return len(self.components)

    @property
    def springs(self) -> Floats:
        """``M``, ``(m, d)`` [Pa]."""
        return np.repeat(self.stiffness, [1, self.d - 1], axis=1)

    @property
    def rest(self) -> Floats:
        """``(a, 0, ..)``: r of points without stress, ``(m, d)``."""
        rest = np.zeros((len(self.weights), self.d))
        rest[:, 0] = self.apex
        return rest

    def strains(self, u: Floats) -> Floats:
        """``x`` of a displacement ``(n,)``, ``(m, d)``."""
        return np.asarray((self.strain @ u).reshape(-1, self.d))

    def forces(self, stress: Floats) -> Floats:
        """Nodal forces ``∫ σ:ε(φ_i) dΩ`` that balance stresses ``r``, ``(n,)`` [N]."""
        balanced = self.weights[:, None] * (self.rest - stress)
        return np.asarray(self.strain.T @ balanced.ravel())

    def stiffness_matrix(self, jacobian: Floats | None = None) -> CsrMatrix:
        """``∫ ε(φ_i):C:ε(φ_j) dΩ``, elastic or with derivatives of `respond`, ``(n, n)``."""
        law = np.eye(self.d) if jacobian is None else jacobian
        blocks = self.weights[:, None, None] * law * self.springs[:, None, :]
        return (self.strain.T @ (block_diagonal(blocks) @ self.strain)).tocsr()

    def respond(
        self,
        strain: Floats,
        start: Floats,
        *,
        frozen: Floats | None = None,
        rate: Rate | None = None,
    ) -> PointEnd:
        """Stress and flow of the law at the increments ``x`` of strain."""
        tau = start - self.springs * strain
        return self.law.respond(tau, self.stiffness, frozen=frozen, rate=rate)

    def gap(
        self, strain: Floats, flow: Floats, stress: Floats, start: Floats
    ) -> Floats:
        """``β - σ·ε`` of each point, zero on the law only [J/m³]."""
        error = strain - flow + (stress - start) / self.springs
        elastic = 0.5 * np.sum(self.springs * error**2, axis=1)
        return np.asarray(elastic + self.law.gap(flow, stress))

    def bipotential(
        self, strain: Floats, flow: Floats, stress: Floats, start: Floats
    ) -> Floats:
        """``β`` of each point in increments, from its energies [J/m³].

        It is that of [dSF91, 22] minus ``σ0·ε``, so that its difference from ``Δσ·ε`` is
        `gap`. Infinite outside the domain of b.
        """
        slip, law = length(flow[:, 1:]), self.law
        b = law.limit(stress) * slip + dot(start, flow)
        stored = 0.5 * np.sum(self.springs * (strain - flow) ** 2, axis=1)
        back = 0.5 * np.sum((stress - start) ** 2 / self.springs, axis=1)
        size = length(stress) + law.cohesion + (1 + law.mu) * self.apex
        inside = within(-stress[:, 0], size) & within(law.overload(stress), size)
        moves = within(law.dilatancy * slip - flow[:, 0], 2 * length(flow))
        return np.where(inside & moves, stored + back + b, np.inf)

    def work(self, flow: Floats, stress: Floats) -> Floats:
        """Elastic energy of the stress and plastic work of the flow [J/m³]."""
        sigma = self.rest - stress
        elastic = 0.5 * np.sum(sigma**2 / self.springs, axis=1)
        return np.asarray(elastic + np.abs(dot(sigma, flow)))

    def from_tensors(self, stress: Floats) -> Floats:
        """``r`` of stress tensors ``(*shape, k)``."""
        sigma = stress.reshape(len(self.weights), -1)
        # σ·ε = (X⁺ᵀ σ)·x for the strains of the points.
        return np.asarray(self.rest - sigma @ np.linalg.pinv(self.components))

    def to_tensors(self, stress: Floats, before: Floats) -> Floats:
        """Stress tensors ``(*shape, k)`` of ``r``, after a step from tensors ``before``."""
        sigma = (self.rest - stress) @ self.components
        if self.poisson is not None:
            start = before.reshape(sigma.shape)
            change = (sigma - start)[:, :2].sum(axis=1)
            sigma[:, 2] = start[:, 2] + self.poisson * change
        return np.asarray(sigma.reshape(*self.shape, -1))

    def to_strain_tensors(self, flow: Floats) -> Floats:
        """Plastic strain tensors ``(*shape, k)`` of flows."""
        strain = flow @ np.linalg.pinv(self.components).T
        return np.asarray(strain.reshape(*self.shape, -1))

    def from_strain_tensors(self, strain: Floats) -> Floats:
        """Flows of plastic strain tensors ``(*shape, k)``."""
        return np.asarray(
            strain.reshape(len(self.weights), -1) @ self.components.T, np.float64
        )

    def lack_across(self, stress: Floats) -> Floats:
        """How far the stress across the plane is outside the criterion, ``(m,)`` [Pa].

        The criterion of Mohr and Coulomb holds between the largest and the smallest
        principal stress. That of the plane is the criterion if σ_z is neither.
        """
        if self.poisson is None:
            return np.zeros(len(self.weights))
        sigma = stress.reshape(len(self.weights), -1)
        r = self.from_tensors(stress)
        mean, radius = self.apex - r[:, 0], length(r[:, 1:])
        high = np.maximum(mean + radius, sigma[:, 2])
        low = np.minimum(mean - radius, sigma[:, 2])
        limit = self.law.cohesion + self.law.mu * (self.apex - 0.5 * (high + low))
        return np.asarray(0.5 * (high - low) - limit)


def check_ratio(what: str, value: object, least: float, most: float) -> float:
    """A number between two limits, the lower included."""
    ratio = number(what, value)
    if not least <= ratio < most:
        raise ValueError(f"{what} is {ratio:g}, expected {least:g} to below {most:g}")
    return ratio


# Directions over half a circle and over half a sphere.
_ANGLES, _SPIRAL = 3600, 400
# Rings around the best direction of these, one after the other.
_RING = 2 * np.pi * np.arange(12) / 12
# A further step, relative to the flow of the last one.
_SHORT = 1e-7
_RADII = 0.1 * 0.6 ** np.arange(16)
# The least hardening of the rate term in shear moduli, for flow that is nearly associated.
_LEAST = 0.01


def critical_hardening(points: PlasticPoints) -> Floats:
    """The hardening ``H`` of each point in the units of its springs, ``(m,)`` [Pa].

    It is at least 0.01 of them. For other laws than that of Mohr and Coulomb it is an
    estimate, with ``M_n/M_t`` in place of ``1/(1 - 2ν)``.
    """
    ratio = points.stiffness[:, 0] / points.stiffness[:, 1]
    nu = np.clip(0.5 * (1 - 1 / np.maximum(ratio, 0.5)), 0.0, 0.5)
    share = (points.law.mu - points.law.dilatancy) ** 2 / (8 * (1 - nu))
    return np.asarray(points.stiffness[:, 1] * np.maximum(share, _LEAST))


def find_ellipticity(
    points: PlasticPoints, end: PointEnd, rate: Rate | None = None
) -> Floats:
    """The least ``det Q(n)`` relative to the elastic one, of points with tensors.

    The tangent is that of the rates, if the flow goes on: of a short further step. 1 at
    points without flow, and of points whose strains are not tensors.
    """
    slip = length(end.flow[:, 1:])
    shifted = None if rate is None else Rate(rate.hardening, rate.before - slip)
    end = points.respond(_SHORT * end.flow, end.stress, rate=shifted)
    least = np.ones(len(points.weights))
    yields = length(end.flow) > 0
    if points.components.shape[1] == 6 and yields.any():
        X, M = points.components, points.springs[yields]
        tangent = np.einsum(
            "ki,mkl,ml,lj->mij", X, end.jacobian[yields], M, X, optimize=True
        )
        elastic = np.einsum("ki,mk,kj->mij", X, M, X)
        plane = not X[:, 3:5].any()
        least[yields] = _find_least(tangent, plane) / _find_least(elastic, plane)
    return least.reshape(points.shape)


def _find_least(tangent: Floats, plane: bool) -> Floats:
    """The least ``det Q`` over the directions."""
    if not plane:
        k = np.arange(_SPIRAL) + 0.5
        best = _determinants(tangent, _spiral(k / _SPIRAL, np.sqrt(_SPIRAL)))
        at = _spiral(k / _SPIRAL, np.sqrt(_SPIRAL))[best.argmin(axis=1)]
        least = best.min(axis=1)
        around = np.stack([np.cos(_RING), np.sin(_RING)], axis=1)
        for radius in _RADII:
            # A frame across each direction, and a ring of directions around it.
            across = np.cross(at, np.eye(3)[np.abs(at).argmin(axis=1)])
            across /= length(across)[:, None]
            frame = np.stack([across, np.cross(at, across)], axis=1)
            ring = at[:, None] + radius * np.einsum("qk,mkd->mqd", around, frame)
            ring /= length(ring)[..., None]
            values = _determinants(tangent, ring)
            rows, near = np.arange(len(at)), values.argmin(axis=1)
            falls = values[rows, near] < least
            at = np.where(falls[:, None], ring[rows, near], at)
            least = np.minimum(least, values[rows, near])
        return np.asarray(least)
    # In the plane det Q is a trigonometric polynomial of five terms, known from five angles.
    few = np.pi * np.arange(5) / 5
    values = _determinants(tangent, np.stack([np.cos(few), np.sin(few)], axis=1))
    terms = np.linalg.solve(_waves(few), values.T)
    return np.asarray(
        (_waves(np.pi * np.arange(_ANGLES) / _ANGLES) @ terms).min(axis=0)
    )


def _spiral(share: Floats, turns: float) -> Floats:
    """Directions over half a sphere, evenly."""
    flat, angle = np.sqrt(share * (2 - share)), 2 * np.pi * turns * share
    return np.stack([flat * np.cos(angle), flat * np.sin(angle), 1 - share], axis=1)


def _waves(angles: Floats) -> Floats:
    """``1, cos 2θ, sin 2θ, cos 4θ, sin 4θ``, ``(angles, 5)``."""
    twice = 2 * angles
    terms = [np.ones_like(angles)]
    terms += [wave(k * twice) for k in (1, 2) for wave in (np.cos, np.sin)]
    return np.stack(terms, axis=1)


def _determinants(tangent: Floats, directions: Floats) -> Floats:
    """``det Q(n)`` in directions ``(q, d)``, or ``(m, q, d)`` of each point: ``(m, q)``."""
    d, root = directions.shape[-1], 1 / np.sqrt(2)
    # Vectors of the tensors sym(e_i ⊗ n) of unit vectors e_i.
    along = np.zeros((*directions.shape, 6))
    for i in range(d):
        along[..., i, i] = directions[..., i]
    for row, (i, j) in zip((5, 4, 3), ((0, 1), (0, 2), (1, 2)), strict=True):
        if j < d:
            along[..., i, row] = root * directions[..., j]
            along[..., j, row] = root * directions[..., i]
    left = along @ tangent[:, None]
    return np.asarray(np.linalg.det(left @ np.swapaxes(along, -1, -2)))
