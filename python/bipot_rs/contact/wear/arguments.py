"""Check the arguments of `ContactProblem.wear`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from bipot_rs._lib.types import Floats
from bipot_rs._lib.validation import by_contact, integer, logical, number
from bipot_rs.contact.path.contacts import Contacts
from bipot_rs.contact.path.load_path import find_start
from bipot_rs.contact.wear.record import Wear, WearState

if TYPE_CHECKING:
    from bipot_rs.contact.results.state import Start


@dataclass(frozen=True, eq=False)
class WearArguments:
    """The arguments of `ContactProblem.wear`, checked."""

    contacts: Contacts  # the contacts, whose areas are known
    # area, coefficient (n_c,): tributary areas, wear coefficients [1/stress].
    area: Floats
    coefficient: Floats
    cycles: int  # number of cycles
    jump: bool  # whether cycles may be jumped over
    rtol: float  # allowed error of the depth, relative to the largest depth
    state: WearState  # where the first cycle starts


def check_wear(
    contacts: Contacts,
    coefficient: ArrayLike,
    cycles: int,
    jump: bool,
    rtol: float,
    start: Wear | Start | None,
) -> WearArguments:
    """Check the arguments that are about wear.

    Raises `TypeError` or `ValueError`: an argument is wrong, or the areas are not known; the
    message names it.
    """
    if contacts.count == 0:
        raise ValueError("the problem has no contacts, which could wear")
    if contacts.area is None:
        raise ValueError(
            "area is missing: wear needs pressures, so pass area= to ContactProblem"
        )
    for what in ("cohesion", "dilatancy"):
        if getattr(contacts.law, what) is not None:
            raise ValueError(
                f"{what} is not zero, expected none: wear is not derived for contacts with "
                f"{what}"
            )
    coefficients = by_contact("coefficient", coefficient, contacts.count)
    if (coefficients < 0).any():
        k = int(np.argmax(coefficients < 0))
        raise ValueError(
            f"coefficient of contact {k} is {coefficients[k]:g}, expected zero or a "
            "positive number: depth = coefficient * pressure * slip"
        )
    count = integer("cycles", cycles, least=1)
    logical("jump", jump)
    share = number("rtol", rtol)
    if not 0 < share < 1:
        raise ValueError(f"rtol is {share:g}, expected a number between 0 and 1")
    state = _find_state(start, contacts.shape)
    return WearArguments(
        contacts, contacts.area, coefficients, count, jump, share, state
    )


def _find_state(start: Wear | Start | None, shape: tuple[int, int]) -> WearState:
    """Where the first cycle starts."""
    if not isinstance(start, Wear):
        step = find_start(start, shape)
        if step is not None and step.wear is not None:
            raise ValueError(
                "start is a step of worn contacts: pass the whole Wear to continue it"
            )
        return WearState.begin(step, shape[0])
    state = start.state
    if state.depth.shape != shape[:1]:
        raise ValueError(
            f"start has the wear of {len(state.depth)} contacts, expected {shape[0]}: "
            "continue the Wear of the same problem"
        )
    find_start(state.at, shape)
    return state
