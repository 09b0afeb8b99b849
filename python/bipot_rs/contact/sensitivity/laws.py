"""The contact law, linearised at a solution: one linear equation for each component (33).

The slip of a step is ``s``, and ``D`` holds the friction coefficients along the tangents.
With ``p = D s / ‖D s‖`` and ``ρ = D⁻¹ r_t``, a sliding contact has ``ρ = - r_n p``. Its
derivative along ``p`` and along ``p⊥``, which is normal to it, is

    p·dρ + dr_n = 0,        ‖D s‖ p⊥·dρ + r_n p⊥·d(D s) = 0,

with ``dρ = D⁻¹ (dr_t - dD ρ)``. Both stay well scaled if ``s`` or ``r_n`` is small.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bipot_rs._lib.types import Bools, Floats, Ints
from bipot_rs.contact.law.status import Status


@dataclass(frozen=True)
class Point:
    """The contacts at the solution of one step.

    Attributes
    ----------
    reaction : (n_c, d)
    opening : (n_c,)
        Normal relative displacement.
    slip : (n_c, d - 1)
        Slip of the step.
    status : (n_c,)
    friction : (n_c, d - 1)
        Coefficients along the tangents.
    """

    reaction: Floats
    opening: Floats
    slip: Floats
    status: Ints
    friction: Floats


@dataclass(frozen=True)
class Laws:
    """``by_r dr + by_v dv = by_mu dD`` at some contacts, ``dv`` with the slip increment.

    Attributes
    ----------
    contacts : (m,)
        Numbers of the contacts; at all others ``dr = 0``.
    by_r, by_v : (m, d, d)
    by_mu : (m, d, d - 1)
    """

    contacts: Ints
    by_r: Floats
    by_v: Floats
    by_mu: Floats

    def adjoint(self, w: Floats, mu: Floats) -> tuple[Floats, Floats]:
        """``Cᵀ w`` of multipliers ``w (n_c, d)``, and ``Mᵀ w`` shaped as ``mu`` (34)."""
        at, of_contacts = self.contacts, w[self.contacts]
        pulled, rubbed = np.zeros_like(w), np.zeros_like(mu)
        pulled[at] = np.einsum("ijk,ij->ik", self.by_v, of_contacts)
        along = np.einsum("ijk,ij->ik", self.by_mu, of_contacts)
        rubbed[at] = along if mu.ndim == 2 else along.sum(axis=1)
        return pulled, rubbed


def find_directions(point: Point, scale: Floats) -> Floats:
    """Direction ``p`` of the slip of each contact, ``(n_c, d - 1)``; zero if unknown.

    The reaction and the slip both have it; the one that is larger, in variables that
    ``scale`` makes comparable, has more digits.
    """
    D = np.where(point.friction > 0, point.friction, 1.0)
    of_slip = D * point.slip
    of_reaction = -point.reaction[:, 1:] / D
    slips, pushes = _measure_length(of_slip), _measure_length(of_reaction)
    rough = point.friction[:, 0] > 0
    # s / √w and r √w have the same unit.
    larger = rough & (pushes * scale**2 >= slips)
    chosen = np.where(larger[:, None], of_reaction, of_slip)
    size = np.where(larger, pushes, slips)[:, None]
    return np.divide(chosen, size, where=size > 0, out=np.zeros_like(chosen))


def linearise_laws(point: Point, side: Ints, direction: Floats, movable: Bools) -> Laws:
    """The law of each contact that is not open, on one side of its borders.

    Parameters
    ----------
    side
        `Status` of each contact, ``(n_c,)``.
    direction
        Direction of slip, ``(n_c, d - 1)``, as `find_directions`.
    movable
        Components that a reaction moves, ``(n_c, d)``. The reaction of others is kept
        where the law holds them.
    """
    contacts = np.flatnonzero(side != Status.OPEN)
    d = point.reaction.shape[1]
    by_r = np.zeros((len(contacts), d, d))
    by_v = np.zeros_like(by_r)
    by_mu = np.zeros((len(contacts), d, d - 1))
    by_v[:, 0, 0] = 1.0
    sticks = side[contacts] == Status.STICK
    k = np.arange(1, d)
    by_v[np.ix_(sticks, k, k)] = np.eye(d - 1)
    slides = ~sticks
    at = contacts[slides]
    rough = point.friction[at, 0] > 0
    parts = (by_r, by_v, by_mu)
    for some, law in ((rough, _linearise_sliding), (~rough, _linearise_frictionless)):
        rows = np.flatnonzero(slides)[some]
        for part, value in zip(parts, law(point, at[some], direction), strict=True):
            part[rows, 1:] = value
    held = ~movable[contacts] & (np.abs(by_r).max(axis=2, initial=0.0) == 0)
    by_v[held] = 0.0
    by_mu[held] = 0.0
    i, k = np.nonzero(held)
    by_r[i, k, k] = 1.0
    return Laws(contacts, by_r, by_v, by_mu)


def _linearise_sliding(
    point: Point, at: Ints, direction: Floats
) -> tuple[Floats, Floats, Floats]:
    """Tangential rows of sliding contacts with friction."""
    r_n, s, D = point.reaction[at, 0], point.slip[at], point.friction[at]
    p = direction[at]
    m, tangents_of = p.shape
    by_r = np.zeros((m, tangents_of, tangents_of + 1))
    by_v, by_mu = np.zeros_like(by_r), np.zeros((m, tangents_of, tangents_of))
    by_r[:, 0, 0] = 1.0
    by_r[:, 0, 1:] = p / D
    by_mu[:, 0] = -r_n[:, None] * p * p / D
    if tangents_of == 2:
        across = np.stack([-p[:, 1], p[:, 0]], axis=1)
        far = _measure_length(D * s)
        by_r[:, 1, 1:] = far[:, None] * across / D
        by_v[:, 1, 1:] = r_n[:, None] * across * D
        by_mu[:, 1] = -r_n[:, None] * across * (far[:, None] * p / D + s)
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


def _measure_length(rows: Floats) -> Floats:
    lengths: Floats = np.linalg.norm(rows, axis=1)
    return lengths
