"""The linearised problem of one step: its contacts on borders, each on one side of them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bipot_rs._lib.types import Bools, Floats, Ints
from bipot_rs.contact.errors import NotDifferentiableError
from bipot_rs.contact.law.status import Status
from bipot_rs.contact.sensitivity.laws import (
    Laws,
    Point,
    find_directions,
    linearise_laws,
)
from bipot_rs.contact.sensitivity.response import ContactResponse, System, make_system

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


def find_borders(
    point: Point,
    compliance: Floats,
    tolerance: float,
    moved: Floats,
    work: float = 0.0,
) -> Borders:
    """The contacts that are on a border up to the tolerance of the step.

    ``compliance``: mean of the diagonal of each block of W, ``(n_c,)``; zero if not known.
    ``tolerance``: relative tolerance of η, which the step met.
    ``moved``: sizes of the terms whose sum is ``v``, ``(n_c,)``; they cancel in a touching one.
    ``work``: that of loads and prescribed displacements, without cancellation. A displacement
    ``v`` that it causes has ``v² / w ≤ work``.
    """
    movable = compliance > 0
    root = np.sqrt(np.where(movable, compliance, 1.0))
    # As in the certificate (13): r √w and v / √w have the same unit.
    r = point.reaction * root[:, None]
    opening = np.abs(point.opening) / root
    slip = np.linalg.norm(point.slip, axis=1) / root
    moved = moved / root
    # Contacts far away from each other say nothing about those that meet.
    meets = movable & ((r[:, 0] > 0) | (opening <= _TOLERANCES * tolerance * moved))
    size = max(
        float(np.linalg.norm(r)),
        float(moved[meets].max(initial=0.0)),
        float(np.sqrt(work)),
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


@dataclass(frozen=True)
class StepChange:
    """Changes of the data of a step."""

    # (n_c, d): `dq`, with the change of the gap, less that of the slip before in its tangential
    # components.
    free: Floats
    balance: Floats  # (k,): `de`
    friction: Floats  # (n_c, d - 1): `dD`
    rest: Floats | None = None  # (n_c, 2): `dc` and `dβ`; None for zero


class LinearisedStep:
    """The linearised problem of one step.

    ``point``: its solution.
    ``borders``: contacts on borders.
    """

    def __init__(
        self, response: ContactResponse, point: Point, borders: Borders
    ) -> None:
        self.response, self.point, self.borders = response, point, borders
        self._scale = np.sqrt(response.diagonal.mean(axis=1))
        self.movable: Bools = response.movable()
        self._reported: System | None = None

    @property
    def reported(self) -> System:
        """The system with each border contact on the side of its reported status."""
        if self._reported is None:
            laws = self.laws(self.point.status, self.direction)
            self._reported = self.system(laws)
        return self._reported

    def adjoint(self) -> System:
        """`reported`, for gradients.

        Raises `NotDifferentiableError`: it is singular, also with the contacts that just touch
        closed: reactions are then not determined beside this point.
        """
        self.refuse_borders(self.borders.touching)
        touching = self.borders.touching & (self.point.status == Status.OPEN)
        if touching.any():
            side = self.point.status.copy()
            side[touching] = Status.SLIP
            side[touching & self.borders.resting] = Status.STICK
            self.system(self.laws(side, self.direction))
        return self.reported

    def refuse_borders(self, borders: Bools) -> None:
        """Raise for contacts with cohesion or dilatancy on these borders."""
        at = np.flatnonzero(borders & ~self.point.is_coulomb)
        if at.size:
            raise NotDifferentiableError(
                f"contact {at[0]} with cohesion or dilatancy is on a border between two "
                "statuses, where its one-sided derivatives are not derived; change the load "
                "a little"
            )

    @property
    def direction(self) -> Floats:
        """Direction of slip of each contact."""
        return find_directions(self.point, self._scale)

    def laws(self, side: Ints, direction: Floats) -> Laws:
        """The law of each contact on a side of its borders."""
        return linearise_laws(self.point, side, direction, self.movable)

    def system(self, laws: Laws) -> System:
        """The system (33) of these laws."""
        contacts, d = self.point.reaction.shape
        return make_system(self.response, laws, (contacts, d))


def make_right_side(laws: Laws, of: StepChange) -> Floats:
    """Right side of (33)."""
    at = laws.contacts
    moved = np.einsum("ijk,ik->ij", laws.by_v, of.free[at])
    rubbed = np.einsum("ijk,ik->ij", laws.by_mu, of.friction[at])
    if of.rest is not None:
        rubbed = rubbed + np.einsum("ijk,ik->ij", laws.by_rest, of.rest[at])
    return np.asarray(rubbed - moved, np.float64)
