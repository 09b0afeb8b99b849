"""Contacts on a border between two statuses, where only one-sided derivatives exist."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bipot_rs._lib.types import Bools, Floats
from bipot_rs.contact.sensitivity.laws import Point

# Distance to a border below which a contact counts as on it, in tolerances of the step times
# the largest terms: the certificate of a converged step allows as large a penetration.
_TOLERANCES = 10.0
# A sticking contact is at the friction limit only if it uses at least this share of it, also
# where the limit is smaller than the tolerance.
_USED = 0.5


@dataclass(frozen=True)
class Borders:
    """Contacts on borders, each ``(n_c,)``."""

    touching: Bools  # just touches: `v_n = 0` and `r_n = 0`
    yielding: Bools  # at the friction limit without slip
    # Touches, and has neither slip nor reaction: all three statuses meet. Part of `touching`.
    resting: Bools

    @property
    def any(self) -> Bools:
        """Contacts on a border."""
        bordering: Bools = self.touching | self.yielding
        return bordering


@dataclass(frozen=True)
class Terms:
    """Sizes of the terms whose sum is ``v``, which cancel where a contact touches."""

    moved: Floats  # (n_c,): of those at the contact [length]
    # Work of the loads and of the prescribed displacements, without cancellation. A
    # displacement `v` that it causes has `v² / w ≤ work`.
    work: float = 0.0


def find_borders(
    point: Point, compliance: Floats, tolerance: float, terms: Terms
) -> Borders:
    """The contacts that are on a border up to the tolerance of the step.

    ``compliance``: mean of the diagonal of each block of W, ``(n_c,)``; zero if not known.
    ``tolerance``: relative tolerance of η, which the step met.
    ``terms``: what cancels in the relative displacement.
    """
    movable = compliance > 0
    root = np.sqrt(np.where(movable, compliance, 1.0))
    # As in the certificate (13): r √w and v / √w have the same unit.
    r = point.reaction * root[:, None]
    opening = np.abs(point.opening) / root
    slip = np.linalg.norm(point.slip, axis=1) / root
    moved = terms.moved / root
    # Contacts far away from each other say nothing about those that meet.
    meets = movable & ((r[:, 0] > 0) | (opening <= _TOLERANCES * tolerance * moved))
    size = max(
        float(np.linalg.norm(r)),
        float(moved[meets].max(initial=0.0)),
        float(np.sqrt(terms.work)),
    )
    near = _TOLERANCES * tolerance * size
    rough = point.friction[:, 0] > 0
    D = np.where(point.friction > 0, point.friction, 1.0)
    left = r[:, 0] - np.linalg.norm(r[:, 1:] / D, axis=1)
    # Distance to the surface of the cone of friction, whose slope is the coefficient.
    slope = D.min(axis=1)
    aside = left * slope / np.hypot(1.0, slope)
    limit = (aside <= near) & (left <= (1.0 - _USED) * r[:, 0])
    cohesion = point.limit[0] * root
    sticky = cohesion > 0
    if sticky.any():
        mu = point.friction[:, 0]
        most = cohesion + mu * r[:, 0]
        left = most - np.linalg.norm(r[:, 1:], axis=1)
        of_cohesion = (left / np.hypot(1.0, mu) <= near) & (
            left <= (1.0 - _USED) * most
        )
        limit, rough = np.where(sticky, of_cohesion, limit), rough | sticky
    touching = movable & (np.maximum(r[:, 0], opening) <= near)
    still = slip <= near
    return Borders(
        touching=touching,
        yielding=movable & rough & ~touching & (r[:, 0] > 0) & still & limit,
        resting=touching & rough & still,
    )
