"""`ContactLaw`: the numbers of the law of each contact, which all layers hand on whole."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from bipot_rs._lib.short_repr import short_repr
from bipot_rs._lib.types import Floats
from bipot_rs._lib.validation import RATIO, by_contact, friction


@dataclass(frozen=True, eq=False)
class ContactLaw:
    """The numbers of the law of each contact, ``|r_t| <= c + mu r_n``, ``v_n >= beta |v_t|``.

    Coulomb's law (8) has no cohesion ``c`` and no dilatancy ``beta``. The core reads the
    attributes by their names (`LawArrays` in ``src/python/arrays.rs``) and checks each number.
    """

    mu: Floats  # (n_c,) or (n_c, 2): friction coefficients
    # (n_c,): cohesion, a force, zero or positive; `None` if it is zero at all contacts.
    cohesion: Floats | None = None
    # (n_c,): dilatancy, from zero to `mu`; `None` if it is zero at all contacts.
    dilatancy: Floats | None = None

    __repr__ = short_repr

    @classmethod
    def check(
        cls,
        contacts: int,
        d: int,
        *,
        mu: ArrayLike,
        cohesion: ArrayLike | None = None,
        dilatancy: ArrayLike | None = None,
        ratio: float = RATIO,
    ) -> ContactLaw:
        """Check the arguments of a problem that are about its law.

        The two coefficients of one contact are within a factor ``ratio`` of each other.

        Raises `TypeError` or `ValueError`: an argument is wrong; the message names it.
        """
        law = cls(
            friction(mu, contacts, d, ratio=ratio),
            _check_number("cohesion", cohesion, contacts),
            _check_number("dilatancy", dilatancy, contacts),
        )
        for what in ("cohesion", "dilatancy"):
            values = getattr(law, what)
            if law.mu.ndim == 2 and values is not None:
                at = int(np.flatnonzero(values)[0])
                raise ValueError(
                    f"mu has two coefficients of each contact and {what} of contact {at} is "
                    f"{values[at]}: give one coefficient of each contact, or no {what}"
                )
        return law

    @property
    def is_coulomb(self) -> bool:
        """Whether there is neither cohesion nor dilatancy."""
        return self.cohesion is None and self.dilatancy is None

    def require_coulomb(self, what: str) -> None:
        """Refuse cohesion and dilatancy, for ``what`` does not take them.

        Raises `ValueError`: a contact has one of them; the message names it.
        """
        for argument in ("cohesion", "dilatancy"):
            values = getattr(self, argument)
            if values is not None:
                at = int(np.flatnonzero(values)[0])
                raise ValueError(
                    f"{what} does not take {argument}, which is {values[at]} at contact {at}"
                )

    def arrays(self) -> dict[str, Floats]:
        """Arrays by the names of `Result.contacts`, for files and for comparison."""
        numbers = {
            "mu": self.mu,
            "cohesion": self.cohesion,
            "dilatancy": self.dilatancy,
        }
        return {name: value for name, value in numbers.items() if value is not None}


def _check_number(what: str, value: ArrayLike | None, contacts: int) -> Floats | None:
    """One number of each contact, or ``None`` if all are zero."""
    if value is None:
        return None
    numbers = by_contact(what, value, contacts)
    return numbers if numbers.any() else None
