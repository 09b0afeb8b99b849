"""The directional derivative of one step, also at contacts on borders."""

from __future__ import annotations

import numpy as np

from bipot_rs._lib.types import Bools, Floats
from bipot_rs.contact.errors import NotDifferentiableError
from bipot_rs.contact.sensitivity.complementarity import BorderProblem
from bipot_rs.contact.sensitivity.linear import (
    LinearisedStep,
    StepChange,
    make_right_side,
)
from bipot_rs.contact.sensitivity.response import System


def differentiate_step(linear: LinearisedStep, of: StepChange) -> tuple[Floats, Floats]:
    """``dr (n_c, d)`` and ``da`` of a step whose data change.

    Raises `NotDifferentiableError`: there is no directional derivative, or several candidates
    for it.
    Raises `ValueError`: a friction coefficient that is zero decreases.
    """
    point, direction = linear.point, linear.direction
    linear.refuse_borders(linear.borders.any)
    smooth = (point.friction[:, 0] == 0) & (point.reaction[:, 0] > 0)
    smooth &= point.is_coulomb
    if smooth.any():
        direction = _find_friction_direction(linear, smooth, direction, of.friction)
    if linear.borders.any.any():
        return BorderProblem(linear, direction, of).solve()
    system = linear.reported
    if smooth.any():
        # The direction changes the right side alone.
        system = System(linear.laws(point.status, direction), system.core, system.shape)
    return system.solve(make_right_side(system.laws, of), -of.balance)


def _find_friction_direction(
    linear: LinearisedStep, smooth: Bools, direction: Floats, change: Floats
) -> Floats:
    """The direction of the friction that begins at contacts without any."""
    asked = smooth & (change != 0).any(axis=1)
    if not asked.any():
        return direction
    lost = asked & (change < 0).any(axis=1)
    if lost.any():
        raise ValueError(
            f"mu of contact {int(np.argmax(lost))} is zero, and its direction "
            "is negative: friction coefficients cannot be negative, so give zero or a "
            "positive direction there"
        )
    # Friction has no effect where the tangential displacement is prescribed.
    loose = linear.movable[:, 1:].any(axis=1)
    still = asked & loose & ~(linear.point.slip != 0).any(axis=1)
    if still.any():
        raise NotDifferentiableError(
            f"mu of contact {int(np.flatnonzero(still)[0])} is zero and it does not "
            "slip: the direction of friction that begins there is not determined"
        )
    turned = direction.copy()
    pushed = change[asked] * linear.point.slip[asked]
    size = np.linalg.norm(pushed, axis=1)[:, None]
    turned[asked] = np.divide(pushed, size, where=size > 0, out=np.zeros_like(pushed))
    return turned
