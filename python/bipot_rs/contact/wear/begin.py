"""Check the arguments of `ContactProblem.wear`, and begin."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from bipot_rs._lib.types import Floats
from bipot_rs._lib.validation import by_contact, number
from bipot_rs.contact.path.load_path import state
from bipot_rs.contact.wear.record import State, Wear

if TYPE_CHECKING:
    from bipot_rs.contact.results.state import Start


def coefficients(value: ArrayLike, contacts: int) -> Floats:
    """Wear coefficients ``(n_c,)``, none negative."""
    found = by_contact("coefficient", value, contacts)
    if (found < 0).any():
        k = int(np.argmax(found < 0))
        raise ValueError(
            f"coefficient of contact {k} is {found[k]:g}, expected zero or a positive "
            "number: depth = coefficient * pressure * slip"
        )
    return found


def relative(rtol: float) -> float:
    """The allowed relative error."""
    found = number("rtol", rtol)
    if not 0 < found < 1:
        raise ValueError(f"rtol is {found:g}, expected a number between 0 and 1")
    return found


def begun(start: Wear | Start | None, shape: tuple[int, int]) -> State:
    """Where the first cycle starts."""
    contacts, d = shape
    if not isinstance(start, Wear):
        at = state(start, contacts, d)
        if at is not None and at.wear is not None:
            raise ValueError(
                "start is a step of worn contacts: pass the whole Wear to continue it"
            )
        return State.first(at, contacts)
    known: Any = start._state
    if known.depth.shape != (contacts,):
        raise ValueError(
            f"start has the wear of {len(known.depth)} contacts, expected {contacts}"
        )
    state(known.at, contacts, d)
    return start._state
