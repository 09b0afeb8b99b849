"""`ContactLaw`: the numbers of the law of each contact, which all layers hand on whole."""

from __future__ import annotations

from dataclasses import dataclass

from numpy.typing import ArrayLike

from bipot_rs._lib.types import Floats
from bipot_rs._lib.validation import RATIO, friction


@dataclass(frozen=True, eq=False)
class ContactLaw:
    """The numbers of the law (8) of each contact, checked.

    The core reads the attributes by their names (`LawArrays` in ``src/python/arrays.rs``).

    Attributes
    ----------
    mu : (n_c,) or (n_c, 2)
        Friction coefficients.
    """

    mu: Floats

    @classmethod
    def check(cls, contacts: int, d: int, *, mu: ArrayLike) -> ContactLaw:
        """Check the arguments of a problem that are about its law.

        Raises
        ------
        TypeError, ValueError
            An argument is wrong; the message names it.
        """
        return cls(friction(mu, contacts, d, ratio=RATIO))

    def arrays(self) -> dict[str, Floats]:
        """Arrays by the names of `Result.contacts`, for files and for comparison."""
        return {"mu": self.mu}
