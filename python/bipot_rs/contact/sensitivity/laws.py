"""The contact law, linearised at a solution: one linear equation for each component (33).

The slip of a step is ``s``, and ``D`` holds the friction coefficients along the tangents.
With ``p = D s / ‖D s‖`` and ``ρ = D⁻¹ r_t``, a sliding contact has ``ρ = - r_n p``. Its
derivative along ``p`` and along ``p⊥``, which is normal to it, is

    p·dρ + dr_n = 0,        ‖D s‖ p⊥·dρ + r_n p⊥·d(D s) = 0,

with ``dρ = D⁻¹ (dr_t - dD ρ)``. Both stay well scaled if ``s`` or ``r_n`` is small.

With cohesion ``c`` and dilatancy ``β`` there is one coefficient, ``r_t = - l p`` with the limit
``l = c + μ r_n``, and

    dv_n = β p·ds + ‖s‖ dβ,    p·dr_t + μ dr_n = - r_n dμ - dc,    ‖s‖ p⊥·dr_t + l p⊥·ds = 0.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bipot_rs._lib.matrices import length
from bipot_rs._lib.types import Bools, Floats, Ints
from bipot_rs.contact.law.status import Status

# A share of the cohesion below which rounding cannot hide that an open contact sticks.
_AT_LIMIT = 1e-6


@dataclass(frozen=True)
class Point:
    """The contacts at the solution of one step."""

    reaction: Floats  # (n_c, d)
    opening: Floats  # (n_c,): normal relative displacement
    slip: Floats  # (n_c, d - 1): slip of the step
    status: Ints  # (n_c,)
    friction: Floats  # (n_c, d - 1): coefficients along the tangents
    # cohesion, dilatancy (n_c,): cohesion that is left, and dilatancy; None if they are zero.
    cohesion: Floats | None = None
    dilatancy: Floats | None = None

    @property
    def limit(self) -> tuple[Floats, Floats]:
        """Cohesion and dilatancy ``(n_c,)``, zero where there is none."""
        zero = np.zeros(len(self.opening))
        return (
            zero if self.cohesion is None else self.cohesion,
            zero if self.dilatancy is None else self.dilatancy,
        )

    @property
    def is_coulomb(self) -> Bools:
        """Contacts without cohesion and dilatancy."""
        cohesion, dilatancy = self.limit
        return np.asarray((cohesion == 0) & (dilatancy == 0))


@dataclass(frozen=True)
class Laws:
    """``by_r dr + by_v dv = by_mu dD + by_rest (dc, dβ)`` at some contacts.

    ``dv`` has the slip increment as its tangential part.
    """

    contacts: Ints  # (m,): numbers of the contacts; at all others `dr = 0`
    by_r: Floats  # (m, d, d)
    by_v: Floats  # (m, d, d)
    by_mu: Floats  # (m, d, d - 1)
    by_rest: Floats  # (m, d, 2)

    @property
    def parts(self) -> tuple[Ints, Floats, Floats]:
        """``contacts``, and ``by_r`` and ``by_v`` by rows ``(m d, d)``, as the core takes them."""
        d = self.by_r.shape[1]
        return self.contacts, self.by_r.reshape(-1, d), self.by_v.reshape(-1, d)

    def adjoint(self, w: Floats, mu: Floats) -> tuple[Floats, Floats]:
        """``Cᵀ w`` of multipliers ``w (n_c, d)``, and ``Mᵀ w`` shaped as ``mu`` (34)."""
        at, of_contacts = self.contacts, w[self.contacts]
        pulled, rubbed = np.zeros_like(w), np.zeros_like(mu)
        pulled[at] = np.einsum("ijk,ij->ik", self.by_v, of_contacts)
        along = np.einsum("ijk,ij->ik", self.by_mu, of_contacts)
        rubbed[at] = along if mu.ndim == 2 else along.sum(axis=1)
        return pulled, rubbed

    def adjoint_rest(self, w: Floats) -> Floats:
        """Derivatives by cohesion and dilatancy, ``(n_c, 2)``, of multipliers ``w``."""
        rest = np.zeros((len(w), 2))
        rest[self.contacts] = np.einsum("ijk,ij->ik", self.by_rest, w[self.contacts])
        return rest


def find_directions(point: Point, scale: Floats) -> Floats:
    """Direction ``p`` of the slip of each contact, ``(n_c, d - 1)``; zero if unknown.

    The reaction and the slip both have it; the one that is larger, in variables that
    ``scale`` makes comparable, has more digits.
    """
    D = np.where(point.friction > 0, point.friction, 1.0)
    of_slip = D * point.slip
    of_reaction = -point.reaction[:, 1:] / D
    slips, pushes = length(of_slip), length(of_reaction)
    rough = point.friction[:, 0] > 0
    # s / √w and r √w have the same unit.
    larger = rough & (pushes * scale**2 >= slips)
    chosen = np.where(larger[:, None], of_reaction, of_slip)
    size = np.where(larger, pushes, slips)[:, None]
    return np.divide(chosen, size, where=size > 0, out=np.zeros_like(chosen))


def linearise_laws(point: Point, side: Ints, direction: Floats, movable: Bools) -> Laws:
    """The law of each contact that is not open, on one side of its borders.

    ``side``: `Status` of each contact, ``(n_c,)``.
    ``direction``: direction of slip, ``(n_c, d - 1)``, as `find_directions`.
    ``movable``: components that a reaction moves, ``(n_c, d)``. The reaction of others is kept
    where the law holds them.
    """
    cohesion, _ = point.limit
    contacts = np.flatnonzero((side != Status.OPEN) | (cohesion > 0))
    d = point.reaction.shape[1]
    by_r = np.zeros((len(contacts), d, d))
    by_v = np.zeros_like(by_r)
    by_mu = np.zeros((len(contacts), d, d - 1))
    by_rest = np.zeros((len(contacts), d, 2))
    by_v[:, 0, 0] = 1.0
    sticks = side[contacts] == Status.STICK
    # Cohesion holds the tangents of an open contact, or limits its shear.
    apart = side[contacts] == Status.OPEN
    by_v[apart, 0, 0], by_r[apart, 0, 0] = 0.0, 1.0
    shear = length(point.reaction[contacts, 1:])
    sticks |= apart & (shear < (1.0 - _AT_LIMIT) * cohesion[contacts])
    k = np.arange(1, d)
    by_v[np.ix_(sticks, k, k)] = np.eye(d - 1)
    slides = ~sticks
    at = contacts[slides]
    rough, coulomb = point.friction[at, 0] > 0, point.is_coulomb[at]
    parts = (by_r, by_v, by_mu)
    smooth = coulomb & ~rough
    for some, law in ((~smooth, _linearise_sliding), (smooth, _linearise_frictionless)):
        rows = np.flatnonzero(slides)[some]
        for part, value in zip(parts, law(point, at[some], direction), strict=True):
            part[rows, 1:] = value
    _add_rest(point, contacts, slides, direction, by_v, by_rest)
    held = ~movable[contacts] & (np.abs(by_r).max(axis=2, initial=0.0) == 0)
    by_v[held] = 0.0
    by_mu[held] = 0.0
    by_rest[held] = 0.0
    i, k = np.nonzero(held)
    by_r[i, k, k] = 1.0
    return Laws(contacts, by_r, by_v, by_mu, by_rest)


def _add_rest(
    point: Point,
    contacts: Ints,
    slides: Bools,
    direction: Floats,
    by_v: Floats,
    by_rest: Floats,
) -> None:
    """Add dilatancy, and the derivatives by cohesion and dilatancy, to sliding contacts."""
    at = contacts[slides]
    p, D = direction[at], point.friction[at]
    _, dilatancy = point.limit
    closed = by_v[slides, 0, 0] > 0
    by_v[slides, 0, 1:] -= (closed * dilatancy[at])[:, None] * p
    by_rest[slides, 0, 1] = closed * length(point.slip[at])
    # The row of ``p·dρ`` of Coulomb's law is divided by μ; without friction the rows are dr_t.
    coulomb, rough = point.is_coulomb[at], D[:, 0] > 0
    along = np.where(coulomb & rough, 1.0 / np.where(rough, D[:, 0], 1.0), 1.0)
    of_tangents = np.zeros_like(p)
    of_tangents[:, 0] = along
    of_tangents[coulomb & ~rough] = p[coulomb & ~rough]
    by_rest[slides, 1:, 0] = -of_tangents


def _linearise_sliding(
    point: Point, at: Ints, direction: Floats
) -> tuple[Floats, Floats, Floats]:
    """Tangential rows of sliding contacts with friction, cohesion or dilatancy."""
    coulomb, mu = point.is_coulomb[at], point.friction[at, 0]
    r_n, s, p = point.reaction[at, 0], point.slip[at], direction[at]
    # With cohesion or dilatancy the rows are those of r_t itself, else those of ρ.
    D = np.where(coulomb[:, None], point.friction[at], 1.0)
    limit = np.where(coulomb, r_n, point.limit[0][at] + mu * r_n)
    m, tangents_of = p.shape
    by_r = np.zeros((m, tangents_of, tangents_of + 1))
    by_v, by_mu = np.zeros_like(by_r), np.zeros((m, tangents_of, tangents_of))
    by_r[:, 0, 0] = np.where(coulomb, 1.0, mu)
    by_r[:, 0, 1:] = p / D
    # A change of μ is one of both coefficients, of which each has its share.
    by_mu[:, 0] = -r_n[:, None] * p * p / D
    if tangents_of == 2:
        across = np.stack([-p[:, 1], p[:, 0]], axis=1)
        far = length(D * s)
        by_r[:, 1, 1:] = far[:, None] * across / D
        by_v[:, 1, 1:] = limit[:, None] * across * D
        turned = -r_n[:, None] * across * (far[:, None] * p / D + s)
        by_mu[:, 1] = np.where(coulomb[:, None], turned, 0.0)
    return by_r, by_v, by_mu


def _linearise_frictionless(
    point: Point, at: Ints, direction: Floats
) -> tuple[Floats, Floats, Floats]:
    """Tangential rows of contacts without friction: ``dr_t = - r_n dD p``."""
    p, r_n = direction[at], point.reaction[at, 0]
    m, tangents_of = p.shape
    by_r = np.zeros((m, tangents_of, tangents_of + 1))
    by_mu = np.zeros((m, tangents_of, tangents_of))
    k = np.arange(tangents_of)
    by_r[:, k, k + 1] = 1.0
    by_mu[:, k, k] = -r_n[:, None] * p
    return by_r, np.zeros_like(by_r), by_mu
