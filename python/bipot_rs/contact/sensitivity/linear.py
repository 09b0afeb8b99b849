"""The linearised problem of one step, with each contact on one side of its borders."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bipot_rs._lib.types import Bools, Floats, Ints
from bipot_rs.contact.errors import NotDifferentiableError
from bipot_rs.contact.law.status import Status
from bipot_rs.contact.sensitivity.borders import Borders
from bipot_rs.contact.sensitivity.laws import (
    Laws,
    Point,
    find_directions,
    linearise_laws,
)
from bipot_rs.contact.sensitivity.response import ContactResponse, System, make_system


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

    def system(self, own: Laws) -> System:
        """The system (33) of these laws."""
        contacts, d = self.point.reaction.shape
        return make_system(self.response, own, (contacts, d))


def make_right_side(own: Laws, of: StepChange) -> Floats:
    """Right side of (33)."""
    at = own.contacts
    moved = np.einsum("ijk,ik->ij", own.by_v, of.free[at])
    rubbed = np.einsum("ijk,ik->ij", own.by_mu, of.friction[at])
    if of.rest is not None:
        rubbed = rubbed + np.einsum("ijk,ik->ij", own.by_rest, of.rest[at])
    return np.asarray(rubbed - moved, np.float64)
