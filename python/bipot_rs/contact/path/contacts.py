"""`ContactSet`: where bodies may touch, and the friction and gaps there."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from bipot_rs._lib.messages import count_noun
from bipot_rs._lib.records import short_repr
from bipot_rs._lib.types import AnyArray, Floats
from bipot_rs._lib.validation import (
    Csr,
    areas,
    by_component,
    choice_of_dimension,
    contact_array,
    floats,
    frames,
)
from bipot_rs.contact.law.contact_law import ContactLaw


@dataclass(frozen=True, eq=False)
class ContactSet:
    """The contacts of a problem, checked."""

    operator: Csr  # (d n_c, n): B
    d: int  # number of components of a contact
    gap: Floats  # (n_c,) or (n_c, d): gaps at the start, as the caller gave them
    law: ContactLaw  # numbers of the law of each contact
    area: Floats | None = None  # (n_c,) or None: tributary areas
    x: Floats | None = None  # (n_c, d) or None: coordinates
    # (n_c, d, d) or None: local bases, with rows n, t1[, t2].
    frame: Floats | None = None

    __repr__ = short_repr

    @classmethod
    def check(
        cls,
        operator: Csr,
        *,
        gap: ArrayLike,
        mu: ArrayLike,
        cohesion: ArrayLike | None = None,
        dilatancy: ArrayLike | None = None,
        dim: int | None = None,
        area: ArrayLike | None = None,
        points: ArrayLike | None = None,
        frame: ArrayLike | None = None,
    ) -> ContactSet:
        """Check the arguments of a `ContactProblem` that are about its contacts.

        Raises `TypeError` or `ValueError`: an argument is wrong; the message names it.
        """
        gaps = floats("gap", gap)
        if gaps.ndim == 0:
            rows = operator.shape[0]
            if dim is None and points is not None:
                dim = floats("points", points, ndim=2).shape[1]
            d = dim if dim in (2, 3) else _find_dim(rows)
            gaps = np.full(rows // d, float(gaps))
        if gaps.ndim not in (1, 2):
            raise ValueError(f"gap has shape {gaps.shape}, expected (n_c,) or (n_c, d)")
        count = len(gaps)
        d = choice_of_dimension(dim, count, operator.shape[0], gaps)
        return cls(
            operator,
            d,
            gaps,
            ContactLaw.check(count, d, mu=mu, cohesion=cohesion, dilatancy=dilatancy),
            areas(area, count),
            contact_array("points", points, count, d),
            frames(frame, count, d),
        )

    @property
    def count(self) -> int:
        """Number of contacts."""
        return len(self.gap)

    @property
    def shape(self) -> tuple[int, int]:
        """``(n_c, d)``."""
        return self.count, self.d

    @cached_property
    def gap_by_component(self) -> Floats:
        """Gaps at the start, ``(n_c, d)``."""
        return self.gap if self.gap.ndim == 2 else by_component(self.gap, self.d)

    def arrays(self) -> dict[str, AnyArray | None]:
        """Arrays by the names of `Result.contacts`."""
        frame = self.frame
        return {
            "x": self.x,
            "normal": None if frame is None else frame[:, 0, :].copy(),
            "frame": frame,
            "area": self.area,
            "gap": self.gap,
            **self.law.arrays(),
        }

    def tractions(self, reaction: Floats) -> Floats | None:
        """Tractions of reactions ``(n_c, d)``; None without areas."""
        return None if self.area is None else reaction / self.area[:, None]


def _find_dim(rows: int) -> int:
    """``d`` of contacts with a number of rows of B, if only one fits."""
    if (rows % 2 == 0) == (rows % 3 == 0):
        raise ValueError(
            f"gap is one number for all contacts, and B has {count_noun(rows, 'row')}: give "
            "dim=2 or dim=3, or one gap for each contact"
        )
    return 2 if rows % 2 == 0 else 3
