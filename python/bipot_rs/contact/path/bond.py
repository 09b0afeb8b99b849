"""What slip and opening leave at the contacts: broken cohesion, and dilation.

A contact that opens loses its cohesion for good, and dilatancy lifts the surfaces: after a
step they meet at the opening ``D``, which has grown by ``beta |slip|`` in each step of a closed
contact (section 9 of ``docs/theory.md``).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from bipot_rs._lib.messages import count_noun, place
from bipot_rs._lib.types import Bools, Floats
from bipot_rs.contact.law.contact_law import ContactLaw
from bipot_rs.contact.path.contacts import ContactSet
from bipot_rs.contact.results.solution import Step, revise

# Rounding of coordinates in mesh files, relative to the extent of the contacts.
_ROUNDING = 1e-9


class Touched(Protocol):
    """What a bond reads of a step: attributes of `Step`."""

    @property
    def relative_displacement(self) -> Floats:
        """``(n_c, d)``."""

    @property
    def slip(self) -> Floats:
        """``(n_c, d - 1)``."""

    @property
    def opened(self) -> Bools | None:
        """``(n_c,)``."""


@dataclass(frozen=True, eq=False)
class Bond:
    """The state of the contacts of a load path beside their slip."""

    law: ContactLaw  # the law of the path, with the cohesion of unbroken contacts
    # (n_c,) or None: contacts that have lost their cohesion; None for a law without.
    broken: Bools | None = None
    # (n_c,) or None: opening at which the surfaces meet; None if dilatancy has never lifted
    # them.
    dilation: Floats | None = None
    rounding: float = 0.0  # openings up to here are rounding of the coordinates
    points: Floats | None = None  # (n_c, d) or None: places of the contacts

    @classmethod
    def begin(cls, contacts: ContactSet, at: Step | None) -> Bond:
        """The bond after a step, or at the start of a path of unloaded bodies."""
        law, x = contacts.law, contacts.x
        extent = 0.0 if x is None or not len(x) else float(np.ptp(x, axis=0).max())
        bond = cls(law, rounding=_ROUNDING * extent, points=x)
        broken, dilation = bond.broken, None if at is None else at.dilation
        if law.cohesion is not None:
            if at is None:
                broken = contacts.gap_by_component[:, 0] > bond.rounding
            elif at.broken is not None:
                broken = at.broken
            else:
                opening = at.relative_displacement[:, 0] - _or_zero(dilation)
                pressed = at.reaction[:, 0] > 0
                broken = ~pressed & (opening > bond.rounding)
        if dilation is None and law.dilatancy is not None:
            dilation = np.zeros(contacts.count)
        return replace(bond, broken=broken, dilation=dilation)

    @property
    def weakened(self) -> ContactLaw:
        """The law with the cohesion that is left."""
        if self.broken is None or not self.broken.any() or self.law.cohesion is None:
            return self.law
        left = np.where(self.broken, 0.0, self.law.cohesion)
        return replace(self.law, cohesion=left if left.any() else None)

    def shift(self, gap: Floats | None, of_problem: Floats) -> Floats | None:
        """Gaps of a step by component, from the surfaces as dilatancy has lifted them."""
        if self.dilation is None or not self.dilation.any():
            return gap
        shifted = (of_problem if gap is None else gap).copy()
        shifted[:, 0] -= self.dilation
        return shifted

    def unshift(self, step: Step) -> Step:
        """A step with its total relative displacement, from one with `shift` gaps."""
        if self.dilation is None or not self.dilation.any():
            return step
        total = step.relative_displacement.copy()
        total[:, 0] += self.dilation
        return revise(step, relative_displacement=total)

    def break_opened(self, step: Touched) -> Bond:
        """The bond after the contacts that opened in a step break, itself if there are none."""
        if self.broken is None or step.opened is None:
            return self
        opening = step.relative_displacement[:, 0] - _or_zero(self.dilation)
        opened = step.opened & (opening > self.rounding)
        if not (opened & ~self.broken).any():
            return self
        return replace(self, broken=self.broken | opened)

    def complete(self, step: Step, before: Bond) -> Step:
        """A step with what broke since ``before``, and with the dilation of its slip."""
        remarks = self._describe_breaking(before)
        dilation, lift = self.lift(step)
        return revise(
            step, broken=self.broken, remarks=remarks, dilation=dilation, lift=lift
        )

    def lift(self, step: Touched) -> tuple[Floats | None, Floats | None]:
        """The dilation after a step, and the part of it from this step."""
        if self.dilation is None or self.law.dilatancy is None or step.opened is None:
            return self.dilation, None
        grown = self.law.dilatancy * np.linalg.norm(step.slip, axis=1)
        lift = np.where(step.opened, 0.0, grown)
        return self.dilation + lift, lift

    def _describe_breaking(self, before: Bond) -> tuple[str, ...]:
        """A sentence about the contacts that broke since ``before``."""
        if self.broken is None or before.broken is None or self.broken is before.broken:
            return ()
        new = np.flatnonzero(self.broken & ~before.broken)
        where = "" if self.points is None else f" at {place(self.points[new[0]])}"
        first = f"contact {new[0]}{where}"
        if len(new) == 1:
            return (f"{first} broke",)
        return (f"{count_noun(len(new), 'contact')} broke, first {first}",)


def _or_zero(values: Floats | None) -> Floats | float:
    return 0.0 if values is None else values
